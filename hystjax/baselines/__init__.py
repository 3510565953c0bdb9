"""Rivals of sparse laws: plain regressions and networks, fitted to the same rows."""

from ._base import AbstractBaseline as AbstractBaseline, rates as rates
from ._cautious import cautious_lbfgs as cautious_lbfgs
from ._linear import Linear as Linear
from ._mlp import LBFGS as LBFGS, MLP as MLP
from ._neural_law import NeuralLaw as NeuralLaw
