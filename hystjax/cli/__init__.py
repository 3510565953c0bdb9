"""The command line: `hystjax identify | simulate | data | reproduce | demo`."""

from ._main import main as main
