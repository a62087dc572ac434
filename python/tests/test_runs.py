import json
import math
import sys

import numpy as np
import pytest

import sps
from conftest import ROOT

HEADER = "method,property,rerun,surface,truth,estimate\n"


@pytest.fixture(params=["pandas", "without pandas"])
def pandas(request, monkeypatch):
    """pandas, and then none."""
    if request.param == "pandas":
        return pytest.importorskip("pandas")
    monkeypatch.setitem(sys.modules, "pandas", None)
    return None


def test_scores_of_a_run(pandas):
    path = ROOT / "docs/measured/friction-materials.json"
    kept = json.loads(path.read_text())
    table = sps.read_results(path)
    assert isinstance(table, dict if pandas is None else pandas.DataFrame)
    methods = [method["id"] for method in kept["methods"]]
    assert list(table["method"]) == methods
    assert list(table["property"]) == ["fRS"] * len(methods)
    for place, method in enumerate(kept["methods"]):
        assert table["mae"][place] == method["mae"]["fRS"]
        assert np.isnan(table["r2_low"][place]) == ("fRS" not in method["r2_interval"])


def test_methods_of_a_run(pandas):
    path = ROOT / "docs/measured/friction-materials.json"
    kept = json.loads(path.read_text())["methods"]
    table = sps.read_results(path, rows="methods")
    assert list(table["id"]) == [method["id"] for method in kept]
    assert list(table["held_out_units"]) == [method["held_out_units"] for method in kept]
    for place, method in enumerate(kept):
        expected = method["r2_mean_interval"] or [math.nan, math.nan]
        ends = [table["r2_mean_low"][place], table["r2_mean_high"][place]]
        np.testing.assert_array_equal(ends, expected)


def test_what_has_no_value_is_nan(tmp_path, pandas):
    scores = {"r2": {"fRS": None}, "r2_interval": {"fRS": [0.25, 0.5]}}
    others = ["r2_std", "mae", "rmse", "median_percent_error", "spearman", "zero_truths"]
    method = {"id": "m", **scores, **{key: {} for key in others}}
    results = {"properties": ["fRS"], "methods": [method]}
    (tmp_path / "results.json").write_text(json.dumps(results))
    table = sps.read_results(tmp_path)
    assert np.isnan(table["r2"][0]) and np.isnan(table["mae"][0])
    assert (table["r2_low"][0], table["r2_high"][0]) == (0.25, 0.5)


def test_estimates_of_a_run(tmp_path, pandas):
    lines = 'ridge,fRS,0,NA,0.1,1e-7\nmean,fRS,12,"red, felt",5e-324,61.0\n'
    (tmp_path / "predictions.csv").write_text(HEADER + lines)
    table = sps.read_predictions(tmp_path)
    assert list(table["method"]) == ["ridge", "mean"]
    assert list(table["surface"]) == ["NA", "red, felt"]
    assert list(table["rerun"]) == [0, 12]
    assert list(table["truth"]) == [0.1, 5e-324]
    assert list(table["estimate"]) == [1e-7, 61.0]
    (tmp_path / "predictions.csv").write_text(HEADER)
    empty = sps.read_predictions(tmp_path)
    assert [len(empty[name]) for name in HEADER.strip().split(",")] == [0] * 6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 0: .*'method'"),
        ("method,property\n", "line 1: 'rerun' is not in list"),
        (HEADER + "ridge,fRS,0,oak,0.1,0.2\nridge,fRS,0,oak,much,0.2\n", "line 3: .*'much'"),
        (HEADER + "ridge,fRS,0\n", "line 2: list index out of range"),
    ],
)
def test_what_are_no_predictions(tmp_path, text, message):
    path = tmp_path / "predictions.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"predictions.csv, {message}"):
        sps.read_predictions(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"properties": ["fRS"], "methods": [{}]}'])
def test_what_are_no_results(tmp_path, text):
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(ValueError, match="results.json is no results.json: "):
        sps.read_results(tmp_path)


def test_what_cannot_be_read(tmp_path):
    with pytest.raises(FileNotFoundError, match="results.json"):
        sps.read_results(tmp_path)
    with pytest.raises(FileNotFoundError, match="predictions.csv"):
        sps.read_predictions(tmp_path)
    with pytest.raises(ValueError, match="rows is 'surfaces', expected 'properties' or 'methods'"):
        sps.read_results(tmp_path, rows="surfaces")
