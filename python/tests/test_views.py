import contextvars
import itertools
import threading

import numpy as np
import pytest

import sps

SCORES = np.random.default_rng(0).uniform(0, 1, (9, 9))


def rugged(views):
    """A loss with no order in it."""
    first, second = views
    return SCORES[first, second]


def best(sets):
    return list(min(sets, key=rugged))


def test_exhaustive_is_the_optimum():
    anyhow = sps.select_views(rugged, 9, 2, "exhaustive")
    assert anyhow.picks == best(itertools.product(range(9), repeat=2))
    assert anyhow.loss == SCORES[tuple(anyhow.picks)]
    assert (anyhow.evaluations, anyhow.computed) == (81, 81)
    distinct = sps.select_views(lambda views: -float(views[0] == views[1]), 9, 2, distinct=True)
    assert len(set(distinct.picks)) == 2


@pytest.mark.parametrize("method", ["greedy", "nvs", "vb-nvs", "random", "equidistant", "nadir"])
def test_methods_are_repeatable(method):
    def loss(views):
        return sum((view - 11.0) ** 2 for view in views)

    found = sps.select_views(loss, 30, 3, method, seed=4)
    again = sps.select_views(loss, 30, 3, method, seed=4)
    assert (found.picks, found.curve) == (again.picks, again.curve)
    assert found.loss == loss(found.picks)
    assert found.curve[-1][0] == found.evaluations and found.curve[-1][2] == found.loss
    if method in ["greedy", "nvs", "vb-nvs"]:
        assert found.picks == [11, 11, 11]


def test_settings_are_the_methods_own():
    few = sps.select_views(rugged, 9, 2, "nvs", evaluations=101, policy={"learning_rate": 0.1})
    assert few.evaluations <= 101
    ends = sps.select_views(rugged, 9, 2, "equidistant", at="ends")
    assert ends.picks == [0, 8]
    with pytest.raises(ValueError, match="unknown field `evaluation`, expected .*`evaluations`"):
        sps.select_views(rugged, 9, 2, "nvs", evaluation=100)
    with pytest.raises(ValueError, match="`learning-rate` is -1, expected a positive number"):
        sps.select_views(rugged, 9, 2, "nvs", policy={"learning_rate": -1.0})
    with pytest.raises(ValueError, match="unknown variant `best`, expected one of `random`"):
        sps.select_views(rugged, 9, 2, "best")
    with pytest.raises(ValueError, match="sets of 3 views are wanted of 2 views"):
        sps.select_views(rugged, 2, 3)


class Unreadable(Exception):
    pass


def test_an_exception_of_the_loss_comes_out_as_itself():
    raised, calls = Unreadable("frame 3"), []

    def loss(views):
        calls.append(views)
        raise raised

    with pytest.raises(Unreadable) as caught:
        sps.select_views(loss, 9, 2, "exhaustive")
    assert caught.value is raised
    assert len(calls) == 1

    def interrupted(views):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sps.select_views(interrupted, 9, 2)


@pytest.mark.parametrize(
    ("loss", "error", "message"),
    [
        (lambda views: np.nan, ValueError, "is NaN, expected a number within 1e100"),
        (lambda views: None, TypeError, "NoneType"),
        (lambda: 0.0, TypeError, "takes 0 positional arguments"),
        ("loss", TypeError, "'str' object is not callable"),
    ],
)
def test_what_is_no_loss(loss, error, message):
    with pytest.raises(error, match=message):
        sps.select_views(loss, 9, 2)


def test_the_loss_is_called_where_it_was_handed_over():
    setting = contextvars.ContextVar("setting")
    setting.set("mine")
    seen = set()

    def loss(views):
        seen.add((threading.get_ident(), setting.get("none"), type(views)))
        return np.float32(sum(views))

    assert sps.select_views(loss, 9, 2).picks == [0, 0]
    assert seen == {(threading.get_ident(), "mine", tuple)}


def test_the_loss_may_embed_and_select(encoder):
    frames = np.random.default_rng(0).integers(0, 256, (5, 16, 16, 3), dtype=np.uint8)
    target = encoder.transform(frames).mean(axis=0)

    def loss(views):
        inner = sps.select_views(lambda one: float(one[0]), 3, 1, "exhaustive")
        embedded = encoder.transform(frames[list(views)]).mean(axis=0)
        return inner.loss + np.linalg.norm(embedded - target)

    found = sps.select_views(loss, 5, 2, "exhaustive", distinct=True)
    assert found.picks == list(min(itertools.permutations(range(5), 2), key=loss))
