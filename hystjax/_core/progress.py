"""Progress for people: silent when nobody is watching."""

import sys
import time
from collections.abc import Callable

_EVERY = 0.2  # s between two lines


def say(message: str, end: str = "\n") -> None:
    """Print a line of progress to standard error, when that is a terminal."""
    if sys.stderr.isatty():
        print(message, end=end, file=sys.stderr, flush=True)


class Meter:
    """One line on how much is done, how fast, and how long the rest will take.

    **Arguments:** how many there are of `what` in all, how many are done already, and
    the clock, which tells s.
    """

    def __init__(
        self,
        what: str,
        total: int,
        done: int = 0,
        *,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._what, self._total, self._first, self._clock = what, total, done, clock
        self._begun = self._shown = clock()

    def show(self, done: int) -> None:
        """Say how far it is, unless that was said just now and there is more to do."""
        now = self._clock()
        if done < self._total and now - self._shown < _EVERY:
            return
        self._shown = now
        # Back to the start of the line: the next call overwrites this one.
        say(self._line(done, now - self._begun), "\n" if done >= self._total else "\r")

    def _line(self, done: int, taken: float) -> str:
        rate = (done - self._first) / taken if taken > 0 else 0.0
        left = f", {_duration((self._total - done) / rate)} left" if rate > 0 else ""
        return f"{done} of {self._total} {self._what}, {rate:.3g} a second{left}   "


def _duration(seconds: float) -> str:
    """Hours, minutes and seconds."""
    minutes, s = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {s:02d} s" if minutes else f"{s} s"
