"""A device made to follow a reference: feedforward, feedback, and learning."""

from ._control import (
    PID as PID,
    Learning as Learning,
    Tracking as Tracking,
    control as control,
)
