"""Which family of laws and models suits a record: all that may, judged alike."""

from ._compare import (
    Compared as Compared,
    Comparison as Comparison,
    compare as compare,
)
from ._families import FAMILIES as FAMILIES
