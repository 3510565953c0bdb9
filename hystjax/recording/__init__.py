"""Recordings: input and output of a device over time, in memory or on disk."""

from ._as_measured import (
    Outliers as Outliers,
    as_group as as_group,
    as_recording as as_recording,
    bridged as bridged,
    outliers as outliers,
    steady as steady,
)
from ._doubts import doubts as doubts
from ._formats import ForcTable as ForcTable, forc_table as forc_table
from ._long import LongRecording as LongRecording
from ._recording import Past as Past, Recording as Recording
