"""Progress for people: silent when nobody is watching."""

import sys


def say(message: str) -> None:
    """Print a line of progress to standard error, when that is a terminal."""
    if sys.stderr.isatty():
        print(message, file=sys.stderr, flush=True)


class Progress:
    """A line on how much is done of how much, how fast, how long the rest will take,
    and what is best so far: on a terminal, and in a notebook where it was asked for.

    **Arguments:** of `what` there are how many in all, as far as is known, and how many
    are done already; and whether it was asked for, `None` where nobody could.
    """

    def __init__(
        self,
        what: str,
        total: int | None = None,
        done: int = 0,
        asked: bool | None = None,
    ):
        from tqdm import tqdm  # slow to import

        watched = sys.stderr.isatty() or (bool(asked) and _is_notebook(sys.stderr))
        self._bar = tqdm(
            total=total,
            initial=done,
            unit=f" {what}",
            file=sys.stderr,
            disable=asked is False or not watched,
            dynamic_ncols=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._bar.close()

    def show(self, done: int, total: int | None = None, best: str = "") -> None:
        """Say how far it is, unless that was said just now; of how many, where that has
        changed; and what is best so far."""
        if total is not None:
            self._bar.total = total
        if best:
            self._bar.set_postfix_str(f"best {best}", refresh=False)
        if not self._bar.disable:
            self._bar.update(done - self._bar.n)


def _is_notebook(stream: object) -> bool:
    return type(stream).__module__.startswith("ipykernel")
