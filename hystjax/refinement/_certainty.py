"""How well the data determine what was fitted, in numbers and in words."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.scipy.special import xlogy
from jaxtyping import Array, ArrayLike, Float, Int, Shaped

from .._core import checks
from .._core.checks import InputError, is_concrete, warn
from .._core.show import moment, quantity
from .._core.solution import RESULTS, AbstractFindings, Solution
from ..least_squares import column_lengths, compress, root_of
from ..models import AbstractModel, sees
from ..models._base import signed_sum
from ..models._sequence import no_numbers
from ..recording import Recording
from ..signals import Cubic, Exact, Linear
from ..simulation import FixedStep, simulate
from ..simulation.properties import rests
from ._objective import Fading, Objective, Run, Unknowns, fitted
from ._solve import value_and_columns

_LAGS = 40
_TAKES_PART = 0.1  # of a direction of length 1
_ROUNDING = 10.0  # times epsilon for each unknown: singular values that are none


class Certainty(eqx.Module):
    """Linearised uncertainty of q unknowns: p values, then free starts.

    **Attributes:**

    - `names`: of the unknowns: parameters, then `start[i]` of recording i, its first
        output (`start[i, j]` for its state j, where several are fitted).
    - `covariance`: shape (q, q), natural units.
    - `singular_values`: of the Jacobian with columns of length 1, largest first,
        relative to the largest, shape (q,). Near 0: the data do not determine the
        combination of unknowns in the same row of `directions`.
    - `directions`: shape (q, q); rows are combinations of the scaled unknowns.
    - `output`: standard errors of the simulated outputs, shape (R, n), output units.
    - `noise`: standard deviation of the residual of a sample of weight 1, output
        units.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    covariance: Float[Array, "q q"]
    singular_values: Float[Array, " q"]
    directions: Float[Array, "q q"]
    output: Float[Array, "r n"]
    noise: Float[Array, ""]

    def undetermined(
        self, tolerance: float = 1e-4
    ) -> tuple[tuple[float, dict[str, float]], ...]:
        """Combinations of unknowns that the data hardly determine.

        **Arguments:** `tolerance`, the relative singular value below which a
        combination counts.

        **Returns:** for each its relative singular value, and the components of more
        than a tenth, by name, of the unit vector of scaled unknowns. For concrete
        values, of one fit.

        **Raises:** `InputError` for a tolerance that is no number, zero or more.
        """
        checks.number("tolerance", tolerance)
        checks.positive("tolerance", tolerance, zero=True)
        sizes, rows = np.asarray(self.singular_values), np.asarray(self.directions)
        return tuple(
            (float(size), self._components(row))
            for size, row in zip(sizes, rows, strict=True)
            if size < tolerance
        )

    def _components(self, row) -> dict[str, float]:
        parts = zip(self.names, row.tolist(), strict=True)
        return {name: part for name, part in parts if abs(part) > _TAKES_PART}


class Linearised(NamedTuple):
    """A free run, and how its output changes with the q unknowns: their names, the run,
    and the Jacobian of its outputs, shape (R n, q)."""

    names: tuple[str, ...]
    run: Run
    jacobian: Float[Array, "m q"]


def linearised(objective: Objective, unknowns: Unknowns) -> Linearised:
    """The free run of some unknowns with its Jacobian."""
    flat, restore = ravel_pytree(fitted(objective, unknowns))
    function = lambda x: objective.run(eqx.combine(restore(x), unknowns))  # noqa: E731
    run, columns = value_and_columns(function, flat)
    names = (*objective.parameters.names, *_start_names(objective, unknowns))
    return Linearised(names, run, columns.outputs.reshape(len(flat), -1).T)


def _start_names(objective: Objective, unknowns: Unknowns) -> tuple[str, ...]:
    recordings, _, d = unknowns.starts.shape
    if objective.free == "nothing":
        return ()
    if objective.free == "output" or d == 1:
        return tuple(f"start[{i}]" for i in range(recordings))
    return tuple(f"start[{i},{j}]" for i in range(recordings) for j in range(d))


