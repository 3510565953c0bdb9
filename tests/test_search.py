"""The search for the right terms."""

import dataclasses
import itertools
import math
import re
import warnings
from functools import partial
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of
from scipy.integrate import cumulative_trapezoid, odeint
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter, savgol_filter
from scipy.stats import binomtest, chi2, norm, spearmanr

import hystjax as hj
from hystjax import refinement, search
from hystjax._core import checks
from hystjax.discovery import Discovered, _discover, _explore, _hidden, _setting
from hystjax.discovery._choosing import _by_evidence, _to_the_end
from hystjax.discovery._discover import _of_output_and_unlike, _regression, explore
from hystjax.discovery._evidence import _drawn, _shares
from hystjax.discovery._layout import _matching, blocks, layout, outside
from hystjax.library import Kind, Library, Polynomial, Term
from hystjax.models import SparseModel
from hystjax.refinement._certainty import lost_by_rounding, missed_by_lines
from hystjax.regression import compress
from hystjax.regression._identify import factor, told_apart, weak_form
from hystjax.reproduce import reproduce
from hystjax.signals import Signals

SLOW, THOROUGH = pytest.mark.slow, pytest.mark.thorough
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


def test_terms_that_make_each_other_up_are_worth_what_they_span():
    a = RNG.normal(size=(60, 4))
    a = np.column_stack([a, a[:, 0] - 2 * a[:, 1] + a[:, 2]])
    y = a @ [1.0, 0.0, -1.0, 0.5, 0.0] + 0.1 * RNG.normal(size=60)
    rows = search.supports(5, 4)
    problem = compress(jnp.asarray(a), jnp.asarray(y))
    _, left = search.solved(problem, jnp.asarray(rows))
    for row, share in zip(rows, left, strict=True):
        fit = a[:, row] @ np.linalg.lstsq(a[:, row], y)[0]
        assert float(share) == pytest.approx(np.sum((y - fit) ** 2) / (y @ y), rel=1e-9)


def test_too_many_supports_grow_from_shorter_ones():
    shorter = jnp.array([[0, 3], [3, 9]])
    grown = search.supports(1000, 3, shorter)
    assert len({tuple(row) for row in grown}) == len(grown) == 998 + 998 - 1
    assert all({0, 3} <= set(row) or {3, 9} <= set(row) for row in grown.tolist())
    assert len(search.supports(10, 3, shorter)) == math.comb(10, 3)


def test_the_best_extensions_are_those_of_brute_force():
    columns = np.column_stack([A, A[:, 2] - 3 * A[:, 4]])  # of these no term is new
    problem = compress(jnp.asarray(columns), jnp.asarray(B))
    expected = []
    for term in (0, 1, 3, 5, 6):
        longer = tuple(sorted((2, 4, term)))
        x, misfit, *_ = np.linalg.lstsq(columns[:, longer], B)
        expected.append((misfit[0], longer, x))
    expected = sorted(expected, key=lambda each: each[0])
    found = list(search.extensions(problem, (2, 4)))
    assert [support for support, _ in found] == [each[1] for each in expected]
    for (_, ours), (*_, x) in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, x, rtol=1e-8)


def test_extensions_are_the_same_in_all_units():
    sizes = 10.0 ** np.linspace(-20, 20, A.shape[1])
    plain, other = (
        list(search.extensions(compress(jnp.asarray(x), jnp.asarray(B)), (2, 4)))
        for x in (A, A * sizes)
    )
    for (support, x), (same, ours) in zip(plain, other, strict=True):
        assert support == same
        np.testing.assert_allclose(ours * sizes[list(same)], x, rtol=1e-8)


def test_a_column_too_large_to_be_squared_leaves_the_others_as_they_are():
    problem = compress(jnp.asarray(A), jnp.asarray(B))
    huge = jnp.full((len(problem.triangle), 1), 1e200)
    larger = jnp.concatenate([problem.triangle, huge], axis=1)
    with_it = eqx.tree_at(lambda p: p.triangle, problem, larger)
    expected = [support for support, _ in search.extensions(problem, (2, 4))]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [support for support, _ in search.extensions(with_it, (2, 4))]
    assert [support for support in found if 7 not in support] == expected


def test_terms_of_low_degree_come_first():
    library = Polynomial(4, ("w", "u", "du"))
    stages = list(_explore.nested(library))
    degrees = [{library.terms[row].degree for row in rows} for rows in stages]
    assert degrees == [{0, 1, 2}, {0, 1, 2, 3}, {0, 1, 2, 3, 4}]
    assert stages[-1].tolist() == list(range(len(library)))
    assert len(list(_explore.nested(Polynomial(1)))) == 1


def test_a_choice_is_the_law_of_its_terms():
    library = Polynomial(2)
    rows = [library.names.index(name) for name in ("du", "w*|du|", "u")]
    values = tuple(map(jnp.asarray, (0.3, -0.7, 9.0)))
    used = jnp.array([True, True, False])
    choice = search.Choice(library, jnp.array(rows), used, values)
    law = SparseModel.from_terms({"du": 0.3, "w*|du|": -0.7})
    w, u, du = jnp.asarray(RNG.normal(size=(3, 20)))
    now = Signals(jnp.zeros(20), u, du)
    chosen, expected = (jax.vmap(each.rate)(w, (), now) for each in (choice, law))
    np.testing.assert_allclose(chosen, expected, rtol=1e-12)
    assert choice.terms() == law.terms()


def test_columns_of_a_problem():
    problem = compress(jnp.asarray(A), jnp.asarray(B))
    part = problem.columns(np.array([5, 0]))
    everything = jnp.ones(2, bool)
    x = np.linalg.lstsq(A[:, [5, 0]], B)[0]
    np.testing.assert_allclose(part.solve(everything), x, rtol=1e-10)
    misfit = np.linalg.norm(A[:, [5, 0]] @ x - B) / np.linalg.norm(B)
    assert float(part.residual(jnp.asarray(x))) == pytest.approx(misfit, rel=1e-10)


def test_rankings_grow_where_there_is_too_much_to_enumerate():
    problem = compress(jnp.asarray(A), jnp.asarray(B))
    found = list(search.rankings(problem, 9, 4, beam=7, most=10))
    assert [ranking.rows.shape for ranking in found] == [
        (min(4, len(search.supports(7, size))), size) for size in range(1, 8)
    ]
    # A beam as wide as there are supports of two terms or fewer loses nothing there.
    best = search.ranking(problem, search.supports(7, 2), 4)
    assert found[1].rows.tolist() == best.rows.tolist()


@pytest.mark.parametrize("correlation", [-0.5, 0.0, 0.6, 0.95])
def test_correlated_residuals_are_worth_fewer_samples(correlation):
    """Of a first-order autoregression n (1 - rho) / (1 + rho), none worth more than
    itself."""
    noise = np.random.default_rng(3).normal(size=(60, 20_000))
    noise = lfilter([1.0], [1.0, -correlation], noise)
    used = np.ones(noise.shape, bool)
    used[30:, 10_000:] = False
    noise[~used] = 1e9
    found = float(search.independent_share(jnp.asarray(noise), jnp.asarray(used)))
    share = min(1.0, (1 - correlation) / (1 + correlation))
    assert found == pytest.approx(share, rel=0.05)


def test_few_correlated_residuals_are_worth_what_their_sums_of_products_say():
    """None of them by way of the other end."""
    noise = np.random.default_rng(5).normal(size=64)
    residuals = 2 + lfilter([1.0], [1.0, -0.8], noise)
    row = jnp.asarray(residuals)[None]
    found = 64 * float(search.independent_share(row, row == row))
    assert found == pytest.approx(worth(residuals), rel=1e-9) and found < 32


@pytest.mark.parametrize("n", [200, 841, 1000, 5000])
def test_white_residuals_count_whole(n):
    """But for as many as the level of the test says. Of 841 samples the 841st part 841
    times is less than one, to rounding, and would be no whole."""
    noise = np.random.default_rng(n).normal(size=(300, 1, n))
    # Noise of no even size is white too, loud over more samples than there are lags.
    loud = 1 + 3 * np.sin(np.arange(n) / 40) ** 2
    share = jax.vmap(lambda row: search.independent_share(row, row == row))
    for each in (noise, loud * noise):
        whole = np.asarray(share(jnp.asarray(each))) == 1
        assert binomtest(int(np.sum(~whole)), 300, 0.01).pvalue > 0.01


def grown(a, seed, n=2000):
    """A sine, and noise of standard deviation 0.3 sqrt(1 + a w^2 / mean(w^2))."""
    w = 7 * np.sin(np.linspace(0, 40, n))
    scale = 0.3 * np.sqrt(1 + a * w**2 / np.mean(w**2))
    return w[None], (scale * np.random.default_rng(seed).normal(size=n))[None]


@pytest.mark.parametrize("memory", [0.0, 0.8])
@pytest.mark.parametrize("gap", ["none", "every second", "most"])
def test_samples_without_weight_hide_no_correlation(memory, gap):
    rng = np.random.default_rng(0)
    used = {
        "none": np.ones(1000, bool),
        "every second": np.arange(1000) % 2 == 0,
        "most": rng.random(1000) < 0.3,
    }[gap]
    shares = []
    for _ in range(40):
        shocks = rng.normal(size=1000)
        noise = lfilter([1.0], [1, -memory], shocks)
        share = search.independent_share(jnp.asarray(noise[None]), used[None])
        shares.append(float(share))
    # Whole is the share of white noise alone.
    assert np.mean((np.array(shares) == 1.0) == (memory == 0)) > 0.9


@pytest.mark.parametrize("a", [0.5, 3.0, 100.0])
def test_weights_are_those_of_greatest_likelihood(a):
    w, residuals = (
        np.concatenate(x, 1) for x in zip(grown(a, 1), grown(a, 2), strict=True)
    )
    used = np.arange(w.shape[1])[None] % 7 > 0

    def likelihood(log_a):
        relative = w[used] ** 2 / np.mean(w[used] ** 2)
        scale = np.sqrt(1 + np.exp(log_a) * relative)
        s = np.sqrt(np.mean((residuals[used] / scale) ** 2))
        return -np.sum(norm.logpdf(residuals[used], scale=s * scale))

    best = minimize_scalar(likelihood, bounds=(-5, 8), method="bounded").x
    found = search.weights(*map(jnp.asarray, (w, residuals, used)), jnp.sum(used))
    relative, inverse = w[used] ** 2 / np.mean(w[used] ** 2), 1 / found[used]
    slope, level = np.polyfit(relative, inverse, 1)
    assert slope / level == pytest.approx(np.exp(best), rel=0.06)
    assert np.mean(found[used]) == pytest.approx(1) and np.all(found[~used] == 0)


def test_even_noise_is_not_weighed():
    used = jnp.ones((1, 2000), bool)
    laws = [grown(0.0, seed) for seed in range(100)]
    found = [search.weights(*map(jnp.asarray, (*law, used)), 2000.0) for law in laws]
    assert sum(weights is not None for weights in found) <= 2
    # Of few independent samples less is believed.
    w, residuals = map(jnp.asarray, grown(0.5, 3))
    assert search.weights(w, residuals, used, 2000.0) is not None
    assert search.weights(w, residuals, used, 20.0) is None


