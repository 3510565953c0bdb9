"""Recordings: input and output of a device over time, in memory or on disk."""

from ._arguments import as_recording as as_recording
from ._forc import ForcTable as ForcTable, forc_table as forc_table
from ._gaps import bridged as bridged
from ._long import LongRecording as LongRecording
from ._outliers import Outliers as Outliers, outliers as outliers
from ._recording import Recording as Recording
from ._steady import steady as steady
