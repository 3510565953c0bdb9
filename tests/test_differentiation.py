import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pysindy
import pytest
from hypothesis import given
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import minimize
from scipy.signal import savgol_filter

from hystjax import RESULTS, ComputationError, InputError, Recording, identify
from hystjax.library import Polynomial
from hystjax.regression import LeastSquares
from hystjax.regression.differentiation import (
    FiniteDifference,
    SavitzkyGolay,
    SmoothingSpline,
    TotalVariation,
)

RNG = np.random.default_rng(2)
EVEN = np.linspace(1.0, 3.0, 60)
UNEVEN = np.cumsum(RNG.uniform(0.2, 1.8, 60)) / 30 + 1
GRIDS = pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])


def signal(t):
    return np.sin(4 * t) + 0.05 * np.random.default_rng(3).normal(size=len(t))


def estimate(method, t, y):
    value, slope = method.estimate(jnp.asarray(t), jnp.asarray(y))
    np.testing.assert_array_equal(slope, method(jnp.asarray(t), jnp.asarray(y)))
    return np.asarray(value), np.asarray(slope)


# -------------------------------------------------------------- finite differences


def test_finite_differences_equal_pysindy():
    y = signal(EVEN)
    value, slope = estimate(FiniteDifference(), EVEN, y)
    expected = pysindy.FiniteDifference(order=2)._differentiate(y[:, None], EVEN)
    np.testing.assert_allclose(slope, expected[:, 0], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(value, y)


@GRIDS
def test_finite_differences_equal_numpy(t):
    slope = FiniteDifference()(jnp.asarray(t), jnp.asarray(signal(t)))
    expected = np.gradient(signal(t), t, edge_order=2)
    np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-11)


gaps = st.lists(st.floats(0.05, 4), min_size=12, max_size=12)
coefficients = st.lists(st.floats(-10, 10), min_size=4, max_size=4)


def polynomial(coefficients, t):
    """A polynomial and its derivative at t."""
    p = np.polynomial.Polynomial(coefficients)
    return p(t), p.deriv()(t)


@given(gaps, coefficients)
def test_finite_differences_are_exact_on_parabolas(gaps, coefficients):
    t = np.cumsum(gaps)
    y, slope = polynomial(coefficients[:3], t)
    tolerance = 1e-13 * (1 + np.max(np.abs(y))) / min(gaps)
    _, ours = estimate(FiniteDifference(), t, y)
    np.testing.assert_allclose(ours, slope, rtol=0, atol=10 * tolerance)


# ---------------------------------------------------------------- Savitzky and Golay


@pytest.mark.parametrize("window, order", [(5, 2), (15, 3), (21, 5), (3, 1), (59, 4)])
def test_savitzky_golay_equals_scipy(window, order):
    y, step = signal(EVEN), EVEN[1] - EVEN[0]
    value, slope = estimate(SavitzkyGolay(window, order), EVEN, y)
    for ours, derivative in ((value, 0), (slope, 1)):
        expected = savgol_filter(
            y, window, order, deriv=derivative, delta=step, mode="interp"
        )
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9)


