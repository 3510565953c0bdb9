"""The source paper's experiments, rerun."""

from ._comparison import Comparison as Comparison, Row as Row
from ._experiments import (
    EXPERIMENTS as EXPERIMENTS,
    published_settings as published_settings,
    reproduce as reproduce,
)
from ._records import (
    bouc_wen_sine as bouc_wen_sine,
    duhem_growing_sine as duhem_growing_sine,
)
