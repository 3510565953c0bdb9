import dataclasses
import io
import re
import sys
import warnings
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import optax
import optimistix as optx
import pytest
from fits import fit_of
from jax.flatten_util import ravel_pytree
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import chi2, kstest

import hystjax as hj
from hystjax import RESULTS, ComputationError, InputError, refinement
from hystjax.library import Polynomial
from hystjax.models import (
    AbstractModel,
    BoucWen,
    BoucWenForce,
    BoucWenOscillator,
    Duhem,
    FittedRange,
    SparseModel,
)
from hystjax.refinement import (
    Cauchy,
    Certainty,
    Huber,
    MultipleShooting,
    SingleShooting,
    Squares,
    _refine as refining,
)
from hystjax.refinement._certainty import (
    Linearised,
    _fading,
    _of_steps,
    _start_names,
    certainty,
)
from hystjax.refinement._choices import parameters
from hystjax.refinement._objective import (
    Drive,
    Objective,
    each_of,
    pulls,
    states,
    within_reach,
)
from hystjax.refinement._solve import (
    Problem,
    Whitened,
    _better,
    _slope,
    compressed,
    factor,
)
from hystjax.signals import Grid
from hystjax.simulation import flow, from_start

# ------------------------------------------------- a Duhem law, with its closed form

NAMES = ("du", "u*|du|", "w*|du|")
TRUTH = np.array([0.25, 0.4, -0.5])
T = np.linspace(0, 12, 241)
U = np.sin(1.3 * T) * (0.4 + 0.1 * T) + 0.3 * np.sin(3.1 * T)
W0 = 0.1


def law(coefficients=TRUTH):
    return SparseModel.from_terms(
        dict(zip(NAMES, map(float, coefficients), strict=True))
    )


def closed_form(coefficients, w0, t, u):
    """The output over straight lines of input, where the law is linear in w with
    constant coefficients."""
    du, u_du, w_du = coefficients
    w = [w0]
    for h, start, stop in zip(np.diff(t), u[:-1], u[1:], strict=True):
        s = (stop - start) / h
        decay = -w_du * abs(s)
        slope = u_du * abs(s) * s / decay
        level = (u_du * abs(s) * start + du * s - slope) / decay
        w.append(level + slope * h + (w[-1] - level) * np.exp(-decay * h))
    return np.array(w)


def record(noise=0.0, seed=0, t=T, u=U, w0=W0, coefficients=TRUTH):
    w = closed_form(coefficients, w0, t, u)
    error = np.random.default_rng(seed).normal(size=len(t))
    return hj.Recording(t, u, w + noise * error)


CUBIC = hj.Recording(T, U, U, interpolation=hj.interpolation.Cubic())
CLEAN, NOISY = record(), record(0.01)


@pytest.mark.slow
def test_a_smooth_input_taken_for_straight_lines_is_told():
    fast = np.sin(9 * T) * (0.4 + 0.1 * T)
    smooth = hj.Recording(T, fast, fast, interpolation=hj.interpolation.Cubic())
    w = hj.simulate(law(), smooth, w0=W0).w
    with pytest.warns(UserWarning, match="the input is smooth.*Cubic"):
        hj.refine(law(), hj.Recording(T, fast, w))
    # The same input, and a device that lines did drive.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hj.refine(law(), record(u=fast))
        hj.refine(law(), record(0.1, u=fast))


def test_an_input_that_stands_still_is_no_smooth_one():
    """A law that settles, in closed form: w' = 1 - 0.5 w from 0."""
    rest = hj.Recording(T, np.full_like(T, 3.0), 2 - 2 * np.exp(-T / 2))
    off = SparseModel.from_terms({"1": 0.8, "w": -0.6})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        terms = hj.refine(off, rest).value.terms()
    np.testing.assert_allclose([terms["1"], terms["w"]], [1, -0.5], rtol=1e-6)


def found(solution):
    return np.array([solution.value.parameters()[name] for name in NAMES])


def errors(solution):
    return np.array([solution.stats["standard_errors"][name] for name in NAMES])