@GRIDS
def test_savitzky_golay_equals_local_polynomials(t):
    """Least squares by NumPy over every window, in actual time."""
    y, window, order = signal(t), 11, 3
    value, slope = estimate(SavitzkyGolay(window, order), t, y)
    for row in range(len(t)):
        first = np.clip(row - window // 2, 0, len(t) - window)
        rows = slice(first, first + window)
        fit = np.polyfit(t[rows] - t[row], y[rows], order)
        np.testing.assert_allclose(value[row], fit[-1], rtol=0, atol=1e-10)
        np.testing.assert_allclose(slope[row], fit[-2], rtol=0, atol=1e-8)


@given(gaps, coefficients)
def test_savitzky_golay_is_exact_on_its_polynomials(gaps, coefficients):
    t = np.cumsum(gaps)
    y, slope = polynomial(coefficients, t)
    ours, derivative = estimate(SavitzkyGolay(7, 3), t, y)
    tolerance = 1e-11 * (1 + np.max(np.abs(y)))
    np.testing.assert_allclose(ours, y, rtol=0, atol=tolerance)
    np.testing.assert_allclose(derivative, slope, rtol=0, atol=tolerance / min(gaps))


# ------------------------------------------------------------------ smoothing spline


@GRIDS
@pytest.mark.parametrize("penalty", [None, 0.0, 1e-4, 1.0])
def test_smoothing_spline_equals_scipy(t, penalty):
    value, slope = estimate(SmoothingSpline(penalty), t, signal(t))
    # Without a penalty SciPy's choice where a step is one, at a flat minimum; a large
    # one is solved for in that unit of time, whose rounding is another.
    unit = np.mean(np.diff(t)) if penalty is None else 1.0
    close = {None: 1e-6, 1.0: 1e-10}.get(penalty, 1e-12)
    spline = make_smoothing_spline(t / unit, signal(t), lam=penalty)
    np.testing.assert_allclose(value, spline(t / unit), rtol=0, atol=close)
    steep = spline(t / unit, nu=1) / unit
    np.testing.assert_allclose(slope, steep, rtol=0, atol=10 * close)


@GRIDS
@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_smoothing_spline_does_not_depend_on_the_unit_of_time(t, unit):
    """Cross-validation chooses the penalty."""
    value, slope = estimate(SmoothingSpline(), t, signal(t))
    other, steeper = estimate(SmoothingSpline(), unit * (t + 50), signal(t))
    np.testing.assert_allclose(other, value, rtol=0, atol=1e-6)
    np.testing.assert_allclose(unit * steeper, slope, rtol=0, atol=1e-4)
    np.testing.assert_allclose(slope, 4 * np.cos(4 * t), atol=1.2)


def roughness(t):
    """Q R^-1 Q' of Green and Silverman (1994), section 2.3."""
    n, step = len(t), np.diff(t)
    q, r = np.zeros((n, n - 2)), np.zeros((n - 2, n - 2))
    for j in range(n - 2):
        before, after = step[j], step[j + 1]
        q[j : j + 3, j] = 1 / before, -1 / before - 1 / after, 1 / after
        r[j, j] = (before + after) / 3
        if j + 1 < n - 2:
            r[j, j + 1] = r[j + 1, j] = after / 6
    return q @ np.linalg.solve(r, q.T)


@GRIDS
def test_smoothing_spline_solves_the_normal_equations_of_its_penalty(t):
    """(1 + penalty roughness) x = y."""
    penalty = 1e-4
    normal = np.eye(len(t)) + penalty * roughness(t)
    expected = np.linalg.solve(normal, signal(t))
    value, _ = estimate(SmoothingSpline(penalty), t, signal(t))
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("uneven", [False, True])
def test_cross_validation_finds_penalties_of_any_size(uneven):
    """Of a sine of 200 samples with noise that is many times 200 steps cubed, tried on
    a grid of penalties."""
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.2, 1.8, 200) if uneven else np.ones(200))
    y = np.sin(2 * np.pi * t / 200) + 0.1 * rng.normal(size=200)

    roughest, shapes = np.linalg.eigh(roughness(t))

    def smoothed(decade):
        kept = 1 / (1 + 10**decade * roughest)
        value = shapes @ (kept * (shapes.T @ y))
        return value, np.sum((y - value) ** 2) / np.sum(1 - kept) ** 2

    tried = [smoothed(decade) for decade in np.arange(0, 7, 0.05)]
    expected, _ = min(tried, key=lambda each: each[1])
    value, slope = estimate(SmoothingSpline(), t, y)
    np.testing.assert_allclose(value, expected, rtol=0, atol=3e-3)  # the grid's step
    wanted = 2 * np.pi / 200 * np.cos(2 * np.pi * t / 200)
    assert np.sqrt(np.mean((slope - wanted) ** 2)) < 0.1 * np.max(wanted)


@GRIDS
def test_smoothing_spline_of_a_great_penalty_is_a_straight_line(t):
    value, slope = estimate(SmoothingSpline(1e15), t, 3 + signal(t))
    line = np.polyfit(t, 3 + signal(t), 1)
    np.testing.assert_allclose(value, np.polyval(line, t), rtol=0, atol=1e-6)
    np.testing.assert_allclose(slope, line[0], rtol=0, atol=1e-5)


# ------------------------------------------------------------------- total variation


def unit(t, y):
    """In which the penalty counts: the spread about the line through the ends."""
    return np.std(y - np.interp(t, t[[0, -1]], y[[0, -1]]))


def slope_changes(t):
    return np.diff(np.diff(np.eye(len(t)), axis=0) / np.diff(t)[:, None], axis=0)


