import csv
import json
import shutil

import numpy as np
import pytest

import sps
from conftest import ROOT


def test_scores_of_a_run():
    path = ROOT / "docs/measured/friction-materials.json"
    kept = json.loads(path.read_text())
    run = sps.Run(path)
    assert [method["id"] for method in run.results["methods"]] == [m["id"] for m in kept["methods"]]
    table = run.scores()
    assert [row["property"] for row in table] == ["fRS"] * len(kept["methods"])
    for row, method in zip(table, kept["methods"]):
        assert (row["method"], row["mae"]) == (method["id"], method["mae"]["fRS"])
        assert row.get("r2_interval") == method["r2_interval"].get("fRS")
    for row, method in zip(run.scores("methods"), kept["methods"]):
        assert row["held_out_units"] == method["held_out_units"]
        assert row["r2_mean_interval"] == method["r2_mean_interval"]
    with pytest.raises(ValueError, match='rows: found "surfaces", expected "properties" or "methods"'):
        run.scores("surfaces")


METHODS = [
    {"id": "ridge", "label": "Ridge", "kind": "ridge"},
    {"id": "mean", "label": "Mean", "kind": "mean"},
]
CONFIG = {"reruns": 2, "floors": [], "methods": METHODS, "properties": ["fRS", "cDF"]}


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    seen = []
    folder = tmp_path_factory.mktemp("data") / "simulated"
    settings = {"surfaces": 40, "views": 1, "size": 32, "seed": 3}
    data = sps.simulate(folder, **settings, progress=lambda *step: seen.append(step))
    assert max(seen) == ("surfaces", 40, 40)
    return data


def test_an_experiment_from_config_to_comparison(simulated, tmp_path):
    settings = {"cache.folder": str(tmp_path / "cache")}
    runs = [
        sps.experiment(CONFIG, tmp_path / name, settings=settings | more, dataset=simulated)
        for name, more in [("one", {}), ("two", {"ridge.penalties": [1e3]})]
    ]
    assert (tmp_path / "one/report.html").is_file()
    assert "ridge" in str(runs[0])
    kept = json.loads((tmp_path / "one/results.json").read_text())
    assert runs[0].results == kept
    table = runs[0].predictions()
    rows = list(csv.DictReader((tmp_path / "one/predictions.csv").open()))
    assert [str(row["surface"]) for row in table] == [row["surface"] for row in rows]
    # What scikit-learn makes of the estimates of each rerun.
    metrics = pytest.importorskip("sklearn.metrics")
    of = [row for row in rows if (row["method"], row["property"]) == ("ridge", "fRS")]
    errors = []
    for rerun in "01":
        pairs = [(row["truth"], row["estimate"]) for row in of if row["rerun"] == rerun]
        errors.append(metrics.mean_absolute_error(*np.array(pairs, float).T))
    (mae,) = [
        row["mae"]
        for row in runs[0].scores()
        if (row["method"], row["property"]) == ("ridge", "fRS")
    ]
    assert mae == pytest.approx(np.mean(errors), rel=1e-12)

    (same,) = sps.compare(runs[0], tmp_path / "one")
    assert same.past(0.0) == [] and {row["difference"] for row in same.scores} <= {0.0, None}
    (moved,) = sps.compare(*runs)
    for row in (row for row in moved.scores if row["method"] == "ridge"):
        assert row["difference"] == pytest.approx(row["second"] - row["first"])
    assert "penalties" in str(moved)


def test_what_progress_raises_ends_the_work(simulated, tmp_path):
    def stop(what, done, total):
        raise KeyError(what)

    with pytest.raises(KeyError, match="frames encoded"):
        settings = {"cache.folder": str(tmp_path / "cache")}
        sps.experiment(CONFIG, tmp_path / "run", settings=settings, dataset=simulated, progress=stop)
    assert not (tmp_path / "run/results.json").exists()


def test_what_cannot_be_run(simulated, tmp_path):
    def run(config, **settings):
        sps.experiment(config, tmp_path / "run", dataset=simulated, **settings)

    with pytest.raises(ValueError, match="`rerun`.*did you mean `reruns`"):
        run(CONFIG | {"rerun": 1})
    with pytest.raises(ValueError, match="--set rerun.*did you mean `reruns`"):
        run(CONFIG, settings={"rerun": 1})
    with pytest.raises(FileNotFoundError, match="none.toml"):
        run(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="have no method in common|is not the folder of a run"):
        sps.compare(tmp_path, tmp_path)


def test_what_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match="file/.*: cannot be written"):
        sps.simulate(tmp_path / "file", surfaces=2, views=1, size=32)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"properties": ["fRS"], "methods": [{}]}'])
def test_what_are_no_results(tmp_path, text):
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(ValueError, match="results.json is damaged: "):
        sps.Run(tmp_path)


def test_what_cannot_be_read(tmp_path):
    with pytest.raises(FileNotFoundError, match="results.json"):
        sps.Run(tmp_path)
    with pytest.raises(FileNotFoundError, match="predictions.csv"):
        shutil.copy(ROOT / "docs/measured/friction-materials.json", tmp_path / "results.json")
        sps.Run(tmp_path).predictions()
