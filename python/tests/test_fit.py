import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import sps
from conftest import ROOT
from files import write_png
from test_estimator import felt, stripes

RATED = ROOT / "../shared/data/material-ratings"


@pytest.fixture(scope="module")
def widths():
    return felt(60)


@pytest.fixture(scope="module")
def photographs(widths):
    return [stripes(width, seed) for seed, width in enumerate(widths)]


@pytest.fixture(scope="module")
def fitted(photographs, widths):
    seen = []
    values = np.stack([10 * widths, 100 - widths], axis=1)
    values[3, 1] = np.nan
    fitted = sps.fit(
        photographs,
        values,
        properties=["fRS", "coarse"],
        resize=None,
        progress=lambda *step: seen.append(step),
    )
    assert ("frames encoded", 60, 60) in seen
    return fitted


def test_the_model_comes_with_its_scores(fitted, widths):
    assert fitted.method in ("ridge", "kernel-ridge", "nearest")
    scores = {row["id"]: row["r2_mean"] for row in fitted.run.scores("methods")}
    assert fitted.r2 == max(scores[method] for method in ("ridge", "kernel-ridge", "nearest"))
    assert set(fitted.scores) == {"fRS", "coarse"} and fitted.scores["coarse"]["readings"] == 3 * 59
    truth = felt(40, seed=2)
    answers = fitted.model.predict_all(stripes(width, 1000 + at) for at, width in enumerate(truth))
    assert sps.r2(10 * truth, answers.values[:, 0]) == pytest.approx(fitted.r2, abs=0.2)
    assert sps.coverage(10 * truth, answers.low[:, 0], answers.high[:, 0]) > 0.7
    errors = [error for _, error in fitted.worst]
    assert len(errors) == 3 and errors == sorted(errors, reverse=True)
    assert all(0 <= int(surface) < 60 for surface, _ in fitted.worst)
    for words in ("interval half width", "furthest from what was measured", fitted.method):
        assert words in str(fitted)


def test_settings_are_those_of_a_config(photographs, widths):
    net = {"id": "net", "label": "Network", "kind": "head", "head": {"epochs": 1}}
    settings = {"methods": [net], "floors": ["mean"], "reruns": 1}
    encoder = sps.Encoder("efficientnet-lite-body", "built-in", depths=["stage-3"])
    fitted = sps.fit(photographs, widths, encoder=encoder, resize=None, level=0.6, settings=settings)
    assert (fitted.method, fitted.model.level) == ("net", 0.6)
    assert sps.Encoder("efficientnet-lite-body", "built-in").name in repr(fitted.model)
    with pytest.raises(ValueError, match="did you mean `reruns`"):
        sps.fit(photographs, widths, settings={"rerun": 1})
    with pytest.raises(ValueError, match="found one group, expected at least two"):
        sps.fit(photographs, widths, groups=[0] * 60)


def test_the_page_lies_beside_the_model(photographs, widths, tmp_path):
    out = tmp_path / "models/mine"
    values = [10 * widths[at] for at in range(60)]
    settings = {"reruns": 1}
    fitted = sps.fit(photographs, values, properties=["fRS"], resize=None, settings=settings, out=out)
    page = (out / "report.html").read_text()
    for words in ("Ridge regression", "Nearest neighbour", "data:image/png;base64,"):
        assert words in page
    loaded = sps.Estimator.load(out)
    assert loaded.predict_all(photographs[:5]) == fitted.model.predict_all(photographs[:5])
    assert os.listdir(tmp_path / "models") == ["mine"]


def test_embeddings_give_the_model_that_photographs_give(photographs, widths, tmp_path):
    settings = {"reruns": 1}
    # One depth, one block, as an array has it: several have a kernel each.
    encoder = sps.Encoder("efficientnet-lite-body", "built-in", depths="last")
    seeing = sps.fit(photographs, widths, encoder=encoder, resize=None, settings=settings)
    embedded = encoder.transform(photographs)
    by_array = sps.fit(photographs, widths, embeddings=embedded, settings=settings)
    np.save(tmp_path / "rows.npy", embedded)
    by_file = sps.fit(photographs, widths, embeddings=tmp_path / "rows.npy", settings=settings)
    data = sps.Dataset(photographs, widths)
    of_data = sps.fit(data, embeddings=embedded[:, None], settings=settings)
    expected = seeing.model.predict_all(photographs[:5]).values
    for blind in (by_array, by_file, of_data):
        assert blind.scores == seeing.scores
        found = blind.model.predict_embedded(embedded[:5]).values
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_embeddings_of_a_folder_are_found_by_file(encoder, photographs, widths, tmp_path):
    folder, table = tmp_path / "photographs", tmp_path / "values.csv"
    folder.mkdir()
    lines = ["photograph,fRS"]
    for at in range(20):
        write_png(folder / f"{at:02}.png", photographs[at])
        lines.append(f"{at:02}.png,{widths[at]:.3f}")
    # The table has another order than the folder.
    table.write_text("\n".join([lines[0], *reversed(lines[1:])]) + "\n")
    rows = encoder.transform(folder)
    settings = {"reruns": 1}
    fitted = sps.fit(folder, table, embeddings=rows, settings=settings)
    seeing = sps.fit(sps.Dataset(folder, table), embeddings=rows[::-1], settings=settings)
    assert fitted.scores == seeing.scores
    with pytest.raises(ValueError, match="found 19 rows without `files`, expected 20"):
        sps.fit(folder, table, embeddings=rows[1:])


