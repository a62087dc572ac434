import math
import sys

import numpy as np
import pytest

import sps
from conftest import ROOT
from files import read_safetensors
from golden import uniform

METRICS = ["r2", "mae", "rmse", "median_percent_error", "spearman"]


def samples(n=60, seed=0):
    random = np.random.default_rng(seed)
    truth = random.uniform(10, 90, n)
    return truth, truth + random.normal(0, 5, n), truth + random.normal(0, 8, n)


def test_scores_are_those_of_scikit_learn():
    golden = read_safetensors(ROOT / "fixtures/golden/metrics.safetensors")
    truth = (uniform("golden/metrics.truth", (41, 15)) + 1) * 50
    estimate = truth + 12 * uniform("golden/metrics.error", (41, 15))
    mean = (uniform("golden/metrics.train_mean", (15,)) + 1) * 50
    for k in range(15):
        pair = truth[:, k], estimate[:, k]
        found = {
            "r2_train_mean": sps.r2(*pair, training_mean=mean[k]),
            "r2_own_mean": sps.r2(*pair),
            "mae": sps.mae(*pair),
            "median_percent_error": sps.median_percent_error(*pair),
        }
        for name, score in found.items():
            assert math.isclose(score, golden[name][k], rel_tol=1e-12), name


def test_scores_by_hand():
    score = sps.rmse([1, 2], [4, 6], details=True)
    assert (score.value, score.samples) == (math.sqrt(12.5), 2)
    assert sps.rmse([1, 2], [4, 6]) == score.value and sps.mae([1, 2], [4, 6]) == 3.5
    # Ranks 1 2 3 4 and 2 1 4 3: 1 - 6 * 4 / (4 * 15).
    assert sps.spearman([1, 2, 3, 4], [5, 4, 9, 6]) == 0.6
    percent = sps.median_percent_error((0.0, 2.0), (1.0, 3.0), details=True)
    assert repr(percent) == "Score(value=50.0, samples=1, zero_truths=1)"


def test_any_array_of_numbers_will_do():
    for kind in [np.float32, np.int16, bool]:
        truth, estimate = np.array([1, 0, 1], kind), np.array([0, 0, 1], kind)
        assert sps.mae(truth, estimate) == 1 / 3
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"t": [1, 2], "e": [2, 4]}, index=[7, 3])
    assert sps.mae(table["t"], table["e"]) == 1.5


@pytest.mark.parametrize(
    ("score", "truth", "estimate", "message"),
    [
        (sps.mae, [], [], "no samples"),
        (sps.mae, [1, 2], [1], "2 truths for 1 estimates"),
        (sps.mae, [1, math.nan], [1, 2], "truth 1 is NaN"),
        (sps.rmse, [1, 2], [math.inf, 2], "estimate 0 is infinite"),
        (sps.spearman, [1, 2], [3, 3], "every estimate is 3"),
        (sps.r2, [5, 5], [1, 2], "every truth is 5"),
        (sps.median_percent_error, [0, 0], [1, 2], "all 2 truths are zero"),
    ],
)
def test_what_has_no_score_says_why(score, truth, estimate, message):
    with pytest.raises(sps.UndefinedScore, match=message):
        score(truth, estimate)
    assert issubclass(sps.UndefinedScore, ValueError)


def test_what_are_no_numbers_is_named():
    with pytest.raises(TypeError) as error:
        sps.mae([[1.0], [2.0]], [1.0, 2.0])
    # Python before 3.11 has no notes.
    notes = getattr(error.value, "__notes__", [])
    assert sys.version_info < (3, 11) or "y_true" in " ".join([str(error.value), *notes])


@pytest.mark.parametrize("metric", METRICS)
def test_an_interval_is_about_the_score(metric):
    truth, estimate, _ = samples()
    interval = sps.interval(metric, truth, estimate)
    score = getattr(sps, metric)(truth, estimate)
    assert math.isclose(interval.estimate, score, rel_tol=1e-12)
    assert interval.low < interval.estimate < interval.high
    assert (interval.level, interval.units, interval.reruns) == (0.95, 60, 1)


def test_a_paired_interval_is_that_of_a_t_test():
    truth, first, second = samples()
    errors = np.abs(truth - first), np.abs(truth - second)
    apart = errors[0] - errors[1]
    found = sps.difference("mae", truth, first, second)
    error = apart.std(ddof=1) / math.sqrt(len(apart))
    assert math.isclose(found.standard_error, error, rel_tol=1e-9)
    # Student's t of 59 degrees of freedom, or fewer where errors have heavy tails.
    half = (found.high - found.low) / 2
    assert half / error >= 2.0010 and math.isclose(found.estimate, apart.mean(), rel_tol=1e-9)


def test_units_are_whole_and_named_anyhow():
    truth, estimate, _ = samples()
    numbers = np.arange(60) // 6
    by_number = sps.interval("mae", truth, estimate, units=numbers)
    names = [f"surface-{number}" for number in numbers]
    by_name = sps.interval("mae", truth, estimate, units=names)
    assert by_number.units == 10
    assert repr(by_number) == repr(by_name)
    # Ten samples of equal errors each say as much as one.
    errors = np.random.default_rng(2).uniform(0, 1, 10)
    together = sps.interval("mae", np.zeros(60), errors[numbers], units=numbers)
    apart = sps.interval("mae", np.zeros(10), errors)
    assert math.isclose(together.low, apart.low, rel_tol=1e-9)
    assert math.isclose(together.high, apart.high, rel_tol=1e-9)