def test_the_free_run_is_linearised_in_all_coefficients():
    """Against differences of free runs by SciPy's integrator of the written-out law."""
    library = Library(tuple(map(Term.parse, ("u*|du|", "w*|du|", "du", "w*du"))))
    record = duhem(0.05, 2)

    def misfit(x):
        def rate(w, t):
            u, du = np.sin(t), np.cos(t)
            change = x[0] * u * abs(du) + x[1] * w * abs(du)
            return change + x[2] * du + x[3] * w * du

        run = odeint(rate, x[4], TIMES, rtol=1e-11, atol=1e-12, hmax=0.01)
        return run[:, 0] - np.asarray(record.w)

    at = np.array([0.41, -0.5, 0.25, 0.0, 0.1])
    steps = 1e-5 * np.eye(5)
    jacobian = np.stack(
        [(misfit(at + step) - misfit(at - step)) / 2e-5 for step in steps], axis=1
    )
    samples = refinement.samples((record,), None, 2)
    problem = search.output_error(samples, library, jnp.asarray(at[:4]), at[4:])
    for support in ([0, 1, 2], [0, 1, 2, 3], [1, 3]):
        free = [*support, 4]
        kept = np.zeros(5)
        kept[free] = at[free]
        # The start stays where it is in `at`; coefficients that are left out go to 0.
        target = jacobian @ np.where(np.arange(5) == 4, 0, at) - misfit(at)
        x, squares, *_ = np.linalg.lstsq(jacobian[:, free], target)
        mask = jnp.asarray(np.isin(np.arange(4), support))
        found = problem.solve(mask)
        np.testing.assert_allclose(found[np.array(support)], x[:-1], rtol=1e-4)
        size = jnp.sqrt(jnp.sum(problem.target**2) + problem.remainder**2)
        assert float((problem.residual(found) * size) ** 2) == pytest.approx(
            float(squares[0]), rel=1e-4
        )


def candidate(names, criterion):
    return search.Trial(dict.fromkeys(names.split(), 1.0), 1.0, criterion)


def test_laws_hardly_worse_than_the_best():
    found = [candidate("u", value) for value in (-1.9, -8.0, -6.5)]
    ordered = search.ordered(found, Polynomial(2))
    assert ordered == (found[1], found[2], found[0])
    assert search.alike(ordered) == (found[2],)
    assert search.alike([]) == search.ordered([], Polynomial(2)) == ()


@pytest.mark.parametrize(
    ("plainer", "other"),
    [
        ("w*|w|", "u du"),
        ("w*|du| u*|du|", "w u du"),
    ],
)
def test_of_laws_hardly_told_apart_the_plainest_is_chosen(plainer, other):
    """That of fewer terms, whatever their degrees."""
    best = candidate(other, 0.0)
    near, far = candidate(plainer, 1.9), candidate(plainer, 2.1)
    assert search.ordered((best, near), Polynomial(2)) == (near, best)
    assert search.alike((near, best)) == (best,)
    assert search.ordered((far, best), Polynomial(2)) == (best, far)
    assert search.alike((best, far)) == ()


def test_by_blocks_one_standard_error_decides():
    """Of the difference block by block, which is far surer than either error."""
    errors = np.array([[1.0, 2.0, 6.0], [1.1, 2.1, 6.1], [1.2, 2.0, 6.05]])
    unsure = [np.std(row - errors[0], ddof=1) / 3**0.5 for row in errors]
    more = np.mean(errors - errors[0], axis=1)
    assert more[1] > unsure[1] + 0.05 and more[2] < unsure[2] + 0.05
    errors[2] -= max(0.0, more[2] - unsure[2]) + 1e-9
    names = ("w u du", "w u", "u du")
    judged = [
        dataclasses.replace(candidate(name, value), blocks=tuple(row))
        for name, value, row in zip(names, (5, 9, 6), errors.tolist(), strict=True)
    ]
    claims = candidate("u", -99.0)
    ordered = search.ordered([claims, *judged], Polynomial(2))
    assert ordered == (judged[2], judged[0], judged[1], claims)
    assert search.alike(ordered) == (judged[0],)


def test_of_laws_hardly_told_apart_the_one_nearest_to_the_others_is_chosen():
    best, plain, middle = (candidate(n, x) for n, x in (("w u", 0), ("w", 1), ("u", 2)))
    middle = dataclasses.replace(middle, criterion=1.9)
    far = {"w u": 3.0, "w": 2.0, "u": 1.0}

    def asked(near):
        assert [*near] == [best, plain, middle]  # the last is no candidate
        return [far[" ".join(trial.terms)] for trial in near]

    every = [best, plain, middle, candidate("du", 9.0)]
    assert search.ordered(every, Polynomial(2), asked)[0] == middle
    far["u"] = 2.0
    assert search.ordered(every, Polynomial(2), asked)[0] == plain  # of as near ones


def test_what_has_more_terms_and_less_evidence_than_another_does_not_contend():
    """However near to the others its runs are; but of as many terms all contend."""
    rows = {"w u": -6.0, "w u du": -7.5, "w": -10.0, "u": -4.0, "du u": -8.0}
    judged = [
        dataclasses.replace(candidate(n, x), blocks=(1.0, 1.0, 1.0), squares=1.0)
        for n, x in rows.items()
    ]
    contenders = [judged[i] for i in (2, 3, 4)]  # the last by just 2 less
    assert search.contenders(judged) == contenders

    def asked(near):
        assert sorted(near, key=str) == sorted(contenders, key=str)
        return [0.0 if trial is judged[4] else 1.0 for trial in near]

    ordered = search.ordered(judged, Polynomial(2), asked)
    assert ordered[0] == judged[4]
    assert len(search.alike(ordered)) == 4


def test_plainness_is_worth_a_tenth_of_the_error_on_all_samples():
    """A block that all laws miss makes the standard error large."""
    rows = {"w u du": [1.0, 1.0, 5.0], "w u": [1.1, 1.0, 4.97], "w": [1.3, 1.3, 4.7]}
    squares = {"w u du": 1.0, "w u": 1.2, "w": 1.3}
    best, near, far = (
        dataclasses.replace(candidate(n, 0), blocks=tuple(row), squares=squares[n])
        for n, row in rows.items()
    )
    assert best.unseen < near.unseen < far.unseen
    # By blocks alone the plainest would be hardly told from the best.
    unsure = np.std(np.subtract(far.blocks, best.blocks), ddof=1) / 3**0.5
    assert far.unseen - best.unseen < unsure
    ordered = search.ordered([best, near, far], Polynomial(2))
    assert ordered == (near, best, far)
    assert search.alike(ordered) == (best,)
    nothing = dataclasses.replace(candidate("", 0), blocks=(0.9, 0.9, 0.9))
    assert search.ordered([best, nothing], Polynomial(2))[0] == nothing


def test_no_law_is_near_that_misses_few_blocks_by_twice_the_least():
    """However unsure that is, and however much of all samples it follows."""
    rows = {"w u": [0.1, 0.5, 0.2], "w u du": [3.8, 0.1, 0.5], "w": [1.0, 0.3, 0.2]}
    squares = {"w u": 1.2, "w u du": 1.0, "w": 1.1}
    best, twice, near = judged = [
        dataclasses.replace(candidate(n, -s), blocks=tuple(row), squares=squares[n])
        for s, (n, row) in enumerate(rows.items())
    ]
    for other in (twice, near):
        unsure = np.std(np.subtract(other.blocks, best.blocks), ddof=1) / 3**0.5
        assert other.unseen < best.unseen + unsure
    assert near.unseen < 2 * best.unseen < twice.unseen
    assert search.contenders(judged) == [best, near]
    assert search.alike(search.ordered(judged, Polynomial(2))) == (best,)


def test_numbers_in_terms_make_a_law_less_plain_fitted_or_not():
    """Three neighbours on the grid hold three radii, as two that are fitted two."""
    two, three = "play(u,0.1) play(u,0.3)", "play(u,0.1) play(u,0.2) play(u,0.3)"
    radii = {f"play(u,{r}).radius": r for r in (0.1, 0.3)}
    fitted = dataclasses.replace(candidate(two, 0.0), numbers=radii)
    on_grid, library = candidate(three, -1.0), hj.library.Play([0.1, 0.2, 0.3])
    assert search.ordered([on_grid, fitted], library) == (fitted, on_grid)


def test_laws_off_the_grid_are_counted_by_the_kinds_of_their_terms():
    radii, base = [0.1, 0.2, 0.3], Polynomial(1, ("u", "du"))
    library = base + hj.library.Play(radii) + base.part([2]) * hj.library.Play(radii)
    kinds = [name.replace("0.2", "0.1").replace("0.3", "0.1") for name in library.names]
    counts = search.laws_off_grid(library)
    for size in range(len(library) + 1):
        every = {tuple(sorted(x)) for x in itertools.combinations(kinds, size)}
        assert counts[size] == len(every)


def test_that_there_is_no_law_has_to_follow_best_of_all():
    nothing, law = (
        dataclasses.replace(candidate(name, 0), blocks=row, squares=squares)
        for name, row, squares in (
            ("", (1.0, 1.0, 5.0), 2.0),  # more than a tenth is missed of all samples
            ("w u", (1.1, 1.0, 4.97), 1.0),
        )
    )
    assert search.ordered([law, nothing], Polynomial(2)) == (nothing, law)
    # Hardly told from the law's by one standard error, but no longer the least.
    worse = dataclasses.replace(nothing, blocks=(1.12, 1.05, 4.93))
    assert 0 < np.mean(np.subtract(worse.blocks, law.blocks)) < 0.02
    assert search.ordered([law, worse], Polynomial(2)) == (law, worse)
    assert search.alike((law, worse)) == ()


@pytest.mark.parametrize("blocks", [(), (1.0, 1.0)])
def test_of_as_many_terms_the_criterion_chooses(blocks):
    low, high, equal = (
        dataclasses.replace(candidate(name, x), blocks=blocks, squares=1.0)
        for name, x in (("u", 5.0), ("w*|du|", 4.0), ("w", 4.05))
    )
    assert search.ordered([low, high], Polynomial(2))[0] == high
    # Where terms are equal on the record so is it, but for what fits make of them.
    assert search.ordered([low, high, equal], Polynomial(2))[0] == equal
    # So it is of a law in other words, whatever chance makes of its start.
    hardly = {"equal": search.HARDLY}
    assert search.ordered([low, high], Polynomial(2), **hardly)[0] == low


def test_the_plainest_is_told_for_many_problems_at_once():
    laws = [(2, 4.0, 0), (1, 5.0, 0), (1, 2.0, 0), (1, 2.0, 1)]
    criteria = [[0, 1, 1.05, 1.02], [0, 1, 1.5, 1.2], [0, 1.05, np.inf, 1]]
    assert search.plainest(laws, np.array(criteria)).tolist() == [2, 1, 3]


