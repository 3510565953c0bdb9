"""Candidate libraries and the terms they are made of."""

from ._kind import Kind as Kind, kind as kind
from ._library import (
    BoucWen as BoucWen,
    Custom as Custom,
    Duhem as Duhem,
    Fourier as Fourier,
    Library as Library,
    Polynomial as Polynomial,
)
from ._term import VARIABLES as VARIABLES, Term as Term