def scipy_fit(records, weights=None):
    """Coefficients and first outputs, and their covariance, by SciPy."""
    weights = weights or [np.ones(len(r)) for r in records]
    records = [jax.tree.map(np.asarray, r) for r in records]

    def residuals(x):
        parts = [
            np.sqrt(weight) * (closed_form(x[:3], start, r.t, r.u) - r.w)
            for r, weight, start in zip(records, weights, x[3:], strict=True)
        ]
        return np.concatenate(parts)

    first = np.array([*TRUTH, *(r.w[0] for r in records)])
    fit = least_squares(residuals, first, "3-point", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    free = sum(np.count_nonzero(weight) for weight in weights) - len(first)
    return fit.x, 2 * fit.cost / free * np.linalg.inv(fit.jac.T @ fit.jac)


def fit(recordings=NOISY, start=1.3 * TRUTH, **settings):
    return hj.refine(law(start), recordings, **settings)


# ----------------------------------------------------------------------------- truth


@pytest.mark.parametrize("off", [0.7, 1.3])
def test_a_duhem_law_is_recovered_from_a_clean_record(off):
    solution = fit(CLEAN, off * TRUTH)
    np.testing.assert_allclose(found(solution), TRUTH, rtol=1e-6)
    assert float(solution.stats["w0"][0]) == pytest.approx(W0, rel=1e-6)
    assert solution.result == RESULTS.successful
    assert eqx.tree_equal(solution.value.fitted_range, FittedRange.of([CLEAN]))


@pytest.mark.parametrize("off", [0.7, 1.3])
def test_the_classical_duhem_law_is_recovered(off):
    start = Duhem(0.4 * off, 0.5 * off, 0.25 * off)
    value = hj.refine(start, CLEAN).value
    assert isinstance(value, Duhem)
    np.testing.assert_allclose(
        [value.alpha, value.beta, value.gamma], [0.4, 0.5, 0.25], rtol=1e-6
    )


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.7, 1.3])
def test_a_bouc_wen_law_is_recovered_with_its_exponent(off):
    truth = BoucWen(1.0, 0.5, 0.8, 2.0)
    method = hj.simulation.Adaptive(rtol=1e-11, atol=1e-11)
    w = hj.simulate(truth, CLEAN, w0=W0, method=method).w
    start = truth.with_parameters({k: off * v for k, v in truth.parameters().items()})
    value = hj.refine(start, hj.Recording(T, U, w), substeps=8).value
    assert isinstance(value, BoucWen)
    np.testing.assert_allclose(
        [value.alpha, value.beta, value.gamma, value.n], [1, 0.5, 0.8, 2], rtol=1e-6
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:with 32 steps", "ignore:the input is smooth")
def test_the_exponent_of_a_knee_stays_positive():
    t = np.linspace(0, 12, 400)
    u = 1.5 * np.sin(2 * t) * np.exp(-t / 20)
    nothing = hj.Recording(t, u, 0 * t)
    truth, method = BoucWen(1.0, 1.2, 0.5, 0.1), hj.simulation.FixedStep(8)
    w = hj.simulate(truth, nothing, w0=0.0, method=method).w
    # The steps that it asks for by itself, after two fits with fewer.
    start, record = BoucWen(0.8, 3.0, -0.5, 4.0), hj.Recording(t, u, w)
    assert hj.refine(start, record, substeps=32, throw=False).value.n > 0


# ----------------------------------------------------------------- SciPy's minimum


def test_the_minimum_and_its_covariance_are_scipys():
    solution = fit()
    best, covariance = scipy_fit([NOISY])
    stats = solution.stats
    np.testing.assert_allclose(found(solution), best[:3], rtol=1e-5)
    np.testing.assert_allclose(stats["w0"], best[3:], rtol=1e-6)
    np.testing.assert_allclose(stats["covariance"], covariance, rtol=1e-4)
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(errors(solution), deviations[:3], rtol=1e-5)
    np.testing.assert_allclose(stats["w0_standard_errors"], deviations[3:], rtol=1e-5)
    residuals = closed_form(best[:3], best[3], T, U) - np.asarray(NOISY.w)
    np.testing.assert_allclose(stats["residuals"][0], residuals, atol=1e-7)
    np.testing.assert_allclose(stats["rmse"][0], np.std(residuals), rtol=0.01)
    scaled = np.mean(residuals**2) / np.var(np.asarray(NOISY.w)) / 2
    assert float(stats["loss"]) == pytest.approx(scaled, rel=1e-6)


def test_the_band_of_the_output_comes_from_the_covariance():
    known = fit().stats["certainty"]
    best, covariance = scipy_fit([NOISY])
    steps = 1e-5 * np.eye(4)
    columns = [
        (
            closed_form(best[:3] + d[:3], best[3] + d[3], T, U)
            - closed_form(best[:3] - d[:3], best[3] - d[3], T, U)
        )
        / 2e-5
        for d in steps
    ]
    jacobian = np.stack(columns, axis=1)
    band = np.sqrt(np.einsum("nq,qr,nr->n", jacobian, covariance, jacobian))
    np.testing.assert_allclose(known.output[0], band, rtol=1e-4)


def test_recordings_of_different_length_and_rate_are_one_problem():
    t = np.linspace(0, 5, 151)
    other = record(0.02, 1, t, 1.5 * np.sin(2 * t) + 0.2 * t, -0.3)
    solution = fit([NOISY, other])
    best, covariance = scipy_fit([NOISY, other])
    np.testing.assert_allclose(found(solution), best[:3], rtol=1e-5)
    np.testing.assert_allclose(solution.stats["w0"], best[3:], rtol=1e-5)
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(errors(solution), deviations[:3], rtol=1e-5)
    padding = np.asarray(solution.stats["residuals"])[1, len(t) :]
    assert padding.size and not padding.any()


# -------------------------------------------------------------------- what is fitted


def test_fixed_parameters_keep_their_value_and_the_rest_is_fitted():
    solution = fit(CLEAN, TRUTH * [1.0, 1.3, 0.7], fixed=["du"])
    np.testing.assert_allclose(found(solution), TRUTH, rtol=1e-6)
    assert set(solution.stats["standard_errors"]) == {"u*|du|", "w*|du|"}
    wrong = fit(CLEAN, TRUTH * [1.3, 1, 1], fixed=["du"])
    assert found(wrong)[0] == 1.3 * TRUTH[0]


def test_tied_parameters_follow():
    solution = fit(CLEAN, TRUTH * [1.3, 1.3, 5.0], tied={"w*|du|": (-1.25, "u*|du|")})
    np.testing.assert_allclose(found(solution), TRUTH, rtol=1e-6)
    _, u_du, w_du = found(solution)
    assert w_du == -1.25 * u_du
    assert set(solution.stats["standard_errors"]) == {"du", "u*|du|"}


@pytest.mark.parametrize(
    "bounds",
    [
        {"du": (0.0, 1.0)},
        {"du": (0.0, np.inf), "w*|du|": (-np.inf, 0.0)},
        {"u*|du|": (-5.0, 40.0), "w*|du|": (-30.0, np.inf)},
        {"w*|du|": (-1.0, -0.4)},  # the fit starts beyond it
    ],
    ids=str,
)
def test_bounds_that_hold_at_the_minimum_do_not_change_it(bounds):
    solution = fit(start=TRUTH * [1.3, 1.3, 2.5], bounds=bounds)
    np.testing.assert_allclose(found(solution), scipy_fit([NOISY])[0][:3], rtol=1e-5)


@pytest.mark.parametrize("far", [1e2, 1e6, 1e10])
def test_a_bound_may_be_far_away(far):
    """A fit starts at the model's own values, however wide the bounds are."""
    bounds = {"du": (0.0, far), "u*|du|": (-1.0, far), "w*|du|": (-far, 0.0)}
    solution = fit(bounds=bounds)
    np.testing.assert_allclose(found(solution), scipy_fit([NOISY])[0][:3], rtol=1e-5)
    begins = parameters(law(), (), bounds, {})
    values = begins.bounded(begins.unbounded(begins.values()))
    np.testing.assert_allclose(values, TRUTH, rtol=1e-9)


@pytest.mark.parametrize(
    ("bounds", "edge"),
    [
        ((-0.4, 1.0), -0.4),
        ((-0.4, np.inf), -0.4),
        ((-np.inf, -0.65), -0.65),
        ((-1.0, -0.65), -0.65),
        ((-0.52, np.inf), -0.52),  # the minimum is a hundredth of an error beyond
    ],
)
def test_a_fit_can_end_on_a_bound(bounds, edge):
    solution = fit(bounds={"w*|du|": bounds})

    def residuals(x):
        return closed_form((*x[:2], edge), x[2], T, U) - np.asarray(NOISY.w)

    best = least_squares(residuals, [0.25, 0.4, 0.1], xtol=1e-14, ftol=1e-14).x
    assert bounds[0] <= found(solution)[2] <= bounds[1]
    np.testing.assert_allclose(found(solution), [*best[:2], edge], rtol=1e-5)


def test_a_minimum_close_to_a_bound_is_not_taken_for_it():
    """So close that the bound is tried, which fits less well."""
    best = scipy_fit([NOISY])[0][:3]
    solution = fit(bounds={"w*|du|": (best[2] - 5e-4, 0.5)})
    np.testing.assert_allclose(found(solution), best, rtol=1e-5)


def test_only_what_is_near_a_bound_is_put_on_it():
    """Between two bounds that is within 0.1 of where the sine turns, of one where the
    hyperbola does, and without any nowhere."""
    bounds = {NAMES[0]: (0.0, 1.0), NAMES[1]: (0.0, np.inf)}
    given = parameters(law(), (), bounds, {})
    assert given.names == NAMES
    for both, one in (((0.09, 0.0), (0.09, 0.0)), ((3.05, np.pi), (-0.11, -0.11))):
        point, expected = zip(both, one, (0.01, 0.01), strict=True)
        np.testing.assert_allclose(given.pinned(jnp.array(point)), expected)


def test_a_number_that_begins_on_a_bound_of_zero_can_leave_it():
    given = parameters(law(0 * TRUTH), (), {NAMES[0]: (0.0, np.inf)}, {})
    start = given.unbounded(given.values())
    slope = jax.jvp(given.bounded, (start,), (jnp.ones(3),))[1]
    assert 0 < given.bounded(start)[0] < 0.1 and slope[0] > 1e-3


def test_several_bounds_can_be_active():
    solution = fit(bounds={"du": (0.35, np.inf), "u*|du|": (0.0, 0.2)})

    def residuals(x):
        return closed_form(x[:3], x[3], T, U) - np.asarray(NOISY.w)

    lower, upper = [0.35, 0.0, -np.inf, -np.inf], [np.inf, 0.2, np.inf, np.inf]
    settings = {"bounds": (lower, upper), "xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    best = least_squares(residuals, [0.4, 0.1, -0.3, 0.1], **settings)
    assert best.active_mask.tolist() == [-1, 1, 0, 0]
    np.testing.assert_allclose(found(solution), best.x[:3], rtol=1e-5)
    np.testing.assert_allclose(solution.stats["w0"], best.x[3:], rtol=1e-5)
    least = best.cost / (len(T) * np.var(np.asarray(NOISY.w)))
    assert float(solution.stats["loss"]) == pytest.approx(least, rel=1e-5)


def test_the_first_output_is_fitted_or_measured():
    w = np.asarray(NOISY.w).copy()
    w[0] += 0.2
    shifted = hj.Recording(T, U, w)
    free, held = fit(shifted), fit(shifted, free_start=False)
    best, _ = scipy_fit([shifted])
    np.testing.assert_allclose(found(free), best[:3], rtol=1e-5)
    np.testing.assert_allclose(free.stats["w0"], best[3:], rtol=1e-6)

    def residuals(x):
        return closed_form(x, w[0], T, U) - w

    best = least_squares(residuals, TRUTH, xtol=1e-14, ftol=1e-14)
    covariance = 2 * best.cost / (len(T) - 3) * np.linalg.inv(best.jac.T @ best.jac)
    np.testing.assert_allclose(found(held), best.x, rtol=1e-5)
    np.testing.assert_allclose(held.stats["covariance"], covariance, rtol=1e-4)
    assert float(held.stats["w0"][0]) == w[0]
    assert float(held.stats["w0_standard_errors"][0]) == 0


# ---------------------------------------------------------- weights, losses, outliers


def test_noise_that_weighs_is_told_at_uneven_times_too():
    rng = np.random.default_rng(0)
    t, sigma = np.sort(rng.uniform(0, 20, 4001)), 0.0005
    w = np.sin(t) + sigma * rng.normal(size=len(t))
    even = np.sin(np.linspace(0, 20, 4001)) + w - np.sin(t)
    records = [hj.Recording(t, np.sin(t), w), hj.Recording(None, even, even)]
    for weights in refinement.weights_of(records, "noise"):
        np.testing.assert_allclose(weights, sigma**-2.0, rtol=0.2)


def test_weights_of_zero_leave_samples_out():
    weights = np.where(np.arange(len(T)) < 180, 1.0, 0.0)
    weighted = fit(weights=[weights])
    shorter = fit(NOISY.window(0, 180))
    np.testing.assert_allclose(found(weighted), found(shorter), rtol=1e-9)
    np.testing.assert_allclose(errors(weighted), errors(shorter), rtol=1e-9)
    for name in ("rmse", "whiteness", "autocorrelation"):
        one, other = weighted.stats[name], shorter.stats[name]
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_noise_of_two_sizes_is_white_where_weights_tell_it():
    """Loud neighbours are loud together, which the same test without weights takes for
    correlation."""
    sigma = np.where(np.arange(len(T)) < 120, 0.002, 0.02)
    weight = jnp.asarray(sigma**-2)
    noise = np.random.default_rng(3).normal(size=(200, len(T)))

    def probabilities(rows):
        each = jax.jit(jax.vmap(refinement.autocorrelation, (0, None)))
        return np.asarray(each(jnp.asarray(rows), weight)[1])

    assert np.mean(probabilities(sigma * noise) < 0.01) > 0.2
    worst = noise[np.argmin(probabilities(sigma * noise))]
    loud = hj.Recording(T, U, np.asarray(record(0.0).w) + sigma * worst)
    assert float(fit(loud, weights=[weight]).stats["whiteness"][0]) > 0.05


def test_a_recording_without_any_weight_is_left_out():
    both = [NOISY, record(0.01, seed=1)]
    solution = hj.refine(law(), both, weights=[np.ones(len(T)), np.zeros(len(T))])
    np.testing.assert_allclose(found(solution), found(fit(NOISY)), rtol=1e-7)
    for name in ("rmse", "whiteness"):
        assert np.isnan(np.asarray(solution.stats[name])).tolist() == [False, True]
    # Nothing tells where it starts, and nothing of the residuals is taken for that.
    _, covariance = scipy_fit([NOISY])
    expected = np.sqrt(np.diag(covariance))[: len(NAMES)]
    np.testing.assert_allclose(errors(solution), expected, rtol=1e-5)


@pytest.mark.filterwarnings("error:with 1 steps", "ignore:the input is smooth")
def test_a_recording_without_any_weight_asks_for_no_more_steps():
    rough = [record(0.01, seed, T[::4], U[::4]) for seed in (0, 1)]
    counts = [np.ones(len(rough[0])), np.zeros(len(rough[1]))]
    refined = hj.refine(law(), rough, weights=counts)
    both = refined.stats
    once, twice = (
        hj.simulate(refined.value, rough[0], w0=both["w0"][0], method=steps).w
        for steps in map(hj.simulation.FixedStep, (1, 2))
    )
    change = np.sqrt(np.mean((once - twice) ** 2))
    assert float(both["step_error"]) == pytest.approx(change, rel=1e-3)
    # Less than is small beside the noise; and more than without any would be.
    least, most = 1e-6 * both["spread"], 0.01 * both["rmse"][0]
    assert both["substeps"] == 1 and least < both["step_error"] < most
    hj.refine(law(), rough, weights=counts, substeps=1)  # without a warning of steps


@pytest.mark.parametrize("scale", [1e-30, 1e-16, 1e12])
def test_the_scale_of_weights_is_no_matter(scale):
    """But to the noise of a sample of weight 1: 1/variance in other units."""
    weights = np.random.default_rng(3).uniform(0.1, 3, len(T))
    one, other = fit(weights=[weights]), fit(weights=[scale * weights])
    np.testing.assert_allclose(found(other), found(one), rtol=1e-9)
    np.testing.assert_allclose(errors(other), errors(one), rtol=1e-7)
    ratio = other.stats["certainty"].noise / one.stats["certainty"].noise
    assert ratio == pytest.approx(scale**0.5)


def test_weights_are_scipys():
    weights = np.random.default_rng(3).uniform(0.1, 3, len(T))
    solution = fit(weights=[weights])
    best, covariance = scipy_fit([NOISY], [weights])
    np.testing.assert_allclose(found(solution), best[:3], rtol=1e-5)
    np.testing.assert_allclose(solution.stats["covariance"], covariance, rtol=1e-4)
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(errors(solution), deviations[:3], rtol=1e-5)


@pytest.mark.parametrize("loss", [Huber(0.0134), Cauchy(0.0238)], ids=repr)
def test_robust_losses_survive_gross_outliers(loss):
    generator = np.random.default_rng(4)
    hit = generator.choice(np.arange(1, len(T)), len(T) // 20, replace=False)
    w = np.asarray(NOISY.w).copy()
    w[hit] += generator.uniform(1, 3, len(hit))
    spoilt = hj.Recording(T, U, w)
    allowed = 5 * np.sqrt(np.diag(scipy_fit([NOISY])[1]))[:3]
    robust = fit(spoilt, loss=loss)
    assert np.all(np.abs(found(robust) - TRUTH) < allowed)
    assert np.any(np.abs(found(fit(spoilt)) - TRUTH) > 3 * allowed)
    # Their standard errors stay those of the clean record, the outliers' do not.
    np.testing.assert_allclose(errors(robust), allowed / 5, rtol=0.35)


def test_robust_standard_errors_leave_out_what_has_no_weight():
    """Though beyond row 120 the record is wrong."""
    half = np.arange(len(T)) < 120
    spoilt = hj.Recording(T, U, np.where(half, NOISY.w, NOISY.w + 0.5))
    loss = Huber(0.0134)
    weighted = fit(spoilt, loss=loss, weights=[np.where(half, 1.0, 0.0)])
    shorter = fit(NOISY.window(0, 120), loss=loss)
    np.testing.assert_allclose(found(weighted), found(shorter), rtol=1e-9)
    np.testing.assert_allclose(errors(weighted), errors(shorter), rtol=1e-9)
    one, other = (solution.stats["certainty"] for solution in (weighted, shorter))
    np.testing.assert_allclose(one.noise, other.noise, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)


def test_robust_standard_errors_of_two_recordings_with_weights_are_their_formula():
    """Huber (1973): the mean of influence^2 over the squared mean of its slope, times
    the inverse of J'WJ. The shorter recording ends in an outlier, which must not count
    for every row that is filled up."""
    generator = np.random.default_rng(9)
    t = np.linspace(0, 5, 101)
    other = record(0.01, 1, t, 1.5 * np.sin(2 * t) + 0.2 * t, -0.3)
    other = hj.Recording(t, other.u, other.w + np.where(t == t[-1], 0.5, 0.0))
    group, scale = [NOISY, other], 0.0238
    weights = [generator.uniform(0.1, 3, len(r)) for r in group]
    solution = fit(group, loss=Cauchy(scale), weights=weights)
    x = np.concatenate([found(solution), solution.stats["w0"]])
    rows, weight = [jax.tree.map(np.asarray, r) for r in group], np.concatenate(weights)

    def outputs(x):
        starts = x[3:]
        runs = zip(rows, starts, strict=True)
        return np.concatenate([closed_form(x[:3], w0, r.t, r.u) for r, w0 in runs])

    steps = 1e-5 * np.eye(5)
    jacobian = np.stack([(outputs(x + d) - outputs(x - d)) / 2e-5 for d in steps], 1)
    r = outputs(x) - np.concatenate([each.w for each in rows])
    influence, share = r / (1 + (r / scale) ** 2), (r / scale) ** 2
    slope = (1 - share) / (1 + share) ** 2
    variance = np.sum(weight * influence**2) / (len(r) - 5)
    variance /= (np.sum(weight * slope) / np.sum(weight)) ** 2
    covariance = variance * np.linalg.inv(jacobian.T * weight @ jacobian)
    np.testing.assert_allclose(solution.stats["covariance"], covariance, rtol=1e-3)
    noise = solution.stats["certainty"].noise
    np.testing.assert_allclose(noise, np.sqrt(variance), rtol=1e-6)


def huber(r, c):
    return np.where(np.abs(r) <= c, r**2 / 2, c * np.abs(r) - c**2 / 2)


def cauchy(r, c):
    return c**2 / 2 * np.log1p((r / c) ** 2)


@pytest.mark.parametrize(
    ("loss", "rho"),
    [
        (Squares(), lambda r: r**2 / 2),
        (Huber(0.7), lambda r: huber(r, 0.7)),
        (Cauchy(0.7), lambda r: cauchy(r, 0.7)),
    ],
    ids=["squares", "Huber", "Cauchy"],
)
def test_losses_are_their_formulas(loss, rho):
    r = np.concatenate([np.linspace(-5, 5, 101), [1e-9, -1e-5, 0.69, 0.71]])
    root = np.asarray(loss.signed_root(jnp.asarray(r)))
    np.testing.assert_allclose(root**2 / 2, rho(r), rtol=1e-9, atol=1e-25)
    assert np.all(np.sign(root) == np.sign(r))
    h = 1e-6
    slope = (rho(r + h) - rho(r - h)) / (2 * h)
    np.testing.assert_allclose(loss.influence(jnp.asarray(r)), slope, atol=1e-6)
    # The solver's own derivative is finite and right at 0 and on the knees.
    along = jax.vmap(jax.grad(loss.signed_root))(jnp.asarray(r))
    np.testing.assert_allclose(root * along, slope, atol=1e-6)


@pytest.mark.parametrize("scale", [0.7, 1e-6, 3e4])
def test_cauchys_root_near_zero_is_its_formula(scale):
    """By mpmath to 50 digits: from far below the scale, where the root is the residual
    itself, over 1e-3 to 0.1 of it, where terms of the series decide, to beyond."""
    shares = np.concatenate([
        np.geomspace(1e-12, 1e-3, 19), np.geomspace(1e-3, 0.1, 21), [0.5, 1.0, 30.0]
    ])  # fmt: skip
    r = scale * np.concatenate([-shares, shares])
    with mpmath.workdps(50):
        exact = [
            mpmath.sign(x) * scale * mpmath.sqrt(mpmath.log1p((x / scale) ** 2))
            for x in map(mpmath.mpf, r.tolist())
        ]
        slopes = [
            x / (1 + (x / scale) ** 2) / root
            for x, root in zip(map(mpmath.mpf, r.tolist()), exact, strict=True)
        ]
    expected, slopes = (np.array([float(x) for x in row]) for row in (exact, slopes))
    loss = Cauchy(scale)
    found, along = jax.vmap(jax.value_and_grad(loss.signed_root))(jnp.asarray(r))
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    np.testing.assert_allclose(along, slopes, rtol=1e-9)
    # What it takes from the residual, (r/scale)^2 / 4, to the digits that are left.
    some = np.abs(r) > 1e-5 * scale
    taken, least = 1 - np.asarray(found)[some] / r[some], 1 - (expected / r)[some]
    np.testing.assert_allclose(taken, least, rtol=1e-5)


# -------------------------------------------------------------- shooting and starts


SHOOTING = pytest.mark.parametrize(
    "shooting", [SingleShooting((0.1, 0.4)), MultipleShooting(8)], ids=str
)


@SHOOTING
def test_every_way_of_shooting_ends_at_the_same_minimum(shooting):
    solution, plain = fit(shooting=shooting), fit()
    np.testing.assert_allclose(found(solution), found(plain), rtol=1e-7)
    np.testing.assert_allclose(errors(solution), errors(plain), rtol=1e-7)


FAR = [0.25, 0.4, 3.0]  # grows by a factor of 1e15 over the record


@SHOOTING
def test_pieces_and_horizons_lead_out_of_a_law_that_blows_up(shooting):
    plain = fit(start=FAR, throw=False)
    assert not np.allclose(found(plain), TRUTH, rtol=0.5)
    np.testing.assert_allclose(
        found(fit(start=FAR, shooting=shooting)), found(fit()), rtol=1e-6
    )


def test_nothing_is_drawn_to_samples_without_weight():
    """Whatever an instrument wrote where it had nothing to say."""
    weight = np.ones(len(T))
    weight[[60, 120, 180]] = 0
    fits = []
    for written in (0.0, -999.0):
        bad = dataclasses.replace(NOISY, w=np.where(weight > 0, NOISY.w, written))
        nudged = refinement.Nudging((0.5, 0.1))
        fits.append(fit(bad, start=FAR, weights=[weight], shooting=nudged))
    np.testing.assert_allclose(found(fits[1]), found(fits[0]), rtol=1e-12)
    np.testing.assert_allclose(found(fits[0]), TRUTH, atol=0.05)


@pytest.mark.parametrize("how", [{"lead_in": 100}, {"periodic": True, "lead_in": 100}])
def test_a_lead_in_draws_trajectories_though_it_does_not_count(how):
    """But for samples in it that have no weight."""
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    record, weight = hj.Recording(t, np.sin(t), np.cos(t)), np.ones(240)
    weight[[20, 200]] = 0
    chosen = how.get("lead_in"), how.get("periodic", False)
    group, weights, known = refinement._objective.as_measured(
        (record,), [weight], *chosen
    )
    samples = each_of(group, weights, (2,), known)[0]
    gain = np.asarray(pulls(samples, jnp.array(0.3)).gain)[0, ::2]
    periodic = "periodic" in how
    expected = np.tile(weight, 2)[140:] if periodic else weight
    assert len(expected) == len(group[0])
    np.testing.assert_array_equal(gain[1:] > 0, expected[1:-1] > 0)
    assert np.all(np.asarray(samples.weight)[0, :100] == 0) and gain[0] == 0


def behind_a_lead_in(samples):
    """A noisy period behind samples without weight, by the end of which a law that
    forgets knows nothing of how it began."""
    terms = {"w": -2.0, "u": 1.0, "du": 0.3, "w*|du|": -0.5}
    t = 0.02 * np.arange(samples + 400)
    u = np.sin(2 * np.pi * t / 8)
    truth = SparseModel.from_terms(terms)
    w = np.asarray(hj.simulate(truth, hj.Recording(t, u, u), w0=0.0).w)
    noise = 0.01 * np.std(w) * np.random.default_rng(0).normal(size=len(t))
    return truth, hj.Recording(t, u, w + noise), (t >= t[samples]).astype(float)


@pytest.mark.parametrize("samples", [400, pytest.param(4000, marks=pytest.mark.slow)])
def test_a_start_that_nothing_tells_stays_near_the_samples(samples):
    truth, record, weight = behind_a_lead_in(samples)
    found = hj.refine(truth, record, weights=[weight])
    assert abs(float(found.stats["w0"][0])) < 0.1
    for name, x in truth.terms().items():
        error = float(found.stats["standard_errors"][name])
        assert abs(found.value.terms()[name] - x) < 4 * error


@pytest.mark.slow
def test_a_law_is_found_behind_a_lead_in():
    truth, record, weight = behind_a_lead_in(400)
    found = hj.discover(record, Polynomial(2), weights=[weight])
    assert found.value.terms().keys() == truth.terms().keys()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lead_in", "periodic", "own"),
    [(0, False, 241), (100, False, 141), (50, True, 241)],
)
def test_horizons_are_shares_of_the_samples_that_have_weight(lead_in, periodic, own):
    u = np.sin(2 * np.pi * np.arange(len(T)) / len(T))
    long = hj.Recording(T, u, u + 7)
    short = hj.Recording(T[:121], u[:121], u[:121] + 7)
    group = (long,) if periodic else (long, short)
    group, weights, _ = refinement._objective.as_measured(
        group, None, lead_in, periodic
    )
    chosen = parameters(law(), (), {}, {})
    laid_out = refinement.samples(group, weights, 1)
    objective = Objective(chosen, laid_out, Squares(), 1, 0.0, "output")
    first = refinement.first_unknowns(objective)
    for horizon in (0.1, 0.5, 1.0):
        misfit, *_ = objective.residuals(first, horizon)
        counted = np.sum(np.asarray(misfit) != 0, axis=1)
        owns = np.array([own] if periodic else [own, own - 120])
        # A run that starts at the first of them misses nothing there.
        expected = np.ceil(horizon * owns) - (lead_in == 0)
        np.testing.assert_array_equal(counted, expected)


@eqx.filter_jit
def gaps_of(objective):
    """Between the pieces of a run, where it begins."""
    first = refinement.first_unknowns(objective)
    return objective.residuals(first, 1.0, 1.0)[1]


def test_pieces_that_are_left_empty_rest_where_the_input_ends():
    """Of a law that has no rate at an input of 0: 30 pieces of 100 intervals are of 4
    each, and the last five have none."""
    library = hj.library.Custom({"ln": lambda w, u, du: du * jnp.log(u)})
    law = SparseModel(library, jnp.array([0.4]), jnp.array([True]))
    t = np.linspace(0, 10, 101)
    u = 2 + np.sin(t)
    record = hj.Recording(t, u, np.cos(t))
    for pieces in (25, 30):
        objective = Objective(
            parameters(law, (), {}, {}),
            refinement.samples([record], None, 1),
            Squares(),
            pieces,
            0.0,
            "state",
        )
        gaps = gaps_of(objective)
        assert gaps.shape == (1, pieces - 1, 1)
        assert np.max(np.abs(gaps)) < 10
        np.testing.assert_array_equal(gaps[0, 25:], 0)


@pytest.mark.slow
def test_the_best_of_several_starts_is_returned():
    many = fit(start=FAR, starts=6, spread=1.5, key=jax.random.key(1))
    losses = np.asarray(many.stats["losses"])
    assert losses.shape == (6,)
    assert float(many.stats["loss"]) == losses.min() < losses[0]
    np.testing.assert_allclose(found(many), found(fit()), rtol=1e-7)
    again = fit(start=FAR, starts=6, spread=1.5, key=jax.random.key(1))
    assert np.array_equal(again.stats["losses"], losses)


@pytest.mark.slow
def test_losses_of_all_starts_are_kept_where_steps_are_refined():
    coarse = np.arange(60) * 0.2
    stiff = SparseModel.from_terms({"w": -9.0, "u": 9.0})
    path = hj.Recording(coarse, np.sin(coarse), np.sin(coarse))
    w = hj.simulate(stiff, path, w0=0.0).w
    solution = hj.refine(
        stiff,
        hj.Recording(coarse, np.sin(coarse), w),
        starts=3,
        spread=0.1,
        key=jax.random.key(0),
    )
    assert solution.stats["substeps"] > 1
    assert solution.stats["losses"].shape == (3,)


@pytest.mark.thorough
def test_several_starts_end_no_farther_off_than_one_for_want_of_steps():
    """Bristles settle within a fraction of a sample: without more steps the fit from
    the model's own numbers is lost, and others lead elsewhere."""
    t = 0.4 * np.arange(50)
    u = np.sin(2 * t) * np.exp(-t / 30)
    truth = hj.models.LuGre(50.0, 1.0, 0.5, 1.0, 1.2, 0.1)
    clean = hj.Recording(t, u, 0 * u)
    w = np.asarray(hj.simulate(truth, clean, method=hj.simulation.Adaptive()).w)
    noise = 0.01 * np.ptp(w) * np.random.default_rng(0).normal(size=len(t))
    record = hj.Recording(t, u, w + noise)
    guess = hj.models.LuGre(20.0, 0.7, 0.3, 0.7, 1.0, 0.2)
    drawn = {"starts": 4, "spread": 1.5, "key": jax.random.key(8)}
    one, four = (hj.refine(guess, record, **each).stats for each in ({}, drawn))
    assert float(four["loss"]) <= 1.001 * float(one["loss"])


def test_starts_that_lose_the_record_come_closer():
    """By half of their way, and again; those that follow it stay where they are."""
    objective = Objective(
        parameters(law(), (), {}, {}),
        each_of((CLEAN,), None, (1,))[0],
        Squares(),
        1,
        0.0,
        "state",
    )
    far = TRUTH + np.array([0.0, 0.0, 6.0])
    first = jnp.stack([TRUTH, 1.3 * TRUTH, far])
    reached = np.asarray(within_reach(objective, first))
    np.testing.assert_array_equal(reached[:2], first[:2])
    halvings = np.log2((far - TRUTH)[2] / (reached[2] - TRUTH)[2])
    assert halvings in (1, 2, 3, 4)

    def missed(coefficients):
        ran = hj.simulate(law(coefficients), CLEAN, throw=False)
        return np.std(ran.w - CLEAN.w) / np.std(CLEAN.w)

    assert missed(reached[2]) < 1e3 < missed(2 * reached[2] - TRUTH)


# --------------------------------------------------------------------------- solvers


@pytest.mark.parametrize(
    "solver",
    [
        optx.LevenbergMarquardt(1e-8, 1e-8),
        optx.Dogleg(1e-8, 1e-8),
        optx.GaussNewton(1e-8, 1e-8),
        optx.BFGS(1e-9, 1e-9),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_other_solvers_find_the_same_minimum(solver):
    np.testing.assert_allclose(found(fit(solver=solver)), found(fit()), rtol=1e-6)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_is_shown_on_a_terminal_only(monkeypatch):
    for stream, shown in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(sys, "stderr", stream)
        solution = hj.refine(law(), NOISY, progress=True)
        jax.effects_barrier()
        losses = re.findall(r"step \d+: loss (\S+) \r", stream.getvalue())
        assert bool(losses) == shown
        if shown:
            least = float(solution.stats["loss"])
            assert min(map(float, losses)) == pytest.approx(least, rel=1e-5)


def rosenbrock(y, _):
    return jnp.stack([10 * (y[1] - y[0] ** 2), 1 - y[0]])


def beale(y, _):
    return jnp.array([1.5, 2.25, 2.625]) - y[0] * (1 - y[1] ** jnp.arange(1, 4))


@pytest.mark.parametrize(
    ("residuals", "start", "minimum"),
    [(rosenbrock, (-1.2, 1), (1, 1)), (beale, (1, 1), (3, 0.5))],
)
def test_our_solver_finds_known_minima(residuals, start, minimum):
    found = optx.least_squares(
        residuals, refinement.LevenbergMarquardt(), jnp.array(start, float)
    )
    np.testing.assert_allclose(found.value, minimum, rtol=1e-12)


def test_our_solver_ends_where_less_than_a_billionth_is_left():
    """A valley that bends so much that its end, a ten-billionth off, is 300 steps away:
    what flat directions of many numbers, such as a network's, look like."""

    def valley(y, _):
        return jnp.stack([y[1] - 1e14 * y[0] ** 2, 1e-10 - y[0]])

    start = jnp.array([-1e-10, 1e-6])
    solver = refinement.LevenbergMarquardt()
    found = optx.least_squares(valley, solver, start, max_steps=50)
    assert np.linalg.norm(valley(found.value, None)) < 1e-9


def wave(y, data):
    t, w = data
    return (y[0] * jnp.sin(y[1] * t + y[2]) - w) / t.size**0.5


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_our_solver_ends_in_single_precision_as_soon_as_in_double(noise):
    """What rounding promises there is no reduction: no step brings it."""
    t = np.linspace(0, 10, 401)
    w = np.sin(1.3 * t) + noise * np.random.default_rng(0).normal(size=t.size)

    def found(double):
        with jax.enable_x64(double):
            data, start = tuple(map(jnp.asarray, (t, w))), jnp.array([0.8, 1.2, 0.2])
            solver = refinement.LevenbergMarquardt()
            solution = optx.least_squares(wave, solver, start, data)
            return np.asarray(solution.value), int(solution.stats["num_steps"])

    (single, taken), (double, enough) = found(False), found(True)
    assert single.dtype == np.float32
    assert taken <= enough
    np.testing.assert_allclose(single, double, atol=1e-5)


def minimum(w, solver=None, max_steps=30):
    """What least squares find along a record with other outputs."""
    objective = refinement.Objective(
        refinement.parameters(law(1.3 * TRUTH), (), {}, {}),
        dataclasses.replace(refinement.samples([NOISY], None, 1), w=w[None]),
        Squares(),
        1,
        False,
        "state",
    )
    solver = refinement.LevenbergMarquardt() if solver is None else solver
    first = refinement.first_unknowns(objective)
    return refinement.minimise(objective, first, solver, max_steps)


@pytest.mark.parametrize(
    "solver",
    [
        None,
        pytest.param(optx.LevenbergMarquardt(1e-12, 1e-12), marks=pytest.mark.slow),
    ],
    ids=["ours", "another"],
)
def test_a_minimum_moves_with_the_data_as_differences_tell(solver):
    w, change = NOISY.w, jnp.sin(3 * T) * jnp.std(NOISY.w)

    def values(share):
        return minimum(w + share * change, solver).unknowns.values

    slopes = jax.jit(jax.jacfwd(values))(0.0)
    ahead, behind = (jax.jit(values)(share) for share in (1e-4, -1e-4))
    np.testing.assert_allclose(slopes, (ahead - behind) / 2e-4, rtol=1e-5)
    reverse = jax.jit(jax.jacrev(values))(0.0)
    np.testing.assert_allclose(reverse, slopes, rtol=1e-9)


def test_lanes_that_begin_together_end_as_alone():
    each = jnp.stack([NOISY.w, CLEAN.w, 2 * NOISY.w])
    together = jax.jit(jax.vmap(minimum))(each)
    for lane, w in enumerate(each):
        alone = jax.jit(minimum)(w)
        ours = jax.tree.map(lambda leaf, lane=lane: leaf[lane], together)
        np.testing.assert_allclose(
            ours.unknowns.values, alone.unknowns.values, rtol=1e-9
        )
        assert ours.num_steps == alone.num_steps
        assert 1 <= ours.num_steps < 30


@pytest.mark.parametrize("loss, row", [(1.0, 0), (2 + 1e-12, 0), (3.0, 1), (np.nan, 1)])
def test_the_better_end_is_taken_with_the_steps_of_both(loss, row):
    ends = [
        (jnp.array(7.0), (jnp.array(loss), RESULTS.diverged, jnp.array(3))),
        (jnp.array(8.0), (jnp.array(2.0), RESULTS.successful, jnp.array(4))),
    ]
    x, (least, result, steps) = _better(*ends)
    taken, (its_loss, its_result, _) = ends[row]
    assert (x, least, steps) == (taken, its_loss, 7)
    assert bool(result == its_result)


@pytest.mark.parametrize("steps", [1, 2])
def test_as_many_steps_are_taken_as_are_allowed(steps):
    end = jax.jit(minimum, static_argnums=2)(NOISY.w, None, steps)
    assert end.num_steps == steps
    assert end.result == RESULTS.nonlinear_max_steps_reached


def test_an_optax_minimiser_finds_the_same_minimum():
    solver = optx.OptaxMinimiser(optax.adam(0.02), 1e-7, 1e-7)
    np.testing.assert_allclose(
        found(fit(solver=solver, max_steps=5000)), found(fit()), rtol=1e-5
    )


@pytest.mark.parametrize(("input_unit", "output_unit"), [(1e-6, 1e6), (1e6, 1e-6)])
def test_units_do_not_matter(input_unit, output_unit):
    factors = np.array(
        [output_unit / input_unit, output_unit / input_unit**2, 1 / input_unit]
    )
    scaled = hj.Recording(T, input_unit * U, output_unit * NOISY.w)
    solution, plain = fit(scaled, 1.3 * TRUTH * factors), fit()
    np.testing.assert_allclose(found(solution), found(plain) * factors, rtol=1e-9)
    np.testing.assert_allclose(errors(solution), errors(plain) * factors, rtol=1e-9)
    assert abs(int(solution.stats["num_steps"]) - int(plain.stats["num_steps"])) <= 2


# ---------------------------------------------------------------------------- fading


SPRING = BoucWenForce(0.1, 50.0, 12.0, 8.0, 1.5)
WIDENING = 0.3 * np.minimum(1, 0.25 + T / 12) * np.sin(2 * T)


def spring_in(unit, alpha=0.1, k=50.0, beta=12.0, gamma=8.0, n=1.5):
    """Of a position in this unit over m."""
    return BoucWenForce(alpha, k / unit, beta / unit**n, gamma / unit**n, n)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        pytest.param(
            {"starts": 3, "key": jax.random.key(1), "max_steps": 1},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_fit_of_an_exponent_does_not_depend_on_the_unit(settings):
    """Of a beta in m^-n."""
    method = hj.simulation.FixedStep(2)
    clean = hj.simulate(SPRING, hj.Recording(T, WIDENING, 0 * T), method=method).w
    w = clean + 0.02 * np.std(clean) * np.random.default_rng(2).normal(size=len(T))
    found = {}
    for unit in (1, 1e3, 1e6):
        rec = hj.Recording(T, unit * WIDENING, w)
        start = spring_in(unit, 0.15, 40.0, 10.0, 10.0, 1.2)
        found[unit] = hj.refine(start, rec, substeps=2, throw=False, **settings)
    plain = found.pop(1)
    numbers = {name: float(x) for name, x in plain.value.parameters().items()}
    for unit, solution in found.items():
        assert int(solution.stats["num_steps"]) == int(plain.stats["num_steps"]) < 30
        losses = (fit.stats["losses"] for fit in (solution, plain))
        np.testing.assert_allclose(*losses, rtol=1e-9)
        expected = spring_in(unit, **numbers).parameters()
        for name, value in solution.value.parameters().items():
            np.testing.assert_allclose(value, expected[name], rtol=1e-9, err_msg=name)
        for name in ("alpha", "n"):
            errors = (fit.stats["standard_errors"][name] for fit in (solution, plain))
            np.testing.assert_allclose(*errors, rtol=1e-9)


@pytest.mark.slow
def test_numbers_with_powers_for_units_move_with_these():
    """At yield z is what it was, whatever the model around; but not where a bound says
    what the number itself may be."""
    inside = hj.models.Instrumented(spring_in(1e6), output_gain=1.0)
    oscillator = BoucWenOscillator(2.0, 3.0, 5.0, 4.0, 12.0, 8.0, 1.5)
    for model, slope in ((spring_in(1e6), 1.0), (inside, 1.0), (oscillator, 4.0)):
        free = parameters(model, (), {"n": (0.5, 9.0)}, {})
        beta, gamma, n = map(free.names.index, ("beta", "gamma", "n"))
        before = free.values()
        moved = free.bounded(free.unbounded(before).at[n].add(0.3))
        at_yield = (
            ((v[beta] + v[gamma]) / slope) ** (1 / v[n]) for v in (before, moved)
        )
        np.testing.assert_allclose(*at_yield, rtol=1e-9)
        assert abs(moved[n] - before[n]) > 0.1
        np.testing.assert_allclose(free.bounded(free.unbounded(moved)), moved)
        above = parameters(model, (), {"beta": (0.0, np.inf)}, {})
        again = above.bounded(above.unbounded(before).at[n].add(0.3))
        at_yield = (
            ((v[beta] + v[gamma]) / slope) ** (1 / v[n]) for v in (before, again)
        )
        np.testing.assert_allclose(*at_yield, rtol=1e-9)
        held = parameters(model, (), {"beta": (1e-20, np.inf)}, {})
        again = held.bounded(held.unbounded(before).at[n].add(0.3))
        np.testing.assert_allclose(again[beta], before[beta], rtol=1e-9)


def test_a_fit_goes_on_from_a_power_of_nothing():
    """Moved inside of its bound n is small still, and |z|^n about 1: beta and gamma are
    what they were. The size of z at yield, of which the n-th power is one over their
    sum, is no number any more."""
    numbers = {"alpha": 0.2, "k": 10.0, "beta": 0.4, "gamma": 0.2, "n": 1.0}
    for kind in (BoucWenForce, hj.models.BoucWenBaberNoori):
        flat = kind(**numbers).with_parameters({"n": 0.0})
        free = parameters(flat, (), {}, {})
        start = dict(
            zip(free.names, free.bounded(free.unbounded(free.values())), strict=True)
        )
        assert 0 < start["n"] < 0.02
        for name in ("beta", "gamma"):
            assert start[name] == pytest.approx(numbers[name], rel=0.1)


def test_powers_are_of_numbers_that_there_are():
    class Own(Duhem):
        def powers(self):
            return {"beta": ("m", 1.0)}

    with pytest.raises(InputError, match=r"`powers` names \['m'\]"):
        hj.refine(Own(0.4, 0.5, 0.25), NOISY)


def test_the_report_on_fading_is_the_closed_form():
    solution = fit(CLEAN)
    report = jax.tree.map(lambda leaf: leaf[0], solution.stats["fading"])
    beta, speed = 0.5, np.abs(np.diff(U) / np.diff(T))
    variation = np.sum(np.abs(np.diff(U)))
    assert float(report.gain) == pytest.approx(-beta * variation, rel=1e-5)
    assert float(report.exponent) == pytest.approx(-beta * variation / 12, rel=1e-5)
    assert float(report.largest) == pytest.approx(-beta * speed.min(), rel=1e-5)
    assert float(report.where) == T[np.argmin(speed)]
    assert float(report.share) == 0


UNSTABLE = np.array([0.25, 0.1, 0.05])


def test_fading_keeps_a_law_from_growing():
    growing = record(0.02, coefficients=UNSTABLE)
    free, kept = fit(growing, TRUTH), fit(growing, TRUTH, fading=True)
    assert float(free.stats["fading"].exponent[0]) > 0
    assert float(free.stats["fading"].share[0]) == 1
    assert float(kept.stats["fading"].exponent[0]) < 0
    assert float(kept.stats["rmse"][0]) > float(free.stats["rmse"][0])


def test_where_a_law_expands_is_a_share_of_the_samples_that_there_are():
    """Also of a recording that is shorter than others."""
    both = [CLEAN, CLEAN.window(0, 60)]
    starts = SparseModel.from_terms({"du": 0.25, "w*|du|": -0.5, "w*du": 0.9})
    fits = hj.refine(starts, both, fixed=["w*|du|", "w*du"], throw=False)
    slope = np.diff(U) / np.diff(T)
    for n, share in zip((len(T), 60), fits.stats["fading"].share, strict=True):
        rate = -0.5 * np.abs(slope[: n - 1]) + 0.9 * slope[: n - 1]
        rate = np.append(rate, rate[-1])  # the left limit at the end
        assert float(share) == pytest.approx(np.mean(rate > 0), abs=1e-12)


def test_fading_may_be_asked_to_go_so_far():
    growing = record(0.02, coefficients=UNSTABLE)
    gain = fit(growing, TRUTH, fading=0.1).stats["fading"].gain
    # A tenth after ten cycles of the input, of which these are fewer.
    cycles = np.sum(np.abs(np.diff(U))) / (2 * np.ptp(U))
    assert cycles < 10
    assert float(gain[0]) < np.log(0.1) * cycles / 10


def test_recordings_of_few_cycles_are_taken_so_often_that_there_are_ten():
    t = np.arange(97.0)
    wave = np.abs(t % 16 - 8) - 4  # from one end to the other in 8 samples
    records = [hj.Recording(t[:n], 3 + wave[:n], t[:n]) for n in (41, 97, 9)]
    many = hj.Recording(t, np.where(t % 2 < 1, 1.0, -1.0), t)
    pace = refinement.samples([*records, many], None, 1).pace
    np.testing.assert_allclose(pace, [10 / 2.5, 10 / 6, 20, 1], rtol=1e-12)


@pytest.mark.parametrize("share", [-0.1, 1.5, np.nan])
def test_fading_is_a_share(unchecked, share):
    with pytest.raises(hj.InputError, match="`fading` must be a share from 0 to 1"):
        fit(fading=share)


def test_fading_changes_nothing_where_the_law_fades():
    np.testing.assert_allclose(found(fit(fading=True)), found(fit()), rtol=1e-9)


# ------------------------------------------------------------------------- certainty


def test_collinear_terms_are_told_by_their_singular_direction():
    t = np.linspace(0, 12, 241)
    u = np.abs((t + 1) % 4 - 2) - 1  # a triangle of slope 1: |du| is constant
    names = ("du", "1", "w*|du|", "|du|")
    truth = SparseModel.from_terms(
        dict(zip(names, (0.8, 0.05, -0.6, 0.1), strict=True))
    )
    w = np.asarray(hj.simulate(truth, hj.Recording(t, u, u), w0=0.1).w)
    w = w + 0.01 * np.random.default_rng(5).normal(size=len(t))
    known = hj.refine(truth, hj.Recording(t, u, w)).stats["certainty"]
    sizes, direction = np.asarray(known.singular_values), np.asarray(known.directions)
    assert sizes[0] == pytest.approx(1, rel=1e-12) and np.all(np.diff(sizes) <= 0)
    assert sizes[-1] < 1e-7 < 1e-3 < sizes[-2]
    named = direction[-1] / direction[-1][1]
    np.testing.assert_allclose(named, [0, 1, 0, -1, 0], atol=1e-9)


def test_a_combination_has_all_that_takes_part_in_it_whatever_its_sign():
    rows = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.05], [0.09, -0.11, 0.99]])
    sizes, eye = np.array([1.0, 2e-4, 5e-5]), np.eye(3)
    known = Certainty(("a", "b", "c"), *map(jnp.asarray, (eye, sizes, rows, eye, 1.0)))
    assert known.undetermined() == ((5e-5, {"b": -0.11, "c": 0.99}),)
    assert known.undetermined(1e-3)[0] == (2e-4, {"a": -0.8, "b": 0.6})


def test_gaps_hide_no_correlation():
    """Of noise that remembers its neighbours, of which some have no weight."""
    rng, every = np.random.default_rng(0), jax.jit(refinement.autocorrelation)
    for share in (1.0, 0.5, 0.2):
        white, coloured, nearest = [], [], []
        for _ in range(60):
            shocks = rng.normal(size=1000)
            noise = lfilter([0.6], [1, -0.8], shocks)
            weight = jnp.asarray(rng.random(1000) < share, float)
            white.append(float(every(jnp.asarray(shocks), weight)[1]))
            lags, probability = every(jnp.asarray(noise), weight)
            coloured.append(float(probability))
            nearest.append(float(lags[0]))
        assert np.mean(np.array(coloured) < 0.01) > 0.9
        assert np.mean(nearest) == pytest.approx(0.8, abs=0.05)
        assert 0.3 < np.mean(white) < 0.7


@pytest.mark.usefixtures("unchecked")
def test_of_several_recordings_the_one_that_fades_least_is_told():
    of_two = {"exponent": [-3.0, -2.0], "share": [0.1, 0.3], "largest": [0.5, 4.0]}
    said = _fading(SimpleNamespace(**of_two, where=[5.0, 7.0]), clocked=True)
    assert said == (
        "the law forgets its initial value at 2 per s on average; it expands on 30 % "
        "of the samples, at most 4 per s, at t = 7 s"
    )


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("free", ["output", "nothing", "state"])
def test_starts_are_named_in_the_order_of_their_numbers(free):
    starts = np.arange(6).reshape(2, 1, 3)
    found = _start_names(SimpleNamespace(free=free), SimpleNamespace(starts=starts))
    each = [f"start[{i},{j}]" for i, _, j in np.argwhere(starts >= 0)]
    expected = {"output": ["start[0]", "start[1]"], "nothing": [], "state": each}
    assert list(found) == expected[free]


@pytest.mark.slow
def test_what_no_record_tells_takes_nothing_from_what_it_does():
    """Friction knows no zero of the position, and a gain is one with stiffnesses. What
    else is fitted is as certain as without them."""
    t = np.linspace(0, 20, 401)
    u = 0.1 * np.sin(t) * np.minimum(1, 0.25 + t / 20)
    device = hj.models.Instrumented(
        hj.models.Dahl(600.0, 5.0), 1.0, 0.01, output_offset=0.3
    )
    w = np.asarray(hj.simulate(device, hj.Recording(t, u, 0 * u), w0=0.0).w)
    record = hj.Recording(t, u, w + 0.04 * np.random.default_rng(1).normal(size=401))
    settled = ["exponent", "input_gain", "input_offset"]
    known = hj.refine(device, record, fixed=settled).stats["standard_errors"]
    whole = hj.refine(device, record, fixed=["exponent"]).stats["standard_errors"]
    for name in ("coulomb", "output_offset"):
        assert float(whole[name]) == pytest.approx(float(known[name]), rel=1e-9)
    for name in ("stiffness", "input_gain", "input_offset"):
        assert float(whole[name]) > 1e6 * float(device.parameters()[name])


def test_white_residuals_pass_and_coloured_ones_do_not():
    generator = np.random.default_rng(6)
    white = generator.normal(size=(300, 1000))
    coloured = np.stack([np.convolve(row, [1, 0.5, 0.25], "same") for row in white])
    test = jax.jit(jax.vmap(refinement.autocorrelation))
    _, passed = test(jnp.asarray(white), jnp.ones(white.shape))
    _, failed = test(jnp.asarray(coloured), jnp.ones(white.shape))
    assert kstest(np.asarray(passed), "uniform").pvalue > 0.01
    assert np.all(np.asarray(failed) < 1e-6)


def test_whiteness_is_the_ljung_box_test():
    x = np.random.default_rng(7).normal(size=200)
    test = jax.jit(refinement.autocorrelation)
    found_correlation, probability = test(jnp.asarray(x), jnp.ones(200))
    d = x - x.mean()
    lags = np.arange(1, 41)
    correlation = np.array([d[k:] @ d[:-k] for k in lags]) / (d @ d)
    statistic = 200 * 202 * np.sum(correlation**2 / (200 - lags))
    np.testing.assert_allclose(found_correlation, correlation, rtol=1e-9, atol=1e-12)
    assert float(probability) == pytest.approx(chi2.sf(statistic, 40), rel=1e-9)


def test_a_short_recording_is_tested_by_the_lags_that_it_has():
    """As it is alone, whatever the length of those beside it."""
    x = np.random.default_rng(3).normal(size=24)
    filled = jnp.concatenate([jnp.asarray(x), jnp.zeros(76)])
    known = jnp.arange(100) < 24
    _, alone = jax.jit(refinement.autocorrelation)(jnp.asarray(x), jnp.ones(24))
    _, beside = jax.jit(refinement.autocorrelation)(filled, 1.0 * known)
    d = x - x.mean()
    lags = np.arange(1, 23)  # an even number, of the 23 that there are
    correlation = np.array([d[k:] @ d[:-k] for k in lags]) / (d @ d)
    statistic = 24 * 26 * np.sum(correlation**2 / (24 - lags))
    for found in (alone, beside):
        assert float(found) == pytest.approx(chi2.sf(statistic, 22), rel=1e-9)


def test_what_a_fit_leaves_is_of_all_samples():
    """A short recording counts for as many as it has, as in the error of the steps."""
    rng = np.random.default_rng(0)
    rows = 0.1 * rng.normal(size=300), rng.normal(size=30)
    residuals = np.zeros((2, 300))
    for row, x in zip(residuals, rows, strict=True):
        row[: len(x)] = x
    known = {"residuals": jnp.asarray(residuals), "spread": jnp.array(1.0)}
    fit = fit_of(law(), recordings=2, **known)
    _, left, _ = _of_steps(fit)
    assert left == pytest.approx(np.sqrt(np.mean(np.concatenate(rows) ** 2)), rel=1e-12)


def test_an_output_that_is_constant_where_it_has_weight_is_refused():
    w = np.where(T < 1, 0.3, T)
    with pytest.raises(hj.InputError, match="constant where it has weight"):
        hj.refine(law(), hj.Recording(T, U, w), weights=[1.0 * (T < 1)])


@pytest.mark.slow
def test_a_further_fit_begins_where_the_last_one_did(monkeypatch):
    """A first sample without weight may be anything: a fit that needs more steps goes
    on from the start that was found, not from there."""
    fits, refit = [], refining._refine

    def watched(*arguments):
        found = refit(*arguments)
        fits.append((arguments, found))
        return found

    monkeypatch.setattr(refining, "_refine", watched)
    t = np.linspace(0, 12, 181)
    record = hj.Recording(t, 2 * np.sin(2.5 * t), 0 * t)
    w = np.array(hj.simulate(law(6 * TRUTH), record, w0=0.3).w)
    w[0], weight = 5.0, np.append(0.0, np.ones(180))
    record = hj.Recording(t, record.u, w)
    hj.refine(law(6.1 * TRUTH), record, weights=[weight])
    (_, first), (again, _) = fits[:2]
    objective, finer, search, begun = again
    assert begun is first.w0 and float(begun[0]) == pytest.approx(0.3, abs=0.1)
    # Nothing moves in no steps: there it begins.
    still = refit(objective, finer, search._replace(max_steps=0), begun)
    np.testing.assert_allclose(still.w0, begun, rtol=1e-12)


@pytest.mark.parametrize(
    "probabilities, told",
    [
        ([0.6, 1e-5], "residuals are correlated (Ljung-Box probability 2e-05)"),
        ([1e-5, 0.6, np.nan], "residuals are correlated (Ljung-Box probability 2e-05)"),
        ([0.003, *[0.5] * 19], "residuals look white (Ljung-Box probability 0.06)"),
        ([0.9, 0.8], "residuals look white (Ljung-Box probability 1)"),
        ([np.nan], None),
    ],
)
def test_every_recording_has_a_say_in_whether_residuals_look_white(probabilities, told):
    """One of twenty is 0.003 more often than one alone, by Bonferroni's inequality; of
    recordings without weight nothing is known."""
    fit = fit_of(
        law(), recordings=len(probabilities), whiteness=jnp.array(probabilities)
    )
    said = [x for x in refinement.statements(fit.solution()) if "Ljung" in x]
    assert [each[: len(told or "")] for each in said] == ([told] if told else [])


def test_the_size_of_residuals_is_told_whatever_the_scale_of_weights():
    """In the unit of the output, and by the weights where these are not all alike."""
    w = closed_form(TRUTH, W0, T, U)
    drawn = np.random.default_rng(9).normal(size=(2, len(T)))
    sizes = np.array([0.003, 0.03])
    group = [hj.Recording(T, U, w + x) for x in sizes[:, None] * drawn]

    def told(recordings, weights):
        fit = hj.refine(law(), recordings, weights=weights)
        said = refinement.statements(fit)[0]
        return list(map(float, re.findall(r"\d\.[\de-]+", said)))

    alike = told(group[0], [np.full(len(T), 1e6)])
    np.testing.assert_allclose(alike, [np.std(sizes[0] * drawn[0])], rtol=0.02)
    np.testing.assert_allclose(told(group, "noise"), sizes, rtol=0.1)


def test_without_a_clock_a_law_forgets_by_the_sample():
    """By its term w |u'| and the way that the input goes."""
    record = hj.Recording(None, U, closed_form(TRUTH, W0, T, U))
    fit = hj.refine(law(), record)
    way = np.sum(np.abs(np.diff(U))) / (len(U) - 1)
    pace = -fit.value.terms()["w*|du|"] * way
    said = refinement.statements(fit)
    assert any(f"at {pace:.3g} per sample on average, and" in each for each in said)


# ---------------------------------------------------------------------- derivatives

NOTHING = (), (), ()  # in memory at the start, the middle and the end of a step

SEVEN = {
    "1": 0.05, "w": -0.3, "u": 0.2, "du": 0.25, "w*u": 0.1, "u*|du|": 0.4,
    "w*|du|": -0.5,
}  # fmt: skip


def seven_rates(x, w, u, du):
    speed = np.abs(du)
    terms = (1.0, w, u, du, w * u, u * speed, w * speed)
    return sum(c * term for c, term in zip(x, terms, strict=True))


def numpy_states(x, start, grid):
    """Classical Runge-Kutta steps in NumPy, for complex numbers too."""
    w = [start]
    _, *stages = (np.stack(each, axis=1) for each in zip(*grid[1:], strict=True))
    for h, u, du in zip(grid.steps, *stages, strict=True):
        k1 = seven_rates(x, w[-1], u[0], du[0])
        k2 = seven_rates(x, w[-1] + h / 2 * k1, u[1], du[1])
        k3 = seven_rates(x, w[-1] + h / 2 * k2, u[1], du[1])
        k4 = seven_rates(x, w[-1] + h * k3, u[2], du[2])
        w.append(w[-1] + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return np.array(w)


def magnified(grid, factor):
    """A grid with another input, and the same derivative."""
    stages = (stage._replace(u=factor * stage.u) for stage in grid[1:])
    return Grid(grid.steps, *stages)


def two_segments():
    """Two segments of 120 steps, with a start each."""
    grid = refinement.samples([CLEAN], None, 1).grid
    cut = jax.tree.map(lambda leaf: leaf.reshape(2, 120), grid)
    return cut, jnp.array([[0.1], [-0.2]])


@pytest.mark.parametrize("segments", [1, 2])
def test_derivatives_of_states_are_those_of_the_complex_step(segments):
    model = SparseModel.from_terms(SEVEN)
    parameters = refinement.parameters(model, (), {}, {})
    grid, starts = jax.tree.map(lambda leaf: leaf[:segments], two_segments())
    x = np.array(list(SEVEN.values()))

    def path(x, starts, strength):
        drive = Drive(magnified(grid, strength), None, NOTHING)
        return states(parameters.build(x), starts, drive, 1)[..., 0]

    arguments = (jnp.asarray(x), starts, jnp.ones(()))
    value = jax.jit(path)(*arguments)
    by_x, by_start, by_input = jax.jit(jax.jacfwd(path, (0, 1, 2)))(*arguments)
    pulled = jax.jit(jax.jacrev(path))(*arguments)
    h = 1e-30
    for i in range(segments):
        row = jax.tree.map(lambda leaf, i=i: np.asarray(leaf[i]), grid)
        start = float(starts[i, 0])
        np.testing.assert_allclose(
            value[i], numpy_states(x, start, row), rtol=1e-11, atol=1e-13
        )
        exact = [numpy_states(x + 1j * h * d, start, row).imag / h for d in np.eye(7)]
        np.testing.assert_allclose(by_x[i].T, exact, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(pulled[i].T, exact, rtol=1e-9, atol=1e-11)
        exact = numpy_states(x, start + 1j * h, row).imag / h
        np.testing.assert_allclose(by_start[i, :, i, 0], exact, rtol=1e-9, atol=1e-11)
        exact = numpy_states(x, start, magnified(row, 1 + 1j * h)).imag / h
        np.testing.assert_allclose(by_input[i], exact, rtol=1e-9, atol=1e-11)


def test_hidden_states_drawn_to_the_output_have_the_derivatives_of_the_loop():
    model = BoucWenOscillator(1.0, 0.3, 2.0, 1.5, 0.8, -0.4)
    parameters = refinement.parameters(model, ("n", "mass"), {}, {})
    sampled = refinement.samples([CUBIC], None, 2)
    grid = jax.tree.map(lambda leaf: leaf[0], sampled.grid)
    at_start = jax.tree.map(lambda leaf: leaf[0], grid.start)
    m, gain = len(T) - 1, 0.3
    at_sample = jnp.arange(2 * m) % 2 == 0
    pull = (
        jnp.where(at_sample, gain, 0.0).at[0].set(0.0),
        jnp.repeat(sampled.w[0, :-1], 2),
    )

    @jax.jit
    def loop(x, start):
        built = parameters.build(x)

        def advance(state, row):
            grid, gain, target = row
            row, whole = ravel_pytree(state)
            drawn = whole(row.at[0].add(gain * (target - row[0])))
            after = flow(built, drawn, built.legs(NOTHING, grid))
            return after, after

        rest = built.start(NOTHING, at_start, jnp.zeros(()))
        first = ravel_pytree(rest)[1](start)
        _, later = jax.lax.scan(advance, first, (grid, *pull))
        along = from_start(first, later)
        return jax.vmap(lambda state: ravel_pytree(state)[0])(along)[::2]

    @jax.jit
    def ours(x, start):
        drive = Drive(sampled.grid, pulls(sampled, jnp.asarray(gain)), NOTHING)
        return states(parameters.build(x), start[None], drive, 2)[0]

    at = parameters.values(), jnp.array([0.1, -0.2, 0.05])
    np.testing.assert_allclose(ours(*at), loop(*at), rtol=1e-12, atol=1e-14)
    by_rule, by_loop = (jax.jit(jax.jacfwd(f, (0, 1)))(*at) for f in (ours, loop))
    for found, exact in zip(by_rule, by_loop, strict=True):
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-11)


def test_compressed_residuals_have_the_products_of_all_of_them():
    objective = refinement.Objective(
        refinement.parameters(law(), (), {}, {}),
        refinement.samples([NOISY], None, 1),
        Squares(),
        1,
        False,
        "state",
    )
    first = refinement.first_unknowns(objective)
    problem = Problem(objective, first, (1.0, 0.0, None))
    x, spread = jnp.array([*TRUTH, W0]), jnp.diag(jnp.array([1.0, 2.0, 3.0, 4.0]))
    whitened = Whitened(problem, x, spread)
    z = jnp.array([0.01, -0.02, 0.03, 0.01])

    def with_slopes(function, x):
        jacobian = jax.jit(jax.jacfwd(function))(x)
        return np.asarray(jacobian), np.asarray(jax.jit(function)(x))

    at = x + spread @ z
    slopes, numbers = with_slopes(lambda z: compressed(z, whitened), z)
    jacobian, residuals = with_slopes(lambda x: problem.residuals(x), at)
    both = np.column_stack([jacobian @ np.asarray(spread), residuals])
    few = np.column_stack([slopes, numbers])
    np.testing.assert_allclose(few.T @ few, both.T @ both, rtol=1e-10, atol=1e-13)


def test_the_cost_has_the_second_derivatives_of_differences():
    objective = refinement.Objective(
        refinement.parameters(law(), (), {}, {}),
        refinement.samples([NOISY], None, 1),
        Squares(),
        1,
        False,
        "state",
    )
    first = refinement.first_unknowns(objective)

    @jax.jit
    def cost(x):
        parts = objective.residuals(dataclasses.replace(first, values=x))
        return sum(jnp.sum(part**2) for part in parts) / 2

    x, h = jnp.asarray(TRUTH), 1e-4
    gradient = jax.jit(jax.grad(cost))
    moved = [(gradient(x + h * d) - gradient(x - h * d)) / (2 * h) for d in np.eye(3)]
    hessian = jax.jit(jax.jacfwd(gradient))(x)
    np.testing.assert_allclose(hessian, jnp.stack(moved), rtol=1e-5)
    moved = [(cost(x + h * d) - cost(x - h * d)) / (2 * h) for d in np.eye(3)]
    np.testing.assert_allclose(gradient(x), jnp.stack(moved), rtol=1e-4, atol=1e-8)


def coefficients_of(w):
    moved = eqx.tree_at(lambda recording: recording.w, NOISY, w)
    value = hj.refine(law(), moved, throw=False).value
    return jnp.stack([value.parameters()[name] for name in NAMES])


@pytest.mark.slow
def test_the_solution_has_a_derivative_with_respect_to_the_data():
    def function(x):
        w = NOISY.w
        return coefficients_of(w * (1 + x[0]) + 0.1 * x[1] * jnp.sin(NOISY.t))

    slopes = jax.jacfwd(function)(jnp.zeros(2))
    h = 1e-3
    moved = [
        (function(jnp.array(h * d)) - function(jnp.array(-h * d))) / (2 * h)
        for d in np.eye(2)
    ]
    np.testing.assert_allclose(slopes.T, moved, rtol=1e-3, atol=1e-5)


@pytest.mark.slow
def test_derivatives_of_a_batch_are_those_of_its_fits():
    noise = 0.02 * np.random.default_rng(8).normal(size=(2, len(T)))

    def along(scale, row):
        return coefficients_of(scale * CLEAN.w + row)

    def tangent(function):
        return jax.jvp(function, (1.0,), (1.0,))[1]

    batch = tangent(lambda scale: jax.vmap(along, (None, 0))(scale, noise))
    loop = jax.vmap(lambda row: tangent(lambda scale: along(scale, row)))(noise)
    np.testing.assert_allclose(batch, loop, rtol=1e-8, atol=1e-10)


@pytest.mark.slow
def test_where_a_fit_begins_has_no_part_in_its_derivative():
    """Wherever from, it ends at the same minimum."""

    def found(scale, start):
        moved = eqx.tree_at(lambda recording: recording.w, NOISY, scale * NOISY.w)
        begun = eqx.tree_at(lambda model: model.coefficients, law(), start)
        value = hj.refine(begun, moved, throw=False).value
        return jnp.stack([value.parameters()[name] for name in NAMES])

    first = law().coefficients
    slope = jax.jacfwd(found, argnums=(0, 1))(1.0, first)
    alone = jax.jacfwd(lambda scale: coefficients_of(scale * NOISY.w))(1.0)
    # One is zero but for rounding.
    np.testing.assert_allclose(slope[0], alone, rtol=1e-8, atol=1e-14)
    assert jnp.all(slope[1] == 0)


def test_a_batch_equals_a_loop():
    noise = 0.02 * np.random.default_rng(8).normal(size=(5, len(T)))
    w = CLEAN.w + noise
    batch = jax.jit(jax.vmap(coefficients_of))(w)
    loop = jnp.stack([coefficients_of(row) for row in w])
    np.testing.assert_allclose(batch, loop, rtol=1e-9)


# -------------------------------------------------------------------------- failures


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fixed": ["u*du"]}, r"`fixed` names \['u\*du'\], .* du, u\*\|du\|, w\*\|du"),
        ({"fixed": "du"}, "`fixed` must be a list of names, got 'du'"),
        ({"fixed": NAMES}, "nothing is left to fit"),
        ({"bounds": {"v": (0, 1)}}, r"`bounds` names \['v'\]"),
        ({"bounds": {"du": (1, 0)}}, r"`bounds` of \['du'\] must be \(lower, upper"),
        ({"bounds": {"du": (0, np.nan)}}, r"`bounds` of \['du'\] must be"),
        ({"bounds": {"du": (0, 1)}, "fixed": ["du"]}, r"`bounds` of \['du'\] do noth"),
        ({"tied": {"du": (1.0, "v")}}, r"`tied` names \['v'\]"),
        ({"tied": {"du": (1.0, "du")}}, r"`tied` refers to \['du'\]"),
        (
            {"tied": {"du": (1.0, "u*|du|")}, "fixed": ["u*|du|"]},
            r"`tied` refers to \['u\*\|du\|'\], which are not free",
        ),
        (
            {"tied": {"du": (1.0, "u*|du|")}, "fixed": ["du"]},
            r"`fixed` and `tied` both name \['du'\]",
        ),
        ({"weights": [np.ones(240)]}, "Lengths differ: `weights` 240, `w` 241"),
        ({"weights": [np.ones(241)] * 2}, "each of the 1 recordings, got 2"),
        (
            {"weights": [-np.eye(241)[7] - np.eye(241)[9]]},
            r"`weights` must be zero or more, got -1 at \[7\], and 1 more such\.",
        ),
        ({"weights": [np.full(241, np.nan)]}, "`weights` has 241 value"),
        (
            {"weights": [np.eye(241)[0]]},
            r"where it starts to .*needs at least 5 samples, got 1",
        ),
        ({"starts": 4}, "several `starts` need a `key`"),
        ({"starts": 0}, "`starts` must be at least 1, got 0"),
        ({"spread": float("nan")}, "`spread` must be zero or more and finite, got nan"),
        ({"spread": float("inf")}, "`spread` must be zero or more and finite, got inf"),
        ({"spread": -0.5}, "`spread` must be zero or more and finite, got -0.5"),
        ({"substeps": 0}, "`substeps` must be at least 1 .* linear"),
        ({"recordings": []}, "`recordings` is empty"),
        (
            {"recordings": hj.Recording(T, U, np.ones(241))},
            r"`w` is constant \(1.0\)",
        ),
        (
            {"recordings": CUBIC, "substeps": 1},
            "`substeps` must be at least 2 .* smooth",
        ),
    ],
)  # fmt: skip
def test_wrong_arguments_are_told(settings, message):
    with pytest.raises(InputError, match=message):
        fit(**settings)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Huber(0.0), "`threshold` must be positive"),
        (lambda: Cauchy(-1.0), "`scale` must be positive"),
        (lambda: SingleShooting((0.5, 0.2)), "`horizons` must increase"),
        (lambda: SingleShooting((0.5, 1.0)), "between 0 and 1"),
        (lambda: MultipleShooting(1), "`pieces` must be at least 2, got 1"),
        (lambda: MultipleShooting(4, ()), "`weights` must be positive"),
        (lambda: MultipleShooting(4, (1.0, 0.0)), "`weights` must be positive"),
    ],
)
def test_wrong_settings_are_told(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_fit_that_does_not_end_says_so():
    cut = fit(max_steps=2, throw=False)
    assert cut.result == RESULTS.nonlinear_max_steps_reached
    with pytest.raises(
        ComputationError, match="did not settle within `max_steps`"
    ) as caught:
        fit(max_steps=2)
    assert caught.value.result == RESULTS.nonlinear_max_steps_reached


def test_a_law_that_cannot_be_tamed_says_so():
    wild = [0.25, 0.4, 400.0]
    assert fit(start=wild, throw=False).result == RESULTS.diverged
    with pytest.raises(ComputationError, match="did not stay finite"):
        fit(start=wild)


PLAY = {"u": 0.5, "play(u,0.2)": 0.3}
OF_A_PLAY = {
    "law": hj.models.SparseModel.from_terms(PLAY, target="value"),
    "stack": hj.models.PrandtlIshlinskii([0.0, 0.2], [0.5, 0.3]),
}


@pytest.mark.parametrize("kind", OF_A_PLAY)
@pytest.mark.parametrize("around", ["nothing", "started", "instruments"])
def test_a_radius_whose_sign_has_turned_is_that_of_a_fit_from_the_other_side(
    kind, around
):
    t, rng = np.linspace(0, 6, 301), np.random.default_rng(3)
    law, u = OF_A_PLAY[kind], np.sin(4 * t) * np.linspace(1, 0.3, 301)
    clean = hj.simulate(law, hj.Recording(t, u, u)).w
    record = hj.Recording(t, u, clean + 1e-3 * rng.normal(size=301))
    model = {
        "nothing": law,
        "started": hj.models.Started.at_rest(law, record),
        "instruments": hj.models.Instrumented(law, output_offset=0.0),
    }[around]
    known = ["offset", "radii[0]"]  # an offset is one with that of the instruments
    fixed = [x for x in model.parameters() if "state" in x or x in known]
    radius = "radii[1]" if kind == "stack" else "play(u,0.2).radius"

    def fitted(start):
        return hj.refine(model.with_parameters({radius: start}), record, fixed=fixed)

    right, turned = fitted(jnp.asarray(0.15)), fitted(jnp.asarray(-0.15))
    found, expected = turned.value.parameters(), right.value.parameters()
    assert all(x > 0 for name, x in found.items() if re.search(r"radius|radii.1", name))
    np.testing.assert_allclose(
        list(found.values()), list(expected.values()), rtol=1e-9, atol=1e-12
    )
    for of in (lambda s: s["covariance"], lambda s: s["certainty"].covariance):
        one, other = of(turned.stats), of(right.stats)
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-12)
    # Combinations have no sign; of any two parts of one their product has.
    rows = [np.asarray(x.stats["certainty"].directions) for x in (turned, right)]
    one, other = (x[:, :, None] * x[:, None] for x in rows)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_number_named_by_its_size_alone_settles():
    law = OF_A_PLAY["law"].with_parameters({"play(u,0.2).radius": jnp.asarray(-0.2)})
    assert float(law.settled().parameters()["play(u,0.2).radius"]) == 0.2
    assert law.settled().terms() == PLAY