class Refined(AbstractFindings):
    """A fit, and what is known of it.

    **Attributes:** the fitted model, the `value`, and how the fit ended, the `result`;
    all others are what `refine` tells in `stats`, by the same names, `fading` only of
    laws, and `weights` only where there are some.
    """

    value: AbstractModel
    result: RESULTS
    num_steps: Int[Array, ""]
    loss: Float[Array, ""]
    losses: Float[Array, " s"]
    rmse: Float[Array, " r"]
    standard_errors: dict[str, Float[Array, ""]]
    w0: Float[Array, " r"]
    w0_standard_errors: Float[Array, " r"]
    covariance: Float[Array, "q q"]
    certainty: Certainty
    residuals: Float[Array, "r n"]
    autocorrelation: Float[Array, "r l"]
    whiteness: Float[Array, " r"]
    substeps: int
    step_error: Float[Array, ""]
    spread: Float[Array, ""]
    fading: Fading | None = None
    lengths: Int[np.ndarray | Array, " r"] | None = None
    weights: Sequence[Float[ArrayLike, " _n"]] | None = None

    def of_numbers(self) -> tuple[tuple[str, ...], Float[Array, "p p"]]:
        """The p fitted parameters by name, and their covariance, without the starts."""
        names = self.certainty.names
        names = tuple(name for name in names if name in self.standard_errors)
        return names, self.covariance[: len(names), : len(names)]


def certainty(
    objective: Objective, run: Linearised
) -> tuple[Certainty, Float[Array, " q"]]:
    """Covariance from the Jacobian at the solution, for independent residuals; and the
    standard errors of the unknowns.

    For robust losses the residual variance is that of M-estimates.

    **Source:** Seber and Wild (2003), doi 10.1002/0471725315; Huber (1973),
    doi 10.1214/aos/1176342503.
    """
    samples, jacobian = objective.samples, run.jacobian
    root = root_of(samples.weight).ravel()
    lengths = column_lengths(root[:, None] * jacobian)
    scaled = jacobian / lengths
    problem = compress(root[:, None] * scaled, jnp.zeros_like(root))
    _, sizes, directions = jnp.linalg.svd(problem.triangle)
    # A direction that nothing determines is known to rounding. Over nothing that would
    # be large: errors of unknowns which take no part in it.
    epsilon = jnp.finfo(sizes.dtype).eps
    floor = epsilon * sizes[0]
    nothing = sizes < _ROUNDING * len(sizes) * floor
    apart = nothing[:, None] & (jnp.abs(directions) < jnp.sqrt(epsilon))
    directions = jnp.where(apart, 0.0, directions)
    spread = directions.T / jnp.maximum(sizes, floor)
    noise = _noise(objective, run.run.outputs, jnp.sum(~nothing))
    half = noise * spread / lengths[:, None]
    # Not from the covariance: in single precision squares of what is small are 0.
    errors = noise * jnp.linalg.norm(spread, axis=1) / lengths
    output = jnp.linalg.norm(jacobian @ half, axis=-1).reshape(samples.w.shape)
    relative = sizes / sizes[0]
    noise = noise * jnp.sqrt(samples.unit)
    known = Certainty(run.names, half @ half.T, relative, directions, output, noise)
    return known, errors


def _noise(objective, outputs, determined: Int[Array, ""]):
    """Residual standard deviation in units of the output, of a sample of the mean
    weight, by how many combinations of unknowns the samples determine: others, such as
    where a recording of no weight starts, take nothing out of the residuals."""
    samples, loss = objective.samples, objective.loss
    residuals = outputs - samples.w
    influence, slope = jax.jvp(
        loss.influence, (residuals,), (jnp.ones_like(residuals),)
    )
    free = jnp.maximum(samples.scored - determined, 1)
    mean = jnp.sum(samples.weight * influence**2) / free
    share = jnp.sum(samples.weight * slope) / jnp.sum(samples.weight)
    return jnp.sqrt(mean) / share


