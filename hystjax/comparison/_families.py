"""Every family that may suit a record, and how each is fitted to it: without each block
and to all samples.

Models of the value that are linear in their coefficients (curves of the input, plays,
stops and lags, side by side or in series) are one linear fit a block. Models that flow,
and others that are not linear in their numbers, are fitted by trajectory matching:
without each block and to all samples, side by side in one program.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .. import models, refinement
from .._core.checks import ComputationError, InputError
from .._core.compiling import changed, jit
from ..discovery import Discovered, discover
from ..discovery._layout import KEPT, NONE, Layout, layout, refined_without
from ..least_squares import solution
from ..library import Lag, Library, Play, Plays, Polynomial, Stop, Term
from ..models import AbstractModel, Everett, PrandtlIshlinskii, SparseModel, compacted
from ..models._preisach import closer, signals_of
from ..recording import Recording
from ..refinement import LevenbergMarquardt, Samples
from ..refinement._certainty import enough_steps, step_error
from ..refinement._refine import fades
from ..simulation import FixedStep, metrics, simulate


class Case(NamedTuple):
    """Recordings of one device, the weights of their samples if these are not even, and
    how they are laid out in blocks."""

    group: tuple[Recording, ...]
    weights: Sequence[Float[Array, " _n"]] | None
    layout: Layout

    @property
    def clocked(self) -> bool:
        """Whether times are known."""
        return all(each.clocked for each in self.group)

    def check_clock(self) -> None:
        """That times are known.

        **Raises:** `InputError` if they are not.
        """
        if not self.clocked:
            raise InputError(
                "it depends on the rate, and the recordings have no clock."
            )

    @property
    def substeps(self) -> int:
        """Integration steps between samples."""
        return self.layout.samples.substeps

    @property
    def widest(self) -> Recording:
        """That whose input goes farthest, which shows most of a device, from the first
        to the last of its outputs that have a weight: beyond these none is known."""
        seen = self.group
        if self.weights is not None:
            known = [np.flatnonzero(each > 0).tolist() for each in self.weights]
            pairs = zip(self.group, known, strict=True)
            seen = [each.window(rows[0], rows[-1] + 1) for each, rows in pairs]
        return max(seen, key=lambda each: float(jnp.ptp(each.u)))

    def padded(
        self, each: Sequence[Float[ArrayLike, "_n k"]]
    ) -> Float[np.ndarray, "r n k"]:
        """Columns along each recording, zero where it is shorter than others."""
        rows = [np.asarray(columns) for columns in each]
        whole = np.zeros((*self.layout.samples.w.shape, rows[0].shape[1]))
        for row, columns in zip(whole, rows, strict=True):
            row[: len(columns)] = columns
        return whole

    def errors(self, outputs: Float[np.ndarray, "b r n"]) -> Float[np.ndarray, " b"]:
        """The errors of fits: of those that each left out a block, on that block; of
        the last, to all samples, on all. Root mean squares, by the weights, of
        residuals over the range of their recording."""
        samples, blocks = self.layout.samples, np.asarray(self.layout.blocks)
        w, weight = np.asarray(samples.w), np.asarray(samples.weight)
        known = weight > 0
        ranges = np.array([float(jnp.ptp(each.w)) for each in self.group])
        judged = [known & (blocks == block) for block in range(len(outputs) - 1)]
        # Where recordings count by their range, one over it, samples count alike.
        scale = weight * ranges[:, None] ** 2
        with np.errstate(over="ignore"):
            squares = weight * (outputs - w) ** 2
            means = [
                np.sum(s[at]) / np.sum(scale[at])
                for s, at in zip(squares, [*judged, known], strict=True)
            ]
        errors = np.sqrt(means)
        return np.where(np.isfinite(errors), errors, np.inf)

    def with_steps(self, substeps: int) -> "Case":
        """The same with so many integration steps between samples."""
        if substeps == self.substeps:
            return self
        laid_out = layout(self.group, self.weights, substeps, True)
        return self._replace(layout=laid_out)


class Fit(NamedTuple):
    """A family fitted: the model fitted to all samples; the outputs of those fitted
    without each block, and of the model itself, shape (blocks + 1, R, n); how many
    numbers were fitted; the case, with the steps that there were; and what is to be
    said."""

    model: AbstractModel
    outputs: Float[np.ndarray, "b r n"]
    numbers: int
    case: Case
    note: str = ""


# Of operators, over the range of the input: dense at first, where loops are narrow.
_RADII = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.27, 0.35, 0.42)
_STOPS = (0.05, 0.12, 0.25, 0.4)
_MANY_RADII = 80  # of which the best pair is a start; from fewer other minima are near
_CREEP = (1 / 60, 1 / 4)  # times of slow lags, over the longest recording
# Times of fast lags, over what the input takes to run through its range.
_LAGS = (0.02, 0.06, 0.1, 0.2)
_SETTLES = 2.0  # times as much is missed where a device still settles
_SPOILT = 1.2  # times as much is missed of the others by a fit that sees that
_SAID = "fitted without the first stretch, in which the device still settles"
_NOTHING = 1e-9  # of the output's range
# Singular values over the largest, below which columns depend on others: a cubic of an
# input with an offset of 10 000 times its range still does not.
_RANK = 1e-13

_CONSTANT = Library((Term(),))
_CUBIC = tuple(Term.parse(name) for name in ("u", "u^2", "u^3"))


def curve(case: Case) -> Fit:
    """A cubic of the input, without memory: what memory is to be better than."""
    return _best(case, [_CONSTANT + Library(_CUBIC)])


def plays(case: Case) -> Fit:
    """Plays beside a cubic of the input."""
    radii = _of_range(case, _RADII)
    return _best(case, [_CONSTANT + Library(_CUBIC) + Play(radii)])


def creep(case: Case) -> Fit:
    """Plays and a cubic of the input, and slow lags of it beside them."""
    radii = _of_range(case, _RADII)
    stack = _CONSTANT + Library(_CUBIC) + Play(radii)
    return _best(case, [stack + Lag(_slow(case))])


def behind_a_lag(case: Case) -> Fit:
    """Plays and a cubic of the input, all behind one lag, and slow lags beside them."""
    first, *others = _fast(case)
    lag = Lag([first])
    library = _CONSTANT + lag + lag * lag + lag * lag * lag
    for radius in _of_range(case, _RADII):
        library = library + Lag([first], of=f"play(u,{radius!r})")
    times = [name for name in library.numbers if name.endswith(".time")]
    library = library + Lag(_slow(case))
    # With other numbers under the same names: one program for all.
    return _best(
        case,
        [library, *(library.with_numbers(dict.fromkeys(times, x)) for x in others)],
    )


def stops(case: Case) -> Fit:
    """Springs that slide, each with a static curve: stops and their cubes; beside a
    spring, and with a clock a viscous term."""
    library = _CONSTANT + Library(_CUBIC[:1])
    if case.clocked:
        library = library + Library((Term.parse("du"),))
    return _best(case, [_and_sliding(library, _of_range(case, _STOPS))])


def two_stops(case: Case) -> Fit:
    """Two springs that slide, each with a static curve, of radii that are refined from
    the best pair of many: errors have minima wherever a radius comes by the amplitude
    of a cycle."""
    shares = np.linspace(0, 0.5, _MANY_RADII + 1)[1:]
    radii = np.array(_of_range(case, shares.tolist()))
    columns = case.padded([_sliding(radii, recording) for recording in case.group])
    rows = np.concatenate([*_triangles(case, columns).values()])
    triangle = np.asarray(np.linalg.qr(rows, mode="r"))

    def fit(pair):
        springs = (row for i in pair for row in (1 + i, 1 + len(radii) + i))
        return _solved([triangle[:, [0, *springs, -1]]])

    pair = min(itertools.combinations(range(len(radii)), 2), key=lambda x: fit(x)[1])
    library = _and_sliding(_CONSTANT, radii[[*pair]].tolist())
    return _matched(case, _law_of(case, library, fit(pair)[0]))


def _sliding(
    radii: Float[np.ndarray, " r"], recording: Recording
) -> Float[np.ndarray, "n _k"]:
    """A constant, stops, and their cubes."""
    plays = np.asarray(signals_of(Plays(jnp.asarray(radii)), recording))
    stops = np.asarray(recording.u)[:, None] - plays
    return np.column_stack([np.ones(len(stops)), stops, stops**3])


def _and_sliding(library: Library, radii: Sequence[float]) -> Library:
    """And springs that slide, each with a static curve: stops and their cubes."""
    for radius in radii:
        stop = Stop([radius])
        library = library + stop + stop * stop * stop
    return library


def prandtl_ishlinskii(case: Case) -> Fit:
    """Plays of radii that are read off the record, which leaves their weights."""
    first = PrandtlIshlinskii.guess(case.widest)
    found = _linear(case, [case.padded([_plays(first, r) for r in case.group])])
    offset, weights = found.coefficients[0], found.coefficients[1:]
    model = eqx.tree_at(
        lambda each: (each.offset, each.weights),
        first,
        (jnp.asarray(offset), jnp.asarray(weights)),
    )
    return Fit(model, found.outputs, len(found.coefficients), case, found.note)


def _plays(model: PrandtlIshlinskii, recording: Recording) -> Float[np.ndarray, "n k"]:
    plays = np.asarray(signals_of(model.memory, recording))
    return np.column_stack([np.ones(len(plays)), plays])


def everett(case: Case) -> Fit:
    """Preisach's operator, whose density has one sign; of an output that leads, with a
    curve beside it: all samples tell which."""
    kinds, layout = Everett.kinds(case.widest), case.layout
    samples, blocks = layout.samples, np.asarray(layout.blocks)
    columns = [case.padded([k.columns(each) for each in case.group]) for k in kinds]
    every = [jnp.asarray(each.reshape(-1, each.shape[-1])) for each in columns]
    w = samples.w.ravel()
    model, flat = closer(kinds, every, w, samples.weight.ravel())
    fits = []
    for block in range(layout.count):
        weight = jnp.where(blocks == block, 0.0, samples.weight).ravel()
        fits.append(model.fitted(flat, w, weight))
    outputs = [
        np.asarray(each.weighed(flat)).reshape(samples.w.shape)
        for each in (*fits, model)
    ]
    numbers = int(jnp.sum(model.roots > 0)) + 1
    if model.curve is not None:
        numbers += int(jnp.sum(model.curve != 0))
    return Fit(model.fitted_to(case.group), np.stack(outputs), numbers, case)


def _of_range(case: Case, shares: Sequence[float]) -> list[float]:
    """Radii of operators on the input."""
    inputs = [np.asarray(each.u) for each in case.group]
    span = max(u.max() for u in inputs) - min(u.min() for u in inputs)
    return [float(span * share) for share in shares]


def _slow(case: Case) -> list[float]:
    case.check_clock()
    longest = max(float(each.t[-1] - each.t[0]) for each in case.group)
    return [longest * share for share in _CREEP]


def _fast(case: Case) -> list[float]:
    widest = case.widest
    u, t = np.asarray(widest.u), np.asarray(widest.t)
    through = np.ptp(u) * (t[-1] - t[0]) / np.sum(np.abs(np.diff(u)))
    return [float(through * share) for share in _LAGS]


def _best(case: Case, libraries: Sequence[Library]) -> Fit:
    """The law over one of several libraries: that which follows best what each fit
    sees, so that a block that is left out has no say in which."""
    columns = [
        case.padded([_columns(library, recording) for recording in case.group])
        for library in libraries
    ]
    found = _linear(case, columns)
    library = libraries[found.chosen].settled()
    law = _law_of(case, library, found.coefficients)
    times = len(libraries) > 1  # one of these is a number that is fitted, too
    return Fit(law, found.outputs, len(library) + times, case, found.note)


def _law_of(
    case: Case, library: Library, coefficients: Float[np.ndarray, " k"]
) -> SparseModel:
    """A law of the value, of all terms."""
    named = case.group[0]
    return SparseModel(
        library,
        jnp.asarray(coefficients),
        np.ones(len(library), bool),
        target="value",
        names=named.names,
        units=named.units,
    )


def _linear(case: Case, columns: Sequence[Float[np.ndarray, "r n k"]]) -> "_Followed":
    """Linear fits of the one of several sets of columns that follows best.

    A stack knows nothing of the past before a recording, and cannot follow a device
    that still settles from it. Where a first stretch, which is none of the blocks, is
    missed by far more than the others even by a fit that sees it, and spoils that for
    them, no fit sees it. A sine that decays only goes farther there: that can be
    followed.
    """
    triangles = [_triangles(case, each) for each in columns]
    samples, blocks = case.layout.samples, np.asarray(case.layout.blocks)
    known = np.asarray(samples.weight) > 0
    first = known & (blocks == KEPT)
    rest = known & ~first
    whole = _followed(columns, triangles, unseen=set())
    if not first.any():
        return whole
    later = _followed(columns, triangles, unseen={KEPT})
    seen, unseen = (np.asarray(samples.w) - x.outputs[-1] for x in (whole, later))
    others, nothing = _size(seen[rest]), _NOTHING * float(samples.spread)
    far_off = _size(seen[first]) > max(_SETTLES * others, nothing)
    settling = far_off and others > _SPOILT * _size(unseen[rest])
    return later._replace(note=_SAID) if settling else whole


def _size(missed: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(missed**2)))


class _Followed(NamedTuple):
    """Which columns are best in a fit to all, with what coefficients; the outputs of
    the best without each block, and to all; and what is to be said."""

    chosen: int
    coefficients: Float[np.ndarray, " k"]
    outputs: Float[np.ndarray, "b r n"]
    note: str = ""


def _followed(columns, triangles, unseen: set[int]) -> _Followed:
    """Linear fits by each set of columns, without each block and to all, and in any
    case without blocks that are `unseen`."""
    outputs = []
    for block in (*sorted(triangles[0].keys() - {KEPT}), None):
        fits = [
            _solved([each[b] for b in each if b != block and b not in unseen])
            for each in triangles
        ]
        chosen = int(np.argmin([left for _, left in fits]))
        coefficients, _ = fits[chosen]
        outputs.append(columns[chosen] @ coefficients)
    return _Followed(chosen, coefficients, np.stack(outputs))


def _triangles(
    case: Case, columns: Float[np.ndarray, "r n k"]
) -> dict[int, Float[np.ndarray, "_m _k"]]:
    """What a linear fit has to know of each block: the triangle of its weighted columns
    and, last, the output."""
    samples, blocks = case.layout.samples, np.asarray(case.layout.blocks)
    root = np.sqrt(np.asarray(samples.weight))[..., None]
    rows = root * np.concatenate([columns, np.asarray(samples.w)[..., None]], axis=-1)
    numbers = (KEPT, *range(case.layout.count))
    return {
        each: np.asarray(np.linalg.qr(rows[blocks == each], mode="r"))
        for each in numbers
    }


def _solved(triangles) -> tuple[Float[np.ndarray, " k"], float]:
    """Coefficients of least squares, and the squares that are left."""
    rows, target = np.hsplit(np.concatenate(triangles), [-1])
    coefficients = solution(rows, target.ravel(), _RANK)
    return coefficients, float(np.sum((rows @ coefficients - target.ravel()) ** 2))


@jit
def _columns(library: Library, recording: Recording) -> Float[Array, "n k"]:
    u, du = recording.path.samples()
    return library(recording.w, u, du, library.signals(recording.path))


_SOLVER, _STEPS = LevenbergMarquardt(rtol=1e-5), 30
_LOST = 0.3  # of the output's range, beyond which a guess is none
_AWAY = 100.0  # of that range, beyond which it does not matter how far
_MOST = 0.4  # of what a guess misses is left at most by an offset that is one
_MOVED = "fitted with an offset of the output, `output_offset`"
_MANY = 8  # times as many steps
_FADING = 0.1  # as `discover` asks of laws


def law(case: Case) -> Fit:
    """A sparse law of first order, as `discover` chooses it."""
    found = Discovered.of(
        discover(case.group, Polynomial(2), weights=case.weights, throw=False)
    )
    said = f"`discover` says: {found.why}"  # and names options of its own
    if found.refined is None:  # there is no law
        raise ComputationError(said)
    case = case.with_steps(found.refined.substeps)
    return _matched(case, compacted(found.value), said, _FADING)


def guessed(guess: Callable[[Recording], AbstractModel]) -> Callable[[Case], Fit]:
    """A model from what it guesses of the record that goes farthest, behind an offset
    of the output where that has one."""

    def fit(case: Case) -> Fit:
        model = guess(case.widest)
        offset = _offset(model, case)
        if offset is None:
            return _matched(case, model)
        moved = models.Instrumented(
            model, output_offset=offset, names=model.names, units=model.units
        )
        return _matched(case, moved, _MOVED)

    return fit


def _offset(model: AbstractModel, case: Case) -> float | None:
    """The constant that a guess misses the output by, if that is most of what it
    misses. The guess is to be near enough to be worth a fit, which takes far longer.

    **Raises:** `InputError` unless it is.
    """
    substeps = case.substeps
    missed, offset = _missed(model, case.widest, substeps)
    if not missed < 1:  # it may have been for want of steps
        substeps *= _MANY
        missed, offset = _missed(model, case.widest, substeps)
    found, missed = None, missed if missed < np.inf else np.inf
    # It begins elsewhere then, and may be off by another constant. From far off a run
    # may tell none, or one that fades.
    w = np.asarray(case.widest.w)
    middle = float(w.max() + w.min()) / 2
    for first in ([offset] if missed < _AWAY else []) + [middle]:
        rest, more = _missed(model, case.widest, substeps, first)
        if rest < _MOST * missed:
            missed, found = rest, first + more
    if not missed < _LOST:
        by = f"misses the output by {100 * missed:.0f} % of its range"
        if not missed < _AWAY:
            by = "runs away from the output"
        raise InputError(
            f"what it guesses {by}: a device of another kind, or an input or output "
            "that is not centred; see `hystjax.loops.centred`."
        )
    return found


def _missed(
    model: AbstractModel, record: Recording, substeps: int, offset: float = 0.0
) -> tuple[float, float]:
    """By how much a free run misses an output less an offset: over its range, and in
    the mean."""
    record = changed(record, w=record.w - offset)
    run = simulate(model, record, method=FixedStep(substeps), throw=False)
    mean = float(jnp.mean(record.w - run.w))
    return float(metrics.nrmse(record.w, run.w)), mean


def _matched(case: Case, model: AbstractModel, note="", fading=0.0) -> Fit:
    """A model refined without each block and to all samples, with the steps of the
    case, or more where these are too long for it."""
    for each in case.group:
        model.check_times(each.t, each.clocked)
    fading = fading if fades(model) else 0.0
    while True:
        samples, substeps = case.layout.samples, case.substeps
        known = np.asarray(samples.weight) > 0
        finer = refinement.samples(case.group, case.weights, 2 * substeps)
        ends = _refined(case.layout, finer, model, fading, case.layout.count)
        values, outputs, change = jax.device_get(ends)
        whole = {name: jnp.asarray(x[-1]) for name, x in values.items()}
        fitted = model.with_parameters(whole).settled()
        with np.errstate(over="ignore", invalid="ignore"):
            missed = (outputs - np.asarray(samples.w))[:, known]
            left = _size(missed[-1])
        # A fit without a block may be lost for want of steps, where this one is not.
        lost = not np.all(np.isfinite(missed))
        error = math.inf if lost else float(change[-1])
        enough = enough_steps(substeps, error, left, float(samples.spread))
        if enough == substeps:
            return Fit(fitted, outputs, len(whole), case, note)
        case = case.with_steps(enough)
        if math.isfinite(left):  # else it may have been for want of steps
            model = fitted


@jit
def _refined(
    layout: Layout, finer: Samples, model: AbstractModel, fading: float, count
) -> tuple[dict[str, Float[Array, " b"]], Float[Array, "b r n"], Float[Array, " b"]]:
    """Of fits without each block, and to all samples, their numbers, outputs, and by
    how much these change with steps that are half as long."""
    samples, starts = layout.samples, layout.samples.w[:, 0]

    def fit(block):
        objective, end, run, _ = refined_without(
            layout, model, block, starts, _SOLVER, _STEPS, fading=fading
        )
        names = objective.parameters.names
        missed = jnp.where(samples.weight > 0, run.outputs - samples.w, 0.0)
        change = step_error(objective, finer, end.unknowns, missed)
        return dict(zip(names, end.unknowns.values, strict=True)), run.outputs, change

    return jax.vmap(fit)(jnp.array([*range(count), NONE]))


FAMILIES: Mapping[str, Callable[[Case], Fit]] = {
    "law": law,  # first, for it takes longest, and others run beside it
    "curve": curve,
    "plays": plays,
    "plays and creep": creep,
    "plays behind a lag": behind_a_lag,
    "stops": stops,
    "two stops": two_stops,
    "PrandtlIshlinskii": prandtl_ishlinskii,
    "Everett": everett,
    "JilesAtherton": guessed(models.JilesAtherton.guess),
    "Tellinen": guessed(models.Tellinen.guess),
    "ColemanHodgdon": guessed(models.ColemanHodgdon.guess),
    "Dahl": guessed(models.Dahl.guess),
    "LuGre": guessed(models.LuGre.guess),
    "BoucWenForce": guessed(models.BoucWenForce.guess),
    "BoucWenBaberNoori": guessed(models.BoucWenBaberNoori.guess),
    "RambergOsgood": guessed(models.RambergOsgood.guess),
}
"""What `compare` tries, by name."""
