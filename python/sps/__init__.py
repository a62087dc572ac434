"""Teaching cameras to feel: fitted models of touch, image encoders, view selection, metrics.

Photographs become what a touch sensor would measure, with intervals (`Estimator`), or embeddings
(`Encoder`), the best few views of many are found (`select_views`), and what a model says is scored
with intervals (`mae`, `interval`, `SplitConformal` and so on). Runs of `cargo xtask experiment` are
read by `read_results` and `read_predictions`.

All of it is the Rust crates' work; long calls leave the interpreter to other threads.
"""

from ._runs import read_predictions, read_results
from ._sps import (
    Answer,
    Coverage,
    Encoder,
    Estimate,
    Estimator,
    GroupConformal,
    Looked,
    Score,
    ScoreInterval,
    Selection,
    Session,
    SplitConformal,
    UndefinedScore,
    __version__,
    coverage,
    difference,
    holm,
    interval,
    mae,
    median_percent_error,
    r2,
    r2_own_mean,
    rmse,
    select_views,
    spearman,
)

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
    "read_predictions",
    "read_results",
    "rmse",
    "select_views",
    "spearman",
]