def autocorrelation(residuals: Float[Array, " n"], weight: Float[Array, " n"]):
    """Autocorrelation of residuals at lags 1 to 40, or to as many as rows have, and the
    probability that white noise would show as much; NaN where none has weight."""
    used = weight > 0
    n = jnp.sum(used)
    centred = jnp.where(used, residuals - jnp.sum(residuals * used) / n, 0.0)
    half = max(1, min(_LAGS, residuals.shape[0] - 1) // 2)
    lags = 1 + jnp.arange(2 * half)
    # One lag after the other, which takes no more memory than the residuals do.
    products, pairs = (
        jax.lax.map(lambda lag, row=row: _product(row, lag), lags)
        for row in (centred, used.astype(centred.dtype))
    )
    correlation = products / jnp.sum(centred**2)
    # Where some have no weight there are fewer pairs than samples.
    whole = correlation * jnp.maximum(n - lags, 0) / jnp.maximum(pairs, 1)
    return whole, jnp.where(n > 0, ljung_box(correlation, n, pairs), jnp.nan)


def ljung_box(
    correlation: Float[Array, " lags"],
    samples: Shaped[ArrayLike, ""],
    pairs: Shaped[Array, " lags"],
) -> Float[Array, ""]:
    """The probability that as many `samples` of white noise show such autocorrelations
    at lags 1, 2, ..., or larger ones. There are so many `pairs` of samples so far apart
    in each: lags with none are left out, and of an odd number the last.

    **Source:** Ljung and Box (1978), doi 10.1093/biomet/65.2.297.
    """
    most, n = len(correlation) // 2, jnp.asarray(samples)
    known = pairs > 0
    half = jnp.clip(jnp.sum(known) // 2, 1, most)
    known = known & (jnp.cumsum(known) <= 2 * half)
    shares = jnp.where(known, correlation**2 / jnp.maximum(pairs, 1), 0.0)
    return _chi2_sf(n * (n + 2) * jnp.sum(shares), half, most)


def _chi2_sf(
    statistic: Float[Array, ""], half: Shaped[Array, ""], most: int
) -> Float[Array, ""]:
    """The probability that chi-squared of an even number of degrees of freedom, twice
    `half`, exceeds a number: that of fewer than `half` Poisson events, of which there
    are `most` to add up.

    A short sum, where the incomplete gamma function takes long to compile.
    """
    mean, events = statistic / 2, np.arange(most, dtype=float)
    factorials = np.cumsum(np.log(np.maximum(events, 1)))
    parts = jnp.exp(xlogy(events, mean) - factorials - mean)
    return jnp.sum(jnp.where(events < half, parts, 0.0))


def _product(series: Float[Array, " n"], lag: Int[Array, ""]) -> Float[Array, ""]:
    """The sum of products of samples so many apart."""
    followed = jnp.concatenate([series, jnp.zeros_like(series)])
    return series @ jax.lax.dynamic_slice_in_dim(followed, lag, len(series))


_WIDE = 5.0  # standard deviations of the output, between which rests are looked for
_SUSPICIOUS = 0.01  # probability below which residuals are not taken for white


def statements(solution: Solution) -> list[str]:
    """Sentences on the noise, on what the data do not determine, and on stability.

    **Arguments:** `solution`, of `hystjax.refine` or `hystjax.discover`, concrete.
    """
    fit = Refined.of(solution)
    unit = getattr(fit.value, "units", ("", ""))[1]
    noise = f"{_noise_in_words(fit)} {unit}".strip()
    said = [f"standard deviation of the residuals: {noise}"]
    said += _whiteness(np.asarray(fit.whiteness))
    said += _undetermined(fit)
    if fit.fading is not None:
        known = fit.value.fitted_range
        clocked = known is None or known.fastest is not None
        said.append(_fading(fit.fading, clocked))
        said += _rests(fit, unit)
    return said


HELD = "while the input is held"


def _rests(fit: Refined, unit: str) -> list[str]:
    """What a law does while its input is held, unless it comes to rest at one output or
    stands still at any."""
    law: Any = fit.value
    known = law.fitted_range
    if known is None:
        return []
    around = _WIDE * float(np.max(fit.spread))
    low, high = np.min(fit.w0) - around, np.max(fit.w0) + around
    held = float(known.low + known.high) / 2
    found = rests(law, held, low, high)
    count, drift = int(np.sum(np.isfinite(found.w))), float(found.drift)
    at = quantity(held, law.units[0], 3)
    if not count and drift:
        by = quantity(abs(drift), f"{unit}/s" if unit else "", 3)
        way = "rises" if drift > 0 else "falls"
        return [f"{HELD} at {at} it {way} by {by}, and never rests"]
    w, stable = np.asarray(found.w)[:count], np.asarray(found.stable)[:count]
    if count < 2 and np.all(stable):
        return []

    def listed(values, word):
        return f" {word} ".join(quantity(float(each), unit, 3) for each in values)

    ends, leaves = w[stable], listed(w[~stable], "and")
    if len(ends) > 1:
        many = f"comes to rest at {listed(ends, 'or')}, whichever the past led to"
        does = f"leaves {leaves}, and {many}"
    elif len(ends):
        does = f"comes to rest at {listed(ends, 'or')}, but runs away beyond {leaves}"
    else:
        does = f"leaves {leaves}, and runs away"
    return [f"{HELD} at {at} it {does}"]


def _noise_in_words(fit: Refined) -> str:
    noise = float(fit.certainty.noise)
    if fit.weights is None:
        return f"{noise:.4g}"
    counted = np.concatenate(fit.weights)
    size = noise / np.sqrt(counted[counted > 0])
    if np.ptp(size) == 0:  # samples were left out, and all others count alike
        return f"{size[0]:.4g}"
    return f"by the weights from {np.min(size):.4g} to {np.max(size):.4g}"


def _whiteness(probabilities: np.ndarray) -> list[str]:
    """Whether residuals look white, of all recordings: as the least white of so many
    does. Of those whose samples have no weight nothing is known."""
    known = probabilities[np.isfinite(probabilities)]
    if not len(known):
        return []
    probability = min(1.0, len(known) * float(np.min(known)))
    if probability >= _SUSPICIOUS:
        return [f"residuals look white (Ljung-Box probability {probability:.2g})"]
    return [
        "residuals are correlated (Ljung-Box probability "
        f"{probability:.1g}): something is left to explain, and standard errors are "
        "too small; `hystjax.bootstrap` gives better ones"
    ]


def _undetermined(fit: Refined) -> list[str]:
    found = fit.certainty.undetermined()
    return [
        f"hardly determined (1 : {1 / max(size, 1e-300):.1e}): {_mixed(components)}"
        for size, components in found
    ]


def _mixed(components) -> str:
    """The combination, such as `0.71 w - 0.71 |du|`."""
    parts = [(part, name) for name, part in components.items()]
    return signed_sum(parts, lambda part: f"{part:.2g}", " ")


def _fading(fading, clocked: bool) -> str:
    exponent = float(np.max(fading.exponent))
    share = 100 * float(np.max(fading.share))
    pace = "per s" if clocked else "per sample"
    if exponent >= 0:
        return (
            f"the law does not forget its initial value (exponent {exponent:.3g} "
            f"{pace})"
        )
    forgets = f"the law forgets its initial value at {-exponent:.3g} {pace} on average"
    if share == 0:
        return f"{forgets}, and at every sample"
    worst = float(np.max(fading.largest))
    where = moment(np.ravel(fading.where)[np.argmax(fading.largest)], 4)
    at = f"t = {where} s" if clocked else f"sample {where}"
    return (
        f"{forgets}; it expands on {share:.2g} % of the samples, at most {worst:.3g} "
        f"{pace}, at {at}"
    )


_STEP_SHARE = 0.01  # of what a fit leaves, that its steps may change
# What steps may change where a fit is near all the same: of what it leaves, or where
# that is nothing else, of the output's spread.
_NEAR, _NEAR_CLEAN = 0.1, 0.01
_NOTHING = 0.99  # of the output's spread, which a fit leaves that explains nothing
_STEP_FLOOR = 1e-6  # of the output's spread, that they may change in any case
_MOST_SUBSTEPS = 32
# Of the error of lines, that cubics have where an input is smooth: 0.35 for the
# multisine of the Bouc-Wen benchmark, 0.67 and more for triangles, 1 for random walks.
_SMOOTH = 0.5
# Of what a fit leaves: less than noise, but no noise, so that terms are found in it.
_TELLS = 0.3
_PROVEN = 100.0  # fits this much closer than lines can miss show that lines are right
_PROVEN_ROUND = 4.0  # such that show that nothing was rounded, which no fit follows
_SEVERAL = 2.5  # steps, that a rounded input moves by from sample to sample
# Steps that cubics miss of a rounded input, the median: 0.27 of independent errors.
_ROUNDED = 0.13, 0.5
# Right laws leave 1.0 to 1.2 times what rounding takes, of records of 6 to 12 bits.
_SPARE = 1.3
_ON_GRID = 0.01  # of a step, by which a multiple of it may be off
_LEVELS = 16  # fewer are no rounding
_SAME = 1e-9  # of the range, by which arithmetic alone sets numbers apart


def steps(group: tuple[Recording, ...], substeps: int | None) -> int:
    """Integration steps a sample interval: enough to step around turning points."""
    least = 1 if all(recording.path.kinked for recording in group) else 2
    if substeps is not None and checks.whole("substeps", substeps) < least:
        raise InputError(
            f"`substeps` must be at least {least} for an input that is "
            f"{'linear' if least == 1 else 'smooth'} between samples, got {substeps}."
        )
    return substeps or least


def step_error(objective, finer, unknowns, residuals) -> Float[Array, ""]:
    """How the simulated output changes with twice as many steps, root mean square."""
    samples = objective.samples
    again = eqx.tree_at(lambda o: o.samples, objective, finer)
    outputs = replace(again, memory=None).run(unknowns).outputs
    used = samples.weight > 0
    change = jnp.where(used, outputs - samples.w, 0.0) - residuals
    return jnp.sqrt(jnp.sum(change**2) / jnp.sum(used))


def enough_steps(substeps: int, error: float, left: float, spread: float) -> int:
    """As many steps a sample interval as a fit needs that had `substeps`, no more than
    32: so many, where its output changes by no more with twice as many than is small
    beside what the fit leaves; else what a method of fourth order needs for that, twice
    to eight times as many.

    **Arguments:** the steps; and, root mean square and in output units, the change of
    the output, what the fit leaves, and the output about its mean.
    """
    most = _may_change(left, spread)
    if error <= most:
        return substeps
    ratio = error / most
    ratio = ratio**0.25 if math.isfinite(ratio) else 8.0
    factor = 2 ** min(3, max(1, math.ceil(math.log2(ratio))))
    return max(substeps, min(_MOST_SUBSTEPS, substeps * factor))


def _may_change(left: float, spread: float) -> float:
    """By how much steps may change an output."""
    left = left if math.isfinite(left) else 0.0
    return max(_STEP_SHARE * left, _STEP_FLOOR * spread)


def _of_steps(fit: Refined) -> tuple[float, float, float]:
    """By how much the output of a fit changes with the steps, what it leaves, and how
    far it spreads; zeros while that is being traced, and where a number of the model is
    none, which no steps mend."""
    if not is_concrete(fit.step_error, *jax.tree.leaves(fit.value)):
        return 0.0, 0.0, 0.0
    error = float(np.nan_to_num(fit.step_error, nan=np.inf))
    if math.isinf(error) and no_numbers(fit.value):
        return 0.0, 0.0, 0.0
    # All samples count the same, as in the error; those without weight are zero.
    residuals = np.asarray(fit.residuals)
    used = max(1, np.count_nonzero(residuals))
    left = float(np.linalg.norm(residuals)) / math.sqrt(used)
    return error, left, float(fit.spread)


def enough(fit: Refined, at_start: Callable[[], Float[Array, ""]]) -> int:
    """As many steps a sample interval as a fit needs, of which the error of the steps
    where it began is known. A fit that explains nothing needs none itself: of a stiff
    law, whose steps were unstable, it may be an output of zero."""
    error, left, spread = _of_steps(fit)
    if left >= _NOTHING * spread > 0:
        error = max(error, float(np.nan_to_num(at_start(), nan=np.inf)))
    return enough_steps(fit.substeps, error, left, spread)


def astray(fit: Refined) -> bool:
    """Whether a fit says more of its steps than of the record, so that there is nothing
    near it: a stiff model, whose steps are unstable, is led away by what they do. (Of a
    record without noise steps are all that is left, and the fit is near.)"""
    error, left, spread = _of_steps(fit)
    near = _leads_on(error, left, spread) and left < _NOTHING * spread
    return bool(fit.result == RESULTS.diverged) or not near


def begun_astray(fit: Refined, at_start: Float[Array, ""]) -> bool:
    """Whether steps, of which the error is known where fits began, may have led the one
    from there away, beside what the best of several leaves."""
    _, left, spread = _of_steps(fit)
    return not _leads_on(float(at_start), left, spread)


def _leads_on(error: float, left: float, spread: float) -> bool:
    """Whether steps of so much error lead to a minimum, not away, as NaN does."""
    return error <= max(_NEAR * left, _NEAR_CLEAN * spread)


def warn_of_steps(fit: Refined) -> None:
    error, left, spread = _of_steps(fit)
    if not error <= _may_change(left, spread):
        warn(
            f"with {fit.substeps} steps a sample interval the simulated output is "
            f"uncertain by about {error:.2g}, which is no small part of what the fit "
            "leaves: give more `substeps`, or judge the law by "
            "`simulation.Adaptive()`.",
        )


def warn_of_lines(group: tuple[Recording, ...], fit: Refined) -> None:
    """Say where inputs are taken for straight lines that are smooth, if that is no
    small part of what a fit leaves."""
    if not is_concrete(fit.rmse, *(each.u for each in group)):
        return
    left = np.asarray(fit.rmse / fit.spread).tolist()
    seen = isinstance(fit.value, AbstractModel) and sees(fit.value, "du")
    for i, (recording, share) in enumerate(zip(group, left, strict=True)):
        missed, how = missed_by_lines(recording, share), ""
        if seen and missed:  # of its rate they miss far more
            of_output = _missed_of_output(recording, fit, i)
            if of_output > missed:
                missed, how = of_output, "as the output of this model sees it "
        if missed > _TELLS * share:
            warn(
                "the input is smooth, and straight lines between its samples miss it "
                f"{how}by about {100 * missed:.2g} % of its spread, where the fit "
                f"leaves {100 * share:.2g} % of the output's: make the recording with "
                "`interpolation=hystjax.interpolation.Cubic()`, or `BandLimited()` for "
                "whole periods.",
            )


def _missed_of_output(recording: Recording, fit: Refined, i: int) -> float:
    """By how much the output of a fit, over its spread, is another where the input of
    one of the recordings goes along cubics."""
    method = FixedStep(2 * fit.substeps)
    line, cubic = (
        simulate(
            fit.value.fitted_on(None), each, w0=fit.w0[i], method=method, throw=False
        ).w
        for each in (recording, replace(recording, interpolation=Cubic()))
    )
    apart = jnp.sqrt(jnp.mean((cubic - line) ** 2)) / fit.spread
    return float(jnp.nan_to_num(apart, posinf=0.0))


_EXACT = 1e-5  # of the output's spread, to which runs are known at best


def known_to(group: Sequence[Recording], left: float) -> float:
    """To what share of its spread the output of any law is known, where a fit leaves
    this share: integration makes it uncertain, the input between its samples, and the
    steps that both were rounded to."""
    unsure = (
        np.hypot(missed_by_lines(each, left), lost_by_rounding(each, left))
        for each in group
    )
    return max(_EXACT, *map(float, unsure))


def missed_by_lines(recording: Recording, left: float) -> float:
    """What straight lines miss of an input between its samples, over its spread: none
    where it is not clearly smooth, or a fit leaves so little of the output, over the
    spread of that, that lines are right."""
    if not isinstance(recording.interpolation, Linear) or not _moves(recording):
        return 0.0
    by_line, by_cubic = (np.sqrt(np.mean(x**2)) for x in _by_neighbours(recording))
    # Half as far from the neighbours, lines are four times as close.
    missed = float(by_line / 4 / np.std(np.asarray(recording.u)))
    smooth = by_cubic < _SMOOTH * by_line
    return missed if smooth and missed < _PROVEN * left else 0.0


def lost_by_rounding(recording: Recording, left: float) -> float:
    """What the steps of a converter or a file take from an input and its output, over
    their spreads and with some to spare: none where a fit leaves so little of the
    output, over its spread, that the input is what it was rounded to.

    An input that moves by several steps from sample to sample is rounded by what looks
    like independent errors, uniform over a step. Stairs and other inputs that were made
    of steps miss that.

    **Source:** Bennett (1948), doi 10.1002/j.1538-7305.1948.tb01340.x.
    """
    if isinstance(recording.interpolation, Exact) or not _moves(recording):
        return 0.0
    u, w = np.asarray(recording.u), np.asarray(recording.w)
    step = _resolution(u)
    _, by_cubic = _by_neighbours(recording)
    low, high = step * np.array(_ROUNDED)
    fast = np.max(np.abs(np.diff(u))) > _SEVERAL * step > 0
    if not (fast and low < np.median(np.abs(by_cubic)) < high):
        return 0.0
    shares = [_resolution(x) / np.std(x) for x in (u, w) if np.ptp(x)]
    lost = float(np.linalg.norm(shares)) / math.sqrt(12)
    return _SPARE * lost if lost < _PROVEN_ROUND * left else 0.0


def _resolution(x: np.ndarray) -> float:
    """The step that all numbers are multiples of, but for an offset, or 0; also of the
    few levels that relays have."""
    values = np.unique(x)
    if len(values) < _LEVELS:
        return 0.0
    apart = np.diff(values)
    step = np.min(apart[apart > _SAME * np.ptp(x)])
    counts = (values - values[0]) / step
    on_grid = np.max(np.abs(counts - np.round(counts))) < _ON_GRID
    return float(step) if on_grid else 0.0


def _moves(recording: Recording) -> bool:
    """Whether there is an input that its neighbours can predict."""
    return len(recording) >= 9 and bool(np.ptp(np.asarray(recording.u)))


def _by_neighbours(
    recording: Recording,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """What the line through two neighbours misses of each sample of the input, and the
    cubic through four. Smooth inputs follow the cubic; corners and noise, neither."""
    t, u = np.asarray(recording.t), np.asarray(recording.u)
    before, after = t[2:-2] - t[1:-3], t[3:-1] - t[2:-2]
    line = _divided(t, u, 2)[1:-1] * before * after
    cubic = _divided(t, u, 4) * before * after
    return line, cubic * (t[2:-2] - t[:-4]) * (t[4:] - t[2:-2])


def _divided(t, u, order: int):
    """Divided differences: by the nodal polynomial, what a polynomial of less than that
    order through the other samples misses of one."""
    for apart in range(1, order + 1):
        u = np.diff(u) / (t[apart:] - t[:-apart])
    return u


def known_covariance(
    given: Any,
) -> tuple[tuple[str, ...], Float[ArrayLike, "p p"]]:
    """The p fitted parameters by name, and their covariance, of the `Solution` of
    `refine`; of anything else none."""
    if not Refined.told_by(given):
        return (), np.zeros((0, 0))
    return Refined.of(given).of_numbers()


def deviations(
    slopes: Float[Array, "n p"], covariance: Float[ArrayLike, "p p"]
) -> Float[Array, " n"]:
    """Standard deviations of n numbers, each for itself, by their derivatives with
    respect to p others of this covariance."""
    variance = jnp.einsum("np,pq,nq->n", slopes, covariance, slopes)
    return jnp.sqrt(jnp.maximum(variance, 0))
