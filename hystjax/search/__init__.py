"""The search for the right terms of a law."""

from ._candidate import (
    Candidate as Candidate,
    frontier as frontier,
    information_criterion as information_criterion,
)
from ._choice import Choice as Choice
from ._ranking import Ranking as Ranking, ranking as ranking, supports as supports
