"""A device made to follow a reference: feedforward, feedback, and learning."""

from ._control import Tracking as Tracking, control as control
from ._schemes import PID as PID, Learning as Learning
