"""What stands around the code: the example of the README, the types, other packages."""

import importlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sps
from conftest import ROOT


@pytest.fixture
def folder(encoder, tmp_path, monkeypatch):
    """A folder to work in, where examples find what they read."""
    frames = sorted((ROOT / "fixtures/tiny-dataset/frames").glob("*/*.*"))
    model = sps.Estimator.fit(frames, np.arange(len(frames)), encoder=encoder, level=0.5)
    model.save(tmp_path / "models/smoke")
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    monkeypatch.chdir(tmp_path)


def examples(readme):
    return re.findall(r"```python\n(.*?)```", (ROOT / readme).read_text(), re.DOTALL)


def run(readme, example):
    exec(compile(example, readme, "exec"), {})


@pytest.mark.parametrize(
    ("readme", "said"),
    [("python/README.md", ["R²", "(1, 1, 1)", "Selection("]), ("README.md", ["value ", "familiarity p ="])],
)
def test_the_readmes_examples_run(readme, said, folder, capsys):
    for example in examples(readme):
        if "sklearn" not in example:
            run(readme, example)
    out = capsys.readouterr().out
    assert all(words in out for words in said), out


def test_the_readmes_example_of_scikit_learn_runs(folder, capsys):
    pytest.importorskip("sklearn", minversion="1.6")
    readme = "python/README.md"
    (example,) = [example for example in examples(readme) if "sklearn" in example]
    run(readme, example)
    out = capsys.readouterr().out
    assert out.startswith("{'regression': '") and "[[" in out, out


def test_the_notebook_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((ROOT / "python/examples/photographs-to-map.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    state = {}
    for cell in cells:
        assert cell["outputs"] == []
        try:
            exec("".join(cell["source"]), state)
        except ModuleNotFoundError as error:
            assert (error.name, cell) == ("matplotlib", cells[-1])
    assert "R²" in capsys.readouterr().out
    assert state["found"]["values"].shape == (3, 13, 13)


def test_scikit_learn_is_asked_for_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.base", None)
    monkeypatch.delitem(sys.modules, "sps.sklearn", raising=False)
    with pytest.raises(ImportError, match="needs scikit-learn 1.6 or later: pip install scikit-"):
        importlib.import_module("sps.sklearn")
    code = "import sps, sys; sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_everything_exported_is_documented():
    for name in sps.__all__:
        assert getattr(sps, name).__doc__, name
    kinds = [sps.Dataset, sps.Fitted, sps.Run, sps.Comparison, sps.Encoder, sps.Selection]
    kinds += [sps.ScoreInterval, sps.Coverage, sps.Estimator, sps.Estimate, sps.Answer, sps.Answers]
    for kind in [*kinds, sps.Session, sps.Looked]:
        members = [name for name in vars(kind) if not name.startswith("_")]
        assert members and all(getattr(kind, name).__doc__ for name in members), kind


@pytest.mark.parametrize(
    "check",
    [
        ["mypy", "--package=sps", "--config-file"],
        # The one whose types stand in a file of their own.
        ["mypy.stubtest", "sps._sps", "--mypy-config-file"],
    ],
)
def test_the_types_hold(check, tmp_path):
    pytest.importorskip("mypy")
    # Where it stands alone: beside others, mypy takes their names for its own.
    (tmp_path / "sps").symlink_to(Path(sps.__file__).parent)
    command = [sys.executable, "-m", *check, ROOT / "python/pyproject.toml"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr


def test_embeddings_go_into_a_pipeline_of_scikit_learn(encoder):
    pipeline = pytest.importorskip("sklearn.pipeline")
    from sklearn.linear_model import Ridge
    from sklearn.preprocessing import FunctionTransformer

    images = np.random.default_rng(0).integers(0, 256, (6, 12, 12, 3), dtype=np.uint8)
    brightness = images.mean(axis=(1, 2, 3))
    model = pipeline.make_pipeline(FunctionTransformer(encoder.transform), Ridge(1e-3))
    estimates = model.fit(images, brightness).predict(images)
    assert sps.r2(brightness, estimates) > 0.99
