"""Laws for use elsewhere: plain text, LaTeX, SymPy, and source text of programs."""

from ._c import to_c as to_c
from ._fmu import fmu as fmu
from ._matlab import to_matlab as to_matlab
from ._modelica import to_modelica as to_modelica
from ._numpy import to_numpy as to_numpy
from ._sums import (
    to_latex as to_latex,
    to_python as to_python,
    to_sympy as to_sympy,
    to_text as to_text,
)
