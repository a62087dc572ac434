"""Readers of what a run of `cargo xtask experiment` leaves behind; `docs/results.md` has its keys."""

from __future__ import annotations

import csv
import json
import math
import os
from pathlib import Path
from typing import Any, Union

import numpy as np

_Path = Union[str, "os.PathLike[str]"]
_Row = dict[str, Any]

# What `results.json` has of a method as objects with the property's code as the key.
_PER_PROPERTY = [
    "r2",
    "r2_std",
    "mae",
    "rmse",
    "median_percent_error",
    "spearman",
    "zero_truths",
]
_PREDICTION = {
    "method": str,
    "property": str,
    "rerun": int,
    "surface": str,
    "truth": float,
    "estimate": float,
}


def read_results(path: _Path, rows: str = "properties") -> Any:
    """What a finished run measured, as a table.

    `path` is the run's folder or its `results.json`, whose keys `docs/results.md` explains. `rows` is
    "properties" for a row for each method and property, with the columns method, property, r2, r2_std,
    r2_low and r2_high (the interval over units and reruns), mae, rmse, median_percent_error, spearman and
    zero_truths; or "methods" for a row for each method, with every single number and string of it,
    and r2_mean_low and r2_mean_high. What has no value is NaN.

    A pandas DataFrame where pandas is installed, else a dict of numpy arrays.

    Raises OSError where the file cannot be read, ValueError where it is no `results.json` or `rows` is
    neither.
    """
    kinds = {"properties": _properties, "methods": _methods}
    if rows not in kinds:
        raise ValueError(f"rows is {rows!r}, expected 'properties' or 'methods'")
    file = _in_run(path, "results.json")
    try:
        return _table(kinds[rows](json.loads(file.read_text(encoding="utf-8"))))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        found = f"{type(error).__name__}: {error}"
        raise ValueError(f"{file} is no results.json: {found}") from error


def read_predictions(path: _Path) -> Any:
    """Every held-out estimate of a finished run: a row for each method, property, rerun and surface.

    `path` is the run's folder or its `predictions.csv`. The columns are method, property, rerun,
    surface, truth and estimate, the last two in the property's own unit.

    A pandas DataFrame where pandas is installed, else a dict of numpy arrays.

    Raises OSError where the file cannot be read, ValueError where it is no `predictions.csv`.
    """
    file = _in_run(path, "predictions.csv")
    with file.open(newline="", encoding="utf-8") as lines:
        reader = csv.reader(lines, strict=True)
        try:
            header = next(reader, [])
            places = {name: header.index(name) for name in _PREDICTION}
            rows = [
                {name: kind(line[places[name]]) for name, kind in _PREDICTION.items()}
                for line in reader
            ]
        except (IndexError, ValueError, csv.Error) as error:
            raise ValueError(f"{file}, line {reader.line_num}: {error}") from error
    return _table(rows, list(_PREDICTION))


def _in_run(path: _Path, name: str) -> Path:
    path = Path(path)
    return path / name if path.is_dir() else path


def _properties(results: dict[str, Any]) -> list[_Row]:
    return [
        {"method": method["id"], "property": property}
        | {key: method[key].get(property) for key in _PER_PROPERTY}
        | _ends("r2", method["r2_interval"].get(property))
        for method in results["methods"]
        for property in results["properties"]
    ]


def _methods(results: dict[str, Any]) -> list[_Row]:
    return [
        {key: value for key, value in method.items() if not isinstance(value, (dict, list))}
        | _ends("r2_mean", method["r2_mean_interval"])
        for method in results["methods"]
    ]


def _ends(score: str, interval: list[float] | None) -> _Row:
    low, high = interval or (None, None)
    return {f"{score}_low": low, f"{score}_high": high}


def _table(rows: list[_Row], columns: list[str] | None = None) -> Any:
    """`columns` where there may be no rows; else those of the rows, in the order that they come in."""
    names = columns or list(dict.fromkeys(name for row in rows for name in row))
    table = {name: _column([row.get(name) for row in rows]) for name in names}
    try:
        import pandas
    except ImportError:
        return table
    return pandas.DataFrame(table)


def _column(values: list[Any]) -> np.ndarray[Any, Any]:
    strings = any(isinstance(value, str) for value in values)
    missing = "" if strings else math.nan
    return np.array([missing if value is None else value for value in values])
