"""Turning points of long records, and diagrams of reversal curves beside PmagPy's."""

import numpy as np

import hystjax as hj
from hystjax.loops._surface import steps_of, surface

from ._agreement import agreed
from ._results import Table
from ._timing import QUICK, Contestant, Effort, Timing, race

_STEP = 5e-4  # T
_SPAN = 5  # steps, half axes of the ellipse
_EQUAL = "hystjax, equal weights"
_TRICUBE = "hystjax, tricube weights"
_THEIRS = "pmagpy loess_rho_from_grid_fast"


def run(effort: Effort) -> tuple[Table, ...]:
    """Reversals by the number of samples, and densities at the same places."""
    return _reversals(effort), *_densities(effort), _diagram(effort)


def _reversals(effort: Effort) -> Table:
    sizes = (10_000, 100_000) if effort == QUICK else (100_000, 1_000_000, 10_000_000)
    rng = np.random.default_rng(0)
    contestants = {}
    for n in sizes:
        t = 0.01 * np.arange(n)
        u = np.sin(t) + 0.05 * rng.standard_normal(n)
        record = hj.Recording(t, u, u)
        contestants[f"hystjax.loops.reversals, {n} samples"] = Contestant(
            lambda record=record: hj.loops.reversals(record), pieces=n
        )
    timings = race(contestants, effort)
    turns = [len(timing.result) for timing in timings.values()]
    wanted = [int(0.01 * n / np.pi + 0.5) for n in sizes]
    missed = max(abs(a - b) for a, b in zip(turns, wanted, strict=True))
    longest = max(timing.median * timing.pieces for timing in timings.values())
    notes = (
        agreed("turning points, whose ends may count,", float(missed), 1),
        f"the longest record takes {longest:.2f} s; other times are a sample's",
    )
    return Table("Turning points under noise", next(iter(timings)), timings, notes)


def _device(n: int):
    """Reversal and other fields of a regular grid, and moments with noise where they
    can be measured."""
    ha, hb = -_STEP * np.arange(n)[::-1], _STEP * (np.arange(2 * n) - n + 1)
    width = n * _STEP / 8
    down = (1 - np.tanh((ha[:, None] + 3 * width) / width)) / 2
    moment = 1 - down * (1 - np.tanh((hb - 3 * width) / width))
    moment += 1e-3 * np.random.default_rng(0).standard_normal(moment.shape)
    moment[hb < ha[:, None] - _STEP / 2] = np.nan
    return ha, hb, moment


def _sediment() -> hj.loops.Curves:
    return hj.loops.read_forc(hj.datasets.path("forc_md00") / "MD00-2361")


def on_even_fields(curves: hj.loops.Curves):
    """Measured curves as such a grid: each read by straight lines at even fields from
    its first on, and their reversal fields taken to be as even."""
    n, step = len(curves), steps_of(curves)[1]
    fields, moments = (
        np.split(each, curves.starts[1:-1]) for each in (curves.field, curves.moment)
    )
    counts = [int(np.ptp(field) / step) + 1 for field in fields]
    moment = np.full((n, n + max(counts)), np.nan)
    for i, count in enumerate(counts):
        even = fields[i][0] + step * np.arange(count)
        moment[i, i : i + count] = np.interp(even, fields[i], moments[i])
    return step * np.arange(n), step * np.arange(n + max(counts)), moment


def _densities(effort: Effort) -> tuple[Table, Table]:
    n, sediment = 250, _sediment()
    if effort == QUICK:
        n, sediment = 40, sediment.pick(range(40))
    return (
        _density("simulated reversal curves", *_device(n), effort),
        _density(
            "curves of forc_md00, read at even fields,",
            *on_even_fields(sediment),
            effort,
        ),
    )


def _density(name: str, ha, hb, moment, effort: Effort) -> Table:
    from pmagpy import forc  # imports much

    span = _SPAN * (hb[1] - hb[0])
    spans = {"span_Ha_T": span, "span_Hb_T": span}
    known = np.isfinite(forc.loess_rho_from_grid_fast(ha, hb, moment, **spans))
    curves = hj.loops.Curves([(hb[~np.isnan(m)], m[~np.isnan(m)]) for m in moment])
    a, b = np.meshgrid(ha, hb, indexing="ij")
    places = a[known], b[known], np.full(known.sum(), _SPAN - 0.5)
    calls = {
        _EQUAL: lambda: -surface(curves, *places).mixed / 2,
        _TRICUBE: lambda: -surface(curves, *places, tricube=True).mixed / 2,
        _THEIRS: lambda: forc.loess_rho_from_grid_fast(ha, hb, moment, **spans)[known],
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    theirs = timings[_THEIRS].result
    apart = np.max(np.abs(timings[_TRICUBE].result - theirs)) / np.max(theirs)
    notes = (
        agreed("densities with tricube weights, of the peak,", float(apart), 1e-9),
        _ratio(timings, _EQUAL),
        _ratio(timings, _TRICUBE),
        "hystjax finds standard errors as well",
    )
    title = f"Densities of {len(curves)} {name} at {known.sum()} places"
    return Table(title, _EQUAL, timings, notes)


def _ratio(timings: dict[str, Timing], ours: str) -> str:
    factor = timings[_THEIRS].median / timings[ours].median
    return f"{_THEIRS} takes {factor:.1f} times as long as {ours}"


def _diagram(effort: Effort) -> Table:
    curves = _sediment()
    calls = {
        "hystjax.loops.forc, smoothing 5": lambda: hj.loops.forc(curves, smoothing=5),
        "hystjax.loops.forc, smoothing chosen": lambda: hj.loops.forc(curves),
        "hystjax.loops.preisach": lambda: hj.loops.preisach(curves).weights,
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    chosen = timings["hystjax.loops.forc, smoothing chosen"].result
    notes = (
        f"{len(curves)} curves, {len(curves.field)} points",
        f"chosen: {np.nanmax(chosen.smoothing):g}",
    )
    return Table("The diagram of forc_md00", next(iter(timings)), timings, notes)
