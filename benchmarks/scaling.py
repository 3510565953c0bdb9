"""How times grow with samples, terms, lanes and devices."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace

from . import _climbs, refinements
from ._alone import process
from ._curves import Curves
from ._machine import cores
from ._timing import FULL, Contestant, Effort, race
from ._units import spaced

_SAMPLES = (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
_TERMS = (6, 21, 56, 126, 252)
_LANES = (1, 10, 100, 1000, 10_000, 100_000)
_DEVICES = (1, 2, 4)
_JOBS = {
    "simulations": (_climbs.areas, 100_000),
    "refinements": (refinements.swept, 2000),
}
_LONGEST = 0.5  # s that a call may take whose problem is made ten times as large


def run(effort: Effort) -> tuple[Curves, ...]:
    """A curve for each that takes part; quick, the second size alone."""
    sizes = slice(None) if effort is FULL else slice(1, 2)
    share = 1 if effort is FULL else 100
    effort = replace(
        effort, rounds=min(effort.rounds, 5), patience=effort.patience / 10
    )
    climbs = (
        (_climbs.over_samples(), _SAMPLES),
        (_climbs.over_terms(), _TERMS),
        (_climbs.many_fits(), _LANES[:-1]),
        (_climbs.many_simulations(), _LANES),
        (_climbs.many_refinements(), _LANES[:-1]),
    )
    curves = [climb.timed(over[sizes], effort, _LONGEST) for climb, over in climbs]
    return (*curves, _over_devices(_DEVICES[sizes], share, effort))


def _over_devices(counts: Sequence[int], share: int, effort: Effort) -> Curves:
    """The same sweeps on ever more devices, each count in a process of its own."""
    jobs = {
        f"hystjax.sweep, {spaced(lanes // share)} {what}": (job, lanes // share)
        for what, (job, lanes) in _JOBS.items()
    }
    with ExitStack() as stack:
        contestants = {}
        for count in counts:
            alone = stack.enter_context(process(count))
            for name, (job, lanes) in jobs.items():
                contestants[name, count] = Contestant(_waiting(alone, job, lanes))
        timings = race(contestants, effort)
    points = {
        count: {name: replace(timings[name, count], result=None) for name in jobs}
        for count in counts
    }
    notes = (
        "the devices are shares of one processor, as if it were several; of it "
        f"{cores()} core(s) were to be had",
    )
    return Curves("Sweeps on several devices", "devices", points, notes)


def _waiting(alone, job, count):
    return lambda: alone.submit(job, count).result()
