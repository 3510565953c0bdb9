"""Which family of laws and models suits a record: all that may, judged alike."""

from ._compare import (
    FAMILIES as FAMILIES,
    Compared as Compared,
    Comparison as Comparison,
    compare as compare,
)
