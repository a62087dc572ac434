from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Protocol, SupportsFloat, Union, final, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

_Path = Union[str, PathLike[str]]

class _Pixels(Protocol):
    """An image of PIL."""
    @property
    def __array_interface__(self) -> dict[str, Any]: ...

class _Tensor(Protocol):
    """A tensor of torch."""
    def __dlpack__(self) -> Any: ...

_Image = Union[NDArray[np.uint8], NDArray[np.float32], _Pixels, _Tensor, _Path]
_Images = Union[_Image, Iterable[_Image]]
_Progress = Callable[[str, int, int], object]
_Scale = Union[Literal["model", "keep"], int]

__all__ = [
    "Answer",
    "Answers",
    "Comparison",
    "Coverage",
    "Dataset",
    "Encoder",
    "Estimate",
    "Estimator",
    "Fitted",
    "GroupConformal",
    "Looked",
    "Run",
    "Score",
    "ScoreInterval",
    "Selection",
    "Session",
    "SplitConformal",
    "UndefinedScore",
    "__version__",
    "compare",
    "coverage",
    "difference",
    "experiment",
    "fit",
    "holm",
    "interval",
    "list_encoders",
    "mae",
    "median_percent_error",
    "program",
    "r2",
    "rmse",
    "select_views",
    "simulate",
    "spearman",
]

__version__: str

class UndefinedScore(ValueError): ...

def program() -> int: ...
@final
class Dataset:
    def __new__(
        cls,
        photographs: _Path | Iterable[_Images],
        values: ArrayLike | _Path | None = None,
        *,
        properties: list[str] | None = None,
        groups: Iterable[Hashable] | None = None,
        materials: list[str] | None = None,
        angles: list[float] | None = None,
    ) -> Dataset: ...
    @property
    def folder(self) -> Path: ...
    @property
    def name(self) -> str: ...
    @property
    def surfaces(self) -> list[str]: ...
    @property
    def materials(self) -> list[str]: ...
    @property
    def groups(self) -> list[str]: ...
    @property
    def angles(self) -> list[float]: ...
    @property
    def properties(self) -> list[str]: ...
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def photographs(self) -> list[list[Path]]: ...
    def __fspath__(self) -> str: ...
    def __len__(self) -> int: ...

def simulate(
    folder: _Path,
    *,
    surfaces: int = 400,
    views: int = 100,
    size: int = 128,
    seed: int = 1,
    format: str = "png",
    progress: _Progress | None = None,
) -> Dataset: ...
@final
class Fitted:
    @property
    def model(self) -> Estimator: ...
    @property
    def method(self) -> str: ...
    @property
    def r2(self) -> float | None: ...
    @property
    def run(self) -> Run: ...
    @property
    def worst(self) -> list[tuple[str, float]]: ...
    @property
    def scores(self) -> dict[str, dict[str, Any]]: ...

def fit(
    photographs: _Path | Iterable[_Images],
    values: ArrayLike | _Path | None = None,
    *,
    properties: list[str] | None = None,
    groups: Iterable[Hashable] | None = None,
    materials: list[str] | None = None,
    angles: list[float] | None = None,
    encoder: Encoder | None = None,
    embeddings: ArrayLike | _Path | None = None,
    resize: int | None = 256,
    level: float = 0.9,
    settings: dict[str, Any] | None = None,
    out: _Path | None = None,
    progress: _Progress | None = None,
) -> Fitted: ...
@final
class Run:
    def __new__(cls, path: _Path) -> Run: ...
    @property
    def path(self) -> Path: ...
    @property
    def results(self) -> dict[str, Any]: ...
    def scores(self, rows: str = "properties") -> list[dict[str, Any]]: ...
    def __fspath__(self) -> str: ...
    def predictions(self) -> list[dict[str, Any]]: ...

def experiment(
    config: _Path | dict[str, Any],
    out: _Path,
    *,
    settings: dict[str, Any] | None = None,
    dataset: _Path | None = None,
    fresh: bool = False,
    progress: _Progress | None = None,
) -> Run: ...
@final
class Comparison:
    @property
    def scores(self) -> list[dict[str, Any]]: ...
    def past(self, tolerance: float) -> list[str]: ...

def compare(first: _Path, *others: _Path) -> list[Comparison]: ...
def list_encoders() -> list[dict[str, Any]]: ...
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
    def transform(self, images: _Images) -> NDArray[np.float32]: ...
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
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def low(self) -> NDArray[np.float64]: ...
    @property
    def high(self) -> NDArray[np.float64]: ...

@final
class Answers:
    def __getitem__(self, surface: int, /) -> Answer: ...
    def __iter__(self) -> Iterator[Answer]: ...
    def __len__(self) -> int: ...
    @property
    def values(self) -> NDArray[np.float64]: ...
    @property
    def low(self) -> NDArray[np.float64]: ...
    @property
    def high(self) -> NDArray[np.float64]: ...
    @property
    def familiar(self) -> NDArray[np.float64]: ...

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
        regression: str | dict[str, Any] | None = None,
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
    ) -> Answers: ...
    def predict_embedded(self, embeddings: ArrayLike) -> Answers: ...
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

@overload
def r2(
    y_true: ArrayLike, y_pred: ArrayLike, *, training_mean: float | None = None, details: Literal[False] = False
) -> float: ...
@overload
def r2(
    y_true: ArrayLike, y_pred: ArrayLike, *, training_mean: float | None = None, details: Literal[True]
) -> Score: ...
@overload
def mae(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[False] = False
) -> float: ...
@overload
def mae(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[True]
) -> Score: ...
@overload
def rmse(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[False] = False
) -> float: ...
@overload
def rmse(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[True]
) -> Score: ...
@overload
def median_percent_error(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[False] = False
) -> float: ...
@overload
def median_percent_error(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[True]
) -> Score: ...
@overload
def spearman(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[False] = False
) -> float: ...
@overload
def spearman(
    y_true: ArrayLike, y_pred: ArrayLike, *, details: Literal[True]
) -> Score: ...
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
    y_true: ArrayLike,
    y_pred: ArrayLike,
    *,
    units: ArrayLike | None = None,
    reruns: ArrayLike | None = None,
    training_mean: float | None = None,
    level: float = 0.95,
    test_per_training: float = 0.0,
) -> ScoreInterval: ...
def difference(
    metric: str,
    y_true: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    *,
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

@overload
def coverage(
    y_true: ArrayLike, low: ArrayLike, high: ArrayLike, *, details: Literal[False] = False
) -> float: ...
@overload
def coverage(
    y_true: ArrayLike, low: ArrayLike, high: ArrayLike, *, details: Literal[True]
) -> Coverage: ...