def test_blocks_are_whole_cycles_or_recordings():
    t = np.linspace(0, 12, 1201)
    wave = hj.Recording(t, np.sin(2 * np.pi * t - 0.4), np.cos(t))
    (rows,) = blocks((wave,), np.ones((1, 1201), bool))
    starts = np.flatnonzero(np.diff(rows)) + 1
    assert rows[0] == -1 and rows[-1] == 5 and len(starts) == 6
    # Each begins where the input comes up through zero.
    np.testing.assert_allclose((t[starts] - 0.4 / (2 * np.pi)) % 1, 0, atol=0.0101)
    ramp = hj.Recording(t[:100], t[:100], t[:100])
    (rows,) = blocks((ramp,), np.ones((1, 100), bool))
    assert np.bincount(rows + 1).tolist() == [33, 33, 34]
    counts = np.arange(1201) < np.array([[1201], [100]])
    two = blocks((wave, ramp), counts)
    assert two.shape == (2, 1201) and set(two[1, 100:]) == {-1}
    assert set(two[0]) == {-1, 0, 1, 2} and set(two[1, :100]) == {-1, 3, 4}
    sizes = [2.0, 1.0, 3.0]
    three = [hj.Recording(t, a * np.sin(t), t) for a in sizes]
    several = blocks(three, np.ones((3, 1201), bool))
    assert [set(row) for row in several] == [{1}, {0}, {2}]


def test_what_ran_backwards_begins_with_the_last_output_beside_a_spring_too():
    """Whose own part of it is of the last input."""
    t = np.linspace(0, 2, 41)
    u, w = np.sin(2 * t) + 0.3 * t, 3 + np.cos(t)
    laid_out = layout((hj.Recording(t, u, w),), None, 1, True)
    force = hj.models.BoucWenForce(0.3, 2.0, 1.0, 0.5, 1.0)
    objective = _matching(force, laid_out.samples)
    found = laid_out.beyond(objective, refinement.first_unknowns(objective))
    np.testing.assert_allclose(found[-1, 0, -1], w[-1], rtol=1e-9)


def test_blocks_hold_as_many_samples_that_count():
    """Whichever do not, and whether the input has cycles."""
    t = np.linspace(0, 12, 1201)
    counts = np.ones((1, 1201), bool)
    counts[0, 300:800] = counts[0, 850:990] = False
    for u in (t, np.sin(20 * np.pi * t)):
        (rows,) = blocks([hj.Recording(t, u, t)], counts)
        np.testing.assert_array_equal(rows[~counts[0]], -1)
        sizes = np.bincount(rows[counts[0]] + 1)
        assert len(sizes) == 7 and np.ptp(sizes) <= 10
        assert np.all(np.diff(rows[counts[0]]) >= 0)
        none = blocks(2 * [hj.Recording(t, u, t)], counts * [[True], [False]])
        assert set(none[1]) == {-1} and set(none[0]) == {-1, 0, 1, 2}


def test_inputs_beyond_the_recorded_ones():
    t = np.linspace(0, 2, 41)
    biased, zero = 5 + np.sin(3 * t), np.sin(3 * t)
    records = [hj.Recording(t, u, t) for u in (biased, zero)]
    far = outside(refinement.samples(records, None, 1))
    u = np.concatenate([far.grid.start.u, far.grid.end.u[:, -1:]], axis=1)
    about = (np.max(biased) + np.min(biased)) / 2
    larger = [about + 1.5 * (biased - about), 1.5 * zero]
    same, back = [biased, zero], [biased[::-1], zero[::-1]]
    expected = [*larger, *same, *same, *back]
    np.testing.assert_allclose(u, expected, rtol=1e-12)
    lengths = np.sum(far.grid.steps, axis=1)
    expected = [2, 2, 2 / 3, 2 / 3, 4, 4, 2, 2]
    np.testing.assert_allclose(lengths, expected, rtol=1e-12)
    times = np.column_stack([far.grid.start.t, far.grid.end.t[:, -1]])
    np.testing.assert_allclose(np.diff(times), far.grid.steps, atol=1e-12)
    slopes = np.diff(u, axis=1) / far.grid.steps
    np.testing.assert_allclose(far.grid.middle.du, slopes, rtol=1e-9)
    np.testing.assert_allclose(np.diff(far.t, axis=1), far.grid.steps, rtol=1e-9)


def test_the_past_of_a_recording_is_larger_faster_and_slower_too():
    t = np.linspace(0, 2, 41)
    u = 5 + np.sin(3 * t)
    far = outside(refinement.samples([hj.Recording(t, u, t).window(10, 41)], None, 1))
    past = np.concatenate([far.past.start.u, far.past.end.u[:, -1:]], axis=1)[:, -11:]
    about = (np.max(u[10:]) + np.min(u[10:])) / 2
    before = u[:11]
    larger = about + 1.5 * (before - about)
    np.testing.assert_allclose(past, [larger, before, before, before], rtol=1e-12)
    lengths = np.sum(far.past.steps, axis=1)
    np.testing.assert_allclose(lengths, [0.5, 0.5 / 3, 1, 0.5], rtol=1e-12)


def test_outputs_beyond_are_in_the_order_of_the_samples():
    """Those of w' = 1.5 u' are the input's; and how far they get, where samples count,
    is over half of the range, backwards a fifth of it."""
    t = np.linspace(0, 2, 41)
    u, w = np.sin(2 * t) + 0.3 * t, 3 + np.cos(t)
    counted = np.where(t < 0.3, 0.0, 1.0)
    laid_out = layout((hj.Recording(t, u, w),), [counted], 1, True)
    law = SparseModel.from_terms({"du": 1.5})
    objective = _matching(law, laid_out.samples)
    unknowns = refinement.first_unknowns(objective)
    found = laid_out.beyond(objective, unknowns)
    change = 1.5 * (u - u[0])
    back = w[-1] + 1.5 * (u - u[-1])
    expected = [w[0] + 1.5 * change, w[0] + change, w[0] + change, back]
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-9)
    seen = w[counted > 0]
    middle, half = (np.max(seen) + np.min(seen)) / 2, np.ptp(seen) / 2
    for outputs in (found, found.at[-1].multiply(100.0)):
        far = np.max(np.abs(outputs[:, 0, counted > 0] - middle), axis=1) / half
        assert laid_out.from_middle(outputs) == pytest.approx(
            max(*far[:3], far[3] / 5), rel=1e-12
        )


@pytest.mark.parametrize("signs", [(0, 0, 0, 0), (0, 1, -1, -1), (-1, 1, 1, 1)])
def test_inclusion_is_that_of_brute_force(signs):
    rng = np.random.default_rng(5)
    matrix, truth = rng.normal(size=(40, 4)), np.array([0.4, 0.0, -0.3, 0.0])
    targets = matrix @ truth + rng.normal(size=(200, 40))
    each = [compress(jnp.asarray(matrix), jnp.asarray(y)) for y in targets]
    problems = eqx.tree_at(
        lambda p: (p.target, p.remainder),
        each[0],
        (jnp.stack([p.target for p in each]), jnp.stack([p.remainder for p in each])),
    )
    sizes = [search.supports(4, size) for size in (1, 2, 3)]
    counts, without = np.zeros(4), 0
    for y in targets:

        def criterion(rows, y=y):
            part, wanted = matrix[:, list(rows)], np.take(signs, rows)
            values = np.linalg.lstsq(part, y)[0]
            if np.any(values * wanted < 0):
                return np.inf
            left = y - part @ values
            s = len(rows)
            choices = 2 * np.log(math.comb(4, s))
            return 25 * np.log(np.mean(left**2)) + (s + 1) * np.log(25) + choices

        every = [tuple(row) for size in sizes for row in size.tolist()]
        least = min(map(criterion, every))
        if not np.isfinite(least):
            without += 1
            continue
        near = [rows for rows in every if criterion(rows) < least + 2]
        fewest = min(map(len, near))
        near = [rows for rows in near if len(rows) == fewest]
        equal = min(map(criterion, near)) + 0.1
        near = [rows for rows in near if criterion(rows) <= equal]
        # All are linear, and the second term is of lower degree than the others.
        keys = {rows: (1 not in rows, criterion(rows)) for rows in near}
        counts[list(min(near, key=keys.__getitem__))] += 1
    assert (min(counts) > 0 and max(counts) < 200) if not any(signs) else max(counts)
    assert (without > 0) == (signs[0] < 0)
    library = Library(tuple(map(Term.parse, ("w", "1", "u", "du"))))
    found = _shares(problems, library, sizes, 25.0, 1, np.array(signs, float))
    np.testing.assert_allclose(found, counts / 200)


# -------------------------------------------------------------------------- discover

TRUTH = {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25}
TIMES = np.linspace(0, 20 * np.pi, 1000)
SHORT = TIMES[:300]  # three periods, of which a search takes a third of the time


def duhem(noise, seed):
    """Experiment 4's record, from the closed form of the law on each branch of u."""
    w = np.asarray(hj.simulate(law(), recording(np.zeros_like(TIMES)), w0=0.0).w)
    error = np.random.default_rng(seed).normal(size=len(TIMES))
    return recording(w + noise * np.std(w) * error)


def law():
    return hj.models.Duhem(0.4, 0.5, 0.25)


def recording(w):
    times = TIMES[: len(w)]
    return hj.Recording(times, np.sin(times), w).with_input(jnp.sin)


def over(library, terms):
    """A law over a library: one program for all of them."""
    coefficients = [terms.get(name, 0.0) for name in library.names]
    support = np.array([name in terms for name in library.names])
    return SparseModel(library, jnp.array(coefficients), support)


@eqx.filter_jit
def whole_run(coefficients, record, w0):
    law = SparseModel(Polynomial(2), coefficients, np.ones(21, bool))
    return hj.simulate(law, record, w0=w0, method=hj.simulation.FixedStep(2)).w


def free_run(terms, record, w0):
    return whole_run(over(Polynomial(2), terms).coefficients, record, jnp.asarray(w0))


@pytest.fixture(scope="module")
def tenth():
    """A record with noise of a tenth, and what `discover` makes of it."""
    record = duhem(0.1, 5)
    return record, hj.discover(record, Polynomial(2))


@pytest.fixture
def found(request, tenth):
    """What is found in a record with noise of such a share."""
    if request.param == 0.1:
        return tenth[1]
    return hj.discover(duhem(request.param, 5), Polynomial(2))


@pytest.mark.parametrize(
    "found",
    [pytest.param(0.05, marks=THOROUGH), 0.1, pytest.param(0.2, marks=SLOW)],
    indirect=True,
)
def test_the_right_terms_are_found_under_noise(found):
    solution = found
    assert solution.value.terms().keys() == TRUTH.keys()
    for name, value in solution.value.terms().items():
        error = float(solution.stats["standard_errors"][name])
        assert abs(value - TRUTH[name]) < 4 * error
    found, frontier = solution.stats["candidates"], solution.stats["frontier"]
    assert found[0].terms.keys() == TRUTH.keys() and found[0].kept < 1e-6
    assert [c.criterion for c in found[1:]] == sorted(c.criterion for c in found[1:])
    assert solution.stats["weights"] is None
    # The right law leaves the noise, which the record tells without any law.
    assert solution.stats["noise_floor"] == pytest.approx(found[0].rmse, rel=0.1)
    assert {3, 4} <= set(frontier) <= {1, 2, 3, 4}
    assert all(len(candidate.terms) == size for size, candidate in frontier.items())
    for size, best in frontier.items():
        rivals = [each.rmse for each in found if len(each.terms) == size]
        assert best.rmse == min(rivals)

    def criterion(candidate, n):
        size = len(candidate.terms)
        choices = 2 * math.log(math.comb(18, size))  # as many terms differ here
        return 2 * n * math.log(candidate.rmse) + (size + 1) * math.log(n) + choices

    # The residuals are white: worth as many samples as there are.
    for candidate in found:
        assert candidate.criterion == pytest.approx(
            criterion(candidate, 1000), rel=1e-12
        )
    assert solution.stats["alike"] == search.alike(found)
    assert {"du^2", "|w|^2"} <= {alias.term for alias in solution.stats["aliases"]}