def test_embeddings_that_do_not_fit_are_refused(encoder, photographs, widths, tmp_path):
    rows = np.float32(np.random.default_rng(0).normal(size=(60, 4)))
    with pytest.raises(ValueError, match="encoder: expected none beside embeddings"):
        sps.fit(photographs, widths, embeddings=rows, encoder=encoder)
    with pytest.raises(ValueError, match=r"shape \[60\], expected \(surfaces, width\)"):
        sps.fit(photographs, widths, embeddings=rows[:, 0])
    with pytest.raises(ValueError, match="59, expected 60, one for each photograph"):
        sps.fit(photographs, widths, embeddings=rows[1:])
    rows[3, 1] = np.nan
    with pytest.raises(ValueError, match="finite numbers"):
        sps.fit(photographs, widths, embeddings=rows)
    with pytest.raises(FileNotFoundError, match="none.npy"):
        sps.fit(photographs, widths, embeddings=tmp_path / "none.npy")
    rows[3, 1] = 0
    model = sps.fit(photographs, widths, embeddings=rows, settings={"reruns": 1}).model
    with pytest.raises(ValueError, match="found rows of 3, expected 4"):
        model.predict_embedded(rows[:, :3])
    with pytest.raises(ValueError, match="their embeddings"):
        model.predict(photographs[0])


def test_groups_and_materials_are_kept(photographs, widths):
    groups = [f"sheet {at // 2}" for at in range(60)]
    materials = ["felt" if at < 30 else "oak" for at in range(60)]
    data = sps.Dataset(photographs, widths, properties=["fRS"], groups=groups, materials=materials)
    assert len(data) == 60 and data.surfaces[:2] == ["0", "1"]
    assert data.materials == materials and len(set(data.groups)) == 30
    assert data.groups[0] == data.groups[1] != data.groups[2]
    np.testing.assert_allclose(data.values[:, 0], widths, rtol=1e-15)
    assert (data.properties, data.angles) == (["fRS"], [0.0])
    fitted = sps.fit(data, resize=None, level=0.6, settings={"reruns": 1})
    assert fitted.scores["fRS"]["unit-coverage"] is not None
    with pytest.raises(ValueError, match="groups: found those of 2 surfaces, expected 60"):
        sps.Dataset(photographs, widths, groups=[0, 1])


def test_a_dataset_is_a_folder_or_photographs(encoder, photographs, widths, tmp_path):
    tiny = sps.Dataset(ROOT / "fixtures/tiny-dataset")
    assert len(tiny) == 6 and "denim-01" in tiny.surfaces and tiny.values.shape[0] == 6
    assert len(tiny.photographs) == 6 and len(tiny.photographs[0]) == len(tiny.angles)
    floats = np.float32(np.stack([photographs[0], photographs[1]]) / 255)
    write_png(tmp_path / "a.png", photographs[0])
    for first in (photographs[0], tmp_path / "a.png", floats[0]):
        data = sps.Dataset([[first, photographs[2]], [floats[1], photographs[3]]], [1.0, np.nan])
        assert data.angles == [0.0, 45.0] and np.isnan(data.values[1, 0])
        found = encoder.transform(path for views in data.photographs for path in views)
        expected = encoder.transform([photographs[at] for at in (0, 2, 1, 3)])
        np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())
    with pytest.raises(ValueError, match="found 1 of surface 1, expected 2 as of the first"):
        sps.Dataset([photographs[:2], photographs[2]], [1.0, 2.0])
    with pytest.raises(FileNotFoundError, match="none.png"):
        sps.Dataset([tmp_path / "none.png"], [1.0])
    with pytest.raises(ValueError, match="not a dataset"):
        sps.Dataset(tmp_path)
    shutil.copy(tiny.folder / "dataset.toml", tmp_path)
    with pytest.raises(FileNotFoundError, match="surfaces.csv: cannot be read"):
        sps.Dataset(tmp_path)
    with pytest.raises(ValueError, match="expected none beside a dataset or a table"):
        sps.fit(tiny, groups=[0] * 6)


def test_the_program_and_the_function_say_the_same(photographs, widths, tmp_path):
    program = os.environ.get("SPS") or shutil.which("sps", path=os.path.join(sys.prefix, "bin"))
    if program is None:
        pytest.skip("no program `sps` is installed beside this Python")
    lines = ["photograph,fRS"]
    (tmp_path / "photographs").mkdir()
    for at, (photograph, width) in enumerate(zip(photographs, widths)):
        write_png(tmp_path / f"photographs/{at:02}.png", photograph)
        lines.append(f"{at:02}.png,{width:.3f}")
    (tmp_path / "values.csv").write_text("\n".join(lines) + "\n")
    command = [program, "fit", "photographs", "--values", "values.csv", "--out", "model"]
    printed = subprocess.run(
        [*command, "--pixels", "40"], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout
    fitted = sps.fit(tmp_path / "photographs", tmp_path / "values.csv", resize=40)
    assert fitted.method in printed and "interval half width" in printed
    model = sps.Estimator.load(tmp_path / "model")
    assert model.predict_all(photographs[:5]) == fitted.model.predict_all(photographs[:5])
    assert model.about["measured"] == fitted.scores
    failed = subprocess.run([program, "predict", "none", "a.png"], capture_output=True, text=True)
    assert failed.returncode == 1 and failed.stderr.startswith("error: ")


@pytest.mark.skipif(not RATED.is_dir(), reason="there are no rated materials")
def test_rated_materials_have_the_r2_of_the_experiment():
    measured = sps.Run(ROOT / "docs/measured/material-ratings.json").results["methods"]
    expected = {method["id"]: method["r2_mean"] for method in measured}
    fitted = sps.fit(sps.Dataset(RATED))
    assert fitted.method == "kernel-ridge"
    assert fitted.r2 == pytest.approx(expected["kernel-ridge-2"], abs=0.005)
