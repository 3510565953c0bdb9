"""The terms of a law, found: what is tried, what decides, and how sure it is."""

from ._discover import discover as discover
from ._inclusion import inclusion as inclusion
from ._suggest import (
    Suggestion as Suggestion,
    suggest_excitation as suggest_excitation,
)
