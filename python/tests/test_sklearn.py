import pickle

import numpy as np
import pytest

import sps
from files import write_png
from test_estimator import felt, stripes

pytest.importorskip("sklearn", minversion="1.6")

from sklearn import config_context
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.metrics import r2_score
from sklearn.model_selection import GridSearchCV, GroupKFold, KFold
from sklearn.model_selection import cross_val_predict, cross_val_score, cross_validate
from sklearn.utils.estimator_checks import parametrize_with_checks
from sklearn.utils.validation import check_is_fitted, validate_data

from sps.sklearn import TactileRegressor

SIDE = 24


class OfNumbers(TactileRegressor):
    """Draws a photograph of each row of numbers, for the checks of scikit-learn know no photographs."""

    def fit(self, X, y, groups=None):
        return super().fit(drawn(validate_data(self, X)), y, groups)

    def _answers(self, X):
        check_is_fitted(self)
        return super()._answers(drawn(validate_data(self, X, reset=False)))

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = True
        tags.input_tags.string = False
        return tags


def drawn(rows):
    """A grating for each number, of its own period and direction and as strong, (n, 12, 12 * features, 3)."""
    strengths = 1 / (1 + np.exp(-rows))
    y, x = np.mgrid[:12, :12]
    gratings = []
    for at in range(rows.shape[1]):
        turn = np.pi * at / rows.shape[1]
        phase = 2 * np.pi * (np.cos(turn) * x + np.sin(turn) * y) / (3 + at)
        gratings.append(strengths[:, at, None, None] * (0.5 + 0.5 * np.sin(phase)))
    return np.tile(np.uint8(255 * np.concatenate(gratings, axis=2))[..., None], (1, 1, 1, 3))


def not_as_expected(_):
    reason = "says that 1 surfaces cannot be split, and expected is a message of '1 sample'"
    return {"check_fit2d_1sample": reason}


@parametrize_with_checks([OfNumbers()], expected_failed_checks=not_as_expected)
def test_the_checks_of_scikit_learn(estimator, check):
    check(estimator)


@pytest.fixture(scope="module")
def widths():
    return felt(36)


@pytest.fixture(scope="module")
def photographs(widths):
    return np.stack([stripes(width, at, (SIDE, SIDE)) for at, width in enumerate(widths)])


@pytest.fixture(scope="module")
def values(widths):
    """Of two properties, the second not measured of the first surface."""
    values = np.stack([10 * widths, 100 - widths], axis=1)
    values[0, 1] = np.nan
    return values


def said(estimator, photographs):
    """(values, intervals, p-values) of an sps.Estimator."""
    answers = estimator.predict_all(photographs)
    return answers.values, np.stack([answers.low, answers.high], axis=-1), answers.familiar


def test_it_says_what_the_estimator_says(encoder, photographs, values):
    settings = {"regression": "kernel-ridge", "level": 0.8, "seed": 7, "calibration": 0.4}
    settings |= {"properties": ["fRS", "coarse"], "resize": 20, "angles": [10.0], "name": "stripes"}
    model = TactileRegressor(encoder, **settings)
    assert model.fit(photographs, values) is model
    estimator = sps.Estimator.fit(photographs, values, encoder=encoder, **settings)
    assert model.estimator_.about == estimator.about
    estimates, intervals, familiar = said(estimator, photographs)
    np.testing.assert_array_equal(model.predict(photographs), estimates)
    np.testing.assert_array_equal(model.predict_interval(photographs), intervals)
    np.testing.assert_array_equal(model.familiarity(photographs), familiar)


def test_what_it_says_has_the_axes_of_y(photographs, values):
    model = TactileRegressor()
    for y, more in [(values[:, 0], ()), (values[:, :1], (1,)), (values, (2,))]:
        model.fit(photographs, y)
        assert model.predict(photographs[:5]).shape == (5, *more)
        assert model.predict_interval(photographs[:5]).shape == (5, *more, 2)
        assert model.predict([]).shape == (0, *more)
        assert model.familiarity(photographs[:5]).shape == (5,)
    assert model.estimator_.properties == ["value 0", "value 1"]
    few = TactileRegressor(level=0.99).fit(photographs, values)
    assert np.isnan(few.predict_interval(photographs)).all()
    assert set(few.estimator_.no_interval) == {"value 0", "value 1"}


