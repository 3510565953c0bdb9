import warnings

import classical_equations as by_hand
import equinox as eqx
import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pysindy
import pytest
import scipy.optimize
from hypothesis import given
from sklearn import linear_model

from hystjax import InputError, LongRecording, Recording, identify, least_squares
from hystjax.least_squares import solution
from hystjax.library import Library, Polynomial, Term
from hystjax.regression import (
    STLSQ,
    LeastSquares,
    LeastSquaresProblem,
    NonNegative,
    Ridge,
    compress,
    merged,
    novelty,
    threshold_path,
)

SHAPES = [(30, 4), (60, 9), (200, 21), (1003, 13)]
RIDGES = [0.0, 1e-3, 0.05, 1.0]


@eqx.filter_jit
def fit(regression, regressors, target):
    return regression.fit(compress(regressors, target))


def random_problem(seed, n, k):
    """Correlated columns of several sizes, few true terms, and noise."""
    rng = np.random.default_rng(seed)
    mixing = np.eye(k) + 0.4 * rng.normal(size=(k, k)) / np.sqrt(k)
    regressors = rng.normal(size=(n, k)) @ mixing * rng.uniform(0.3, 3.0, k)
    truth = np.where(rng.uniform(size=k) < 0.4, rng.normal(size=k), 0.0)
    target = regressors @ truth + 0.1 * rng.normal(size=n)
    return jnp.asarray(regressors), jnp.asarray(target)


def by_pysindy(regressors, target, threshold, ridge, max_steps=20):
    reference = pysindy.STLSQ(threshold=threshold, alpha=ridge, max_iter=max_steps)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of an empty support
        reference.fit(np.asarray(regressors), np.asarray(target))
    return np.ravel(reference.coef_)


def assert_same_fit(ours, coefficients):
    np.testing.assert_array_equal(ours.support, coefficients != 0)
    np.testing.assert_allclose(ours.coefficients, coefficients, rtol=1e-9, atol=1e-12)


# ------------------------------------------------------------------------------ STLSQ


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seed", range(20))
def test_stlsq_equals_pysindy(shape, seed):
    """80 problems; among the thresholds one that drops nothing, one that drops all."""
    regressors, target = random_problem(seed, *shape)
    threshold = [0.0, 0.02, 0.1, 0.3, 1e3][seed % 5]
    ridge = RIDGES[seed % 4]
    ours = STLSQ(jnp.array(threshold), jnp.array(ridge), normalise=False)
    expected = by_pysindy(regressors, target, threshold, ridge)
    assert_same_fit(fit(ours, regressors, target), expected)
    if threshold in (0.0, 1e3):
        assert np.all((expected == 0) == (threshold == 1e3))


