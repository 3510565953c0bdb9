"""Progress for people: silent when nobody is watching."""

import sys


def say(message: str) -> None:
    """Print a line of progress to standard error, when that is a terminal."""
    if sys.stderr.isatty():
        print(message, file=sys.stderr, flush=True)
