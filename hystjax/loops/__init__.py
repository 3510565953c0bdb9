"""Loops as engineers read them: turning points, cycles, their numbers, backbones,
losses, and first-order reversal curves."""

from ._corrections import (
    centred as centred,
    in_si as in_si,
    without_demagnetisation as without_demagnetisation,
    without_drift as without_drift,
    without_slope as without_slope,
)
from ._fits import (
    Backbone as Backbone,
    Bilinear as Bilinear,
    Eeep as Eeep,
    Fit as Fit,
    backbone as backbone,
    bilinear as bilinear,
    core_loss as core_loss,
    creep as creep,
    eeep as eeep,
    separate as separate,
    steinmetz as steinmetz,
)
from ._forc import (
    Forc as Forc,
    Varying as Varying,
    forc as forc,
    left_out as left_out,
    preisach as preisach,
    read_forc as read_forc,
)
from ._reversals import (
    Rainflow as Rainflow,
    Reversals as Reversals,
    cycles as cycles,
    rainflow as rainflow,
    reversals as reversals,
)
from ._summary import side_by_side as side_by_side, summary as summary, table as table
from ._surface import Curves as Curves