@pytest.mark.slow
def test_white_noise_that_fails_a_test_of_whiteness_is_noise():
    """As one record in a hundred does by chance: free runs on blocks have the right law
    and one of four terms equal."""
    record, clean = duhem(0.1, 294), duhem(0.0, 294)
    noise = np.asarray(record.w - clean.w)
    correlation = np.correlate(noise, noise, "full")[len(noise) - 1 :]
    n, lags = len(noise), np.arange(1, 41)
    squares = (correlation[lags] / correlation[0]) ** 2 / (n - lags)
    assert chi2.sf(n * (n + 2) * np.sum(squares), 40) < 0.01
    solution = hj.discover(record, Polynomial(2))
    assert solution.value.terms().keys() == TRUTH.keys()
    assert "looks like white noise" in solution.stats["why"]


def worth(residuals):
    """Geyer's (1992) number of independent samples, by NumPy."""
    n = len(residuals)
    products = np.correlate(residuals, residuals, "full")[n - 1 :]
    pairs = (products / products[0]).reshape(-1, 2).sum(axis=1)
    first = np.flatnonzero(pairs <= 0)[0]
    return n / (2 * np.sum(pairs[:first]) - 1)


@SLOW
@pytest.mark.parametrize("seed", [0, pytest.param(2, marks=THOROUGH)])
def test_under_coloured_noise_few_samples_are_independent(seed):
    """Those that the best law's residuals are worth: of all 1000, more terms would be
    chosen, to follow the noise."""
    record = duhem(0.0, 0)
    noise = np.random.default_rng(seed).normal(size=1200)
    noise = lfilter([1.0], [1.0, -0.9], noise)[200:]
    noise *= 0.1 * np.std(record.w) / np.std(noise)
    record = recording(record.w + noise)
    solution = hj.discover(record, Polynomial(2))
    assert solution.value.terms().keys() == TRUTH.keys()
    found = solution.stats["candidates"]
    best = min(found, key=lambda each: each.rmse)
    run = free_run(best.terms, record, best.starts[0])
    assert best.rmse == pytest.approx(float(hj.metrics.rmse(record.w, run)), rel=1e-9)
    independent = worth(np.asarray(run - record.w))
    assert independent < 100

    def criterion(candidate, samples):
        size, squares = len(candidate.terms), candidate.rmse**2
        penalty = (size + 1) * math.log(samples) + 2 * math.log(math.comb(18, size))
        return samples * math.log(squares) + penalty

    for each in found:
        expected = criterion(each, independent)
        assert each.criterion == pytest.approx(expected, abs=0.05)
    counted = [
        dataclasses.replace(c, criterion=criterion(c, 1000), blocks=()) for c in found
    ]
    assert len(search.ordered(counted, Polynomial(2))[0].terms) > len(TRUTH)


def test_terms_of_high_degree_are_no_centres_among_those_of_low_degree(monkeypatch):
    """Larger laws are looked for from the low degrees on again, when laws of all
    degrees were tried before."""
    library = Polynomial(3, ("w", "du"))
    record = recording(np.sin(TIMES - 0.3))
    laid_out = layout((record,), None, 1, False)
    setting = _setting.Setting((record,), laid_out, library, 4, 2, 0.0)
    high = search.Trial({"du": 1.0, "w^2*du": 1.0}, squares=1.0)
    low = search.Trial({"du": 1.0, "w": -1.0}, squares=2.0)
    centres: list[Any] = []
    nothing: Any = None

    def untouched(_, tried, guesses):
        return tried | {guess.support: guess for guess in guesses}

    def unlinearised(_, among, centre):
        return _explore.Close(centre, library.names, among, nothing)

    def nearby(_, close):
        centres.append((len(close.among), close.law))
        return iter(())

    monkeypatch.setattr("hystjax.discovery._explore.with_guesses", untouched)
    monkeypatch.setattr("hystjax.discovery._explore.close_to", unlinearised)
    monkeypatch.setattr("hystjax.discovery._explore.nearby", nearby)
    first = (low,), (search.Trial({"w": -1.0}, squares=3.0),)
    stages = map(_explore.Stage, _explore.nested(library), [(first[0],), (first[1],)])
    explore(setting, tuple(stages), math.inf, False, (high,))
    sizes = [len(rows) for rows in _explore.nested(library)]
    assert (sizes[0], low) in centres and (sizes[1], high) in centres
    assert (sizes[0], high) not in centres


def test_terms_that_others_make_up_nearly_are_tried_where_noise_is_left():
    """A column that those before it make up, or but for 1e-8, is tried if it is of the
    output and not equal to another; of the input alone it is not."""
    library, rng = Polynomial(2), np.random.default_rng(0)
    columns = dict(
        zip(library.names, rng.normal(size=(len(library), 100)), strict=True)
    )
    columns["w*u"] = np.zeros(100)
    for name in ("w*|w|", "u*|w|", "du^2"):
        before = np.stack([*columns.values()][: library.names.index(name)])
        mix = rng.normal(size=len(before)) @ before
        columns[name] = mix + 1e-8 * np.linalg.norm(mix) * rng.normal(size=100)
    columns["|du|*|w|"] = columns["w*|du|"] - columns["w*du"] + columns["du*|w|"]
    columns["|w|^2"] = -2 * columns["w^2"]
    problem = compress(jnp.stack([*columns.values()], 1), jnp.zeros(100))
    kept = np.flatnonzero(np.asarray(told_apart(problem)))
    more = np.setdiff1d(_of_output_and_unlike(problem, library), kept)
    assert [library.names[row] for row in more] == ["w*|w|", "u*|w|", "|du|*|w|"]


def duhem_searched():
    """A record, laid out as `discover` does it, for its compiled programs."""
    record = duhem(0.05, 0)
    problem = factor((record,), Polynomial(2), weak_form((record,)))
    library = Polynomial(2).part(np.flatnonzero(told_apart(problem)).tolist())
    laid_out = layout((record,), None, 2, True)
    setting = _setting.Setting((record,), laid_out, library, 4, 6, 0.1, 3.0)
    return record, setting


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_noise_on_the_input_is_no_turning_point(noise):
    """A sine of ten periods turns twice in each; a test function is as wide as four
    fifths of the way from one turn to the next, and a thinned record keeps 20 samples
    of it. An input at rest does not turn."""
    u = np.sin(TIMES) + noise * np.random.default_rng(0).normal(size=len(TIMES))
    record = hj.Recording(TIMES, u, np.cos(TIMES))
    rest = hj.Recording(TIMES, np.zeros_like(u), np.cos(TIMES))
    between = len(TIMES) / (20 + 1)
    assert weak_form((rest, record)).half_width == round(0.8 * between / 2)
    weight = jnp.arange(len(u), dtype=float)
    thin, left = _hidden._thinned(record, weight)
    np.testing.assert_array_equal(thin.u, u[:: int(between / 20)])
    np.testing.assert_array_equal(left, weight[:: int(between / 20)])


def test_random_laws_see_samples_that_have_a_weight_alone(monkeypatch):
    record = duhem(0.05, 0)
    group, weights = (record, record.window(0, 500)), [np.ones(1000), np.zeros(500)]
    laid_out = layout(group, weights, 2, False)
    setting = _setting.Setting(group, laid_out, Polynomial(1), 1, 1, 0.0)
    problem = factor(group, setting.library, weak_form(group))

    class Held(Exception):
        """Laws are held against a layout."""

    def held(setting, guesses, effort):
        raise Held(setting.layout.samples)

    monkeypatch.setattr(_hidden, "refined", held)
    draws = _hidden.Draws(1.0, 1, jax.random.key(0))
    with pytest.raises(Held) as error:
        _hidden.random(setting, problem, draws, math.inf, progress=False)
    (samples,) = error.value.args
    stride = 1000 // 21 // 20
    assert samples.weight[0].tolist() == [1.0] * len(record.t[::stride])
    assert not np.any(samples.weight[1])


@pytest.mark.slow
def test_laws_that_take_long_go_on_and_those_far_behind_do_not(monkeypatch):
    record, setting = duhem_searched()
    library = setting.library
    far = {"du": 2.0, "w*|du|": -4.0, "u*|du|": -3.0}
    turns, refined = [], _explore.refined

    def watched(setting, guesses, effort):
        turns.append([guess.support for guess in guesses])
        return refined(setting, guesses, effort)

    monkeypatch.setattr(_explore, "refined", watched)
    guesses = [search.Trial(terms) for terms in (far, {"du": 0.3}, {"w": -0.1})]
    tried = _explore.with_guesses(setting, {}, guesses)
    assert tried.keys() == set(turns[0]) and turns[1:3] == 2 * [[tuple(far)]]
    assert tried["w",].squares > 4 * tried["du",].squares
    whole = hj.refine(over(library, far), record, fading=0.1)
    assert whole.stats["num_steps"] > 16
    squares = 1000 * float(whole.stats["rmse"][0]) ** 2
    assert tried[tuple(far)].squares == pytest.approx(squares, rel=1e-9)


def test_guesses_near_a_law_begin_as_it_does_and_promise_what_they_leave():
    _, setting = duhem_searched()
    library = setting.library
    guess = search.Trial({"du": 0.3, "w*|du|": -0.4, "u*|du|": 0.4})
    ((centre, _),) = _explore.refined(setting, [guess], _explore.ENOUGH)
    close = _explore.close_to(setting, np.arange(len(library)), centre)
    *others, near = _explore.nearby(setting, close)
    # One more, and then all sizes near its own.
    assert [len(next(iter(each)).terms) for each in others] == [4, 2, 3]
    firsts = [*itertools.islice(near, 3)]
    ends = {
        each.support: each
        for each, _ in _explore.refined(setting, firsts, _explore.ENOUGH)
    }
    assert len(ends) == 3
    for first in firsts:
        assert len(first.terms) == 4 and first.starts == centre.starts
        assert first.squares == pytest.approx(ends[first.support].squares, rel=1e-3)