@pytest.mark.parametrize("rubbish", [0.0, 1e6, -1e6])
def test_a_fit_begins_at_an_output_that_has_weight(rubbish):
    law = SparseModel.from_terms({"w": -0.08, "u": 0.3, "du": 0.5})
    t = np.linspace(0, 25, 600)
    u = np.exp(-t / 25) * np.sin(2 * t)
    w = np.array(hj.simulate(law, hj.Recording(t, u, 0 * u), w0=0.2).w)
    weight = np.where(np.arange(600) < 5, 0.0, 1.0)
    record = hj.Recording(t, u, np.where(weight > 0, w, rubbish))
    start = law.with_parameters({"w": -0.1, "u": 0.25})
    found = hj.refine(start, record, weights=[weight], substeps=1)
    assert float(found.stats["w0"][0]) == pytest.approx(0.2, abs=1e-3)
    for name, value in law.terms().items():
        assert float(found.value.terms()[name]) == pytest.approx(value, rel=1e-3)


def plays(radii, weights=(0.3, -0.5)):
    terms = {f"play(u,{r!r})": x for r, x in zip(radii, weights, strict=True)}
    return SparseModel.from_terms({"u": 1.0, **terms}, target="value")


def played(radii):
    t = np.linspace(0, 30, 600)
    u = 30 * (np.exp(-t / 25) * np.sin(2 * t) + 0.25 * np.sin(0.7 * t))
    w = np.asarray(hj.simulate(plays(radii), hj.Recording(t, u, 0 * u)).w)
    noise = np.random.default_rng(0).normal(size=600)
    return hj.Recording(t, u, w + 0.01 * np.std(w) * noise)