def test_surfaces_come_in_any_container(photographs, widths, tmp_path):
    files = [tmp_path / f"{at:02}.png" for at in range(len(photographs))]
    for path, photograph in zip(files, photographs):
        write_png(path, photograph)
    expected = TactileRegressor().fit(photographs, widths).predict(photographs)
    paths = [str(path) for path in files]
    column = np.array(files)[:, None]
    for X in [list(photographs), photographs[:, None], files, np.array(paths), column]:
        model = TactileRegressor().fit(X, widths)
        np.testing.assert_array_equal(model.predict(X), expected)
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"photograph": paths, "width": widths, "coarse": -widths})
    for X in [table["photograph"], table[["photograph"]]]:
        model = TactileRegressor().fit(X, table["width"])
        np.testing.assert_array_equal(model.predict(X), expected)
    model = TactileRegressor().fit(table["photograph"], table[["width", "coarse"]])
    assert model.estimator_.properties == ["width", "coarse"]


def test_several_photographs_of_each_surface(encoder, photographs, widths):
    views = np.stack([photographs, photographs[:, ::-1]], axis=1)
    model = TactileRegressor(encoder, angles=[0.0, 20.0], one_by_one=True).fit(views, widths)
    estimator = sps.Estimator.fit(
        list(views), widths, encoder=encoder, angles=[0.0, 20.0], one_by_one=True
    )
    assert model.estimator_.angles == [0.0, 20.0]
    for seen in (views, photographs):
        np.testing.assert_array_equal(model.predict(seen), said(estimator, seen)[0][:, 0])


def test_photographs_come_to_the_scale_that_is_asked_for(photographs, widths):
    model = TactileRegressor().fit(photographs, widths)
    large = photographs[:3].repeat(2, axis=1).repeat(2, axis=2)
    kept = clone(model).set_params(scale="keep").fit(photographs, widths)
    expected = [kept.estimator_.predict(one, scale="keep").estimates[0].value for one in large]
    assert list(kept.predict(large)) == expected
    assert list(model.predict(large)) != expected


@pytest.mark.parametrize("calibration", [0.3, None])
def test_cross_validation_is_fitting_and_asking_by_hand(encoder, photographs, values, calibration):
    by_hand = np.empty_like(values)
    scores = []
    for train, test in KFold(3).split(photographs):
        settings = {"properties": ["a", "b"], "calibration": calibration}
        estimator = sps.Estimator.fit(
            photographs[train], values[train], encoder=encoder, **settings
        )
        by_hand[test] = said(estimator, photographs[test])[0]
        truth = values[test]
        known = ~np.isnan(truth[:, 1])
        both = [
            r2_score(truth[:, 0], by_hand[test, 0]),
            r2_score(truth[known, 1], by_hand[test][known, 1]),
        ]
        scores.append(np.mean(both))
    model = TactileRegressor(encoder, calibration=calibration)
    estimates = cross_val_predict(model, photographs, values, cv=KFold(3))
    np.testing.assert_array_equal(estimates, by_hand)
    np.testing.assert_array_equal(
        cross_val_score(model, photographs, values, cv=KFold(3), error_score="raise"), scores
    )
    intervals = model.fit(photographs, values).predict_interval(photographs[:2])
    assert np.isnan(intervals).all() == (calibration is None)


def test_the_better_of_several_settings_is_found(encoder, photographs, widths):
    grid = {"regression": ["ridge", "kernel-ridge"], "encoder": [None, encoder]}
    search = GridSearchCV(TactileRegressor(), grid, cv=2, error_score="raise")
    search.fit(list(photographs), widths)
    tried = {
        regression: np.mean(
            cross_val_score(TactileRegressor(regression=regression), photographs, widths, cv=2)
        )
        for regression in grid["regression"]
    }
    assert search.best_params_["regression"] == max(tried, key=tried.get)
    assert search.best_score_ == max(tried.values())
    check_is_fitted(search.best_estimator_)


def test_groups_stay_whole(encoder, photographs, widths):
    groups = [f"material {at % 9}" for at in range(len(widths))]

    def reasons(train):
        estimator = sps.Estimator.fit(
            photographs[train],
            widths[train],
            encoder=encoder,
            groups=[groups[at] for at in train],
        )
        return estimator.no_interval

    model = TactileRegressor(encoder).fit(photographs, widths, groups)
    expected = reasons(range(len(widths)))
    assert "calibration group(s)" in expected["value"]
    assert model.estimator_.no_interval == expected

    folds = list(GroupKFold(3).split(photographs, groups=groups))
    expected = [reasons(train) for train, _ in folds]
    settings = {"cv": GroupKFold(3), "return_estimator": True, "error_score": "raise"}
    to_both = cross_validate(
        model, photographs, widths, groups=groups, params={"groups": groups}, **settings
    )
    with config_context(enable_metadata_routing=True):
        routed = cross_validate(model, photographs, widths, params={"groups": groups}, **settings)
    for found in (to_both, routed):
        assert [one.estimator_.no_interval for one in found["estimator"]] == expected