@GRIDS
@pytest.mark.parametrize("penalty", [1e-4, 1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("size", [1.0, 1e-6, 1e5], ids="size={:g}".format)
def test_total_variation_is_optimal(t, penalty, size):
    """Its primal and dual objectives meet, which only the minimiser's do."""
    y, changes = size * signal(t), slope_changes(t)
    bound = penalty * unit(t, y)
    x, slope = estimate(TotalVariation(penalty), t, y)
    dual = np.linalg.lstsq(changes.T, y - x)[0]
    assert np.max(np.abs(changes.T @ dual - (y - x))) < 1e-10 * size
    assert np.max(np.abs(dual)) <= bound * (1 + 1e-6)
    gap = bound * np.sum(np.abs(changes @ x)) - dual @ (changes @ x)
    assert gap + 1e-9 * size**2 >= 0 and gap < 1e-9 * len(t) * np.var(y)
    np.testing.assert_allclose(slope, np.gradient(x, t), rtol=0, atol=1e-9 * size)


@GRIDS
@pytest.mark.parametrize("penalty", [1e-3, 1e-2])
def test_total_variation_equals_another_solver(t, penalty):
    t = t[:40]
    y, changes = signal(t), slope_changes(t)
    scale = np.max(np.abs(changes))
    bound = penalty * unit(t, y) * scale

    def dual(z):
        x = changes.T @ z / scale
        return x @ x / 2 - x @ y, changes @ (x - y) / scale

    found = minimize(
        dual,
        np.zeros(len(t) - 2),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-bound, bound)] * (len(t) - 2),
        options={"maxiter": 50_000, "maxfun": 100_000, "ftol": 1e-16, "gtol": 1e-12},
    )
    x, _ = estimate(TotalVariation(penalty), t, y)
    np.testing.assert_allclose(x, y - changes.T @ found.x / scale, rtol=0, atol=1e-4)


@GRIDS
def test_a_huge_penalty_leaves_the_straight_line(t):
    value, slope = estimate(TotalVariation(1e6), t, signal(t))
    rate, start = np.polyfit(t, signal(t), 1)
    np.testing.assert_allclose(value, rate * t + start, rtol=0, atol=1e-4)
    np.testing.assert_allclose(slope, rate, rtol=0, atol=1e-3)


@GRIDS
def test_a_line_that_is_added_stays_a_line(t):
    noisy = signal(t) + 0.01 * np.random.default_rng(0).normal(size=len(t))
    value, slope = estimate(TotalVariation(1e-2), t, noisy)
    for rise in (2.0, 2000.0):
        whole, steeper = estimate(TotalVariation(1e-2), t, noisy + 3 + rise * t)
        np.testing.assert_allclose(whole - 3 - rise * t, value, rtol=0, atol=1e-8)
        np.testing.assert_allclose(steeper - rise, slope, rtol=0, atol=1e-8)


def test_total_variation_finds_the_same_law_whatever_the_units():
    u, w = signal(EVEN), np.cumsum(np.abs(signal(UNEVEN)))
    how = {"differentiation": TotalVariation(1e-3), "regression": LeastSquares()}
    own, other = (
        identify(Recording(EVEN, a * u, b * w), Polynomial(1, ("u", "du")), **how)
        for a, b in ((1.0, 1.0), (1e-3, 50.0))
    )
    for name, ours in own.value.terms().items():
        expected = 50 * ours * (1 if name == "1" else 1e3)
        np.testing.assert_allclose(other.value.terms()[name], expected, rtol=1e-6)


@GRIDS
def test_a_small_penalty_leaves_the_signal(t):
    value, _ = estimate(TotalVariation(1e-9), t, signal(t))
    np.testing.assert_allclose(value, signal(t), rtol=0, atol=1e-4)


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_times_that_are_too_uneven_are_told():
    t = np.cumsum(10 ** np.random.default_rng(0).uniform(-9, 0, 200))
    with pytest.raises(ComputationError, match=r"uneven, of .* 9e\+08 times"):
        estimate(TotalVariation(1e-3), t, signal(t))
    # In a program it is data: beside it others are estimated, and regressions say so.
    both = jnp.stack([t, EVEN[0] + np.arange(200) / 100])
    slopes = jax.vmap(TotalVariation(1e-3))(both, jnp.stack([signal(t), both[1]]))
    assert np.all(np.isnan(slopes[0]))
    np.testing.assert_allclose(slopes[1], 1, rtol=0, atol=1e-2)
    record, uneven = Recording(t, signal(t), signal(t)), TotalVariation(1e-3)
    found = identify(record, Polynomial(1), differentiation=uneven, throw=False)
    assert found.result == RESULTS.not_finite
    with pytest.raises(ComputationError, match=r"`TotalVariation` did not converge"):
        identify(record, Polynomial(1), differentiation=uneven)


@pytest.mark.parametrize("method", [SmoothingSpline(), TotalVariation(1e-3)])
def test_estimates_of_all_samples_say_which_is_none(method):
    y = signal(EVEN)
    missing = np.where(np.arange(60) == 7, np.nan, y)
    with pytest.raises(InputError, match=r"`y` has 1 value.*NaN.*row 7"):
        method.estimate(EVEN, missing)
    with pytest.raises(InputError, match=r"`t` must increase strictly.*row 1"):
        method.estimate(EVEN[::-1], y)
    assert np.all(np.isnan(jax.jit(method)(EVEN, missing)))


