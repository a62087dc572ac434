"""Teaching cameras to feel: image encoders, view selection, and metrics with intervals.

Photographs become embeddings (`Encoder`), the best few views of many are found (`select_views`), and
what a model says is scored with intervals (`mae`, `Bootstrap`, `SplitConformal` and so on). Runs of
`cargo xtask experiment` are read by `read_results` and `read_predictions`.

All of it is the Rust crates' work; long calls leave the interpreter to other threads.
"""

from ._runs import read_predictions, read_results
from ._sps import (
    Bootstrap,
    BootstrapInterval,
    Coverage,
    Encoder,
    GroupConformal,
    Score,
    Selection,
    SplitConformal,
    UndefinedScore,
    __version__,
    coverage,
    mae,
    median_percent_error,
    r2,
    r2_own_mean,
    rmse,
    select_views,
    spearman,
)

__all__ = [
    "Bootstrap",
    "BootstrapInterval",
    "Coverage",
    "Encoder",
    "GroupConformal",
    "Score",
    "Selection",
    "SplitConformal",
    "UndefinedScore",
    "__version__",
    "coverage",
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