def test_a_score_is_of_what_was_measured(photographs, values):
    model = TactileRegressor().fit(photographs, values)
    estimates = model.predict(photographs)
    weights = np.arange(len(values))
    for weighted in (None, weights):
        known = None if weighted is None else weighted[1:]
        each = [
            r2_score(values[:, 0], estimates[:, 0], sample_weight=weighted),
            r2_score(values[1:, 1], estimates[1:, 1], sample_weight=known),
        ]
        assert model.score(photographs, values, weighted) == np.mean(each)
    every = slice(1, None)
    everything = r2_score(values[every], estimates[every])
    assert model.score(photographs[every], values[every]) == pytest.approx(everything, rel=1e-12)
    with pytest.raises(sps.UndefinedScore, match=r"value 1: found 1 value\(s\) in y, expected at least"):
        model.score(photographs[:2], values[:2])
    with pytest.raises(ValueError, match=r"y of shape \(36,\), expected \(36, 2\)"):
        model.score(photographs, values[:, 0])


def test_a_copy_is_as_the_original(photographs, values, tmp_path):
    encoder = sps.Encoder("efficientnet-lite-body", "built-in", precision="bf16")
    model = TactileRegressor(encoder, level=0.7, properties=["fRS", "coarse"])
    assert repr(pickle.loads(pickle.dumps(model))) == repr(model)
    model.fit(photographs, values)
    unfitted = clone(model)
    with pytest.raises(NotFittedError):
        unfitted.predict(photographs)
    assert repr(unfitted) == repr(model)
    assert "level=0.7" in repr(model) and "bf16" in repr(model)
    for copy in (unfitted.fit(photographs, values), pickle.loads(pickle.dumps(model))):
        np.testing.assert_array_equal(copy.predict(photographs), model.predict(photographs))
        np.testing.assert_array_equal(
            copy.predict_interval(photographs), model.predict_interval(photographs)
        )


@pytest.mark.parametrize(
    ("X", "y", "error", "message"),
    [
        (np.zeros((9, 5)), np.zeros(9), ValueError, r"X of shape \(9, 5\) and dtype float64, exp"),
        (np.zeros((9, 4, 4), np.uint8), np.zeros(9), ValueError, r"expected paths \(n,\) or"),
        (np.zeros((9, 4, 4, 3)), np.zeros(9), TypeError, "dtype float64, expected uint8, or"),
        ([[1.0, 2.0]] * 9, np.zeros(9), TypeError, "surface 0: image 0 is a .*float"),
        ("a.png", np.zeros(1), TypeError, "photographs: found one photograph, expected one or"),
        (["none.png"] * 9, np.zeros(9), FileNotFoundError, "none.png: cannot be read"),
        ([stripes(1, 1)] * 9, np.zeros(8), ValueError, "found those of 9 surfaces, expected 8"),
        ([stripes(1, 1)] * 9, None, ValueError, "requires y to be passed"),
        ([stripes(1, 1)] * 9, ["rough"] * 9, ValueError, "could not convert string to float"),
        ([stripes(1, 1)] * 9, np.full(9, np.inf), ValueError, "inf for value of surface 0"),
    ],
)
def test_what_cannot_be_fitted(X, y, error, message):
    with pytest.raises(error, match=message):
        TactileRegressor().fit(X, y)


def test_what_cannot_be_set(photographs, widths):
    with pytest.raises(ValueError, match="Invalid parameter 'levels' for estimator TactileRegr"):
        TactileRegressor().set_params(levels=0.5)
    for settings, message in [
        ({"regression": "forest"}, "methods.0.kind.*`forest`"),
        ({"level": 2.0}, "2"),
        ({"properties": ["a", "b"]}, "expected a name for each of 1 columns"),
    ]:
        with pytest.raises(ValueError, match=message):
            TactileRegressor(**settings).fit(photographs, widths)
    with pytest.raises(ValueError, match="scale: found 'small'"):
        TactileRegressor(scale="small").fit(photographs, widths).predict(photographs)
    with pytest.raises(ValueError, match="groups: found 2, expected one for each of 36 surf"):
        TactileRegressor().fit(photographs, widths, groups=[0, 1])
