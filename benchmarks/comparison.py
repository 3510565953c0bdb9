"""Every family on a record, and the search for a law, beside one fit of one law."""

import hystjax as hj

from . import _problem
from ._results import Table
from ._timing import Contestant, Effort, race
from .refine import long_by_scipy


def run(effort: Effort) -> tuple[Table]:
    """The piezo's 10 000 samples, as a newcomer gives them."""
    record = _problem.recording()
    ours = "hystjax.compare"
    calls = {
        ours: lambda: hj.compare(record),
        "hystjax.discover": lambda: hj.discover(record, hj.library.Polynomial(2)),
        "scipy least_squares over odeint, one law": lambda: long_by_scipy(record, True),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    compared = timings[ours].result
    notes = (
        f"{len(compared.rows)} families, each fitted without each of "
        f"{len(compared.best.blocks)} blocks and to all, and {len(compared.left_out)} "
        f"that do not suit; first {compared.best.family} with "
        f"{100 * compared.best.error:.3g} % on blocks",
        "SciPy is given the five terms, a start near the minimum and u as a sine; "
        "discover finds terms; compare finds a law and fits every other family too",
    )
    return (Table("Every family on a record of 10 000 samples", ours, timings, notes),)