def test_reruns_widen_an_interval_by_how_much_they_differ():
    truth = np.zeros(40)
    estimate = np.random.default_rng(3).uniform(1, 2, 40)
    both = {"y_true": np.tile(truth, 3), "reruns": np.repeat(["a", "b", "c"], 40)}
    same = sps.interval("mae", y_pred=np.tile(estimate, 3), **both)
    alone = sps.interval("mae", truth, estimate)
    assert (same.units, same.reruns) == (40, 3)
    assert math.isclose(same.low, alone.low, rel_tol=1e-9)
    moved = np.tile(estimate, 3) + np.repeat([-0.1, 0.0, 0.1], 40)
    other = sps.interval("mae", y_pred=moved, **both)
    variance = other.standard_error**2 - alone.standard_error**2
    assert math.isclose(variance, 0.01 / 3, rel_tol=1e-9)
    shared = sps.interval("mae", y_pred=np.tile(estimate, 3), test_per_training=1 / 9, **both)
    ratio = shared.standard_error / alone.standard_error
    assert math.isclose(ratio, math.sqrt(10 / 9), rel_tol=1e-9)


def test_a_difference_is_paired():
    truth, fine, rough = samples()
    gain = sps.difference("mae", truth, rough, fine)
    assert gain.excludes_zero() and gain.low < gain.estimate < gain.high
    assert gain.p < 0.05
    swapped = sps.difference("mae", truth, fine, rough)
    assert (swapped.low, swapped.high) == (-gain.high, -gain.low)
    none = sps.difference("mae", truth, fine, fine)
    assert (none.low, none.high, none.excludes_zero(), none.p) == (0, 0, False, 1)


def test_many_p_values_are_corrected():
    assert sps.holm([0.01, 0.04, 0.03]) == [0.03, 0.06, 0.06]


def test_r2_may_be_about_the_training_mean_and_no_other_may():
    truth, estimate, other = samples()
    found = sps.interval("r2", truth, estimate, training_mean=40.0)
    assert found.estimate == sps.r2(truth, estimate, training_mean=40.0)
    assert found.estimate != sps.interval("r2", truth, estimate).estimate
    with pytest.raises(ValueError, match="a training_mean for mae, expected none"):
        sps.difference("mae", truth, estimate, other, training_mean=40.0)
    with pytest.raises(ValueError, match='unknown metric "r3", expected r2,'):
        sps.interval("r3", truth, estimate)
    with pytest.raises(sps.UndefinedScore, match="training mean 0 is NaN"):
        sps.r2(truth, estimate, training_mean=math.nan)


def test_what_has_no_interval_says_why():
    one = {"y_true": [1.0], "y_pred": [2.0]}
    two = {"y_true": [1, 2], "y_pred": [1, 3]}
    with pytest.raises(sps.UndefinedScore, match="rests on one unit.* needs at least 2"):
        sps.interval("mae", **one)
    with pytest.raises(sps.UndefinedScore, match="the score is undefined"):
        sps.interval("spearman", **one)
    with pytest.raises(ValueError, match="reruns: 1, and at least 2 are needed"):
        sps.interval("mae", reruns=[0, 0], **two)
    with pytest.raises(ValueError, match="3 units for 2 samples"):
        sps.interval("mae", units=[1, 2, 3], **two)
    with pytest.raises(ValueError, match="labels of 2 dimensions, expected one"):
        sps.interval("mae", units=[[1, 2]], **two)
    with pytest.raises(ValueError, match="strictly between 0 and 1, found 95"):
        sps.interval("mae", level=95, **two)
    with pytest.raises(ValueError, match="test_per_training is -1, expected a number from 0 on"):
        sps.interval("mae", test_per_training=-1, **two)


def test_the_radius_is_an_order_statistic():
    residuals = np.random.default_rng(0).normal(0, 3, 99)
    conformal = sps.SplitConformal(residuals, level=0.8)
    assert conformal.radius == np.sort(np.abs(residuals))[79]
    assert conformal.expected_coverage == 0.8
    expected = [[1 - conformal.radius, 1 + conformal.radius]]
    np.testing.assert_array_equal(conformal.intervals([1.0]), expected)
    with pytest.raises(ValueError, match="8 calibration sample.* needs at least 9"):
        sps.SplitConformal(residuals[:8])
    with pytest.raises(sps.UndefinedScore, match="residual 0 is NaN"):
        sps.SplitConformal([math.nan] * 20)


def test_groups_count_the_same_whatever_their_size():
    residuals, groups = [0.1, 0.2, -0.3, 0.5, -0.7], ["a", "a", "a", "b", "c"]
    # Mass up to 0.5 of the three groups and the new one: (3/3 + 1) / 4.
    conformal = sps.GroupConformal(residuals, groups, level=0.5)
    assert (conformal.radius, conformal.groups) == (0.5, 3)
    np.testing.assert_array_equal(conformal.intervals([5.0]), [[4.5, 5.5]])
    with pytest.raises(ValueError, match="needs at least 9"):
        sps.GroupConformal(residuals, groups)
    with pytest.raises(ValueError, match="4 group numbers for 5 samples"):
        sps.GroupConformal(residuals, groups[:4], level=0.5)


def test_coverage_by_hand():
    truth, low, high = [1, 4.5, 5, 7], [0, 2, 5, 6], [1, 4, 5, 9]
    assert sps.coverage(truth, low, high) == 0.75
    found = sps.coverage(truth, low, high, details=True)
    assert repr(found) == "Coverage(covered=3, samples=4, fraction=0.75, mean_width=1.5)"
    with pytest.raises(sps.UndefinedScore, match="2 lower ends and 1 upper ends"):
        sps.coverage([1, 2], [1, 2], [3])
    with pytest.raises(sps.UndefinedScore, match="interval 0 ends below its start"):
        sps.coverage([1], [2], [1])