def test_laws_are_refined_without_the_blocks_that_judge_them():
    """Against fits with weights of zero there, and their free runs; and against free
    runs under the input 1.5 times as large, three times and half as fast, and
    backwards."""
    record, setting = duhem_searched()
    library, laid_out = setting.library, setting.layout
    guess = search.Trial({"du": 0.3, "w*|du|": -0.4, "u*|du|": 0.4})
    ((trial, _),) = _explore.refined(setting, [guess], _explore.ENOUGH)
    (judged,) = _explore.left_out(setting, [trial])
    (rows,) = laid_out.blocks
    for block in (0, 3):
        out = rows == block
        known = np.asarray(record.w).copy()
        if out[0]:  # what a free run begins with, as well as all samples tell it
            out[0], known[0] = False, trial.starts[0]
        seen = eqx.tree_at(lambda r: r.w, record, jnp.asarray(known))
        fit = hj.refine(over(library, trial.terms), seen, weights=[1.0 - out])
        run = free_run(fit.value.terms(), record, fit.stats["w0"][0])
        error = np.sqrt(np.mean((np.asarray(run - record.w)[out]) ** 2))
        assert judged.blocks[block] == pytest.approx(error, rel=1e-6)
    middle = (np.max(record.w) + np.min(record.w)) / 2
    furthest = 0.0
    end = TIMES[0] + TIMES[-1]
    first, last = trial.starts[0], float(record.w[-1])
    for function, r, start, allowed in (
        (lambda t: 1.5 * jnp.sin(t), 1, first, 1),
        (lambda t: jnp.sin(3 * t), 3, first, 1),
        (lambda t: jnp.sin(t / 2), 1 / 2, first, 1),
        (lambda t: jnp.sin(end - t), 1, last, 5),
    ):
        times = TIMES / r
        other = hj.Recording(times, np.asarray(function(times)), record.w)
        run = free_run(trial.terms, other.with_input(function), start)
        furthest = max(furthest, np.max(np.abs(run - middle)) / allowed)
    expected = furthest / (np.ptp(record.w) / 2)
    assert trial.beyond == pytest.approx(expected, rel=1e-6)


def test_errors_of_laws_are_those_of_samples_that_count():
    record, setting = duhem_searched()
    rows = np.arange(len(TIMES))
    weights = np.where(rows % 5 == 0, 0.0, 1 + rows % 3)
    setting = setting._replace(layout=layout((record,), [weights], 2, True))
    guess = search.Trial({"du": 0.3, "w*|du|": -0.4, "u*|du|": 0.4})
    ((trial, _),) = _explore.refined(setting, [guess], _explore.ENOUGH)
    error = np.asarray(free_run(trial.terms, record, trial.starts[0]) - record.w)
    counts = weights > 0
    assert trial.rmse == pytest.approx(np.sqrt(np.mean(error[counts] ** 2)), rel=1e-6)
    weights = weights / np.mean(weights[counts])
    assert trial.squares == pytest.approx(np.sum(weights * error**2), rel=1e-6)
    # On a block by the weights too.
    (judged,) = _explore.left_out(setting, [trial])
    out = np.asarray(setting.layout.blocks[0]) == 3
    law = over(setting.library, trial.terms)
    fit = hj.refine(law, record, weights=[weights * ~out])
    run = free_run(fit.value.terms(), record, fit.stats["w0"][0])
    error = np.asarray(run - record.w)
    mean = np.average(error[out] ** 2, weights=weights[out])
    assert judged.blocks[3] == pytest.approx(np.sqrt(mean), rel=1e-6)


def test_criteria_are_by_all_that_is_fitted_to_samples_that_count():
    """Of a law its terms, numbers in these and where it starts, chosen out of all; of a
    constant output its mean. Variances are those by the weights."""
    record, n = duhem(0.05, 0), len(TIMES)
    weights = np.where(np.arange(n) < 100, 0.0, 1 + np.arange(n) % 3)
    laid_out = layout((record,), [weights], 2, False)
    setting = _setting.Setting((record,), laid_out, Polynomial(2), 4, 6, 0.1)
    tried = (
        search.Trial({"du": 1.0}, squares=2.0, independent=0.5),
        search.Trial({"du": 1.0, "w": 1.0}, squares=3.0, numbers={"radius": 1.0}),
    )
    w = np.asarray(record.w)
    apart = (w - np.average(w, weights=weights)) ** 2
    left = np.average(apart, weights=weights)
    scored, k = n - 100, len(setting.library)
    worth = scored / 2  # as much as the residuals of the law that follows best
    expected = [
        worth * np.log(2.0 / scored) + 2 * np.log(worth) + 2 * np.log(k),
        worth * np.log(3.0 / scored) + 4 * np.log(worth) + 2 * np.log(k * (k - 1) / 2),
        worth * np.log(left) + np.log(worth),
    ]
    judged = _by_evidence(setting, tried)
    assert [each.criterion for each in judged] == pytest.approx(expected, rel=1e-9)


def test_laws_that_run_away_are_refused():
    setting = _setting.Setting(
        (), layout((duhem(0.0, 0),), None, 2, True), Polynomial(2), 4, 6, 0.1, 3.0
    )
    tame = search.Trial({"du": 1.0}, kept=1.0, squares=1.0, beyond=2.9)
    assert _explore.admitted(setting, tame)
    wild = dataclasses.replace(tame, beyond=3.1)
    assert not _explore.admitted(setting, wild)
    assert _explore.admitted(setting._replace(reach=math.inf), wild)


