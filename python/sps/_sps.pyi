from collections.abc import Callable, Hashable, Iterable, Sequence
from os import PathLike
from typing import Any, Literal, SupportsFloat, Union, final

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

_Path = Union[str, PathLike[str]]
_Image = Union[NDArray[np.uint8], NDArray[np.float32], _Path]
_Images = Union[_Image, Iterable[_Image]]
_Scale = Union[Literal["model", "keep"], int]

__all__ = [
    "Answer",
    "Coverage",
    "Encoder",
    "Estimate",
    "Estimator",
    "GroupConformal",
    "Looked",
    "Score",
    "ScoreInterval",
    "Selection",
    "Session",
    "SplitConformal",
    "UndefinedScore",
    "__version__",
    "coverage",
    "difference",
    "holm",
    "interval",
    "mae",
    "median_percent_error",
    "r2",
    "r2_own_mean",
    "rmse",
    "select_views",
    "spearman",
]

__version__: str

class UndefinedScore(ValueError): ...

@final
class Encoder:
    def __new__(
        cls,
        name: str,
        weights: _Path,
        precision: str = "f32",
        depths: str | Sequence[str] = "all",
    ) -> Encoder: ...
    @property
    def name(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def blocks(self) -> list[tuple[str, int]]: ...
    @property
    def precision(self) -> str: ...
    def embed(self, images: _Images) -> NDArray[np.float32]: ...
    def calibrated(self, images: _Images, file: _Path) -> Encoder: ...
    def __getnewargs__(self) -> tuple[str, PathLike[str], str, str | list[str]]: ...

@final
class Estimate:
    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def value(self) -> float: ...
    @property
    def low(self) -> float | None: ...
    @property
    def high(self) -> float | None: ...
    # Last, for its name hides the decorator.
    @property
    def property(self) -> str: ...

@final
class Answer:
    @property
    def estimates(self) -> list[Estimate]: ...
    @property
    def familiar(self) -> float | None: ...
    @property
    def no_interval(self) -> dict[str, str]: ...

@final
class Looked:
    @property
    def views(self) -> int: ...
    @property
    def answer(self) -> Answer: ...
    @property
    def narrow(self) -> list[bool]: ...
    @property
    def next_angle(self) -> float | None: ...

@final
class Session:
    @property
    def next_angle(self) -> float | None: ...
    def look(self, photograph: _Image, *, scale: _Scale = "model") -> Looked: ...

@final
class Estimator:
    @staticmethod
    def load(folder: _Path, *, joint: bool = False) -> Estimator: ...
    @staticmethod
    def fit(
        photographs: Iterable[_Images],
        values: ArrayLike,
        *,
        encoder: Encoder | None = None,
        properties: list[str] | None = None,
        groups: Iterable[Hashable] | None = None,
        regression: str = "ridge",
        calibration: float | None = 0.3,
        level: float = 0.9,
        seed: int = 0,
        resize: int | None = None,
        angles: list[float] | None = None,
        one_by_one: bool = False,
        name: str = "",
    ) -> Estimator: ...
    def save(self, folder: _Path) -> None: ...
    def predict(self, photographs: _Images, *, scale: _Scale = "model") -> Answer: ...
    def predict_all(
        self, surfaces: Iterable[_Images], *, scale: _Scale = "model"
    ) -> list[Answer]: ...
    def session(self, width: float) -> Session: ...
    def map(
        self,
        photograph: _Image,
        stride: int | None = None,
        *,
        scale: _Scale = "keep",
        alone: bool = False,
    ) -> dict[str, NDArray[np.float64]]: ...
    @property
    def properties(self) -> list[str]: ...
    @property
    def level(self) -> float: ...
    @property
    def angles(self) -> list[float]: ...
    @property
    def no_interval(self) -> dict[str, str]: ...
    @property
    def no_familiar(self) -> str | None: ...
    @property
    def about(self) -> dict[str, Any]: ...

@final
class Selection:
    @property
    def picks(self) -> list[int]: ...
    @property
    def loss(self) -> float: ...
    @property
    def evaluations(self) -> int: ...
    @property
    def computed(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def curve(self) -> list[tuple[int, float, float]]: ...

def select_views(
    loss: Callable[[tuple[int, ...]], SupportsFloat],
    n: int,
    k: int,
    method: str = "greedy",
    *,
    seed: int = 0,
    distinct: bool = False,
    **settings: Any,
) -> Selection: ...
@final
class Score:
    @property
    def value(self) -> float: ...
    @property
    def samples(self) -> int: ...
    @property
    def zero_truths(self) -> int: ...
    def __float__(self) -> float: ...
    def __array__(
        self, dtype: DTypeLike | None = None, copy: bool | None = None
    ) -> NDArray[Any]: ...

def r2(*, truth: ArrayLike, estimate: ArrayLike, training_mean: float) -> Score: ...
def r2_own_mean(*, truth: ArrayLike, estimate: ArrayLike) -> Score: ...
def mae(*, truth: ArrayLike, estimate: ArrayLike) -> Score: ...
def rmse(*, truth: ArrayLike, estimate: ArrayLike) -> Score: ...
def median_percent_error(*, truth: ArrayLike, estimate: ArrayLike) -> Score: ...
def spearman(*, truth: ArrayLike, estimate: ArrayLike) -> Score: ...
@final
class ScoreInterval:
    @property
    def estimate(self) -> float: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...
    @property
    def level(self) -> float: ...
    @property
    def units(self) -> int: ...
    @property
    def reruns(self) -> int: ...
    @property
    def standard_error(self) -> float: ...
    @property
    def p(self) -> float: ...
    def excludes_zero(self) -> bool: ...

def interval(
    metric: str,
    *,
    truth: ArrayLike,
    estimate: ArrayLike,
    units: ArrayLike | None = None,
    reruns: ArrayLike | None = None,
    training_mean: float | None = None,
    level: float = 0.95,
    test_per_training: float = 0.0,
) -> ScoreInterval: ...
def difference(
    metric: str,
    *,
    truth: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    units: ArrayLike | None = None,
    reruns: ArrayLike | None = None,
    training_mean: float | None = None,
    level: float = 0.95,
    test_per_training: float = 0.0,
) -> ScoreInterval: ...
def holm(p_values: ArrayLike) -> list[float]: ...
@final
class SplitConformal:
    def __new__(cls, residuals: ArrayLike, *, level: float = 0.9) -> SplitConformal: ...
    @property
    def radius(self) -> float: ...
    @property
    def expected_coverage(self) -> float: ...
    def intervals(self, estimates: ArrayLike) -> NDArray[np.float64]: ...

@final
class GroupConformal:
    def __new__(
        cls, residuals: ArrayLike, groups: ArrayLike, *, level: float = 0.9
    ) -> GroupConformal: ...
    @property
    def radius(self) -> float: ...
    @property
    def groups(self) -> int: ...
    def intervals(self, estimates: ArrayLike) -> NDArray[np.float64]: ...

@final
class Coverage:
    @property
    def covered(self) -> int: ...
    @property
    def samples(self) -> int: ...
    @property
    def fraction(self) -> float: ...
    @property
    def mean_width(self) -> float: ...

def coverage(*, intervals: ArrayLike, truth: ArrayLike) -> Coverage: ...
