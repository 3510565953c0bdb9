"""The search for the right terms."""

import itertools
import math

import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax import search
from hystjax.library import Polynomial
from hystjax.models import SparseModel
from hystjax.regression import compress

RNG = np.random.default_rng(8)
A = RNG.normal(size=(60, 7)) * 10.0 ** np.arange(-3, 4)
B = RNG.normal(size=60) + 1e3 * A[:, 0] - 5e-2 * A[:, 5]


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_the_best_supports_are_those_of_brute_force(size):
    rows = search.supports(7, size)
    assert len(rows) == math.comb(7, size)
    found = search.ranking(compress(jnp.asarray(A), jnp.asarray(B)), rows, 10)
    expected = []
    for support in itertools.combinations(range(7), size):
        x = np.linalg.lstsq(A[:, support], B)[0]
        misfit = np.linalg.norm(A[:, support] @ x - B) / np.linalg.norm(B)
        expected.append((misfit, support, x))
    expected = sorted(expected, key=lambda each: each[0])[:10]
    np.testing.assert_allclose(found.residuals, [e[0] for e in expected], rtol=1e-9)
    assert [tuple(row) for row in found.rows.tolist()] == [e[1] for e in expected]
    for ours, (_, _, x) in zip(found.coefficients, expected, strict=True):
        np.testing.assert_allclose(ours, x, rtol=1e-8)


def test_too_many_supports_grow_from_shorter_ones():
    shorter = jnp.array([[0, 3], [3, 9]])
    grown = search.supports(1000, 3, shorter)
    assert len({tuple(row) for row in grown}) == len(grown) == 998 + 998 - 1
    assert all({0, 3} <= set(row) or {3, 9} <= set(row) for row in grown.tolist())
    assert len(search.supports(10, 3, shorter)) == math.comb(10, 3)


def test_a_choice_is_the_law_of_its_terms():
    library = Polynomial(2)
    rows = [library.names.index(name) for name in ("du", "w*|du|", "u")]
    values = tuple(map(jnp.asarray, (0.3, -0.7, 9.0)))
    used = jnp.array([True, True, False])
    choice = search.Choice(library, jnp.array(rows), used, values)
    law = SparseModel.from_terms({"du": 0.3, "w*|du|": -0.7})
    w, u, du = jnp.asarray(RNG.normal(size=(3, 20)))
    np.testing.assert_allclose(choice.rate(w, u, du), law.rate(w, u, du), rtol=1e-12)
    assert choice.terms() == law.terms()


def test_columns_of_a_problem():
    problem = compress(jnp.asarray(A), jnp.asarray(B))
    part = problem.columns(np.array([5, 0]))
    everything = jnp.ones(2, bool)
    x = np.linalg.lstsq(A[:, [5, 0]], B)[0]
    np.testing.assert_allclose(part.solve(everything), x, rtol=1e-10)
    misfit = np.linalg.norm(A[:, [5, 0]] @ x - B) / np.linalg.norm(B)
    assert float(part.residual(jnp.asarray(x))) == pytest.approx(misfit, rel=1e-10)


# -------------------------------------------------------------------------- discover

TRUTH = {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25}
TIMES = np.linspace(0, 20 * np.pi, 1000)


def duhem(noise, seed):
    """Experiment 4's record, from the closed form of the law on each branch of u."""
    w = np.asarray(hj.simulate(law(), recording(np.zeros_like(TIMES)), w0=0.0).w)
    error = np.random.default_rng(seed).normal(size=len(TIMES))
    return recording(w + noise * np.std(w) * error)


def law():
    return hj.models.Duhem(0.4, 0.5, 0.25)


def recording(w):
    return hj.Recording(TIMES, np.sin(TIMES), w).with_input(jnp.sin)


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
def test_the_right_terms_are_found_under_noise(noise):
    solution = hj.discover(duhem(noise, 5), Polynomial(2))
    assert solution.value.terms().keys() == TRUTH.keys()
    for name, value in solution.value.terms().items():
        error = float(solution.stats["standard_errors"][name])
        assert abs(value - TRUTH[name]) < 4 * error
    found, frontier = solution.stats["candidates"], solution.stats["frontier"]
    assert found[0].terms.keys() == TRUTH.keys() and found[0].forgets
    assert [c.criterion for c in found] == sorted(c.criterion for c in found)
    assert {3, 4} <= set(frontier) <= {1, 2, 3, 4}
    assert all(len(candidate.terms) == size for size, candidate in frontier.items())
    n = len(TIMES)
    for size, candidate in frontier.items():
        misfit = n * np.log(candidate.rmse**2)
        choices = 2 * np.log(math.comb(18, size))  # as many terms differ here
        expected = misfit + (size + 1) * np.log(n) + choices
        assert candidate.criterion == pytest.approx(expected)
    assert {"du^2", "|w|^2"} <= {alias.term for alias in solution.stats["aliases"]}


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
def test_the_right_terms_are_found_nearly_always(noise):
    supports = [
        hj.discover(duhem(noise, seed), Polynomial(2), throw=False).value.terms().keys()
        for seed in range(30)
    ]
    assert sum(support == TRUTH.keys() for support in supports) >= 29


def test_noise_alone_is_no_law():
    noise = recording(np.random.default_rng(1).normal(size=len(TIMES)))
    solution = hj.discover(noise, Polynomial(2), largest=2, throw=False)
    assert solution.result == hj.RESULTS.empty_support
    assert solution.value.terms() == {}
    with pytest.raises(hj.ComputationError, match="No term survived"):
        hj.discover(noise, Polynomial(2), largest=2)


@pytest.mark.parametrize("name", ["largest", "width"])
def test_wrong_sizes_are_told(name):
    with pytest.raises(hj.InputError, match=f"`{name}` must be at least 1, got 0"):
        hj.discover(duhem(0.0, 0), Polynomial(2), **{name: 0})
