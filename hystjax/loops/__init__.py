"""Loops as engineers read them: turning points, cycles, their numbers, backbones,
losses, and first-order reversal curves."""

from ._backbone import (
    Backbone as Backbone,
    Bilinear as Bilinear,
    Eeep as Eeep,
    backbone as backbone,
    bilinear as bilinear,
    eeep as eeep,
)
from ._corrections import (
    centred as centred,
    in_si as in_si,
    without_demagnetisation as without_demagnetisation,
    without_drift as without_drift,
    without_slope as without_slope,
)
from ._creep import creep as creep
from ._cycles import Rainflow as Rainflow, cycles as cycles, rainflow as rainflow
from ._fits import Fit as Fit
from ._forc import Forc as Forc, Varying as Varying, forc as forc
from ._forc_files import Curves as Curves, read_forc as read_forc
from ._forc_model import left_out as left_out, preisach as preisach
from ._losses import (
    core_loss as core_loss,
    separate as separate,
    steinmetz as steinmetz,
)
from ._reversals import Reversals as Reversals, reversals as reversals
from ._summary import side_by_side as side_by_side, summary as summary, table as table