@pytest.mark.slow
def test_standard_errors_are_of_their_numbers_whatever_their_names_sort_as():
    """The second radius gets a digit more, whose name sorts before the first."""
    record, start = played((8.0, 10.5)), plays((8.2, 9.9))
    free = hj.refine(start, record)
    one, other = (n for n in free.value.parameters() if n.endswith("radius"))
    assert one.startswith("play(u,8.") and other.startswith("play(u,10.")
    errors = free.stats["standard_errors"]
    covariance = np.sqrt(np.diag(free.stats["covariance"]))
    names = free.stats["certainty"].names
    assert list(free.value.parameters()) == list(names)[: len(errors)]
    for name, error in zip(names, covariance, strict=False):
        assert float(errors[name]) == pytest.approx(error, rel=1e-9)
    # In another unit no name changes its place.
    small = hj.Recording(record.t, record.u / 10, record.w)
    weights = [float(x) for x in start.coefficients][1:]
    terms = {f"play(u,{r})": 10 * x for r, x in zip((0.82, 0.99), weights, strict=True)}
    same = SparseModel.from_terms({"u": 10.0, **terms}, target="value")
    scaled = hj.refine(same, small).stats["standard_errors"]
    radii = [float(x) for name, x in scaled.items() if name.endswith("radius")]
    expected = [float(errors[one]) / 10, float(errors[other]) / 10]
    np.testing.assert_allclose(sorted(radii), sorted(expected), rtol=1e-3)
    by_size = sorted((n, float(x)) for n, x in scaled.items() if n.endswith("radius"))
    np.testing.assert_allclose([x for _, x in by_size], expected, rtol=1e-3)
    held = hj.refine(start, record, fixed=["play(u,8.2).radius"])
    assert "play(u,8.2).radius" not in held.stats["standard_errors"]
    assert any(n.startswith("play(u,10.") for n in held.stats["standard_errors"])


