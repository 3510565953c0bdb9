"""The terms of a law, found: what is tried, what decides, and how sure it is."""

from ._complete import Offer as Offer, complete as complete
from ._discover import Discovered as Discovered, discover as discover
from ._evidence import (
    Suggestion as Suggestion,
    inclusion as inclusion,
    suggest_excitation as suggest_excitation,
)
