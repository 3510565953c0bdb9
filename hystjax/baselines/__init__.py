"""Rivals of sparse laws: plain regressions, networks and an evolutionary fit."""

from ._base import AbstractBaseline as AbstractBaseline, rates as rates
from ._cautious import cautious_lbfgs as cautious_lbfgs
from ._convolutional import FCN as FCN, TCN as TCN
from ._evolution import DifferentialEvolution as DifferentialEvolution
from ._linear import Linear as Linear
from ._mlp import LBFGS as LBFGS, MLP as MLP
from ._neural_law import NeuralLaw as NeuralLaw
from ._recurrent import GRU as GRU, LSTM as LSTM
from ._sequence import (
    AbstractSequenceBaseline as AbstractSequenceBaseline,
    Stage as Stage,
)
from ._sequence_network import SequenceNetwork as SequenceNetwork