@pytest.mark.slow
def test_standard_errors_are_of_their_numbers_in_products_too():
    """From 0.21 and 0.22 the radii go to 0.3 and 0.15, past each other."""

    def product(one, other):
        terms = {"u": 1.0, f"play(u,{one})*play(u,{other})": 0.8}
        return SparseModel.from_terms(terms, target="value")

    t = np.linspace(0, 20, 600)
    u = (1 - 0.03 * t) * np.sin(t) + 0.3 * np.sin(3.3 * t)
    w = np.asarray(hj.simulate(product(0.3, 0.15), hj.Recording(t, u, 0 * u)).w)
    noise = 1e-3 * np.random.default_rng(0).normal(size=600)
    record = hj.Recording(t, u, w + noise)

    def by_size(start):
        found = hj.refine(start, record)
        values, errors = found.value.parameters(), found.stats["standard_errors"]
        radii = [name for name in values if name.endswith("radius")]
        return sorted((float(values[n]), float(errors[n])) for n in radii)

    crossing, staying = by_size(product(0.21, 0.22)), by_size(product(0.16, 0.29))
    # Minima are found to far less than standard errors; on either side of a sample at
    # which a play begins to move, where the errors leap by a hundredth.
    (radii, errors), expected = np.transpose(crossing), np.transpose(staying)
    np.testing.assert_allclose(radii, expected[0], rtol=1e-4)
    np.testing.assert_allclose(errors, expected[1], rtol=0.02)
    assert errors[0] != pytest.approx(errors[1], rel=0.1)


