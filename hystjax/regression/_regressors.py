"""From recordings to the least-squares problem of their derivative."""

import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core import checks
from .._core.checks import InputError
from .._core.compiling import jit
from ..least_squares import LeastSquaresProblem, compress, novelty
from ..library import Library, Term, check_library
from ..recording import Recording, as_recording
from .differentiation import AbstractDifferentiation
from .formulation import AbstractFormulation, Pointwise, WeakForm
from .weighting import AbstractWeighting, Even

_NEW = 1e-5  # share of a column that must be new for its term to be a candidate
_WIDTH = 0.4  # half width of test functions, in distances of turning points


def as_group(
    recordings: Recording | Sequence[Recording],
    call: str = "identify(recordings, library)",
) -> tuple[Recording, ...]:
    """One or several recordings as a tuple; the `call` is for messages.

    **Raises:** `InputError` when there is none, one is a batch, their units or names
    differ, or something else was given.
    """
    several = isinstance(recordings, list | tuple)
    group = tuple(recordings) if several else (recordings,)
    group = tuple(as_recording(each, call, "recordings") for each in group)
    if not group:
        raise InputError("`recordings` is empty; pass at least one recording.")
    for recording in group:
        if recording.t.ndim != 1:
            raise InputError(
                f"`recordings` holds a batch, with arrays of shape {recording.t.shape};"
                " call this under `jax.vmap`, or pass a sequence of recordings."
            )
    _check_alike(group)
    return group


def _check_alike(group: tuple[Recording, ...]) -> None:
    """Raise `InputError` unless all recordings have the units and names of the first:
    a law has one unit for its input, and one for its output."""
    first = group[0]
    cures = {
        "units": "Convert the columns to one unit each, and give that as `units`.",
        "names": "If they are the same quantities, give them the same names: "
        "`dataclasses.replace(recording, names=...)`.",
    }
    for kind, cure in cures.items():
        for number, other in enumerate(group):
            if getattr(other, kind) != getattr(first, kind):
                raise InputError(
                    f"`recordings` must be of one device, and the {kind} of recording "
                    f"{number} are {getattr(other, kind)}, those of recording 0 "
                    f"{getattr(first, kind)}. {cure}"
                )


def check(recordings: tuple[Recording, ...], library: Library) -> None:
    """Raise `InputError` when no law can be regressed, warn when precision is lost."""
    check_library(library)
    rows = sum(len(recording) for recording in recordings)
    checks.enough_samples(f"a library of {len(library)} terms", rows, len(library) + 1)
    for recording in recordings:
        checks.not_constant("u", recording.u, "without change there is no hysteresis.")
        checks.not_constant("w", recording.w, "there is no derivative to explain.")
        _check_sizes(recording, library)
        checks.warn_single_precision(recording.t, recording.w)


def _check_sizes(recording: Recording, library: Library) -> None:
    """Raise `InputError` where squares of the derivative or of a term leave the floats:
    regression adds them up, and would lose such terms in silence."""
    columns = recording.t, recording.w, recording.u
    if not checks.is_concrete(*columns):
        return
    t, w, u = map(np.asarray, columns)
    logs = {}
    for name, signal in (("w", w), ("u", u)):
        low, high = float(np.min(signal)), float(np.max(signal))
        logs[name] = math.log10(max(-low, high))
        logs[f"{name}'"] = math.log10(high - low) - math.log10(t[-1] - t[0])
    parts = [_sizes(term, logs) for term in library.terms]
    sizes = 2 * np.array([*(sum(p.values()) for p in parts), logs["w'"]])
    number = np.finfo(t.dtype)
    most = math.log10(number.max) - math.log10(len(t))
    bad = np.flatnonzero((sizes <= math.log10(number.tiny)) | (sizes >= most))
    if not bad.size:
        return
    term = bad[0] < len(library)
    found = parts[bad[0]] if term else {}
    cause = max(found, key=lambda signal: abs(found[signal])) if term else "w'"
    square = f"the square of the term {library.names[bad[0]]}" if term else "its square"
    raise InputError(_unheld(cause, logs[cause], square, t.dtype))


def _sizes(term: Term, logs: dict[str, float]) -> dict[str, float]:
    """What each signal adds to the logarithm of a term's size."""
    sizes: dict[str, float] = {}
    for variable, power in term.factors:
        w, u, s = variable.unit or (0, 0, 0)
        signal = "w" if w else "u'" if s else "u"
        if w or u:
            sizes[signal] = sizes.get(signal, 0.0) + power * logs[signal]
    return sizes