def test_corners_of_a_noisy_triangle_stay():
    t = np.linspace(0, 4, 401)
    triangle = np.abs((t + 1) % 2 - 1)
    slope = np.sign(np.sin(np.pi * (t + 1e-9)))
    noisy = triangle + 0.01 * np.random.default_rng(5).normal(size=len(t))
    _, ours = estimate(TotalVariation(0.07), t, noisy)
    away = np.min(np.abs(t[:, None] - np.arange(5)), axis=1) > 0.05
    assert np.max(np.abs(ours - slope)[away]) < 0.1
    # Filters of the same noise suppression round the corner off much further out.
    _, rounded = estimate(SavitzkyGolay(61, 3), t, noisy)
    assert np.max(np.abs(rounded - slope)[away]) > 0.3


# ------------------------------------------------------------------------ all of them

METHODS = [
    FiniteDifference(),
    SavitzkyGolay(11, 3),
    SmoothingSpline(1e-4),
    SmoothingSpline(),
    TotalVariation(1e-3),
]


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_methods_under_jit_and_vmap(method):
    batch = jnp.stack([signal(UNEVEN), jnp.cos(UNEVEN), UNEVEN**2])
    t = jnp.asarray(UNEVEN)
    values, slopes = jax.jit(jax.vmap(method.estimate, in_axes=(None, 0)))(t, batch)
    for y, value, slope in zip(batch, values, slopes, strict=True):
        expected = method.estimate(t, y)
        np.testing.assert_allclose(value, expected[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(slope, expected[1], rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", METHODS[:2], ids=repr)
def test_linear_methods_are_differentiable(method):
    t, towards = jnp.asarray(UNEVEN), jnp.cos(7 * UNEVEN)
    y = jnp.asarray(signal(UNEVEN))
    _, change = jax.jvp(lambda y: method(t, y), (y,), (towards,))
    np.testing.assert_allclose(change, method(t, towards), rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_counts_of_a_converter_are_numbers_like_others(unchecked, method):
    counts = np.round(100 * signal(UNEVEN)).astype(int)
    expected = method.estimate(UNEVEN, counts.astype(float))
    for t, y in ((UNEVEN, counts), (UNEVEN.tolist(), counts.tolist())):
        for found, known in zip(method.estimate(t, y), expected, strict=True):
            np.testing.assert_allclose(found, known, rtol=0, atol=1e-9)
    for t, y in ((UNEVEN[:20], counts[:30]), (UNEVEN, np.stack([counts] * 2, axis=1))):
        with pytest.raises(InputError, match=r"`t` 20, `y` 30|`y` must be 1-D"):
            method.estimate(t, y)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_constant_signal_has_no_slope(method):
    value, slope = estimate(method, UNEVEN, np.full(60, 2.5))
    np.testing.assert_allclose(value, 2.5, rtol=1e-9)
    np.testing.assert_allclose(slope, 0, atol=1e-8)


SHORT = jnp.arange(10.0)
BAD = {
    "penalty without end": (
        lambda: SmoothingSpline(np.inf),
        "`penalty` must be one finite number, got the number inf",
    ),
    "two samples": (
        lambda: FiniteDifference()(SHORT[:2], SHORT[:2]),
        r"`FiniteDifference` needs at least 3 samples, got 2",
    ),
    "window too wide": (
        lambda: SavitzkyGolay(15, 3)(SHORT, SHORT),
        r"`SavitzkyGolay\(window=15\)` needs at least 15 .*got 10.*smaller `window`",
    ),
    "even window": (lambda: SavitzkyGolay(10, 3), r"odd.*window=10"),
    "order": (lambda: SavitzkyGolay(5, 5), r"larger than `order`.*order=5"),
    "order 0": (lambda: SavitzkyGolay(5, 0), r"at least 1.*order=0"),
    "spline samples": (
        lambda: SmoothingSpline()(SHORT[:4], SHORT[:4]),
        r"`SmoothingSpline` needs at least 5 samples, got 4",
    ),
    "spline penalty": (
        lambda: SmoothingSpline(-1.0),
        r"`penalty` must be zero or more",
    ),
    "variation samples": (
        lambda: TotalVariation(1.0)(SHORT[:3], SHORT[:3]),
        r"`TotalVariation` needs at least 4 samples, got 3",
    ),
    "variation penalty": (lambda: TotalVariation(0.0), r"`penalty` must be positive"),
}


@pytest.mark.parametrize("call, message", BAD.values(), ids=BAD)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()
