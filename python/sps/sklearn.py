"""`sps.Estimator` as a regressor of scikit-learn, to cross-validate and search with what people have.

Needs scikit-learn 1.6 or later, which the rest of the package does not: `pip install scikit-learn`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any, Literal, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._sps import Answers, Encoder, Estimator, UndefinedScore

try:
    from sklearn.base import BaseEstimator, RegressorMixin
    from sklearn.metrics import r2_score
    from sklearn.utils import Tags
    from sklearn.utils.validation import check_is_fitted
except ImportError as error:
    needed = "sps.sklearn needs scikit-learn 1.6 or later: pip install scikit-learn"
    raise ImportError(f"{needed} ({error})") from error

__all__ = ["TactileRegressor"]

_Floats = NDArray[np.float64]


class TactileRegressor(RegressorMixin, BaseEstimator):
    """What a touch sensor would measure on surfaces, from photographs of them: a regressor.

    `X` holds the photographs of n surfaces: paths, as a list, an array or a column of a table, or
    pixels, as an array (n, height, width, 3) or a list of arrays (height, width, 3), uint8, or float32
    from 0 to 1. Several photographs of each surface stand in one more axis: (n, views) of paths,
    (n, views, height, width, 3), or a list of lists. `y` is (n,) or (n, properties), NaN where nothing
    was measured.

    The parameters are the keywords of Estimator.fit, which says what each does. `encoder` is an Encoder;
    None is efficientnet-lite-body with the weights that come with the package. `properties` names the columns
    of y; None takes their names where y is a table, else "value", or "value 0", "value 1" and so on.
    `scale` is that of Estimator.predict; fit takes photographs as they come, or as `resize` says.

    Each fit keeps the share `calibration` of its surfaces aside for the intervals, and estimates do not
    learn from them. Scores are of estimates alone: where cross_val_score or a search compares them,
    calibration=None fits to all surfaces, and gives no intervals.

    Each fit and each question embeds its photographs anew. Where one is asked for values, intervals and
    p-values of the same photographs, `estimator_.predict_all(X)` says all of them at once.

    Once it is fitted, `estimator_` is the Estimator: to save, to map photographs, to ask why there is no
    interval.
    """

    # Where metadata is routed, groups come here unless set_fit_request says otherwise.
    __metadata_request__fit = {"groups": True}

    def __init__(
        self,
        encoder: Encoder | None = None,
        *,
        properties: list[str] | None = None,
        regression: str | dict[str, Any] = "ridge",
        calibration: float | None = 0.3,
        level: float = 0.9,
        seed: int = 0,
        resize: int | None = None,
        angles: list[float] | None = None,
        one_by_one: bool = False,
        name: str = "",
        scale: Union[Literal["model", "keep"], int] = "model",
    ) -> None:
        self.encoder = encoder
        self.properties = properties
        self.regression = regression
        self.calibration = calibration
        self.level = level
        self.seed = seed
        self.resize = resize
        self.angles = angles
        self.one_by_one = one_by_one
        self.name = name
        self.scale = scale

    def fit(
        self, X: Any, y: ArrayLike, groups: Iterable[Hashable] | None = None
    ) -> TactileRegressor:
        """Fits to photographs and what was measured on them; returns itself.

        `groups`, (n,) of anything hashable, says which surfaces are alike (photographs of one material,
        sheets of one roll): a group is never parted, and intervals are for a surface of a new one.

        Raises what Estimator.fit raises, and ValueError for an array X of another shape.
        """
        values = _values(y)
        settings = self.get_params(deep=False)
        del settings["scale"]
        if self.properties is None:
            settings["properties"] = _names(y, values)
        self.estimator_ = Estimator.fit(_surfaces(X), values, groups=groups, **settings)
        self._one_column = values.ndim == 1
        return self

    def predict(self, X: Any) -> _Floats:
        """The estimates, float64 of the shape that y had in fit: (n,) or (n, properties).

        Raises NotFittedError before fit, ValueError for an array X of another shape, and what
        Estimator.predict_all raises.
        """
        return self._of_each_property(self._answers(X).values)

    def predict_interval(self, X: Any) -> _Floats:
        """The intervals, float64 with their lower and upper ends in the last axis: (n, 2), or
        (n, properties, 2) where y had columns in fit. NaN where there is none; `estimator_.no_interval`
        says why, or Answer.no_interval of several photographs by a model of one.

        An interval holds the truth of a new surface, or of one of a new group, with a probability of at
        least `level`. Raises what predict raises.
        """
        answers = self._answers(X)
        return self._of_each_property(np.stack([answers.low, answers.high], axis=-1))

    def familiarity(self, X: Any) -> _Floats:
        """The p-values of "like those that it was fitted on", float64 (n,): of surfaces that are, at most
        q with a probability of at most q. NaN where the model does not know, and
        `estimator_.no_familiar` says why.

        Raises what predict raises.
        """
        return self._answers(X).familiar

    def score(self, X: Any, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """R² about the mean of y, of the surfaces where a property was measured; of several properties
        the mean. Where all was measured, it is what every regressor of scikit-learn says.

        Raises what predict raises, ValueError for a y of another shape than the estimates, and
        UndefinedScore for a property with fewer than two values.
        """
        truth, estimates = _values(y), self.predict(X)
        if truth.shape != estimates.shape:
            raise ValueError(f"y of shape {truth.shape}, expected {estimates.shape}")
        columns = zip(self.estimator_.properties, np.atleast_2d(truth.T), np.atleast_2d(estimates.T))
        return float(np.mean([_r2(*column, sample_weight) for column in columns]))

    def _answers(self, X: Any) -> Answers:
        check_is_fitted(self)
        return self.estimator_.predict_all(_surfaces(X), scale=self.scale)

    def _of_each_property(self, cells: _Floats) -> _Floats:
        """(n, properties, ...), or (n, ...) where y had one axis."""
        return cells[:, 0] if self._one_column else cells

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        # Rows of numbers are no photographs.
        tags.input_tags.two_d_array = False
        tags.input_tags.string = True
        tags.target_tags.multi_output = True
        return tags


def _surfaces(X: Any) -> Any:
    """What Estimator takes: an item for each surface, be it of an array or a table."""
    if not hasattr(X, "__array__"):
        return X
    X = np.asarray(X)
    if X.ndim in (4, 5):
        return X
    if X.ndim in (1, 2) and X.dtype.kind in "OTU":
        return X.tolist()
    expected = "paths (n,) or (n, views), or pixels (n, height, width, 3) or (n, views, height, width, 3)"
    raise ValueError(f"X of shape {X.shape} and dtype {X.dtype}, expected {expected}")


def _values(y: Any) -> _Floats:
    if y is None:
        # In scikit-learn's words, which its checks look for.
        raise ValueError("requires y to be passed, but the target y is None")
    return np.asarray(y, dtype=np.float64)


def _names(y: Any, values: _Floats) -> list[str]:
    """Of the columns of y."""
    if hasattr(y, "columns"):
        return [str(name) for name in y.columns]
    columns = values.shape[1] if values.ndim == 2 else 1
    return ["value"] if columns == 1 else [f"value {column}" for column in range(columns)]


def _r2(property: str, truth: _Floats, estimate: _Floats, weights: ArrayLike | None) -> float:
    """Of the surfaces that have a truth."""
    known = ~np.isnan(truth)
    if known.sum() < 2:
        raise UndefinedScore(f"{property}: found {known.sum()} value(s) in y, expected at least two")
    weights = None if weights is None else np.asarray(weights)[known]
    return float(r2_score(truth[known], estimate[known], sample_weight=weights))
