import json
import os
import pickle
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import sps
from conftest import ROOT
from files import write_png

SIDE = 40


def stripes(width, seed, size=(SIDE, SIDE)):
    """A photograph of stripes that are `width` pixels wide, and somewhat noisy."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    values = 0.5 + 0.4 * np.sin((x + 0.3 * y) / width + rng.uniform(0, 6))
    values = values[..., None] + rng.normal(0, 0.05, (*size, 3))
    return (np.clip(values, 0, 1) * 255).astype(np.uint8)


def felt(count, seed=0):
    return np.random.default_rng(seed).uniform(1, 8, count)


@pytest.fixture(scope="module")
def widths():
    return felt(60)


@pytest.fixture(scope="module")
def photographs(widths):
    return [stripes(width, seed) for seed, width in enumerate(widths)]


@pytest.fixture(scope="module")
def model(encoder, photographs, widths):
    values = np.stack([10 * widths, 100 - widths], axis=1)
    values[3, 1] = np.nan
    return sps.Estimator.fit(
        photographs, values, encoder=encoder, properties=["fRS", "coarse"], name="stripes"
    )


@pytest.fixture(scope="module")
def looking(encoder):
    widths = felt(60, 1)
    views = [[stripes(width, 100 * s + v) for v in range(3)] for s, width in enumerate(widths)]
    angles = [0.0, 20.0, -20.0]
    return sps.Estimator.fit(
        views, widths, encoder=encoder, angles=angles, one_by_one=True, level=0.8
    )


def test_what_it_is(model):
    assert model.properties == ["fRS", "coarse"]
    assert (model.level, model.angles, model.no_interval) == (0.9, [0.0], {})
    assert model.no_familiar is None
    about = model.about
    assert (about["name"], about["frame-size"]) == ("stripes", [SIDE, SIDE])
    assert repr(model).startswith('Estimator(name="stripes", encoder="efficientnet-lite-body"')
    first, second = model.predict(stripes(3, 1)).estimates
    assert (first.property, first.name) == ("fRS", "sliding resistance")
    assert (second.property, second.name) == ("coarse", "coarse")
    assert repr(first).startswith('Estimate(property="fRS", name="sliding resistance", value=')


@pytest.mark.parametrize("regression", ["ridge", "kernel-ridge"])
def test_new_surfaces_are_estimated_and_covered(encoder, photographs, widths, regression):
    model = sps.Estimator.fit(photographs, widths, encoder=encoder, regression=regression)
    truth = felt(60, seed=2)
    answers = model.predict_all(stripes(width, 1000 + at) for at, width in enumerate(truth))
    assert {answer.estimates[0].property for answer in answers} == {"value"}
    assert sps.r2(truth, answers.values[:, 0]) > 0.5
    # 54 of 60 are promised on average; a binomial holds fewer than 46 once in a thousand times.
    held = sps.coverage(truth, answers.low[:, 0], answers.high[:, 0], details=True)
    assert held.covered >= 46
    # p-values of the like are spread evenly, or lie higher.
    assert (answers.familiar <= 0.05).sum() <= 10
    noise = np.random.default_rng(0).integers(0, 256, (SIDE, SIDE, 3), dtype=np.uint8)
    assert model.predict(noise).familiar <= 0.05


def test_the_same_is_fitted_again(model, encoder, photographs, widths, tmp_path):
    values = np.stack([10 * widths, 100 - widths], axis=1)
    values[3, 1] = np.nan
    files = [tmp_path / f"{at:02}.png" for at in range(len(photographs))]
    for path, photograph in zip(files, photographs):
        write_png(path, photograph)
    again = sps.Estimator.fit(files, values, encoder=encoder, properties=["fRS", "coarse"])
    assert again.predict(photographs[7]) == model.predict(photographs[7])
    other = sps.Estimator.fit(files, values, encoder=encoder, properties=["a", "b"], seed=1)
    found, before = (m.predict(photographs[7]).estimates[0].low for m in (other, model))
    assert found != before


def test_it_comes_back_from_its_folder_the_same(model, photographs, tmp_path):
    model.save(tmp_path / "a" / "b")
    loaded = sps.Estimator.load(str(tmp_path / "a" / "b"))
    assert loaded.predict_all(photographs) == model.predict_all(photographs)
    assert (loaded.properties, loaded.about) == (model.properties, model.about)
    loaded.save(tmp_path / "c")
    for path in (tmp_path / "c").iterdir():
        assert path.read_bytes() == (tmp_path / "a" / "b" / path.name).read_bytes()
    weights = tmp_path / "c" / "encoder.safetensors"
    data = bytearray(weights.read_bytes())
    data[-1] ^= 1
    weights.write_bytes(data)
    with pytest.raises(ValueError, match="encoder.safetensors: "):
        sps.Estimator.load(tmp_path / "c")
    with pytest.raises(FileNotFoundError, match="estimator.json"):
        sps.Estimator.load(tmp_path / "none")


def test_several_surfaces_and_several_photographs(model, photographs):
    one, other = photographs[:2]
    together = model.predict_all([one, [one, other], np.stack([other])])
    assert list(together) == [model.predict(what) for what in (one, [one, other], other)]
    first, both, second = together
    for at in range(2):
        each = [answer.estimates[at].value for answer in (first, second)]
        assert both.estimates[at].value == np.mean(each)
        # 18 surfaces calibrate, and 90 % for the mean of two needs 19.
        assert (both.estimates[at].low, both.estimates[at].high) == (None, None)
    assert set(both.no_interval) == {"fRS", "coarse"}
    assert "found 2 photographs" in both.no_interval["fRS"]
    assert first.no_interval == {}
    assert both.familiar == min(1, 2 * min(first.familiar, second.familiar))
    assert model.predict_all([]).values.shape == (0, 2)


def test_answers_are_arrays(model, photographs):
    answers = model.predict_all([photographs[0], photographs[:2]])
    for of in ("values", "low", "high"):
        name = of.rstrip("s")
        each = [[getattr(one, name) for one in answer.estimates] for answer in answers]
        np.testing.assert_array_equal(getattr(answers, of), np.array(each, float))
        np.testing.assert_array_equal(getattr(answers[0], of), each[0])
    assert np.isnan(answers[1].low).all() and answers.low.shape == (2, 2)
    np.testing.assert_array_equal(answers.familiar, [answer.familiar for answer in answers])
    with pytest.raises(IndexError):
        answers[2]


def test_a_pickled_model_says_the_same(model, photographs, tmp_path):
    model.save(tmp_path)
    for one in (model, sps.Estimator.load(tmp_path, joint=True)):
        copy = pickle.loads(pickle.dumps(one))
        assert copy.predict_all(photographs[:4]) == one.predict_all(photographs[:4])
        assert copy.about == one.about


@pytest.mark.parametrize(
    ("regression", "same"),
    [
        ({"kind": "ridge", "ridge": {"penalties": [1.0]}}, False),
        ({"kind": "kernel-ridge", "kernel-ridge": {"at-most": 10}}, False),
        ({"kind": "head", "head": {"epochs": 2}}, False),
        ({"kind": "head", "head": {"epochs": 1, "model": {"kind": "cross-modal"}}}, False),
        ({"kind": "stacked", "members": ["ridge", "nearest"], "folds": 3}, False),
        ({"kind": "nearest"}, True),
    ],
)
def test_regressions_have_the_settings_of_a_config(encoder, photographs, widths, regression, same):
    def fit(regression):
        model = sps.Estimator.fit(photographs, widths, encoder=encoder, regression=regression)
        return model.predict(photographs[0])

    usual = {"kind": regression["kind"]} if regression["kind"] != "stacked" else "ridge"
    assert (fit(regression) == fit(usual)) == same
    assert fit(regression) == fit(regression)


def test_the_interval_of_two_photographs_holds_at_the_level(encoder, photographs, widths):
    model = sps.Estimator.fit(photographs, widths, encoder=encoder, level=0.8)
    one, two = photographs[:2]
    each = [model.predict(photograph).estimates[0] for photograph in (one, two)]
    both = model.predict([one, two])
    assert both.no_interval == {}
    # Of 18 residuals the 16th for one photograph, the 18th for each of two.
    assert both.estimates[0].high - both.estimates[0].low >= np.mean([e.high - e.low for e in each])


def test_a_folder_is_its_photographs_by_name(model, looking, photographs, tmp_path):
    for name, photograph in zip(["b.png", "a.png", "c.png"], photographs):
        write_png(tmp_path / name, photograph)
    (tmp_path / "notes.txt").write_text("no photograph")
    by_name = [photographs[at] for at in (1, 0, 2)]
    for folder in (tmp_path, str(tmp_path)):
        assert model.predict(folder) == model.predict(by_name)
        assert looking.predict(folder) == looking.predict(by_name)
    assert model.predict_all([tmp_path, photographs[0]])[0] == model.predict(by_name)
    (tmp_path / "above" / "oak").mkdir(parents=True)
    with pytest.raises(ValueError, match="above: found no photograph, .* it holds folders"):
        model.predict(tmp_path / "above")


def test_all_surfaces_are_fitted_to_where_none_calibrates(encoder, photographs, widths):
    model = sps.Estimator.fit(photographs, widths, encoder=encoder, calibration=None)
    assert "kept aside" in model.no_interval["value"]
    one = model.predict(photographs[0]).estimates[0]
    assert (one.low, one.high) == (None, None)
    # Each reading moves what is said of its photograph: none is left out.
    for at in (0, 17, 28, 43, 59):
        other = widths.copy()
        other[at] += 5
        moved = sps.Estimator.fit(photographs, other, encoder=encoder, calibration=None)
        before, after = (m.predict(photographs[at]).estimates[0].value for m in (model, moved))
        assert after != before


def test_photographs_come_to_the_models_size(model, encoder, photographs, widths, tmp_path):
    large = np.repeat(np.repeat(photographs[0], 3, axis=0), 3, axis=1)
    assert model.predict(large) == model.predict(large, scale=SIDE)
    assert model.predict(large) != model.predict(large, scale="keep")
    assert model.predict(photographs[0], scale="keep") == model.predict(photographs[0])
    write_png(tmp_path / "large.png", large)
    assert model.predict(tmp_path / "large.png") == model.predict(large)
    with pytest.raises(ValueError, match='scale: found .small., expected "model", "keep" or a'):
        model.predict(large, scale="small")
    with pytest.raises(ValueError, match="scale: found 0, expected"):
        model.predict(large, scale=0)
    own = sps.Estimator.fit(photographs, widths, encoder=encoder, resize=32)
    assert own.about["frame-size"] == [SIDE, SIDE]
    # Of 96 pixels, as it is seen; windows of 32, 4 apart.
    assert own.map(large)["values"].shape == (1, 17, 17)
    with pytest.raises(ValueError, match="brings the shorter side of every photograph to 32"):
        own.predict(large, scale="keep")


def test_groups_stay_whole(encoder, photographs, widths):
    def fit(groups):
        return sps.Estimator.fit(photographs, widths, encoder=encoder, groups=groups)

    of_seven = [at % 7 for at in range(60)]
    few = fit(of_seven)
    assert "2 calibration group(s)" in few.no_interval["value"]
    estimate = few.predict(photographs[0]).estimates[0]
    assert estimate.low is None and estimate.high is None
    assert repr(estimate).endswith("low=None, high=None)")
    with pytest.raises(ValueError, match="value: found no interval: .*, expected an interval"):
        few.session(1.0)
    # What they are called does not matter.
    for same in [[(group, "x") for group in of_seven], map(str, of_seven)]:
        assert fit(same).predict(photographs[0]) == few.predict(photographs[0])
    alone = sps.Estimator.fit(photographs, widths, encoder=encoder)
    assert fit(range(60)).predict(photographs[0]) == alone.predict(photographs[0])
    with pytest.raises(ValueError, match="groups: found 2, expected one for each of 60 surfaces"):
        fit([0, 1])
    with pytest.raises(TypeError, match="unhashable"):
        fit([[]] * 60)


def test_a_session_ends_when_it_is_narrow_enough(looking):
    assert looking.angles == [0.0, 20.0, -20.0]
    views = [stripes(4, 7000 + view) for view in range(3)]
    session = looking.session(1000)
    assert session.next_angle == 0.0
    looked = session.look(views[0])
    assert (looked.views, looked.narrow, looked.next_angle) == (1, [True], None)
    assert looked.answer == looking.predict(views[:1])
    assert "Looked(views=1, answer=Answer(" in repr(looked)
    with pytest.raises(ValueError, match="photographs: found one more after 1, expected none"):
        session.look(views[1])

    session, angles = looking.session(1e-6), []
    for count, view in enumerate(views, 1):
        angles.append(session.next_angle)
        looked = session.look(view)
        assert (looked.views, looked.narrow) == (count, [False])
        assert looked.answer == looking.predict(views[:count])
    assert (angles, session.next_angle) == (looking.angles, None)
    with pytest.raises(ValueError, match="width: found -1, expected standard deviations"):
        looking.session(-1)


def test_a_map_lies_on_a_grid(model):
    photograph = stripes(3, 5, size=(72, 88))
    found = model.map(photograph)
    shapes = {name: array.shape for name, array in found.items()}
    stride = SIDE // 8
    rows, columns = (72 - SIDE) // stride + 1, (88 - SIDE) // stride + 1
    each = (2, rows, columns)
    places = {"familiar": (rows, columns), "centres": (rows, columns, 2)}
    assert shapes == {"values": each, "low": each, "high": each, **places}
    assert all(array.dtype == np.float64 for array in found.values())
    assert (found["low"] <= found["values"]).all() and (found["values"] <= found["high"]).all()
    steps = np.diff(found["centres"][..., 0], axis=0), np.diff(found["centres"][..., 1], axis=1)
    assert all((step == stride).all() for step in steps)
    # A single window is a photograph.
    alone = model.map(stripes(3, 5))
    estimates = model.predict(stripes(3, 5)).estimates
    np.testing.assert_allclose(alone["values"].ravel(), [e.value for e in estimates], rtol=1e-4)
    with pytest.raises(ValueError, match="window"):
        model.map(stripes(3, 5, size=(30, 88)))
    with pytest.raises(ValueError, match="stride"):
        model.map(photograph, 0)


def test_eight_threads_at_once(model, photographs):
    alone = model.predict_all(photographs[:8])
    at_once = threading.Barrier(8)

    def predict(photograph):
        at_once.wait()
        return [model.predict(photograph) for _ in range(5)]

    with ThreadPoolExecutor(8) as threads:
        for expected, found in zip(alone, threads.map(predict, photographs[:8])):
            assert all(one == expected for one in found)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"values": np.zeros((60, 2, 2))}, ValueError, r"values of shape \[60, 2, 2\], expected"),
        ({"values": np.zeros((60, 2))}, ValueError, 'found \\["value"\\], expected a name for each'),
        ({"values": np.full(60, np.inf)}, ValueError, "inf for value of surface 0"),
        ({"values": np.zeros(59)}, ValueError, "found those of 60 surfaces, expected 59"),
        ({"regression": "forest"}, ValueError, "methods.0.kind.*`forest`"),
        ({"regression": {"kind": "head", "head": {"epoch": 1}}}, ValueError, "mean `epochs`"),
        ({"regression": {"kind": "ridge", "views": 3}}, ValueError, "found `views`, expected kind"),
        ({"regression": "mean"}, ValueError, "expected one that looks at photographs"),
        ({"level": 1.0}, ValueError, "1"),
        ({"calibration": 0.0}, ValueError, "0"),
        ({"resize": 0}, ValueError, "resize: found 0, expected at least a pixel"),
        ({"angles": [1.0, 2.0]}, ValueError, r"angles: found \[1.0, 2.0\], expected one for each"),
        ({"photographs": []}, ValueError, "photographs: found none, expected one or several"),
        ({"photographs": [[]] * 60}, ValueError, "photographs: found none, expected one or sev"),
        ({"photographs": "a.png"}, TypeError, "photographs: found one photograph, expected"),
        ({"photographs": ["none.png"]}, FileNotFoundError, "none.png: cannot be read"),
        ({"photographs": [[stripes(1, 1)], [None]]}, TypeError, "surface 1: image 0 is a NoneT"),
        (
            {"photographs": [[stripes(1, 1)] * 2, stripes(1, 1)]},
            ValueError,
            "photographs: found 1 of surface 1, expected 2 as of the first",
        ),
    ],
)
def test_what_cannot_be_fitted(encoder, photographs, widths, change, error, message):
    arguments = {"photographs": photographs, "values": widths, "encoder": encoder, **change}
    with pytest.raises(error, match=message):
        sps.Estimator.fit(**arguments)


def test_what_cannot_be_asked(model, looking, photographs):
    with pytest.raises(ValueError, match="photographs: found none, expected at least one"):
        model.predict([])
    with pytest.raises(ValueError, match="surface 1: photographs: found none"):
        model.predict_all([photographs[0], []])
    wanted = "found 4, expected 1, 2 or 3, at 0, 20 and -20 degrees"
    with pytest.raises(ValueError, match=f"photographs of a surface: {wanted}"):
        looking.predict(photographs[:4])
    with pytest.raises(ValueError, match="found one of 3 views, expected one that looks at a sin"):
        looking.map(photographs[0])
    with pytest.raises(FileNotFoundError, match="none.png"):
        model.predict("none.png")
    with pytest.raises(TypeError, match="image 1 is a int, expected|image 1 is a builtins.int"):
        model.predict([photographs[0], 7])


@pytest.mark.skipif("XTASK" not in os.environ, reason="XTASK names no binary of the command line")
def test_the_command_line_says_the_same(tmp_path):
    def xtask(*arguments):
        command = [os.environ["XTASK"], *arguments]
        return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout

    folder = tmp_path / "model"
    # Several views one after the other in none of them: a model of one photograph.
    xtask("fit", "--config", "configs/smoke.toml", "--set", "data.simulated.views=1", "--out", folder)
    images = sorted((ROOT / "fixtures/tiny-dataset/frames").glob("*/00[12].*"))
    lines = xtask("predict", folder, "--json", *images).splitlines()
    model = sps.Estimator.load(folder)
    answers = model.predict_all(images)
    assert len(lines) == len(answers) == 12
    for line, answer in zip(map(json.loads, lines), answers):
        assert line["familiar"] == answer.familiar
        assert len(line["estimates"]) == len(answer.estimates)
        for said, estimate in zip(line["estimates"], answer.estimates):
            assert said == {name: getattr(estimate, name) for name in said}


def test_joint_intervals_are_wider(model, tmp_path):
    model.save(tmp_path)
    joint = sps.Estimator.load(tmp_path, joint=True)
    photograph = stripes(4, 9000)
    both = zip(model.predict(photograph).estimates, joint.predict(photograph).estimates)
    widths = [(alone.high - alone.low, wide.high - wide.low) for alone, wide in both]
    assert all(wide >= alone for alone, wide in widths) and widths[0] != widths[1]
    several = joint.predict([photograph, photograph])
    assert "found 2 photographs, expected one" in several.no_interval["fRS"]


def test_the_built_in_encoder_needs_no_name(encoder, photographs, widths):
    named = sps.Estimator.fit(photographs, widths, encoder=encoder)
    alone = sps.Estimator.fit(photographs, widths)
    assert alone.predict(photographs[0]) == named.predict(photographs[0])
