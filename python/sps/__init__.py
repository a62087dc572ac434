"""Teaching cameras to feel: fitted models of touch, image encoders, view selection, metrics.

Photographs become what a touch sensor would measure, with intervals (`fit`, `Estimator`), or embeddings
(`Encoder`), the best few views of many are found (`select_views`), and what a model says is scored
with intervals (`mae`, `interval`, `SplitConformal` and so on). Experiments are run and compared
(`experiment`, `compare`) on datasets that were measured or simulated (`Dataset`, `simulate`).

All of it is the Rust crates' work; long calls leave the interpreter to other threads.
"""

from ._sps import *
from ._sps import __all__ as __all__
