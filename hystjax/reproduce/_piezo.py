"""Experiment 6: a measured piezo actuator."""

from functools import partial

import jax.numpy as jnp

from .. import datasets
from .._judge import judge
from .._recording import Recording
from ..models import AbstractModel
from ._comparison import Comparison, Row
from ._figures import Side, averaged, published_side, runs, side_by_side
from ._published import (
    REFINED_LAW,
    ROUNDED,
    ROUNDED_LAW,
    coefficient_rows,
    learned,
    percent,
    three_laws,
)

COPIED = {"1": -0.176, "w": -2.388, "u": 0.581, "du": 0.119, "w*|w|": -0.076}
_PUBLISHED = {
    "1": (-0.176, -0.176),
    "w": (-2.38, -2.383),
    "u": (0.58, 0.580),
    "du": (0.12, 0.119),
    "w*|w|": (-0.076, -0.076),
}
_NOTE = (
    "The law is fitted to rows 35001:45001; rows 17500:35000 are unseen. `hystjax "
    "reproduce measured` refines laws of this and other devices."
)


def experiment_6() -> Comparison:
    """Measured piezo actuator, rows 35001:45001, judged on rows 17500:35000 too."""
    own, unseen = piezo(35001, 45001), piezo(17500, 35000)
    law = learned(own, threshold=0.01)
    laws = three_laws(law, COPIED, own, free_start=True)
    script, better = laws[ROUNDED_LAW], laws[REFINED_LAW]
    rounded, later = judge(script, own), judge(script, unseen)
    over_own = float(later.errors["rmse"]) / float(jnp.ptp(own.w))
    rows = (
        *coefficient_rows(law, _PUBLISHED),
        Row("NRMSE, own rows, %", 0.23, None, _nrmse(law, own)),
        Row("  with the script's rounded law", 0.23, 0.2328, percent(rounded, "nrmse")),
        Row("  with the refined law", None, None, _nrmse(better, own)),
        Row("NRMSE, unseen rows 17500:35000, %", None, None, _nrmse(law, unseen)),
        Row("  rounded law, unseen", None, None, percent(later, "nrmse")),
        Row(
            "  rounded law, over the range of the own rows", None, 0.248, 100 * over_own
        ),
        Row("  refined law, unseen", None, None, _nrmse(better, unseen)),
        Row("R2, own rows, rounded law", 0.99, 0.99996, float(rounded.errors["r2"])),
        Row(
            "squared error, own rows, rounded law, %",
            None,
            4.37e-3,
            percent(rounded, "relative_squared_error"),
            percent(rounded, "relative_error"),
        ),
    )
    title = "Experiment 6: measured piezo actuator, u = 150 sin(2 pi t - 46.2)"
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: script}, own, "measured"),
        Side("On unseen rows", unseen, runs(laws, unseen), "measured"),
        draw_errors=averaged(101),
    )
    return Comparison(title, rows, (str(law), ROUNDED, _NOTE), drawing)


def _nrmse(law: AbstractModel, record: Recording) -> float:
    return percent(judge(law, record), "nrmse")


def piezo(start: int, stop: int) -> Recording:
    """Rows of the recording with its input replaced by the fitted sine, as the paper's
    script does."""
    record = datasets.load("piezo_ayala").window(start, stop)
    return record.with_input(_fitted_sine)


def _fitted_sine(t):
    return 150 * jnp.sin(6.28318530724 * t - 46.2178545458)
