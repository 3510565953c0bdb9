"""Rivals of sparse laws: plain regressions, networks and an evolutionary fit."""

from ._base import (
    AbstractBaseline as AbstractBaseline,
    DifferentialEvolution as DifferentialEvolution,
    Linear as Linear,
    rates as rates,
)
from ._mlp import (
    LBFGS as LBFGS,
    MLP as MLP,
    NeuralLaw as NeuralLaw,
    cautious_lbfgs as cautious_lbfgs,
)
from ._networks import (
    FCN as FCN,
    GRU as GRU,
    LSTM as LSTM,
    TCN as TCN,
    AbstractSequenceBaseline as AbstractSequenceBaseline,
    SequenceNetwork as SequenceNetwork,
    Stage as Stage,
)
