"""Refine a law by matching trajectories; and check its standard errors by fitting
the data again and again."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import jit
from .._core.show import Card, Number, Shown
from .._core.solution import RESULTS, Solution, if_sorted, raise_unless_successful
from ..least_squares import root_of
from ..models import AbstractModel, as_model, check_answers, compacted
from ..models._sequence import fitting, no_numbers, warn_of_units
from ..recording import Recording, as_group
from ..recording._as_measured import Weights, led_in
from ..simulation import FixedStep, flows, last_period, simulate
from ._certainty import (
    Refined,
    astray,
    autocorrelation,
    begun_astray,
    certainty,
    enough,
    linearised,
    step_error,
    steps,
    warn_of_lines,
    warn_of_steps,
)
from ._choices import (
    AbstractLoss,
    AbstractShooting,
    SingleShooting,
    Squares,
    parameters,
)
from ._objective import (
    FAR,
    Free,
    Objective,
    Samples,
    as_measured,
    check_starts,
    each_of,
    fading,
    first_unknowns,
    first_values,
    free_of,
    signals,
    within_reach,
)
from ._solve import LevenbergMarquardt, Minimum, Solver, minimise, watched


def refine(
    model: AbstractModel | Solution,
    recordings: Recording | Sequence[Recording],
    *,
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    tied: Mapping[str, tuple[float, str]] | None = None,
    free_start: bool | None = None,
    weights: Weights | None = None,
    periodic: bool = False,
    lead_in: int | None = None,
    loss: AbstractLoss = Squares(),
    shooting: AbstractShooting = SingleShooting(),
    fading: bool | float = False,
    solver: Solver = LevenbergMarquardt(),
    max_steps: int = 256,
    starts: int = 1,
    spread: float = 0.5,
    key: PRNGKeyArray | None = None,
    substeps: int | None = None,
    progress: bool = False,
    throw: bool = True,
) -> Solution:
    """Fit the parameters of a model so that its free run follows the measured output.

    Unlike regression on derivatives this is not misled by noise: with independent
    Gaussian noise it is the maximum-likelihood estimate.

    **Arguments:**

    - `model`: a learned law or a classical model, or the `Solution` of a fit; where
        this one starts.
    - `recordings`: one, or several of one device, of any lengths and rates.
    - `fixed`: parameters that keep their value: names of terms for learned laws
        (`"u*|du|"`), of attributes for others (`"n"`); see `model.parameters()`.
    - `bounds`: lower and upper bound by parameter, infinite for none; by default those
        of the model, within which it makes sense.
    - `tied`: parameters that follow another, as `{name: (factor, other)}`.
    - `free_start`: whether the state at the first sample of each recording is fitted
        too, or left as that sample tells it. By default that of laws is, and of models
        with hidden states, of which the output tells less, the first output, from which
        they start at rest: it is as noisy as every other. An output that has no weight
        there stays near the one recorded, if that is among the others, or near the
        first that has, unless the samples tell otherwise. With `lead_in` or `periodic`
        nothing is fitted.
    - `weights`: of the samples, one array for each recording, shape (n,); 0 leaves a
        sample out of the sum but not out of the simulation. Or by what to weigh whole
        recordings, so that the largest does not rule: their `"range"`, or the `"noise"`
        on them.
    - `periodic`: whether each recording is of whole periods of its input, evenly
        sampled, the first row not again at the end, of a device that has settled: the
        model then goes through the end of the period before it comes to the first
        sample.
    - `lead_in`: number of samples that the model settles in, without weight: the first
        of each recording, none by default; if `periodic`, of the period before it, by
        default all of one, which slow memory may need more than.
    - `loss`: `refinement.Squares()`, `Huber(...)` or `Cauchy(...)`.
    - `shooting`: `refinement.SingleShooting(...)`, `MultipleShooting(...)`, or
        `Nudging(...)`, which finds the way from far off.
    - `fading`: share of a difference between initial values that may be left at the end
        of each recording, or after ten cycles of its input where it has fewer; laws
        that keep more are penalised. `True` is 1, for laws that forget at all; `False`
        for any.
    - `solver`: an Optimistix least-squares solver or minimiser (Optax too, by
        `optimistix.OptaxMinimiser`).
    - `max_steps`: most steps of the solver, at each stage; as many again where
        parameters have bounds, to fit the others with those that came close on theirs.
    - `starts`: number of fits, the first from the model's own parameters, the others
        from parameters changed at random by up to `spread` times themselves, drawn with
        `key`, or by less where the model then loses the record; the best is returned.
        What is in m^-n is changed in its unit at the n of the model.
    - `substeps`: integration steps a sample interval. By default 1 for inputs that are
        linear between samples, else 2; and as many more, in a further fit from where
        the last one ended, as the output still changes with them by more than a
        hundredth of what the fit leaves (and a millionth of the output's spread). From
        the model's own parameters again, where it changes by more than a tenth of that,
        or where the fit explains nothing and the output there changes with them.
        Under `jit` and `vmap` there is no further fit.
    - `progress`: whether to show steps on standard error, where that is a terminal.
    - `throw`: whether to raise on failure, or to say so in `result`.

    **Returns:** a `Solution` whose `value` is a model like the one given, with the
    `fitted_range` of the recordings, and their names and units where it has none; and
    whose `stats` hold

    - `num_steps`, `loss`: of the last stage; `loss` is half the mean squared residual
        over the output's variance;
    - `rmse`: root mean square residual of each recording, shape (R,), output units; NaN
        of one whose samples have no weight;
    - `standard_errors`: by free parameter; `w0` and `w0_standard_errors`: of the first
        simulated outputs, shape (R,);
    - `covariance`: shape (q, q), of the free parameters in the order of
        `model.parameters()`, then the free starts;
    - `certainty`: a `refinement.Certainty`, with the standard errors of the simulated
        output and, named, the combinations of unknowns that the data do not determine;
    - `fading`: a `refinement.Fading` for each recording (laws only);
    - `residuals`: simulated minus measured output, shape (R, n), zero on padding, which
        begins after as many samples as `lengths` tells of each recording, shape (R,);
        if `periodic`, the lead-in comes first;
    - `autocorrelation`, `whiteness`: of the residuals by the roots of their weights,
        shape (R, lags), and the Ljung-Box probability, shape (R,): near 0, standard
        errors are too small;
    - `losses`: of all starts, shape (starts,), with the number of steps by which they
        were compared;
    - `weights`: of the samples of each recording, where not all count the same;
    - `substeps`, and `step_error`: root mean square change of the simulated output with
        twice as many, output units; several times the error of the steps.

    **Raises:** `InputError` for unknown names, bad bounds, weights or lead-ins, and
    recordings that are not `periodic` but said to be; and `ComputationError` when no
    fit converges. Warns where the steps are too long for the law that was found, where
    an input is smooth between its samples but taken for straight lines, and where a
    period is fitted before the model has settled.

    **Source:** Levenberg (1944), doi 10.1090/qam/10666; Marquardt (1963),
    doi 10.1137/0111030.
    """
    model = _with_a_free_run(model)
    _check_kinds(loss, shooting, solver)
    checks.count("max_steps", max_steps)
    checks.answers(progress=progress, throw=throw)
    check_starts(starts, spread, key)
    recorded = as_group(recordings, "refine(model, recordings)")
    group, weights, known = as_measured(recorded, weights, lead_in, periodic)
    group = fitting(model, group)
    warn_of_units(model, group[0])  # all have the units of the first
    _check_fading(model, fading)

    def laid_out(count: int):
        """Samples with so many steps between them, and with twice as many."""
        return each_of(group, weights, (count, 2 * count), known)

    coarse, finer = laid_out(steps(group, substeps))
    free = _free(model, _asked(free_start, lead_in, periodic))
    objective = Objective(
        parameters(model, fixed, bounds or {}, tied or {}),
        coarse,
        loss,
        shooting.segments,
        share(fading),
        free,
    )
    _check_samples(group, objective)

    search = _Search(
        (starts, spread, key),
        shooting,
        watched(solver) if progress else solver,
        max_steps,
    )
    found = _refine(objective, finer, search)
    if substeps is None:
        found = _with_their_steps(found, objective, finer, search, laid_out)

    warn_of_steps(found)
    warn_of_lines(group, found)
    if periodic:
        _warn_unsettled(recorded, group, found)
    solution = _settled(_of(found, group, weights)).solution()
    if not throw:
        return solution
    return raise_unless_successful(solution, lambda _: no_numbers(model))


def _asked(free_start: bool | None, lead_in: int | None, periodic: bool) -> bool | None:
    """Whether starts are to be fitted; by default none behind a lead-in, of which next
    to nothing is left, and could be had from noise by one that is wild."""
    return False if free_start is None and (periodic or lead_in) else free_start


def _warn_unsettled(recorded, fitted, found: Refined) -> None:
    """Say where a period is fitted that differs from the one that would follow it: the
    one that leads in to it may begin at rest."""
    if not is_concrete(found.w0):
        return
    method = FixedStep(found.substeps)
    for each, whole, w0 in zip(recorded, fitted, found.w0, strict=True):
        longer, _ = led_in(each, None, len(whole), periodic=True)
        run = simulate(found.value, longer, w0=w0, method=method, throw=False)
        last_period(run, each)


def _with_a_free_run(given: AbstractModel | Solution) -> AbstractModel:
    """The model that is given, without what an earlier fit has told of inputs.

    **Raises:** `InputError` for one that maps whole sequences.
    """
    model = as_model(given, "refine(model, recordings)")
    if not isinstance(model, AbstractModel):
        raise InputError(
            f"{checks.described(model)} maps whole sequences, and has no free run to "
            "match step by step; it is trained by what made it."
        )
    return compacted(model).fitted_on(None)


class _Search(NamedTuple):
    """How a minimum is looked for.

    **Attributes:** `draws`, of which `first_values` makes the models to start from; and
    what `refine` calls by these names.
    """

    draws: tuple[int, float, PRNGKeyArray | None]
    shooting: AbstractShooting
    solver: Solver
    max_steps: int


def _with_their_steps(
    found: Refined,
    objective: Objective,
    finer: Samples,
    search: _Search,
    laid_out: Callable[[int], tuple[Samples, ...]],
) -> Refined:
    """The best of several fits with as many steps as it needs; or that from the model's
    own parameters, which may have been behind for want of steps, where with those that
    it needs itself it comes closer."""
    best = _with_enough_steps(found, objective, finer, search, laid_out)
    if not is_concrete(found.losses) or int(jnp.argmin(found.losses)) == 0:
        return best
    if not begun_astray(found, _start_error(objective, finer)):
        return best
    _, spread, _ = search.draws
    alone = search._replace(draws=(1, spread, None))
    own = _refine(objective, finer, alone)
    own = _with_enough_steps(own, objective, finer, alone, laid_out)
    return replace(own, losses=best.losses) if own.loss < best.loss else best


def _with_enough_steps(
    found: Refined,
    objective: Objective,
    finer: Samples,
    search: _Search,
    laid_out: Callable[[int], tuple[Samples, ...]],
) -> Refined:
    """A fit with as many steps a sample interval as it needs: from where the last one
    ended, or from where that began, if it may have gone astray for want of steps."""
    while (
        count := enough(found, partial(_start_error, objective, finer))
    ) > found.substeps:
        coarse, finer = laid_out(count)
        objective = eqx.tree_at(lambda o: o.samples, objective, coarse)
        if astray(found):
            found = _refine(objective, finer, search)
            continue
        starts, spread, _ = search.draws
        near = search._replace(draws=(1, spread, None), shooting=SingleShooting())
        again = _refine(_from(objective, found.value), finer, near, found.w0)
        found = replace(again, losses=found.losses) if starts > 1 else again
    return found


@jit
def _start_error(objective: Objective, finer: Samples) -> Float[Array, ""]:
    """How the output changes with twice as many steps where a fit begins."""
    objective = replace(objective, pieces=1).prepared()
    unknowns, samples = first_unknowns(objective), objective.samples
    missed = objective.run(unknowns).outputs - samples.w
    residuals = jnp.where(samples.weight > 0, missed, 0.0)
    return step_error(objective, finer, unknowns, residuals)


def _from(objective: Objective, model: AbstractModel) -> Objective:
    """The same fit from another model of the same kind."""
    single = replace(objective, pieces=1)
    return eqx.tree_at(lambda o: o.parameters.model, single, model)


def _of(found: Refined, group: Sequence[Recording], weights: Any) -> Refined:
    """The fit with what it is of."""
    return replace(
        found,
        value=found.value.fitted_to(group),
        result=if_sorted(found.result, *(each.t for each in group)),
        lengths=np.array([*map(len, group)]),
        weights=weights,
    )


def _settled(found: Refined) -> Refined:
    """The fit with radii that are positive, and names of parameters that show the
    numbers found, unless some are no parameters then: of a play that has come to be the
    input, or to be another one."""
    model = found.value.settled()
    before, after = found.value.parameters(), model.parameters()
    if model is found.value or len(after) < len(before):
        return found
    renamed = dict(zip(before, after, strict=True))
    known = found.certainty
    # What another sign of a number turns about.
    turned = [
        before[name] * after[renamed[name]] < 0 if name in renamed else False
        for name in known.names
    ]
    signs = jnp.where(jnp.array(turned, bool), -1.0, 1.0)
    errors = {renamed[name]: x for name, x in found.standard_errors.items()}
    certainty = replace(
        known,
        names=tuple(renamed.get(name, name) for name in known.names),
        covariance=known.covariance * signs * signs[:, None],
        directions=known.directions * signs,
    )
    return replace(
        found,
        value=model,
        standard_errors=errors,
        covariance=certainty.covariance,
        certainty=certainty,
    )


def _free(model: AbstractModel, asked: bool | None) -> Free:
    """What is fitted of where recordings start.

    **Raises:** `InputError` for what is no answer.
    """
    if asked is not None and not isinstance(asked, bool | np.bool_):
        raise InputError(
            "`free_start` must be True, False or, for what suits the model, None; got "
            f"{checks.described(asked)}."
        )
    if asked is not None:
        return "state" if asked else "nothing"
    return free_of(model)


def _check_fading(model: AbstractModel, fading: bool | float) -> None:
    """Raise `InputError` where it is asked of a model that is no law."""
    if share(fading) and not fades(model):
        raise InputError(
            f"`fading` is about laws w' = f(w, u, u'), and this {type(model).__name__} "
            "is none: its state is not its output; leave it out."
        )


def share(fading: bool | float) -> float:
    """What may be left of a difference between initial values, 0 for anything."""
    return checks.share("fading", fading, ", or True or False")


def _check_kinds(loss: Any, shooting: Any, solver: Any) -> None:
    """Raise `InputError` for the name of a setting, or for a class."""
    checks.kind("loss", loss, AbstractLoss, "refinement.Huber(0.1)")
    ways = "refinement.MultipleShooting(4)"
    checks.kind("shooting", shooting, AbstractShooting, ways)
    if not isinstance(solver, Solver):
        raise InputError(
            "`solver` must be a solver of Optimistix, such as `optimistix.Dogleg(rtol="
            f"1e-8, atol=1e-8)`; got {checks.described(solver)}."
        )


def _check_samples(group: tuple[Recording, ...], objective: Objective) -> None:
    """Raise `InputError` when the samples cannot determine the parameters."""
    for recording in group:
        checks.not_constant("w", recording.w, "there is no trajectory to match.")
    names, scored = objective.parameters.names, objective.samples.scored
    w, weight = objective.samples.w, objective.samples.weight
    if is_concrete(scored, weight):
        used = int(np.sum(np.any(np.asarray(weight) > 0, axis=1)))
        starts = 0 if objective.free == "nothing" else used
        of = f"{', '.join(names)}{' and where it starts' if starts else ''}"
        what = f"a fit of {of} to samples of positive weight"
        # As many as unknowns leave no residuals, and no errors to tell.
        checks.enough_samples(what, int(scored), len(names) + starts + 1)
    if is_concrete(w, weight) and not np.ptp(np.asarray(w)[np.asarray(weight) > 0]):
        raise InputError(
            "the output is constant where it has weight: there is no trajectory to "
            "match. Give weight to samples of other outputs."
        )


@jit
def _refine(
    objective: Objective,
    finer: Samples,
    search: _Search,
    begun: Float[Array, " r"] | None = None,
) -> Refined:
    """The best of the fits of a search, whose recordings begin with the measured
    outputs, or with those of an earlier fit."""
    check_answers(objective.parameters.model)
    first = first_values(objective.parameters, *search.draws)
    objective = objective.prepared()

    def fit(values):
        return _stages(objective, values, begun, *search[1:])

    if len(first) == 1:
        minimum, losses = fit(first[0]), None
    else:
        minima = jax.vmap(fit)(within_reach(objective, first))
        losses = jnp.where(jnp.isfinite(minima.loss), minima.loss, jnp.inf)
        minimum = jax.tree.map(lambda leaf: leaf[jnp.argmin(losses)], minima)
    return _report(replace(objective, pieces=1), finer, minimum, losses)


def _stages(objective, values, begun, shooting, solver, max_steps):
    """Go through the stages of shooting; the last fit is one piece, all samples."""
    build = objective.parameters.build
    objective = eqx.tree_at(lambda o: o.parameters.model, objective, build(values))
    unknowns = first_unknowns(objective, begun)

    def stage(unknowns, settings):
        end = minimise(objective, unknowns, solver, max_steps, *settings)
        return end.unknowns, None

    stages = shooting.stages()
    if len(stages[0]):
        unknowns, _ = jax.lax.scan(stage, unknowns, stages)
    single = replace(objective, pieces=1)
    unknowns = replace(unknowns, starts=unknowns.starts[:, :1])
    return minimise(single, unknowns, solver, max_steps)


def _report(objective, finer, minimum: Minimum, losses) -> Refined:
    """What is known about a fit: of all, the best one's minimum, and the losses."""
    samples, parameters = objective.samples, objective.parameters
    model = parameters.build(minimum.unknowns.values)
    run = linearised(objective, minimum.unknowns)
    known, errors = certainty(objective, run)
    outputs = run.run.outputs
    used = samples.weight > 0
    residuals = jnp.where(used, outputs - samples.w, 0.0)
    rmse = jnp.sqrt(jnp.sum(residuals**2, axis=1) / jnp.sum(used, axis=1))
    weighed = root_of(samples.weight) * residuals
    correlation, white = jax.vmap(autocorrelation)(weighed, samples.weight)
    fading_along = None
    if fades(model):
        rows = run.run.states[..., 0], run.run.memory, signals(samples)
        fading_along = jax.vmap(lambda *row: fading(model, *row))(*rows)
    if losses is None:
        # Not the minimum's own, a further free run that would be compiled for it alone.
        loss = objective.cost(minimum.unknowns, run.run)
    else:
        loss = jnp.min(losses)  # the same number, not one a rounding apart
    # NaN too; and a law that leaves the record far behind has not converged, though
    # its trajectory may be finite.
    near = (rmse < FAR * samples.spread) | ~jnp.any(used, axis=1)
    lost = ~jnp.all(near)
    return Refined(
        value=model,
        result=RESULTS.where(lost, RESULTS.diverged, minimum.result),  # pyright: ignore
        num_steps=minimum.num_steps,
        loss=loss,
        losses=loss[None] if losses is None else losses,
        rmse=rmse,
        standard_errors={name: errors[i] for i, name in enumerate(parameters.names)},
        w0=outputs[:, 0],
        w0_standard_errors=known.output[:, 0],
        covariance=known.covariance,
        certainty=known,
        fading=fading_along,
        residuals=residuals,
        autocorrelation=correlation,
        whiteness=white,
        substeps=samples.substeps,
        step_error=step_error(objective, finer, minimum.unknowns, residuals),
        spread=samples.spread,
    )


def fades(model: AbstractModel) -> bool:
    """Whether its output tells a state that flows, as that of a law w' = f(w, u, u')
    does, with instruments or without: what that state was may be forgotten."""
    return not model.hidden and flows(model)


class Bootstrap(Shown):
    """Parameters fitted to resampled data.

    **Attributes:**

    - `values`: by free parameter, shape (samples,).
    - `standard_errors`: standard deviations of those, over the fits that succeeded.
    - `good`: which did, shape (samples,); and `failed`, how many did not.
    """

    values: dict[str, Float[Array, " samples"]]
    standard_errors: dict[str, Float[Array, ""]]
    good: Bool[Array, " samples"]

    @property
    def failed(self) -> Int[Array, ""]:
        """Number of fits that did not succeed."""
        return jnp.sum(~self.good)

    def _card(self) -> Card | None:
        if np.ndim(self.good) != 1 or not is_concrete(self.good):
            return None
        good = np.asarray(self.good)
        title = f"Bootstrap of {len(good)} fits, {int(self.failed)} of which failed"
        if not np.any(good):
            return Card(title)
        numbers = (
            Number(name, float(np.median(x[good])), error=float(errors))
            for (name, x), errors in zip(
                self.values.items(), self.standard_errors.values(), strict=True
            )
        )
        return Card(f"{title}: medians", numbers=tuple(numbers))


def bootstrap(
    model: AbstractModel | Solution,
    recordings: Recording | Sequence[Recording],
    *,
    key: PRNGKeyArray,
    samples: int = 200,
    block: int | None = None,
    weights: Weights | None = None,
    lead_in: int | None = None,
    periodic: bool = False,
    **options: Any,
) -> Bootstrap:
    """Resample blocks of a refined model's residuals, add them to its free run, and
    refine again.

    Blocks keep the correlation of the residuals, which the standard errors of `refine`
    do not know of: where the two differ much, believe these.

    **Arguments:**

    - `model`: what `refine` returned, or its value, which then is refined once more.
    - `recordings`: what it was refined on.
    - `key`: a `jax.random` key.
    - `samples`: number of fits, all in one `vmap`.
    - `block`: samples a block, several times the length over which residuals are
        correlated; the square root of the recording's length by default.
    - `weights`, `lead_in`, `periodic`: those it was refined with, and where none is
        given the weights that what `refine` returned tells; samples of weight 0 leave
        no residuals to be drawn, and from others to others these are scaled as the
        weights have it.
    - `options`: further arguments of `refine`; by default the `substeps` of the fit,
        and starts are fitted only where it fitted them.

    **Returns:** a `Bootstrap`.

    **Raises:** `InputError` for fewer than two `samples`, a block longer than a
    recording, and other recordings or weights than those of the fit.

    **Source:** Künsch (1989), doi 10.1214/aos/1176347265, for blocks; Politis and
    Romano (1992), A circular block-resampling procedure for stationary data, in
    Exploring the Limits of Bootstrap, Wiley, ISBN 0-471-53631-8, for drawing them from
    a ring; the standard error, over one less than the fits, by Efron and Tibshirani
    (1986), doi 10.1214/ss/1177013815.
    """
    checks.key("key", key)
    if checks.whole("samples", samples) < 2:
        raise InputError(f"`samples` must be at least 2 to differ, got {samples}.")
    if "throw" in options:
        raise InputError(
            "`bootstrap` has no `throw`: fits that fail are told by its `good`."
        )
    group = as_group(recordings, _BOOTSTRAP)
    keys = jax.random.split(key, samples + 1)
    if options.get("starts", 1) > 1:
        options = {"key": keys[0]} | options
    if isinstance(model, Solution) and Refined.told_by(model):
        fit = Refined.of(model)
        group, weights = _as_fitted(group, fit, weights, lead_in, periodic)
        if fit.standard_errors.keys() >= set(fit.certainty.names):  # no start is one
            options = {"free_start": False} | options
    else:
        group, weights, _ = as_measured(group, weights, lead_in, periodic)
        asked = _asked(options.get("free_start"), lead_in, periodic)
        options = options | {"free_start": asked}
        again = refine(model, group, weights=weights, throw=False, **options)
        fit = Refined.of(again)
        options = _under_new_names(options, as_model(model, "bootstrap"), fit.value)
    options = {"substeps": fit.substeps, **options}
    runs = [
        _free_run(recording, residuals, known)
        for recording, residuals, known in zip(
            group, fit.residuals, weights or [None] * len(group), strict=True
        )
    ]
    blocks = [block_length(block, len(run.rows)) for run in runs]
    # As `refine` has it, which no longer sees the support of a law over a library.
    law = compacted(fit.value)
    values, good = _refits(law, group, runs, blocks, weights, options, keys[1:])
    errors = {
        name: jnp.std(value, where=good, ddof=1) for name, value in values.items()
    }
    return Bootstrap(values, errors, good)


_BOOTSTRAP = "bootstrap(model, recordings)"


def _as_fitted(
    group: tuple[Recording, ...],
    fit: Refined,
    weights: Weights | None,
    lead_in: int | None,
    periodic: bool,
) -> tuple[tuple[Recording, ...], list[Array] | None]:
    """Recordings and weights as `as_measured` has them, where nothing is said of these
    by the weights of the fit.

    **Raises:** `InputError` for others than those of the fit.
    """
    if weights is None and not lead_in and not periodic:
        check_fitted_on(group, fit, _BOOTSTRAP)
        return as_measured(group, fit.weights, None, periodic=False)[:2]
    group, known, _ = as_measured(group, weights, lead_in, periodic)
    check_fitted_on(group, fit, _BOOTSTRAP)
    _check_weights(group, fit, known)
    return group, known


def _check_weights(group, fit: Refined, given: list[Array] | None) -> None:
    """Raise `InputError` for other weights than those of a fit; their scale is no
    matter."""
    alike = [np.ones(len(each)) for each in group]
    pair = given or alike, fit.weights or alike
    if not is_concrete(*pair[0], *pair[1]):
        return
    new, own = (np.concatenate([*map(np.asarray, each)]) for each in pair)
    if len(new) != len(own) or not np.allclose(
        new / np.mean(new), own / np.mean(own), atol=0
    ):
        raise InputError(
            f"{_BOOTSTRAP}: `weights` and `lead_in` are not those that the model was "
            "refined with. Give those, or leave out both: the fit tells its weights."
        )


def _under_new_names(options, before: AbstractModel, after: AbstractModel):
    """Options that name parameters, by what these are called after a fit: of plays and
    lags names show the numbers found."""
    old, new = before.parameters(), after.parameters()
    named = dict(zip(old, new, strict=False)) if len(old) == len(new) else {}

    def now(name: str) -> str:
        return named.get(name, name)

    fixed, bounds, tied = (options.get(n) or {} for n in ("fixed", "bounds", "tied"))
    return options | {
        "fixed": tuple(map(now, fixed)),
        "bounds": {now(name): each for name, each in bounds.items()},
        "tied": {now(name): (by, now(other)) for name, (by, other) in tied.items()},
    }


class _FreeRun(NamedTuple):
    """The output of a fit; the rows that it was fitted to, the roots of their weights,
    and by these what it leaves there, measured minus simulated."""

    w: Float[Array, " n"]
    rows: Int[np.ndarray, " m"]
    root: Float[Array, " m"]
    left: Float[Array, " m"]


def _free_run(recording: Recording, residuals, weight) -> _FreeRun:
    n = len(recording)
    weight = np.ones(n, recording.w.dtype) if weight is None else weight
    rows = np.flatnonzero(np.asarray(weight) > 0)
    root = jnp.sqrt(weight[rows])
    return _FreeRun(recording.w + residuals[:n], rows, root, -root * residuals[rows])


@jit
def _refits(model, group, runs, blocks, weights, options, keys):
    """The free parameters by resampled data, a set a key, and whether that ended."""

    def refit(key):
        resampled = [
            eqx.tree_at(
                lambda r: r.w,
                recording,
                # Of the size that noise has there, whose variance is one over weight.
                w.at[rows].add(redrawn(key, left, length) / root),
            )
            for recording, (w, rows, root, left), length, key in zip(
                group, runs, blocks, jax.random.split(key, len(group)), strict=True
            )
        ]
        fit = refine(model, resampled, weights=weights, throw=False, **options)
        fit = Refined.of(fit)
        good = fit.result == RESULTS.successful
        values = fit.value.parameters()
        return {name: values[name] for name in fit.standard_errors}, good

    return jax.vmap(refit)(keys)


_SAME = 1e-6  # of the output's spread, by which first outputs may be rounded


def check_fitted_on(group: tuple[Recording, ...], fit: Refined, call: str) -> None:
    """Raise `InputError` for other recordings than those of a fit: of other lengths, or
    with other first outputs, where it knows these."""
    longest = max(map(len, group))
    others = f"{call}: these are not the recordings that the model was refined on"
    if fit.residuals.shape != (len(group), longest):
        raise InputError(
            f"{others}, or not with the lead-in of then: {len(group)} of at most "
            f"{longest} samples, where it leaves residuals of shape "
            f"{fit.residuals.shape}."
        )
    if not is_concrete(fit.residuals, [each.w for each in group]):
        return
    left, w = np.asarray(fit.residuals)[:, 0], np.array([each.w[0] for each in group])
    then = np.asarray(fit.w0) - left
    rounding = np.finfo(w.dtype).eps * np.maximum(np.abs(w), np.abs(then))
    known = left != 0  # not of a sample without weight
    off = known & (np.abs(w - then) > _SAME * float(fit.spread) + 8 * rounding)
    if np.any(off):
        i = int(np.argmax(off))
        raise InputError(
            f"{others}: the output of recording {i} begins with {w[i]:.6g}, and there "
            f"with {then[i]:.6g}."
        )


def redrawn(key, residuals: Float[Array, " n"], length: int) -> Float[Array, " n"]:
    """Blocks from random places, end to end; the record is taken as a ring. Of none
    there are none."""
    n = residuals.shape[0]
    if n == 0:
        return residuals
    starts = jax.random.randint(key, (-(-n // length),), 0, n)
    rows = (starts[:, None] + jnp.arange(length)).ravel()[:n] % n
    return (residuals - jnp.mean(residuals))[rows]


def block_length(block: int | None, n: int) -> int:
    """Residuals a block, of n: by default the square root of these.

    **Raises:** `InputError` for more, unless there are none: a recording that weights
    leave out has no part in what blocks may be.
    """
    if n == 0:
        return 1
    length = round(n**0.5) if block is None else checks.whole("block", block)
    if not 1 <= length <= n:
        raise InputError(f"`block` must lie between 1 and {n} samples, got {length}.")
    return length