@pytest.mark.slow
def test_a_recording_without_any_weight_is_left_out():
    records = [duhem(noise, 0) for noise in (0.1, 5.0)]
    counts = [x * np.ones(len(records[0])) for x in (1.0, 0.0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = hj.discover(
            records, hj.library.Duhem(), weights=counts, rate_independent=True
        )
    for name, x in TRUTH.items():
        error = found.stats["standard_errors"][name]
        assert abs(found.value.terms()[name] - x) < 4 * error
    # Its noise is none that the law would leave, nor one that would choose other terms.
    left = float(found.stats["rmse"][0])
    assert found.stats["noise_floor"] == pytest.approx(left, rel=0.15)
    shares = hj.inclusion(found, records, key=jax.random.key(0), samples=20)
    assert all(shares[name] > 0.9 for name in TRUTH)


def test_what_has_no_weight_tells_no_terms_apart():
    """Of a sine, u'^2 = 1 - u^2; of a recording beside it that is left out, not; nor of
    a stretch of it. But dropouts everywhere leave nothing else to look at."""
    sine, n = duhem(0.0, 0), len(TIMES)
    u = np.where(TIMES < 40, np.sin(TIMES), np.sin(2.2 * TIMES))
    broken = [hj.Recording(TIMES, x, sine.w) for x in (u, u * TIMES)]
    library, weak = Polynomial(2, ("u", "du")), hj.formulation.WeakForm(20)
    expected = [each.term for each in hj.aliases(sine, library, formulation=weak)]
    assert expected == ["du^2"]

    def alike(records, weights):
        group, given = tuple(records), [jnp.asarray(x, float) for x in weights]
        found = _regression(group, library, weak, search.itself, None, given, "rate")
        return [x.term for x in hj.regression.aliases(found[0], library.names)]

    assert alike([sine, broken[1]], [np.full(n, 0.3), np.zeros(n)]) == expected
    assert alike([sine, broken[1]], [np.ones(n), np.ones(n)]) == []
    assert alike(broken[:1], [TIMES < 40]) == expected
    assert alike(broken[:1], [TIMES > 0]) == []
    assert alike(broken[:1], [np.arange(n) % 30 > 0]) == []


@SLOW
def test_what_is_known_of_a_device_narrows_the_candidates(tenth):
    record, _ = tenth
    library = Polynomial(2)
    found = hj.discover(record, library, rate_independent=True, odd=True, largest=3)
    assert found.value.terms().keys() == TRUTH.keys()
    tried = {name for trial in found.stats["candidates"] for name in trial.terms}
    assert tried <= {"du", "w*|du|", "u*|du|", "du*|w|", "du*|u|"}
    with pytest.raises(hj.InputError, match="no term of `library` is left"):
        hj.discover(record, Library((Term.parse("u*w"),)), odd=True)


def test_first_outputs_are_fitted_where_the_samples_tell_them():
    """Of a law its state, whatever the weight; of an oscillator the position, which
    counts where it was seen; of a butterfly the numbers say how it starts."""
    records, n = (duhem(0.0, 0),) * 2, len(TIMES)
    counts = [np.ones(n), np.where(np.arange(n) < 5, 0.0, 1.0)]
    setting = _setting.Setting(
        records, layout(records, counts, 1, False), Polynomial(1), 2, 2, 0.0
    )
    assert setting.others() == 2
    hidden = setting._replace(around=lambda law: hj.models.Oscillator(1, 0.1, 2, law))
    assert hidden.others() == len(hidden.own()) + 1 == 4
    objective = _matching(
        hidden.around(over(Polynomial(1), {})), setting.layout.samples
    )
    unknowns = refinement.first_unknowns(objective)
    moved = eqx.tree_at(lambda x: x.first, unknowns, unknowns.first + 0.1)
    before, after = (objective.run(each).outputs[:, 0] for each in (unknowns, moved))
    np.testing.assert_allclose(after - before, [0.1, 0.1], atol=1e-12)
    from_its_own = lambda law: hj.models.Butterfly(law, -1.0, 0.3)  # noqa: E731
    assert setting._replace(around=from_its_own).others() == 2


def test_operators_are_odd_and_of_value_where_no_rate_is_in_them():
    library = hj.library.Play([0.1, 0.3]) + Library((Term.parse("du"),))
    plays, record = library.names[:-1], duhem(0.0, 0)
    odd = _setting.symmetric(library, (record,), False, True)
    assert odd.names == library.names
    alike = _setting.symmetric(library, (record,), True, False, "value")
    assert alike.names == plays


def test_terms_are_odd_by_all_recordings_whichever_comes_first():
    knee = {"knee": lambda w, u, du: jnp.maximum(u - 0.6, 0) * du}
    library = hj.library.Custom(knee) + Library((Term.parse("du"),))
    small, large = (
        hj.Recording(TIMES, size * np.sin(TIMES), size * np.sin(TIMES - 0.3))
        for size in (0.5, 1.0)
    )
    for group in ((small, large), (large, small)):
        odd = _setting.symmetric(library, group, False, True)
        assert odd.names == ("du",)


def test_what_cannot_be_searched_is_refused_before_it_is(tenth):
    record, _ = tenth
    with pytest.raises(hj.InputError, match="positive weight needs at least 9"):
        hj.discover(record, Polynomial(2), weights=[np.zeros(len(record))])
    logarithm = hj.library.Custom({"lg": lambda w, u, du: jnp.log(u)})
    with pytest.raises(hj.InputError, match="`library` holds lg, NaN or inf"):
        hj.discover(record, Polynomial(1) + logarithm)


def test_recordings_are_weighed_by_their_range_or_noise():
    rng = np.random.default_rng(0)
    t = np.linspace(0, 20, 4001)
    large, small = np.sin(t), 0.1 * np.sin(t)
    noisy = [
        hj.Recording(t, large, x + s * rng.normal(size=len(t)))
        for x, s in ((large, 0.05), (small, 0.002))
    ]
    by_range = refinement.weights_of(noisy, "range")
    for each, weight in zip(noisy, by_range, strict=True):
        np.testing.assert_allclose(weight, np.ptp(each.w) ** -2.0)
    by_noise = refinement.weights_of(noisy, "noise")
    for sigma, weight in zip((0.05, 0.002), by_noise, strict=True):
        np.testing.assert_allclose(weight, sigma**-2.0, rtol=0.1)
    still = [hj.Recording(t, large, np.full_like(t, 2.0))]
    with pytest.raises(hj.InputError, match="its range is zero"):
        refinement.weights_of(still, "range")


@SLOW
def test_true_terms_are_sure_and_others_are_not(tenth):
    record, solution = tenth
    options = {"key": jax.random.key(1), "largest": 3, "samples": 50}
    shares = hj.inclusion(solution, record, **options)
    assert list(shares.values()) == sorted(shares.values(), reverse=True)
    assert set(list(shares)[:3]) == TRUTH.keys()
    assert min(shares[name] for name in TRUTH) > 0.95
    assert max(share for name, share in shares.items() if name not in TRUTH) < 0.05
    assert hj.inclusion(solution, record, **options) == shares
    with pytest.raises(hj.InputError, match="`block` must lie between 1 and 1000"):
        hj.inclusion(solution, record, key=jax.random.key(1), block=0)
    with pytest.raises(hj.InputError, match="not the recordings that the model"):
        hj.inclusion(solution, record.window(0, 500), key=jax.random.key(1))


class Enough(Exception):
    """What a test wanted to see was seen."""


def found_of(law, fit, weights=None):
    """What `discover` would return, without a search."""
    rest = dict.fromkeys(("candidates", "alike", "aliases"), ())
    rest |= {"apart": 0.0, "marked": False, "noise_floor": 0.0, "why": ""}
    known = {"weights": weights, **rest}
    return Discovered(law, fit.result, **known, frontier={}, refined=fit).solution()


def test_noise_is_drawn_again_as_large_as_weights_say(monkeypatch):
    """Of a sample with a hundredth of the weight ten times as large, about the law's
    free run; by the standard deviation over draws, in recordings of any length."""
    whole, rng = duhem(0.0, 0), np.random.default_rng(6)
    clean = [whole.window(0, 400), whole.window(400, 700)]
    weights = [10.0 ** rng.uniform(-2, 2, len(r)) for r in clean]
    noise = [0.01 * rng.normal(size=len(w)) / w**0.5 for w in weights]
    pairs = zip(clean, noise, strict=True)
    group = [eqx.tree_at(lambda r: r.w, r, r.w + error) for r, error in pairs]
    residuals = np.stack([np.pad(-error, (0, 400 - len(error))) for error in noise])
    starts = jnp.array([r.w[0] for r in clean])
    law = SparseModel.from_terms(TRUTH)
    seen = []

    def watched(*arguments):
        seen.append(arguments)
        raise Enough

    monkeypatch.setattr(search, "output_error", watched)
    fit = fit_of(law, recordings=2, residuals=jnp.asarray(residuals), w0=starts)
    found = found_of(law, fit, weights)
    with pytest.raises(Enough):
        hj.inclusion(found, group, key=jax.random.key(2), samples=1000)
    recorded, *drawn = np.asarray(seen[-1][4])
    for i, record in enumerate(group):
        np.testing.assert_array_equal(recorded[i, : len(record)], record.w)
    drawn = np.stack(drawn)
    assert drawn.shape == (1000, 2, 400) and not np.any(drawn[:, 1, 300:])
    for i, (record, weight) in enumerate(zip(clean, weights, strict=True)):
        n, root = len(record), np.sqrt(weight)
        free_run = np.asarray(record.w)
        spread = np.std(root * noise[i]) / root
        off = (drawn[:, i, :n] - free_run) / spread
        assert np.max(np.abs(np.mean(off, axis=0))) < 5 / 1000**0.5
        np.testing.assert_allclose(np.std(off, axis=0), 1, rtol=0.15)
        np.testing.assert_allclose(np.mean(np.std(off, axis=0)), 1, rtol=0.01)


@pytest.mark.parametrize("rows, sizes", [(2, [2]), (4, [4]), (5, [4, 5]), (9, [4, 6])])
def test_laws_are_of_as_many_terms_as_are_asked_for_and_left(monkeypatch, rows, sizes):
    """Among the terms that are tried second too, which may be more than the first."""
    seen: list[int] = []
    library, nothing = Polynomial(2), SimpleNamespace(columns=lambda rows: None)
    task: Any = _discover._Task(
        library,
        nothing,
        np.arange(2),
        np.arange(9),
        np.arange(0),
        None,
        (),
        1.0,
        1.0,
        False,
    )
    setting: Any = _setting.Setting((), None, library, 6, 6, 0.0)
    monkeypatch.setattr(
        _discover, "_explored", lambda _, each, *__: seen.append(each.largest) or ()
    )
    monkeypatch.setattr(_discover, "wants_more", lambda *_: True)
    last, _ = _discover._searched(task, setting, np.arange(rows))
    assert seen == sizes and last.largest == sizes[-1]


def test_nothing_is_warned_of_laws_that_are_only_tried(monkeypatch):
    _, setting = duhem_searched()

    def astray(law, *_, **__):
        checks.warn("the steps are too long")
        return fit_of(law).solution()

    monkeypatch.setattr("hystjax.discovery._choosing.refine", astray)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _to_the_end(setting, search.Trial({"du": 0.3, "w*|du|": -0.4}))
    with pytest.warns(UserWarning, match="the steps are too long"):
        astray(over(setting.library, {"du": 0.3}))


@SLOW
def test_laws_of_more_than_four_terms_are_chosen_again_too():
    """Without noise to speak of each time with all of their terms."""
    terms = {"w": -0.3, "u": 0.5, **TRUTH}
    own = SparseModel.from_terms(terms).library
    law = over(hj.library.Custom({"same": lambda w, u, du: u}) + own, terms)
    u = np.sin(TIMES) + np.sin(0.37 * TIMES)
    record = hj.Recording(TIMES, u, 0 * u)
    w = np.asarray(hj.simulate(law, record, w0=0.0).w)
    noise = 1e-5 * np.random.default_rng(6).normal(size=len(TIMES))
    residuals, start = jnp.asarray(-noise)[None], jnp.asarray(w[:1])
    fit = fit_of(law, tuple(terms), residuals=residuals, w0=start)
    found = found_of(law, fit)
    arguments = found, hj.Recording(TIMES, u, w + noise)
    shares = hj.inclusion(*arguments, key=jax.random.key(0), samples=20)
    # A candidate before it is equal to a term of the law, which is one all the same.
    assert shares.pop("u") + shares.pop("same") == 1
    assert shares == dict.fromkeys(terms.keys() - {"u"}, 1.0)
    with pytest.raises(hj.InputError, match=r"at least 5, .* got 4"):
        hj.inclusion(*arguments, key=jax.random.key(0), largest=4)


def test_noise_is_drawn_again_where_samples_have_weight():
    record, rng = duhem(0.0, 0).window(0, 300), np.random.default_rng(6)
    root = np.where(np.arange(300) % 7 == 0, 0.0, 2.0)
    residuals = np.where(root > 0, 0.01 * rng.normal(size=300), 0.0)
    rows = [np.flatnonzero(root)]
    arguments = (jnp.asarray(residuals)[None], jnp.asarray(root)[None], rows, [1])
    drawn = _drawn((record,), *arguments, jax.random.key(0), 4)
    off = np.asarray(drawn[:, 0] - record.w - residuals)
    assert not np.any(off[:, root == 0])
    left = -residuals[rows[0]] + np.mean(residuals[rows[0]])
    assert np.all(np.isin(np.round(off[:, rows[0]], 12), np.round(left, 12)))


@THOROUGH
@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2])
def test_the_right_terms_are_found_nearly_always(noise):
    supports = [
        hj.discover(duhem(noise, seed), Polynomial(2), throw=False).value.terms().keys()
        for seed in range(30)
    ]
    assert sum(support == TRUTH.keys() for support in supports) >= 29


@pytest.fixture(scope="module")
def growing():
    """A record, the output without its noise of 10 % of each sample, and the law."""
    w = np.asarray(hj.simulate(law(), recording(np.zeros_like(TIMES)), w0=0.0).w)
    drawn = np.random.default_rng(4).normal(size=len(TIMES))
    record = recording(w * (1 + 0.1 * drawn))
    return record, w, hj.discover(record, Polynomial(2))


@pytest.mark.slow
def test_noise_that_grows_with_the_output_is_weighed(growing):
    """As near to the truth as the Cramer-Rao bound of that noise allows, of which even
    weights stay away."""
    record, w, solution = growing
    assert solution.value.terms().keys() == TRUTH.keys()
    even = hj.refine(solution.value, record).stats["standard_errors"]
    for name, value in solution.value.terms().items():
        error = float(solution.stats["standard_errors"][name])
        assert abs(value - TRUTH[name]) < 4 * error < 4 * float(even[name])
    (weights,) = solution.stats["weights"]
    assert spearmanr(np.abs(w), weights).statistic < -0.99
    shares = hj.inclusion(solution, record, key=jax.random.key(1), samples=50)
    assert set(list(shares)[:3]) == TRUTH.keys()
    low, high = re.findall(
        r"by the weights from (\S+) to (\S+)",
        refinement.statements(solution)[0],
    )[0]
    assert float(low) < float(high) == pytest.approx(0.1 * np.max(np.abs(w)), rel=0.1)


@pytest.mark.slow
def test_errors_of_weighed_laws_are_those_of_plain_free_runs(growing):
    """Whatever they were fitted with: from the first output that the weighed squares
    like best, all samples count the same in the error that is told."""
    record, _, solution = growing
    w = np.asarray(record.w)
    (weights,) = map(np.asarray, solution.stats["weights"])

    def mean_squares(w0, terms):
        squares = np.asarray(free_run(terms, record, w0) - record.w) ** 2
        return np.mean(weights * squares), np.mean(squares)

    def weighed_only(*arguments):
        return mean_squares(*arguments)[0]

    chosen = solution.stats["candidates"][0]
    near = w[0] + 0.2 * np.ptp(w) * np.array([-1, 1])
    for trial in (chosen, *solution.stats["frontier"].values()):
        terms = (trial.terms,)
        w0 = minimize_scalar(weighed_only, bounds=near, args=terms, method="bounded").x
        weighed, plain = np.sqrt(mean_squares(w0, trial.terms))
        assert trial.rmse == pytest.approx(plain, rel=0.01)
        assert abs(weighed / plain - 1) > 0.03


@SLOW
def test_a_second_search_without_time_leaves_the_first_one(growing, monkeypatch):
    record, _, whole = growing
    searches = []

    def once(*arguments):
        searches.append(arguments)
        return explore(*arguments) if len(searches) == 1 else ()

    monkeypatch.setattr("hystjax.discovery._discover.explore", once)
    solution = hj.discover(record, Polynomial(2))
    assert len(searches) > 1 and solution.stats["weights"] is None
    assert solution.value.terms().keys() == TRUTH.keys()
    assert solution.value.terms() != whole.value.terms()


@SLOW
def test_a_search_that_its_time_ended_says_so(monkeypatch):
    record = duhem(0.02, 0)
    whole = hj.discover(record, Polynomial(2), width=1, largest=3, seconds=1e6)
    clock = itertools.chain([0.0, 0.0], itertools.repeat(11.0))
    stopped = SimpleNamespace(monotonic=lambda: next(clock))
    for file in ("_discover", "_explore"):
        monkeypatch.setattr(f"hystjax.discovery.{file}.time", stopped)
    cut = hj.discover(record, Polynomial(2), width=1, largest=3, seconds=10)
    assert len(cut.stats["candidates"]) < len(whole.stats["candidates"])
    said = "The time was up when the search ended, `seconds=10`"
    assert said in cut.stats["why"] and "time" not in whole.stats["why"]


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(0, marks=SLOW),
        *(pytest.param(s, marks=THOROUGH) for s in (1, 2)),
    ],
)
def test_a_linear_system_has_no_hysteresis(seed):
    """The lag w' = -0.3 w + 0.5 u + 0.2 u' under a sine, in closed form."""
    gain = (0.5 + 0.2j) / (0.3 + 1j)
    w = np.imag(gain * np.exp(1j * SHORT)) - gain.imag * np.exp(-0.3 * SHORT)
    error = np.random.default_rng(seed).normal(size=len(SHORT))
    solution = hj.discover(recording(w + 0.1 * np.std(w) * error), Polynomial(2))
    assert solution.value.terms().keys() <= {"1", "w", "u", "du"}
    assert solution.value.kind is Kind.LINEAR
    assert not solution.value.kind.hysteretic