@pytest.mark.slow
def test_options_of_a_bootstrap_name_numbers_as_they_were_given():
    record = played((8.0, 10.5))
    start = plays((8.2, 9.9))
    found = hj.bootstrap(
        start,
        record,
        key=jax.random.key(0),
        samples=4,
        fixed=["play(u,8.2).radius"],
        bounds={"play(u,9.9).radius": (5.0, 20.0)},
    )
    assert "play(u,8.2).radius" not in found.values
    radius = next(x for n, x in found.values.items() if n.endswith("radius"))
    assert np.all(np.abs(np.asarray(radius) - 10.5) < 1)


@pytest.mark.slow
def test_a_first_output_without_weight_is_what_the_samples_tell_of_it():
    """However few these are among all, of a law that soon forgets it."""
    t = 0.3 * np.arange(400)
    u = np.sin(t)
    law = SparseModel.from_terms({"w": -1.0, "du": 1.0})
    w = np.array(hj.simulate(law, hj.Recording(t, u, u), w0=0.6).w)
    w[0] = -0.3
    weights = [np.minimum(np.arange(400.0), 1)]
    fit = hj.refine(law, hj.Recording(t, u, w), weights=weights)
    np.testing.assert_allclose(fit.stats["w0"], 0.6, atol=1e-3)


