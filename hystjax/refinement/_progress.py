"""Steps of a fit, for people who wait."""

import sys
from typing import Any

import equinox as eqx
import jax

from .._errors import InputError


def watched(solver: Any) -> Any:
    """An Optimistix solver that prints its step and loss on one line of standard error,
    where that is a terminal.

    **Raises:** `InputError` for a solver without steps to watch.
    """
    if not sys.stderr.isatty():
        return solver
    if not hasattr(solver, "verbose"):
        raise InputError(
            f"`progress` needs a solver with steps to show, and {type(solver).__name__}"
            " has none; leave it out."
        )
    return eqx.tree_at(lambda each: each.verbose, solver, _show)


def _show(*, num_steps, loss_this_step, **_) -> None:
    jax.debug.callback(_print, num_steps[1], loss_this_step[1])


def _print(step, loss) -> None:
    # Back to the start of the line: the next step overwrites this one.
    print(f"step {int(step)}: loss {float(loss):.6g} ", end="\r", file=sys.stderr)