def test_straight_lines_miss_smooth_inputs_by_their_curvature():
    def missed(u, left=1.0, interpolation=hj.interpolation.Linear()):
        record = hj.Recording(TIMES, u, u, interpolation=interpolation)
        return missed_by_lines(record, left)

    sine, step = np.sin(TIMES), TIMES[1]
    # A line over h misses a curve by h^2/8 |u''|, and u'' is -u.
    assert missed(sine) == pytest.approx(step**2 / 8, rel=0.01)
    assert missed(sine, 1e-2 * step**2 / 8) == 0  # so small that lines are right
    assert missed(sine, 1.1e-2 * step**2 / 8) > 0
    assert missed(sine, interpolation=hj.interpolation.Cubic()) == 0
    assert missed(np.arcsin(sine)) == 0  # a triangle, whose lines are its own
    uneven = TIMES + 0.4 * step * np.sin(TIMES**2)
    record = hj.Recording(uneven, np.sin(uneven), np.sin(uneven))
    apart = np.sqrt(np.mean(np.diff(uneven) ** 4))
    assert missed_by_lines(record, 1.0) == pytest.approx(apart / 8, rel=0.3)
    # Each sample of a parabola is off the line through its neighbours by the product
    # of how far these are, and half as far away lines miss a fourth of that.
    before, after = np.diff(uneven)[1:-2], np.diff(uneven)[2:-1]
    expected = np.sqrt(np.mean((before * after) ** 2)) / 4 / np.std(uneven**2)
    record = hj.Recording(uneven, uneven**2, uneven)
    assert missed_by_lines(record, 1.0) == pytest.approx(expected, rel=1e-6)
    assert missed(sine + 0.01 * np.random.default_rng(0).normal(size=len(TIMES))) == 0


@pytest.mark.slow
def test_of_a_record_without_noise_nothing_is_added():
    """What the steps of a run leave is not white, and no term of the device."""
    solution = hj.discover(duhem(0.0, 0), Polynomial(2))
    assert solution.value.terms() == pytest.approx(TRUTH, rel=1e-6)
    assert "to which the recorded samples tell the output" in solution.stats["why"]
    known = 1e-5 * float(jnp.std(duhem(0.0, 0).w))
    assert solution.stats["candidates"][0].rmse < known


@pytest.mark.slow
def test_what_straight_lines_miss_is_no_term():
    clean = hj.Recording(TIMES, np.sin(TIMES), duhem(0.0, 0).w)
    with pytest.warns(UserWarning, match="straight lines between its samples miss"):
        solution = hj.discover(clean, Polynomial(2))
    assert solution.value.terms() == pytest.approx(TRUTH, rel=0.01)
    # Lines of h are h^2/8 |u''| off at most, and so sin is at their middles.
    missed = TIMES[1] ** 2 / 8 * float(jnp.std(clean.w))
    assert missed / 5 < solution.stats["candidates"][0].rmse < missed


def rounded(x, bits):
    """What a converter of some bits makes of numbers that fill its range."""
    step = np.ptp(x) / 2**bits
    return step * np.round(x / step)


FADING = np.exp(-TIMES / 45) * np.sin(TIMES)


@pytest.mark.parametrize("bits", [7, 8, 10, 12])
def test_rounding_takes_what_it_does_from_input_and_output(bits):
    def lost(u, w, left=1.0, **options):
        return lost_by_rounding(hj.Recording(TIMES, u, w, **options), left)

    other = TIMES - 20 * np.cos(TIMES / 7)
    u, w = rounded(FADING, bits), rounded(other, bits)
    shares = [np.std(x - y) / np.std(y) for x, y in ((u, FADING), (w, other))]
    assert lost(u, other) == pytest.approx(1.3 * shares[0], rel=0.1)
    assert lost(u, w) == pytest.approx(1.3 * np.hypot(*shares), rel=0.1)
    moved = 0.1 + 3 * u  # which are no multiples of a step but for rounding errors
    assert lost(moved, other) == pytest.approx(lost(u, other), rel=1e-6)
    # Fits that leave next to nothing, and relays, say that the input is what it is.
    assert lost(u, other, 0.2 * shares[0]) == 0 < lost(u, other, 0.4 * shares[0])
    assert lost(u, np.sign(u)) == lost(u, other)
    known = hj.interpolation.Exact(jnp.sin)
    assert lost(rounded(np.sin(TIMES), 12), other, interpolation=known) == 0


@pytest.mark.parametrize("name", ["sine", "stairs", "triangle", "levels", "noise"])
def test_inputs_that_were_made_of_steps_are_what_they_are(name):
    random = np.random.default_rng(0)
    u = {
        "sine": FADING,
        "stairs": np.repeat(np.round(random.normal(size=100), 1), 10),
        "triangle": 0.05 * np.abs(np.arange(1000) % 80 - 40),
        "levels": np.round(random.normal(size=1000), 1),
        "noise": rounded(FADING + 0.01 * random.normal(size=1000), 10),
    }[name]
    assert lost_by_rounding(hj.Recording(TIMES, u, FADING), 1.0) == 0


@pytest.mark.slow
@pytest.mark.parametrize("bits", [8, 10])
def test_what_rounding_takes_is_no_term(bits):
    """Without that, terms of 0.005 and less come in beside those of the device."""
    w = hj.simulate(law(), hj.Recording(TIMES, FADING, 0 * TIMES), w0=0.0).w
    record = hj.Recording(TIMES, rounded(FADING, bits), rounded(np.asarray(w), bits))
    solution = hj.discover(record, Polynomial(2))
    assert solution.value.terms() == pytest.approx(TRUTH, rel=0.05)
    assert "to which the recorded samples tell the output" in solution.stats["why"]


@SLOW
def test_an_output_that_the_input_alone_decides_has_no_memory():
    error = np.random.default_rng(0).normal(size=len(TIMES))
    u = np.sin(TIMES)
    solution = hj.discover(recording(2 * u + 0.5 * u**2 + 0.1 * error), Polynomial(2))
    found, errors = solution.value.terms(), solution.stats["standard_errors"]
    assert found.keys() == {"du", "u*du"}
    assert abs(found["du"] - 2) < 4 * float(errors["du"]) < 0.1
    assert abs(found["u*du"] - 1) < 4 * float(errors["u*du"]) < 0.1
    assert solution.value.kind is Kind.MEMORYLESS


def noise_alone(seed):
    return recording(np.random.default_rng(seed).normal(size=len(SHORT)))


@pytest.mark.parametrize(
    "seed", [pytest.param(0, marks=SLOW), pytest.param(1, marks=THOROUGH)]
)
def test_noise_alone_is_no_law(seed):
    solution = hj.discover(noise_alone(seed), Polynomial(2), throw=False)
    assert solution.result == hj.RESULTS.no_law
    assert solution.value.terms() == {}


@pytest.mark.parametrize("terms", [["u"], ["u", "du"]])
def test_where_there_is_no_law_those_refused_are_told(terms):
    """An integrator, which never forgets how it began. Nothing else is left, or a law
    without memory, which blocks tell from a constant output."""
    u = np.sin(TIMES)
    integral = cumulative_trapezoid(u, TIMES, initial=0.0)
    w = integral + 0.01 * np.random.default_rng(0).normal(size=len(TIMES))
    library = Library(tuple(map(Term.parse, terms)))
    found = hj.discover(recording(w), library, throw=False)
    assert found.result == hj.RESULTS.no_law
    told = re.fullmatch(
        r"No law explains the output clearly better than a constant does\. (\d) that "
        r"follow better, down to (\S+), were refused, for they do not forget how they "
        r"began \(`fading=False` admits them\)\.",
        found.stats["why"],
    )
    assert told is not None and int(told[1]) == len(terms)
    # By NumPy, the output as a sum of what the terms are the derivatives of.
    columns = np.column_stack([np.ones_like(u), integral, u][: len(terms) + 1])
    left = w - columns @ np.linalg.lstsq(columns, w)[0]
    assert float(told[2]) == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.01)