class Near(AbstractModel):
    """It has no rate where the input is farther than 1 from a play of it."""

    gain: jax.Array

    @property
    def memory(self):
        return hj.library.Plays(jnp.array([0.5]))

    def start(self, m, now, seen):
        return seen

    def rate(self, x, m, now):
        return self.gain * jnp.log(1 - jnp.abs(now.u - m[0]))

    def output(self, x, m, now):
        return x


def test_pieces_that_are_left_empty_remember_what_there_is_at_the_end():
    t = np.linspace(0, 10, 101)
    record = hj.Recording(t, t, np.cos(t))
    model = parameters(Near(jnp.array(0.1)), (), {}, {})
    samples = refinement.samples([record], None, 1)
    objective = Objective(model, samples, Squares(), 30, 0.0, "state")
    gaps = gaps_of(objective)
    assert np.max(np.abs(gaps)) < 10
    np.testing.assert_array_equal(gaps[0, 25:], 0)


# ------------------------------------------------------------------- single precision


class Line(eqx.Module):
    """Residuals that are linear in the unknowns."""

    matrix: jax.Array
    target: jax.Array

    def residuals(self, z):
        return self.matrix @ z - self.target


@pytest.mark.usefixtures("unchecked")
def test_in_single_precision_columns_of_any_unit_have_their_products():
    """Though their squares are 0, or infinite; and so has a column of zeros."""
    random = np.random.default_rng(3)
    matrix = random.normal(size=(30, 4)) * [1e-25, 1.0, 1e25, 0.0]
    target = random.normal(size=30)
    with jax.enable_x64(False):
        line: Any = Line(*map(jnp.float32, (matrix, target)))
        triangle = np.asarray(factor(jnp.zeros(4), line), np.float64)
    both = np.column_stack([matrix, -target])
    lengths = np.linalg.norm(both, axis=0)
    units = np.outer(*2 * [np.where(lengths > 0, lengths, 1.0)])
    products = triangle.T @ triangle / units
    np.testing.assert_allclose(products, both.T @ both / units, atol=1e-5)


