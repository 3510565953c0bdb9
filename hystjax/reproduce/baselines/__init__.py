"""Rivals of sparse laws: plain regressions, networks and an evolutionary fit."""

from ._networks import (
    FCN as FCN,
    GRU as GRU,
    LSTM as LSTM,
    TCN as TCN,
    AbstractSequenceBaseline as AbstractSequenceBaseline,
    SequenceNetwork as SequenceNetwork,
    Stage as Stage,
)
from ._rates import (
    LBFGS as LBFGS,
    MLP as MLP,
    AbstractBaseline as AbstractBaseline,
    DifferentialEvolution as DifferentialEvolution,
    Linear as Linear,
    NeuralLaw as NeuralLaw,
    cautious_lbfgs as cautious_lbfgs,
    rates as rates,
)