@SLOW
def test_a_law_whose_coefficients_still_move_is_told_and_not_refused(monkeypatch):
    law = SparseModel.from_terms({"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5})
    w = hj.simulate(law, hj.Recording(TIMES, np.sin(TIMES), 0 * TIMES)).w
    error = 0.05 * np.std(w) * np.random.default_rng(0).normal(size=len(TIMES))
    short = partial(hj.refine, max_steps=1)
    monkeypatch.setattr("hystjax.discovery._choosing.refine", short)
    found = hj.discover(recording(w + error), Polynomial(2))
    assert found.result == hj.RESULTS.nonlinear_max_steps_reached
    assert "After 1 steps of its last refinement" in found.stats["why"]
    assert found.value.terms()


@SLOW
def test_that_there_is_no_law_can_be_raised():
    with pytest.raises(hj.ComputationError, match=r"No law was found.*a constant does"):
        hj.discover(noise_alone(2), Polynomial(2))


@pytest.mark.parametrize("name", ["largest", "width", "starts"])
def test_wrong_sizes_are_told(name, unchecked):
    with pytest.raises(hj.InputError, match=f"`{name}` must be at least 1, got 0"):
        hj.discover(duhem(0.0, 0), Polynomial(2), **{name: 0})
    with pytest.raises(hj.InputError, match=f"`{name}` must be a whole number.*2.5"):
        hj.discover(duhem(0.0, 0), Polynomial(2), **{name: 2.5})


@pytest.fixture(scope="module")
def piezo():
    """Rows that are fitted and unseen ones, and what `discover` makes of the first."""
    recording = hj.datasets.load("piezo_ayala")
    fitted, unseen = recording.window(35000, 45000), recording.window(17500, 35000)
    return fitted, unseen, hj.discover(fitted, Polynomial(2))


@pytest.mark.recordings
@SLOW
def test_the_law_of_the_piezo_is_as_good_as_known(piezo):
    """As good as the best four terms known, which regression of the derivative does not
    find."""
    fitted, unseen, solution = piezo
    assert "on 6 blocks" in solution.stats["why"]
    floor = solution.stats["noise_floor"]
    assert f"of which the noise is {floor:.2g} " in solution.stats["why"]
    assert 0 < floor < solution.stats["candidates"][0].rmse
    for recording, most in ((fitted, 0.00154), (unseen, 0.00173)):
        run = hj.simulate(solution.value, recording)
        assert hj.metrics.nrmse(recording.w, run.w) < most
    assert np.all(np.exp(solution.stats["fading"].gain) < 0.1)


@pytest.mark.recordings
@SLOW
def test_what_free_runs_left_out_choose_holds_on_the_second_half():
    """Of a device that no law of six terms is: rows that nobody fitted, 0.27 µm asked
    of a law of first order."""
    record = hj.datasets.load("piezo_yan9a")
    half = len(record) // 2
    found = hj.discover(record.window(0, half), Polynomial(2))
    unseen = record.window(half, len(record))
    run = hj.simulate(found.value, unseen)
    assert hj.metrics.rmse(unseen.w, run.w) < 0.27
    assert found.value.kind.hysteretic
    for amplitude, rate in ((1.5, 1), (1, 3), (1, 1 / 3)):
        u, t = amplitude * np.asarray(record.u), np.asarray(record.t) / rate
        run = hj.simulate(found.value, hj.Recording(t, u, record.w), throw=False)
        middle = (np.max(record.w) + np.min(record.w)) / 2
        assert np.all(np.abs(run.w - middle) < 1.5 * np.ptp(record.w))


FOUR = {"1", "w", "u", "du*|du|"}


@pytest.mark.recordings
@pytest.mark.parametrize(
    "rows",
    [
        pytest.param((35001, 45001), marks=THOROUGH),
        pytest.param((35010, 45010), marks=THOROUGH),
        pytest.param((35100, 45100), marks=THOROUGH),
        pytest.param((35000, 40000), marks=SLOW),
        pytest.param((40000, 45000), marks=THOROUGH),
    ],
)
def test_the_law_of_the_piezo_does_not_depend_on_the_window(rows):
    window = hj.datasets.load("piezo_ayala").window(*rows)
    found = hj.discover(window, Polynomial(2), largest=4)
    assert found.value.terms().keys() == FOUR


@pytest.mark.recordings
@THOROUGH
def test_more_candidates_do_not_hide_the_law_of_the_piezo(piezo):
    """With 56 terms only few of the 367 290 supports of four are looked at."""
    fitted, *_ = piezo
    frontier = hj.discover(fitted, Polynomial(3), largest=4).stats["frontier"]
    assert frontier[4].terms.keys() == FOUR


@pytest.mark.recordings
@THOROUGH
def test_laws_of_the_piezo_by_size():
    rows = {row.terms: row for row in reproduce("sizes").rows}
    assert set(rows) == set(range(1, 9))
    assert rows[4].chosen.own < 0.154
    assert rows[4].chosen.unseen < 0.173
    for row in rows.values():
        assert len(row.chosen.terms) == len(row.best.terms) == row.terms
        assert row.best.unseen <= row.chosen.unseen
    # A law as good as asked for is among those that are refined; no rule that knows
    # the fitted rows only is known to choose it.
    assert min(row.best.unseen for row in rows.values()) < 0.155
    assert min(row.chosen.unseen for row in rows.values()) < 0.164


# Said after all warnings of the recording, and before anything is searched.
UNKNOWN = r"`signs` names 'u\^7', which is no candidate"


def test_terms_are_those_of_degree_two_where_none_are_given():
    t = np.linspace(0, 12, 301)
    record = hj.Recording(t, np.sin(t), np.sin(t - 0.4))
    with pytest.raises(hj.InputError, match=r"names 'u\^3', which is no candidate"):
        hj.discover(record, signs={"w*|du|": -1.0, "u^2": 1.0, "u^3": 1.0})


@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_an_output_that_is_as_good_as_constant_is_told(offset):
    t = np.linspace(0, 12, 120)
    w = offset + 0.3 * np.sin(2 * t - 0.4)
    record = hj.Recording(t, np.sin(2 * t), w, units=("V", "µm"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises(hj.InputError, match=UNKNOWN):
            hj.discover(record, Polynomial(1), signs={"u^7": 1.0})
    said = "about 1e+05 µm and changes by 0.21 µm"
    assert any(said in str(each.message) for each in caught) == (offset > 0)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_noise_on_the_input_is_told_and_smoothing_takes_it_away(noise):
    t = np.linspace(0, 12, 1201)
    u = np.sin(t) + noise * np.random.default_rng(0).normal(size=len(t))
    smooth = savgol_filter(u, 101, 3)
    told = []
    for each in (u, smooth):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with pytest.raises(hj.InputError, match=UNKNOWN):
                record = hj.Recording(t, each, np.sin(t - 0.4))
                hj.discover([record, record], Polynomial(1), signs={"u^7": 1.0})
        told.append([str(each.message) for each in caught])
    if noise:
        first, second = told[0]
        farther = float(re.findall(r"travels ([\d.]+) times", first)[0])
        nodes = np.sum(np.abs(np.diff(np.sin(t))))
        expected = np.sum(np.abs(np.diff(u))) / nodes
        assert farther == pytest.approx(expected, rel=0.05)
        assert "recording 0" in first and "recording 1" in second
    else:
        assert not told[0]
    assert not told[1]


@pytest.mark.parametrize("samples, cycles", [(60_001, 10), (60_001, 250), (40_001, 10)])
def test_means_are_offered_where_there_are_far_more_samples_than_loops_need(
    samples, cycles
):
    """Of 60 000, 3000 a half cycle, means of 6 leave the 10 000 that are kept; and with
    120 a half cycle none are to be had."""
    t = np.linspace(0, cycles, samples)
    record = hj.Recording(t, np.sin(2 * np.pi * t), np.sin(2 * np.pi * t - 0.4))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises(hj.InputError, match=UNKNOWN):
            hj.discover(record, Polynomial(1), signs={"u^7": 1.0})
    offered = [re.findall(r"averaged\((\d+)\)", str(each.message)) for each in caught]
    assert offered == ([["6"]] if samples > 50_000 and cycles < 100 else [])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("per_cycle", [4, 6, 8, 10, 200])
def test_no_noise_is_seen_in_triangles_of_few_samples(per_cycle):
    phase = np.arange(20 * per_cycle + 1) / per_cycle
    u = 4 * np.abs(phase - np.floor(phase + 0.5)) - 1
    record = hj.Recording(phase, u, np.sin(2 * np.pi * phase))
    with pytest.raises(hj.InputError, match=UNKNOWN):
        hj.discover(record, Polynomial(1), signs={"u^7": 1.0})


def decaying():
    """Times, input and noisy output of a law of Duhem under a decaying sine."""
    t = np.linspace(0, 20, 401)
    u = np.exp(-t / 15) * np.sin(2.5 * t)
    truth = SparseModel.from_terms({"du": 0.25, "w*|du|": -0.5, "u*|du|": 0.4})
    w = hj.simulate(truth, hj.Recording(t, u, 0 * u), w0=0.0).w
    w = np.asarray(w) + 0.02 * np.std(w) * np.random.default_rng(0).normal(size=len(t))
    return t, u, w


@pytest.mark.slow
def test_units_and_the_pace_of_time_change_nothing_in_the_choice():
    t, u, w = decaying()
    found = hj.discover(hj.Recording(t, u, w), hj.library.Duhem())
    # In hours, mV and km: coefficients by the powers of their units.
    other = hj.discover(hj.Recording(t / 3600, 1e3 * u, 1e-3 * w), hj.library.Duhem())
    factors = {"du": 1e-6, "w*|du|": 1e-3, "u*|du|": 1e-9, "|du|": 1e-6}
    for one, same in zip(
        found.stats["candidates"], other.stats["candidates"], strict=True
    ):
        assert one.named == same.named
        assert same.rmse == pytest.approx(1e-3 * one.rmse, rel=1e-4)
    expected = {name: factors[name] * x for name, x in found.value.terms().items()}
    assert other.value.terms() == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_without_a_clock_no_pace_changes_the_law():
    _, u, w = decaying()
    found = hj.discover(hj.Recording(None, u, w), hj.library.Polynomial(2)).value
    assert set(found.terms()) == {"du", "w*|du|", "u*|du|"}
    for pace in (0.01, 7.0):
        timed = hj.Recording(pace * np.arange(401), u, w)
        same = hj.discover(timed, hj.library.Polynomial(2), rate_independent=True).value
        assert same.terms() == pytest.approx(found.terms(), rel=1e-4)


N = 600
DECAYING = np.linspace(0, 25, N)
SWINGS = np.exp(-DECAYING / 25) * np.sin(2 * DECAYING) + 0.25 * np.sin(0.7 * DECAYING)


def noisy_run(law, u=SWINGS):
    w = np.asarray(hj.simulate(law, hj.Recording(DECAYING, u, 0 * u), w0=0.0).w)
    return w + 0.01 * np.std(w) * np.random.default_rng(0).normal(size=N)


@SLOW
@pytest.mark.parametrize("unit", [1.0, 20.0])
def test_radii_and_times_are_each_that_of_their_own_term(unit):
    """Whose names sort as text in another order than as terms: 2 s and 0.5 s, or plays
    of 8 and 20 behind lags."""
    truth = {"u": 0.6, f"play(u,{0.3 * unit:g})": 0.4, "lag(u,0.9)": 0.5}
    law = hj.models.SparseModel.from_terms(truth, target="value")
    record = hj.Recording(DECAYING, unit * SWINGS, noisy_run(law, unit * SWINGS))
    library = (
        Polynomial(1, ("u",))
        + hj.library.Play([0.2 * unit, 0.4 * unit, unit])
        + hj.library.Lag([0.5, 2.0])
    )
    found = hj.discover(record, library, target="value", largest=3)
    numbers = found.value.parameters()
    told = {re.sub(r",[^)]*", "", name): float(x) for name, x in numbers.items()}
    assert told["play(u).radius"] == pytest.approx(0.3 * unit, rel=0.05)
    assert told["lag(u).time"] == pytest.approx(0.9, rel=0.05)
    left = float(hj.judge(found.value, record).errors["rmse"])
    assert found.stats["candidates"][0].rmse == pytest.approx(left, rel=0.02)


@SLOW
@pytest.mark.parametrize("rows", [slice(N - 10, N), slice(0, 5)])
def test_outputs_of_no_weight_may_be_anything_at_the_ends_too(rows):
    law = hj.models.SparseModel.from_terms({"w": -0.08, "u": 0.3, "du": 0.5})
    w, weight = noisy_run(law), np.ones(N)
    weight[rows] = 0
    found = []
    for rubbish in (0.0, 1e6):
        w[rows] = rubbish
        record = hj.Recording(DECAYING, SWINGS, w)
        found.append(hj.discover(record, weights=[weight]))
    one, other = (fit.value.terms() for fit in found)
    assert one.keys() == other.keys() == law.terms().keys()
    for name, value in one.items():
        assert float(other[name]) == pytest.approx(float(value), rel=1e-6)


@SLOW
def test_radii_that_get_another_digit_stay_with_their_terms():
    """9.8 becomes 10.4, whose name sorts before 8.0."""
    truth = {"u": 1.0, "play(u,8.0)": 0.3, "play(u,10.4)": -0.5}
    law = hj.models.SparseModel.from_terms(truth, target="value")
    record = hj.Recording(DECAYING, 30 * SWINGS, noisy_run(law, 30 * SWINGS))
    library = Polynomial(1, ("u",), constant=False) + hj.library.Play([4, 6, 8.2, 9.8])
    found = hj.discover(record, library, target="value", largest=3)
    left = float(hj.judge(found.value, record).errors["rmse"])
    assert found.stats["rmse"][0] == pytest.approx(left, rel=0.02)
    by_weight = {round(float(x), 1): name for name, x in found.value.terms().items()}
    assert by_weight[0.3].startswith("play(u,8.")
    assert by_weight[-0.5].startswith("play(u,10.")