@pytest.mark.parametrize("seed", range(12))
def test_normalised_stlsq_equals_pysindy_on_normalised_columns(seed):
    regressors, target = random_problem(seed, 200, 21)
    regressors = regressors * 10.0 ** np.linspace(-4, 4, 21)
    columns, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (regressors, target))
    threshold, ridge = [0.01, 0.05, 0.2][seed % 3], RIDGES[seed % 4]
    expected = by_pysindy(
        regressors / columns, target / size, threshold, ridge * len(target)
    )
    ours = fit(STLSQ(jnp.array(threshold), jnp.array(ridge)), regressors, target)
    np.testing.assert_array_equal(ours.support, expected != 0)
    np.testing.assert_allclose(
        ours.coefficients * columns / size, expected, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("max_steps", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_stlsq_stops_when_pysindy_does(max_steps, seed):
    regressors, target = random_problem(100 + seed, 60, 9)
    ours = STLSQ(0.3, 0.05, normalise=False, max_steps=max_steps)
    result = fit(ours, regressors, target)
    assert_same_fit(result, by_pysindy(regressors, target, 0.3, 0.05, max_steps))
    assert result.num_steps <= max_steps + 1


@pytest.mark.parametrize("method", [STLSQ(0.05, 1e-3), NonNegative()], ids=repr)
def test_fits_are_free_of_units(method):
    """Normalised, units of terms and target change the coefficients' units only."""
    regressors, target = random_problem(7, 200, 21)
    units, unit = 10.0 ** np.random.default_rng(8).uniform(-6, 6, 21), 1e-5
    one = fit(method, regressors, target)
    other = fit(method, regressors * units, target * unit)
    np.testing.assert_array_equal(one.support, other.support)
    np.testing.assert_allclose(
        other.coefficients * units / unit, one.coefficients, rtol=1e-9, atol=1e-12
    )


# ------------------------------------------------------------------ other regressions


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_least_squares_equals_numpy(shape):
    regressors, target = random_problem(0, *shape)
    expected, *_ = np.linalg.lstsq(regressors, target)
    assert_same_fit(fit(LeastSquares(), regressors, target), expected)


@pytest.mark.parametrize("seed", range(3))
def test_columns_of_many_sizes_and_condition_1e10_equal_numpy(seed):
    """10 000 rows of 22 columns, in units that span 16 decades and nearly dependent
    whatever these are: normal equations, which square the condition, find nothing of
    half of the directions."""
    rng = np.random.default_rng(seed)
    n, k, condition = 10_000, 22, 1e10
    left = np.linalg.qr(rng.normal(size=(n, k)))[0]
    right = np.linalg.qr(rng.normal(size=(k, k)))[0]
    plain = left * np.geomspace(1, 1 / condition, k) @ right.T
    units = 10 ** rng.uniform(-8, 8, k)
    target = plain @ rng.normal(size=k) + 0.01 * left @ rng.normal(size=k)
    target += 1e-3 * rng.normal(size=n) / n**0.5
    problem = compress(jnp.asarray(plain * units), jnp.asarray(target))
    found = np.asarray(problem.solve(jnp.ones(k, bool))) * units
    expected = np.linalg.lstsq(plain, target, rcond=0)[0]
    rounding = 10 * k * np.finfo(float).eps
    misfit = np.linalg.norm(plain @ (found - expected))
    assert misfit < rounding * np.linalg.norm(expected)
    off = np.linalg.norm(found - expected) / np.linalg.norm(expected)
    assert off < condition * rounding


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("ridge", [1e-3, 0.05, 1.0, 1e4])
def test_ridge_equals_sklearn(shape, ridge):
    regressors, target = random_problem(1, *shape)
    reference = linear_model.Ridge(ridge, fit_intercept=False, solver="svd")
    plain = Ridge(jnp.array(ridge), normalise=False)
    assert_same_fit(
        fit(plain, regressors, target), reference.fit(regressors, target).coef_
    )

    columns, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (regressors, target))
    reference.set_params(alpha=ridge * len(target)).fit(
        regressors / columns, target / size
    )
    assert_same_fit(
        fit(Ridge(jnp.array(ridge)), regressors, target),
        reference.coef_ * size / columns,
    )


@pytest.mark.parametrize("n, k", [(60, 9), (1003, 21), (600, 80)])
def test_residual_and_norms(n, k):
    # In one block of rows, in several, and of too many columns for blocks.
    regressors, target = random_problem(2, n, k)
    problem = compress(regressors, target)
    guess = jnp.linspace(-1, 1, k)
    misfit = np.linalg.norm(regressors @ guess - target) / np.linalg.norm(target)
    np.testing.assert_allclose(problem.residual(guess), misfit, rtol=1e-12)
    columns, size = problem.norms()
    np.testing.assert_allclose(columns, np.sqrt(np.mean(regressors**2, axis=0)))
    np.testing.assert_allclose(size, np.sqrt(np.mean(target**2)))


def test_solve_on_a_given_support():
    regressors, target = random_problem(3, 60, 9)
    support = jnp.array([1, 0, 1, 1, 0, 0, 0, 1, 0], bool)
    expected = np.zeros(9)
    expected[support] = np.linalg.lstsq(regressors[:, support], target)[0]
    ours = compress(regressors, target).solve(support)
    np.testing.assert_allclose(ours, expected, rtol=1e-10, atol=0)


# ------------------------------------------------------------------------ non-negative


def plays(n, k):
    """A stack of k plays, radii evenly up to all but the input's amplitude, which
    falls; neighbours are nearly the same, on few samples more so."""
    u = np.sin(np.linspace(0, 6 * np.pi, n)) * np.linspace(1, 0.4, n)
    return by_hand.plays(u, np.linspace(0, 0.9, k))


def non_negative_problem(kind, seed):
    """Columns, and half of them with positive weights and noise; or without."""
    rng = np.random.default_rng(seed)
    n, k = [(80, 6), (100, 30), (90, 60)][seed % 3]
    columns = np.array(random_problem(seed, n, k)[0])
    if kind == "plays":
        columns = plays(n, k)
    if kind == "dependent":
        columns[:, k // 2] = 3.0 * columns[:, 1]
        columns[:, k // 2 + 1] = columns[:, 0] - 0.2 * columns[:, 2]
        columns[:, -1] = 0.0
    noise = 0.0 if kind == "exact" else 0.1
    target = columns @ np.maximum(rng.normal(size=k), 0) + noise * rng.normal(size=n)
    return columns, target


@pytest.mark.parametrize("kind", ["random", "plays", "dependent", "exact"])
@pytest.mark.parametrize("seed", range(25))
def test_non_negative_equals_scipy(kind, seed):
    """100 problems of up to 60 terms; dependent terms have many solutions, all with
    one residual."""
    columns, target = non_negative_problem(kind, seed)
    expected, residual = scipy.optimize.nnls(columns, target, maxiter=10_000)
    ours = fit(NonNegative(), columns, target)
    misfit = np.linalg.norm(columns @ ours.coefficients - target)
    np.testing.assert_allclose(misfit, residual, atol=1e-9 * np.linalg.norm(target))
    np.testing.assert_array_equal(ours.support, ours.coefficients > 0)
    assert np.min(ours.coefficients) >= 0 and ours.num_steps < 3 * len(expected)
    if kind != "dependent":
        atol = 1e-9 * np.max(expected)
        np.testing.assert_allclose(ours.coefficients, expected, rtol=0, atol=atol)


COARSE = hnp.arrays(float, (7, 6), elements=st.integers(-2, 2).map(float))


@given(COARSE)
def test_non_negative_solutions_are_optimal(numbers):
    """By the conditions of Karush, Kuhn and Tucker; among small whole numbers are
    columns that are equal, opposite, dependent or zero, and ties."""
    columns, target = numbers[:, :5], numbers[:, 5]
    x = np.asarray(fit(NonNegative(), columns, target).coefficients)
    slopes = columns.T @ (target - columns @ x)
    assert np.all(x >= 0)
    assert np.all(slopes <= 1e-11)
    np.testing.assert_allclose(slopes[x > 0], 0, atol=1e-11)


def test_non_negative_of_many_targets_at_once():
    """Each lane stops by itself; nothing at all and what no term can make among
    them."""
    columns, target = non_negative_problem("plays", 1)
    noise = np.random.default_rng(0).normal(size=(6, len(target)))
    scales = np.array([0, 1e-6, 1e-3, 1, 1e3, 0])[:, None]
    targets = target + scales * noise
    targets[0], targets[-1] = 0.0, -np.abs(columns[:, 0])
    together = jax.vmap(lambda y: fit(NonNegative(), columns, y))(jnp.asarray(targets))
    assert len(set(together.num_steps.tolist())) > 2
    for i, y in enumerate(targets):
        alone = fit(NonNegative(), columns, y)
        assert together.num_steps[i] == alone.num_steps
        np.testing.assert_array_equal(together.support[i], alone.support)
        np.testing.assert_allclose(together.coefficients[i], alone.coefficients)
        expected, _ = scipy.optimize.nnls(columns, y)
        np.testing.assert_allclose(alone.coefficients, expected, rtol=1e-8, atol=1e-9)


def test_two_hundred_plays():
    """More than there are samples, so that neighbours can hardly be told apart."""
    columns = plays(150, 200)
    noise = 1e-3 * np.random.default_rng(3).normal(size=150)
    target = columns[:, [20, 90]] @ [1.0, 0.5] + noise
    expected, residual = scipy.optimize.nnls(columns, target, maxiter=10_000)
    ours = fit(NonNegative(), columns, target)
    misfit = np.linalg.norm(columns @ ours.coefficients - target)
    np.testing.assert_allclose(misfit, residual, rtol=1e-9)
    np.testing.assert_allclose(ours.coefficients, expected, atol=1e-9)
    assert ours.num_steps < 200


def test_terms_that_are_dependent_beyond_rounding():
    """Columns of a Hilbert matrix: only some ten of them can be told apart."""
    rng = np.random.default_rng(4)
    columns = 1 / (np.arange(30)[:, None] + np.arange(20) + 1)
    target = columns @ np.maximum(rng.normal(size=20), 0)
    ours = fit(NonNegative(), columns, target)
    misfit = np.linalg.norm(columns @ ours.coefficients - target)
    assert misfit < 1e-9 * np.linalg.norm(target)
    assert np.all(ours.coefficients >= 0) and np.sum(ours.support) <= 12


@pytest.mark.parametrize("seed", range(5))
def test_non_negative_takes_the_first_of_equal_terms(seed):
    """Whatever their units: their slopes are then equal but for rounding."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(50, 40))
    columns[:, 3:] = columns[:, [1]] * rng.uniform(0.1, 10, 37)
    target = columns[:, :3] @ [0.5, 2.0, 1.0]
    ours = fit(NonNegative(), columns, target)
    np.testing.assert_array_equal(ours.support, np.arange(40) < 3)
    np.testing.assert_allclose(ours.coefficients[:3], [0.5, 2.0, 1.0], rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_rounding_brings_no_terms_in(seed):
    """Without noise the support is that of the truth."""
    rng = np.random.default_rng(seed)
    columns, truth = rng.normal(size=(200, 60)), np.maximum(rng.normal(size=60), 0)
    ours = fit(NonNegative(), columns, columns @ truth)
    np.testing.assert_array_equal(ours.support, truth > 0)
    np.testing.assert_allclose(ours.coefficients, truth, atol=1e-13)


def test_a_search_cut_short_gives_least_squares_on_its_support():
    columns, target = non_negative_problem("random", 2)
    ours = fit(NonNegative(max_steps=5), columns, target)
    assert ours.num_steps == 5 and 0 < np.sum(ours.support) < 5
    on = np.asarray(ours.support)
    expected = np.zeros(len(on))
    expected[on] = np.linalg.lstsq(columns[:, on], target)[0]
    np.testing.assert_allclose(ours.coefficients, expected, rtol=1e-10)
    assert np.all(ours.coefficients >= 0)


def test_non_negative_in_single_precision():
    columns, target = non_negative_problem("random", 1)
    expected, _ = scipy.optimize.nnls(columns, target)
    with jax.enable_x64(False):
        ours = fit(NonNegative(), jnp.asarray(columns), jnp.asarray(target))
    assert ours.coefficients.dtype == jnp.float32
    np.testing.assert_allclose(ours.coefficients, expected, atol=1e-5)
    np.testing.assert_array_equal(ours.support, expected > 0)


# ---------------------------------------------------------------------------- batches


def test_many_thresholds_and_ridges_at_once():
    regressors, target = random_problem(4, 200, 21)
    problem = compress(regressors, target)
    thresholds = jnp.logspace(-3, 1, 12)

    @jax.jit
    def path_of(ridge):
        return jax.vmap(lambda t: STLSQ(t, ridge, False).fit(problem))(thresholds)

    for ridge in RIDGES:
        path = path_of(ridge)
        for i, threshold in enumerate(thresholds):
            lane = jax.tree.map(lambda leaf, i=i: leaf[i], path)
            assert_same_fit(lane, by_pysindy(regressors, target, threshold, ridge))


def test_several_targets_at_once():
    regressors, first = random_problem(5, 200, 21)
    targets = jnp.stack([first, first[::-1], jnp.roll(first, 50)])
    ours = jax.vmap(lambda y: fit(STLSQ(0.05, 0.05, False), regressors, y))(targets)
    reference = pysindy.STLSQ(threshold=0.05, alpha=0.05)
    reference.fit(np.asarray(regressors), np.asarray(targets).T)
    np.testing.assert_array_equal(ours.support, reference.coef_ != 0)
    np.testing.assert_allclose(
        ours.coefficients, reference.coef_, rtol=1e-9, atol=1e-12
    )


# ------------------------------------------------------------------------------- rank


@pytest.mark.parametrize("normalise", [True, False])
@pytest.mark.parametrize(
    "method", [LeastSquares, Ridge, STLSQ], ids=lambda m: m.__name__
)
def test_of_equal_columns_the_earlier_is_kept(method, normalise):
    columns = np.array(random_problem(6, 200, 9)[0])
    columns[:, 5] = 3.0 * columns[:, 2]
    columns[:, 8] = columns[:, 0] - columns[:, 1]
    truth = np.array([2, 0, 1, 0, -1, 0, 0, 0, 0.0])
    method = {
        LeastSquares: LeastSquares(),
        Ridge: Ridge(0.0, normalise),
        STLSQ: STLSQ(0.1, 0.0, normalise),
    }[method]
    ours = fit(method, jnp.asarray(columns), jnp.asarray(columns @ truth))
    np.testing.assert_allclose(ours.coefficients, truth, rtol=0, atol=1e-11)
    assert not ours.support[5] and not ours.support[8]


@pytest.mark.parametrize("normalise", [True, False])
def test_equal_columns_under_a_ridge(normalise):
    """The ridge keeps both of a pair; the last regression must not."""
    columns = np.array(random_problem(6, 200, 9)[0])
    columns[:, 5] = 3.0 * columns[:, 2]
    truth = np.array([2, 0, 1, 0, -1, 0, 0, 0, 0.0])
    both = fit(
        Ridge(0.05, normalise), jnp.asarray(columns), jnp.asarray(columns @ truth)
    )
    assert min(both.coefficients[jnp.array([2, 5])]) > 0.01
    one = fit(
        STLSQ(0.01, 0.05, normalise), jnp.asarray(columns), jnp.asarray(columns @ truth)
    )
    np.testing.assert_allclose(one.coefficients[5], 0, atol=0)
    np.testing.assert_allclose(columns @ one.coefficients, columns @ truth, atol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_of_equal_columns_pysindy_keeps_both_and_we_the_first(seed):
    """With a ridge the same terms otherwise, and the same predictions; without one, the
    results of PySINDy on the columns but the later of the two."""
    columns, target = map(np.array, random_problem(seed, 200, 9))
    columns[:, 6] = columns[:, 2]
    threshold, ridge = [0.02, 0.1, 0.3][seed % 3], RIDGES[seed % 4]
    if ridge:
        expected = by_pysindy(columns, target, threshold, ridge)
        np.testing.assert_allclose(expected[6], expected[2], rtol=1e-9, atol=1e-12)
        expected[2] += expected[6]
        expected[6] = 0.0
    else:
        fewer = np.delete(columns, 6, axis=1)
        expected = np.insert(by_pysindy(fewer, target, threshold, ridge), 6, 0.0)
    method = STLSQ(jnp.array(threshold), jnp.array(ridge), normalise=False)
    assert_same_fit(fit(method, jnp.asarray(columns), jnp.asarray(target)), expected)


def share_not_explained(basis, column):
    left = column - basis @ np.linalg.lstsq(basis, column)[0]
    return np.linalg.norm(left) / np.linalg.norm(column)


def test_novelty_equals_projections():
    rng = np.random.default_rng(9)
    columns = rng.normal(size=(80, 8)) * 10.0 ** rng.uniform(-8, 8, 8)
    columns[:, 3] = columns[:, 0] + columns[:, 1]
    columns[:, 5] = columns[:, 4] / np.linalg.norm(columns[:, 4])
    columns[:, 5] += 1e-9 * rng.normal(size=80)
    columns[:, 6] = 0.0
    columns[:, 7] = 3.0 * columns[:, 4]  # is nothing new beside the rounding of that
    target = jnp.asarray(rng.normal(size=80))
    shares, kept = novelty(compress(jnp.asarray(columns), target))
    np.testing.assert_array_equal(kept, [1, 1, 1, 0, 1, 1, 0, 0])
    for i in range(8):
        before = [j for j in range(i) if kept[j]]
        if i == 6:
            assert shares[i] == 0
        elif i in (3, 7):
            assert shares[i] < 1e-12
        else:
            basis = columns[:, before] / np.linalg.norm(columns[:, before], axis=0)
            expected = share_not_explained(basis, columns[:, i]) if before else 1.0
            np.testing.assert_allclose(shares[i], expected, rtol=1e-6)


@pytest.mark.parametrize("rank", [None, 1e-6])
def test_solutions_are_of_columns_that_are_told_apart_whatever_their_units(rank):
    """Of columns that are a mix of others but for less than the rank that of least
    norm, each column of length 1."""
    rng = np.random.default_rng(14)
    plain = rng.normal(size=(60, 5))
    plain[:, 3] = plain[:, 1] + 1e-8 * plain[:, 3]
    plain[:, 4] = 0.0
    plain[:, :4] /= np.linalg.norm(plain[:, :4], axis=0)
    target = plain[:, :3] @ [1.0, 2.0, -1.0] + 1e-3 * rng.normal(size=60)
    left, sizes, right = np.linalg.svd(plain, full_matrices=False)
    count = 4 if rank is None else 3
    expected = right[:count].T @ (left[:, :count].T @ target / sizes[:count])
    units = 10.0 ** np.array([-9, 0, 5, 9, 0])
    found = solution(plain * units, target, rank) * units
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_novelty_of_candidates_and_by_tolerance():
    rng = np.random.default_rng(10)
    columns = rng.normal(size=(80, 4))
    columns[:, 2] = columns[:, 0] + 1e-3 * rng.normal(size=80)
    problem = compress(jnp.asarray(columns), jnp.asarray(columns[:, 0]))
    every = novelty(problem)
    coarse = novelty(problem, tolerance=0.01)
    without = novelty(problem, jnp.array([False, True, True, True]))
    np.testing.assert_array_equal(every[1], [1, 1, 1, 1])
    np.testing.assert_array_equal(coarse[1], [1, 1, 0, 1])
    np.testing.assert_array_equal(without[1], [0, 1, 1, 1])
    expected = share_not_explained(columns[:, [1]], columns[:, 2])
    np.testing.assert_allclose(without[0][2], expected, rtol=1e-12)


def test_one_sine_hides_terms():
    """u = sin t: u^2 + du^2 = 1 and |w|^2 = w^2."""
    t = np.linspace(0, 20 * np.pi, 2000)
    library = Polynomial(2)
    w = jnp.asarray(np.sin(t - 0.5) + 0.2 * np.sin(3 * t))
    regressors = library(w, jnp.sin(t), jnp.cos(t))
    _, kept = novelty(compress(regressors, w))
    hidden = [name for name, k in zip(library.names, kept, strict=True) if not k]
    assert {"du^2", "|du|^2", "|w|^2"} <= set(hidden)
    assert "1" not in hidden and "u^2" not in hidden


# ----------------------------------------------------------------------- factorisation


@pytest.mark.parametrize(
    "n, k", [(60, 5), (1000, 5), (1001, 5), (1249, 5), (20_011, 5), (1300, 130), (5, 9)]
)
def test_compress_equals_one_factorisation(n, k):
    """In blocks or at once: up to signs of rows."""
    rng = np.random.default_rng(n)
    regressors, target = rng.normal(size=(n, k)), rng.normal(size=n)
    problem = compress(jnp.asarray(regressors), jnp.asarray(target))
    both = np.column_stack([regressors, target])
    expected = np.linalg.qr(np.pad(both, ((0, max(0, k + 1 - n)), (0, 0))), mode="r")
    expected *= np.where(np.diag(expected) < 0, -1, 1)[:, None]
    ours = np.block([
        [problem.triangle, problem.target[:, None]],
        [np.zeros((1, k)), problem.remainder],
    ])  # fmt: skip
    ours *= np.where(np.diag(ours) < 0, -1, 1)[:, None]
    rank = min(n, k + 1)
    np.testing.assert_allclose(ours[:rank], expected[:rank], rtol=0, atol=1e-11 * n)
    np.testing.assert_allclose(ours[rank:], 0, atol=1e-11)
    assert problem.rows == n


@pytest.mark.parametrize("n, k, m", [(60, 4, 7), (3, 5, 4), (1, 2, 30)])
def test_merged_problems_are_that_of_all_rows(n, k, m):
    random = np.random.default_rng(n)
    regressors = random.normal(size=(m, n, k))
    target = random.normal(size=(m, n))
    whole = merged(jax.vmap(compress)(regressors, target))
    expected, rest, *_ = np.linalg.lstsq(
        regressors.reshape(-1, k), target.ravel(), rcond=None
    )
    np.testing.assert_allclose(whole.solve(jnp.ones(k, bool)), expected, rtol=1e-9)
    misfit = whole.residual(jnp.asarray(expected)) * np.linalg.norm(target)
    np.testing.assert_allclose(misfit**2, rest[0], rtol=1e-9)
    np.testing.assert_allclose(
        whole.norms()[0], np.sqrt(np.mean(regressors**2, axis=(0, 1))), rtol=1e-12
    )


def test_more_columns_than_rows():
    rng = np.random.default_rng(11)
    regressors, target = rng.normal(size=(6, 10)), rng.normal(size=6)
    plain = fit(LeastSquares(), regressors, target)
    np.testing.assert_array_equal(plain.support, np.arange(10) < 6)
    np.testing.assert_allclose(regressors @ plain.coefficients, target, atol=1e-10)
    reference = linear_model.Ridge(0.3, fit_intercept=False, solver="svd")
    assert_same_fit(
        fit(Ridge(0.3, normalise=False), regressors, target),
        reference.fit(regressors, target).coef_,
    )


@pytest.mark.parametrize("method", [LeastSquares(), STLSQ(1e-3)], ids=repr)
def test_columns_of_extreme_sizes(method):
    rng = np.random.default_rng(12)
    sizes = 10.0 ** np.array([-8, 8, 0, -5, 5, 8, -8, 3])
    regressors, truth = rng.normal(size=(300, 8)), rng.uniform(0.5, 2, 8)
    target = regressors @ truth
    ours = fit(method, regressors * sizes, target)
    np.testing.assert_allclose(ours.coefficients * sizes, truth, rtol=1e-11)


@pytest.mark.parametrize("size, finite", [(1.0, True), (1e200, False), (np.nan, False)])
@pytest.mark.parametrize("column", [0, 3])
def test_columns_and_a_target_that_have_no_squares_are_told(size, finite, column):
    """The last one is the target."""
    table = np.random.default_rng(13).normal(size=(60, 4))
    table[7, column] = size
    problem = compress(jnp.asarray(table[:, :3]), jnp.asarray(table[:, 3]))
    assert problem.finite() == finite


# --------------------------------------------------------------------- differentiation


@pytest.mark.parametrize(
    "method, n",
    [
        (LeastSquares(), 60),
        (Ridge(0.1), 60),
        (STLSQ(0.1, 0.05, False), 60),
        (NonNegative(), 60),
        (STLSQ(0.1), 1001),  # more rows than fit in whole blocks
    ],
)
def test_coefficients_are_differentiable_in_the_target(method, n):
    """Forwards and backwards, against differences along one direction."""
    regressors, target = random_problem(13, n, 6)
    towards = jnp.asarray(np.random.default_rng(14).normal(size=n))

    @jax.jit
    def coefficients(target):
        return fit(method, regressors, target).coefficients

    step = 1e-5
    expected = (
        coefficients(target + step * towards) - coefficients(target - step * towards)
    ) / (2 * step)
    _, forwards = jax.jvp(coefficients, (target,), (towards,))
    np.testing.assert_allclose(forwards, expected, rtol=1e-6, atol=1e-8)
    backwards = jax.jit(jax.jacrev(coefficients))(target) @ towards
    np.testing.assert_allclose(backwards, expected, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("ridge", [0.0, 0.3])
def test_coefficients_are_differentiable_in_everything(ridge):
    """In the regressors, the target and the ridge, a ridge of 0 included."""
    regressors, target = random_problem(16, 60, 6)
    rng = np.random.default_rng(17)
    towards = (
        jnp.asarray(rng.normal(size=(60, 6))),
        jnp.asarray(rng.normal(size=60)),
        1.0,
    )

    def coefficients(regressors, target, ridge):
        gram = regressors.T @ regressors + ridge * jnp.eye(6)
        return jnp.linalg.solve(gram, regressors.T @ target)

    def ours(regressors, target, ridge):
        return compress(regressors, target).solve(jnp.ones(6, bool), ridge)

    at = (regressors, target, ridge)
    value, change = jax.jvp(ours, at, towards)
    expected, expected_change = jax.jvp(coefficients, at, towards)
    np.testing.assert_allclose(value, expected, rtol=1e-10)
    np.testing.assert_allclose(change, expected_change, rtol=1e-8)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: STLSQ(-0.1), "`threshold` must be zero or more, got -0.1"),
        (lambda: STLSQ(0.1, -1.0), "`ridge` must be zero or more, got -1.0"),
        (lambda: STLSQ(0.1, max_steps=0), "`max_steps` must be at least 1, got 0"),
        (lambda: STLSQ(0.1, max_steps=True), "`max_steps` must be a whole number"),
        (lambda: NonNegative(max_steps=0), "`max_steps` must be at least 1, got 0"),
        (lambda: Ridge(np.nan), "`ridge` must be zero or more, got nan"),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_problems_are_pytrees():
    regressors, target = random_problem(15, 30, 4)
    problem = compress(regressors, target)
    again = jax.tree.map(lambda leaf: leaf, problem)
    assert isinstance(again, LeastSquaresProblem) and eqx.tree_equal(problem, again)


@pytest.mark.parametrize("normalise", [False, True])
@pytest.mark.parametrize("ridge", [0.0, 0.05])
def test_a_threshold_path_equals_fits_one_by_one(normalise, ridge):
    rng = np.random.default_rng(5)
    theta = rng.normal(size=(300, 9)) * np.logspace(-1, 1, 9)
    target = theta[:, ::3] @ [2.0, -0.3, 0.04] + 0.1 * rng.normal(size=300)
    theta, target = jnp.asarray(theta), jnp.asarray(target)
    problem = compress(theta, target)
    thresholds = jnp.asarray(rng.permutation(np.logspace(-5, 2, 57)))
    regression = STLSQ(0.0, ridge, normalise)
    path = threshold_path(regression, problem, thresholds)
    for i, threshold in enumerate(thresholds):
        one = fit(STLSQ(threshold, ridge, normalise), theta, target)
        np.testing.assert_array_equal(path.support[i], one.support)
        np.testing.assert_array_equal(path.num_steps[i], one.num_steps)
        np.testing.assert_allclose(path.coefficients[i], one.coefficients, rtol=1e-12)


def test_a_threshold_path_stops_where_fits_one_by_one_do():
    regressors, target = random_problem(104, 60, 9)
    problem, thresholds = compress(regressors, target), jnp.array([0.1, 0.3, 0.5])
    regression = STLSQ(0.0, 0.05, normalise=False, max_steps=1)
    path = threshold_path(regression, problem, thresholds)
    for i, threshold in enumerate(thresholds):
        expected = by_pysindy(regressors, target, threshold, 0.05, max_steps=1)
        assert_same_fit(jax.tree.map(lambda leaf, i=i: leaf[i], path), expected)
    assert max(path.num_steps) == 2


def test_columns_that_are_small_by_their_unit_have_lengths_in_single_precision():
    columns = np.float32([[3e-21, 0.0, 3e21], [4e-21, 0.0, 4e21]])
    found = least_squares.column_lengths(jnp.asarray(columns))
    np.testing.assert_allclose(found, [5e-21, 1.0, 5e21], rtol=1e-6)


@pytest.mark.parametrize("kind", [Recording, LongRecording])
def test_in_single_precision_slopes_tell_whether_squares_are_held(kind):
    """However many cycles there are: the range of an input over the duration does not
    say how fast it changes."""
    n = 5000
    library = Library(tuple(map(Term.parse, ("u", "du^2"))))

    def law(t, u):
        with jax.enable_x64(False):
            record = kind(*map(np.float32, (t, u, np.roll(u, 1))))
            return identify(record, library, LeastSquares()).value

    t = np.arange(n)
    slow = law(t, 1e-7 * np.sin(1.3 * t))
    assert np.all(np.isfinite(slow.coefficients)) and np.all(slow.support)
    with pytest.raises(InputError, match=r"`u` changes by about 1e9 .* term du\^2"):
        law(t * 2e-9, 200 * np.sin(2e6 * np.pi * t * 2e-9))


def test_columns_and_targets_of_zeros_have_no_size():
    rows, nothing = jnp.asarray(np.eye(4)[:, :2] * [1.0, 0.0]), jnp.zeros(4)
    for target in (nothing, nothing + 1.0):
        inner, unit = least_squares.scaled(compress(rows, target), True)
        assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves((inner, unit)))


@pytest.mark.parametrize("nothing", ["in a block", "throughout"])
def test_columns_that_are_zero_leave_the_others_their_derivatives(nothing):
    """Such as that of u' where the input rests, in some of the blocks that a triangle
    is made of; or that of a play that never moves."""
    rng = np.random.default_rng(3)
    regressors, target = rng.normal(size=(3000, 6)), rng.normal(size=3000)
    change = rng.normal(size=(3000, 6))
    still = slice(100, 2900) if nothing == "in a block" else slice(None)
    regressors[still, 2] = change[still, 2] = 0.0

    def coefficients(step):
        rows = jnp.asarray(regressors) + step * jnp.asarray(change)
        return LeastSquares().fit(compress(rows, jnp.asarray(target))).coefficients

    found = jax.jacfwd(coefficients)(0.0)
    backwards = jax.jacrev(coefficients)(0.0)
    h = 1e-6
    expected = (coefficients(h) - coefficients(-h)) / (2 * h)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(backwards, found, rtol=0, atol=1e-12)
    assert np.max(np.abs(expected)) > 1e-3