@pytest.mark.usefixtures("unchecked")
def test_slopes_have_their_derivatives_where_nothing_is_missed():
    matrix = np.random.default_rng(3).normal(size=(30, 3)) * [1.0, 0.0, 2.0]
    line: Any = Line(jnp.asarray(matrix), jnp.zeros(30))
    found = jax.jit(jax.jacfwd(lambda z: _slope(z, line)))(jnp.zeros(3))
    np.testing.assert_allclose(found, matrix.T @ matrix, rtol=1e-12, atol=1e-12)


@pytest.mark.usefixtures("unchecked")
def test_in_single_precision_small_numbers_have_standard_errors():
    """Whose squares are 0: those of linear regression."""
    n, random = 40, np.random.default_rng(4)
    jacobian = random.normal(size=(n, 2)) * [1e8, 1e22]
    t, missed = np.arange(n), random.normal(size=n)
    with jax.enable_x64(False):
        record = hj.Recording(t, t, np.zeros(n))
        samples = refinement.samples([record], None, 1)
        objective: Any = SimpleNamespace(samples=samples, loss=Squares())
        run: Any = SimpleNamespace(outputs=jnp.float32(missed)[None])
        _, errors = certainty(
            objective, Linearised(("a", "b"), run, jnp.float32(jacobian))
        )
        assert errors.dtype == np.float32
    unit = jacobian / [1e8, 1e22]
    covariance = np.linalg.inv(unit.T @ unit) * np.sum(missed**2) / (n - 2)
    expected = np.sqrt(np.diag(covariance)) / [1e8, 1e22]
    np.testing.assert_allclose(errors, expected, rtol=1e-4)
