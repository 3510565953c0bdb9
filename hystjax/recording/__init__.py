"""Recordings: input and output of a device over time, in memory or on disk."""

from ._long import LongRecording as LongRecording
from ._outliers import Outliers as Outliers, outliers as outliers
from ._recording import Recording as Recording