def _unheld(cause: str, log: float, square: str, dtype: np.dtype) -> str:
    slope = " in a unit of `t`" if cause.endswith("'") else ""
    units = "it or for `t`" if slope else "it"
    hint = " 64-bit numbers, by `jax_enable_x64`, hold more." * (dtype == np.float32)
    return (
        f"`{cause[0]}` {'changes by' if slope else 'is'} about 1e{log:.0f}{slope}, and "
        f"{dtype} numbers do not hold {square}; choose another unit for {units}, in "
        f"which values are nearer to 1.{hint}"
    )


def chosen(
    formulation: AbstractFormulation | None, differentiation: AbstractDifferentiation
) -> AbstractFormulation:
    """A formulation, by default of the derivative at each sample."""
    return Pointwise(differentiation) if formulation is None else formulation


def admitted(
    library: Library, group: tuple[Recording, ...], how: AbstractFormulation
) -> tuple[Library, tuple[Recording, ...]]:
    """The terms that can be tried on these recordings, without a clock those that do
    not depend on the rate; and the recordings with no more than these need.

    **Raises:** `InputError` when there is no such term, or a law of the value would
    hold the output.
    """
    check_library(library)
    if not all(recording.clocked for recording in group):
        degree = int(how.target == "rate")
        kept = [i for i, t in enumerate(library.terms) if t.rate_degree == degree]
        if not kept:
            raise InputError(
                "the recording has no clock, and every term of `library` depends on "
                "the rate of the input, or may. Use rate-independent terms, such as "
                "`library.Duhem()`, or give the times."
            )
        library = library.part(kept)
    looped = [term.name for term in library.terms if not term.driven]
    if how.target == "value" and looped:
        raise InputError(
            f"`library` holds {looped}, and a law of the value w cannot hold w, nor "
            "functions of your own, which might. Use terms of the input alone, such as "
            "`library.Play(radii)`."
        )
    keep = not library.memory.empty
    return library, group if keep else tuple(each.afresh() for each in group)


@jit
def factor(
    recordings: tuple[Recording, ...],
    library: Library,
    how: AbstractFormulation,
    weighting: AbstractWeighting = Even(),
    weights: Sequence[Float[Array, " _n"]] | None = None,
) -> LeastSquaresProblem:
    """The factored problem of the output's derivative regressed on the library."""
    each = equations(recordings, library, how)
    rows, targets = map(jnp.concatenate, zip(*each, strict=True))
    counts = weighting.weights(rows, targets)
    if weights is not None:
        known = jnp.concatenate([how.weights(each) for each in weights])
        # Of mean 1, as without: ridges add to squares.
        counts = counts * known * jnp.sum(known > 0) / jnp.sum(known)
    root = jnp.sqrt(counts)
    return compress(root[:, None] * rows, root * targets)


def equations(
    recordings: tuple[Recording, ...],
    library: Library,
    how: AbstractFormulation,
) -> list[tuple[Float[Array, "_m k"], Float[Array, " _m"]]]:
    """Of each recording the equations for the coefficients."""
    return [how.equations(library, each.path, each.w) for each in recordings]


def told_apart(problem: LeastSquaresProblem) -> Bool[Array, " k"]:
    """The terms that are candidates: of those that are almost equal the first."""
    # As `aliases` calls it, for one compiled program.
    return novelty(problem, tolerance=jnp.asarray(_NEW))[1]


def weak_form(recordings: tuple[Recording, ...]) -> WeakForm:
    """With test functions for the turning points of these inputs."""
    between = []
    for recording in recordings:
        checks.enough_samples("The weak form", len(recording), 9)
        turns = len(recording.path.turning_points()[0])
        between.append(len(recording) / (turns + 1))
    return WeakForm(max(2, round(_WIDTH * min(between))))


def differentiated(
    recording: Recording, differentiation: AbstractDifferentiation
) -> tuple[Float[Array, " n"], ...]:
    """w, u, dw/dt and du/dt at the samples.

    Output and input pass through the same differentiation (and its smoothing), so that
    its bias is the same on both sides of a law.
    """
    w, dw = differentiation.estimate(recording.t, recording.w)
    u, du = differentiation.estimate(recording.t, recording.u)
    return w, u, dw, du
