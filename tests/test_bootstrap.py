"""Standard errors by resampling, against those of many records."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.models import SparseModel
from hystjax.refinement import Refined, _refine

T = np.linspace(0, 12, 481)
U = np.sin(1.3 * T) * (0.4 + 0.1 * T)
TRUTH = SparseModel.from_terms({"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5})
NAMES = tuple(TRUTH.terms())


@functools.cache
def clean():
    with jax.ensure_compile_time_eval():
        return np.asarray(hj.simulate(TRUTH, hj.Recording(T, U, U), w0=0.1).w)


def noise(key, memory):
    """Noise of size 0.01 whose neighbours are correlated by `memory`."""
    shocks = 0.01 * (1 - memory**2) ** 0.5 * jax.random.normal(key, T.shape)
    return jax.lax.scan(lambda e, s: (memory * e + s,) * 2, shocks[0], shocks)[1]


def recording(w):
    return hj.Recording(T, U, w)


@pytest.mark.slow
def test_starts_behind_a_lead_in_are_no_more_fitted_than_by_refine():
    record = recording(clean() + noise(jax.random.key(4), 0.0))
    how = {"lead_in": 40}
    solution = hj.refine(TRUTH, record, **how)
    assert all("start" not in name for name in solution.stats["certainty"].names)
    draws = {"key": jax.random.key(0), "samples": 3}
    again = hj.bootstrap(solution, record, **how, **draws)
    asked = hj.bootstrap(solution, record, free_start=False, **how, **draws)
    told = hj.bootstrap(solution, record, **draws)  # the lead-in by the fit itself
    for name in NAMES:
        np.testing.assert_array_equal(again.values[name], asked.values[name])
        np.testing.assert_array_equal(again.values[name], told.values[name])


def spread(memory):
    """Standard deviations of the estimates from 200 records."""

    @jax.vmap
    def fitted(key):
        record = recording(clean() + noise(key, memory))
        return hj.refine(TRUTH, record, throw=False).value.parameters()

    estimates = jax.jit(fitted)(jax.random.split(jax.random.key(1), 200))
    return np.array([np.std(estimates[name]) for name in NAMES])


def resampled(memory, block):
    """Standard errors by blocks of residuals, and those promised for white noise."""
    record = recording(clean() + noise(jax.random.key(4), memory))
    solution = hj.refine(TRUTH, record)
    again = hj.bootstrap(
        solution.value, record, key=jax.random.key(0), samples=200, block=block
    )
    assert again.failed == 0
    promised = solution.stats["standard_errors"]
    return [
        np.array([float(errors[name]) for name in NAMES])
        for errors in (again.standard_errors, promised)
    ]


@pytest.fixture(scope="module")
def of_correlated():
    return resampled(0.8, None)


@pytest.mark.slow
def test_blocks_keep_the_correlation_of_the_residuals(of_correlated):
    """The errors of estimates that are linear in the noise, as they are in so little:
    its covariance between the pseudo-inverses of the Jacobian."""
    found, promised = of_correlated
    values = np.array([*TRUTH.terms().values(), 0.1])

    @jax.vmap
    def outputs(values):
        law = TRUTH.with_parameters(dict(zip(NAMES, values[:-1], strict=True)))
        method = hj.simulation.FixedStep(1)
        return hj.simulate(law, recording(U), w0=values[-1], method=method).w

    changes = 1e-5 * np.concatenate([np.eye(4), -np.eye(4)])
    above, below = np.split(np.asarray(jax.jit(outputs)(values + changes)), 2)
    inverse = np.linalg.pinv((above - below).T / 2e-5)
    apart = np.abs(np.arange(len(T))[:, None] - np.arange(len(T)))
    covariance = inverse @ (0.01**2 * 0.8**apart) @ inverse.T
    scatter = np.sqrt(np.diag(covariance))[:-1]
    # 200 fits know a standard deviation to 5 %; blocks of 22 samples cut some of the
    # correlation, which reaches over ten.
    np.testing.assert_allclose(found, scatter, rtol=0.25)
    assert np.all(promised < 0.6 * scatter)


@pytest.mark.slow
def test_blocks_tell_how_estimates_of_many_records_scatter(of_correlated):
    # 200 records too know a standard deviation to 5 % only.
    (found, promised), scatter = of_correlated, spread(0.8)
    np.testing.assert_allclose(found, scatter, rtol=0.25)
    assert np.all(promised < 0.6 * scatter)
    (found, promised), scatter = resampled(0.0, 1), spread(0.0)
    np.testing.assert_allclose(found, scatter, rtol=0.2)
    np.testing.assert_allclose(promised, scatter, rtol=0.2)


@pytest.mark.slow
def test_the_key_decides():
    record = recording(clean() + noise(jax.random.key(4), 0.0))
    one, same, other = (
        hj.bootstrap(TRUTH, record, key=jax.random.key(seed), samples=3, fixed=["du"])
        for seed in (0, 0, 1)
    )
    assert one.values.keys() == {"u*|du|", "w*|du|"}
    for name, values in one.values.items():
        assert values.shape == (3,)
        assert jnp.all(values == same.values[name])
        assert jnp.all(values != other.values[name])
        error = np.sqrt(np.sum((values - np.mean(values)) ** 2) / 2)  # of three
        np.testing.assert_allclose(one.standard_errors[name], error, rtol=1e-12)


@pytest.mark.slow
def test_terms_that_a_law_does_not_have_are_not_fitted():
    """As those of the library that `discover` looked in: the fits are those of the law
    over its own terms."""
    record = recording(clean() + noise(jax.random.key(4), 0.0))
    solution = hj.refine(TRUTH, record)
    named = SparseModel.from_terms({"|du|": 0.0, **solution.value.terms()})
    wider = SparseModel(
        named.library, named.coefficients, np.array([False, True, True, True])
    )
    within = hj.Solution(wider, solution.result, solution.stats)
    own, among = (
        hj.bootstrap(each, record, key=jax.random.key(0), samples=3)
        for each in (solution, within)
    )
    assert among.values.keys() == set(NAMES)
    for name, values in own.values.items():
        np.testing.assert_allclose(among.values[name], values, rtol=1e-9)


@pytest.mark.slow
def test_samples_without_weight_leave_no_residuals():
    """As of dropouts that were bridged; and a wrong first sample begins no run."""
    weights = np.ones(len(T))
    weights[100:160] = 0
    w = np.array(clean() + noise(jax.random.key(4), 0.0))
    w[100:160] += 5
    w[0] += 0.03
    solution = hj.refine(TRUTH, recording(w), weights=[weights])
    again = hj.bootstrap(
        solution, recording(w), key=jax.random.key(0), samples=200, weights=[weights]
    )
    assert again.failed == 0
    for name, promised in solution.stats["standard_errors"].items():
        assert 0.6 < again.standard_errors[name] / promised < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("block", [None, 40])
def test_a_recording_without_any_weight_leaves_none(block):
    both = [recording(clean() + noise(jax.random.key(i), 0.0)) for i in (4, 5)]
    weights = [np.ones(len(T)), np.zeros(len(T))]
    solution = hj.refine(TRUTH, both, weights=weights)
    options = {"key": jax.random.key(0), "samples": 60, "weights": weights}
    again = hj.bootstrap(solution, both, block=block, **options)
    assert again.failed == 0
    for name, promised in solution.stats["standard_errors"].items():
        assert 0.5 < again.standard_errors[name] / promised < 2


@pytest.mark.slow
def test_residuals_are_scaled_by_the_weights_of_where_they_come_to():
    """Of noise that is 26 times as large in every other stretch."""
    size = 0.002 + 0.05 * (np.arange(len(T)) % 60 < 30)
    weights = [1 / size**2]
    w = clean() + size * np.random.default_rng(4).normal(size=len(T))
    solution = hj.refine(TRUTH, recording(w), weights=weights)
    again = hj.bootstrap(
        solution, recording(w), key=jax.random.key(0), samples=200, weights=weights
    )
    assert again.failed == 0
    for name, promised in solution.stats["standard_errors"].items():
        assert 0.6 < again.standard_errors[name] / promised < 1.5


def test_residuals_by_their_weights_are_of_one_size():
    size = np.geomspace(1e-3, 1.0, len(T))
    drawn = np.random.default_rng(5).normal(size=len(T))
    weight = jnp.where(jnp.arange(len(T)) < 9, 0.0, 1 / size**2)
    run = _refine._free_run(
        recording(clean() + size * drawn), jnp.asarray(-size * drawn), weight
    )
    np.testing.assert_allclose(run.left, drawn[9:], rtol=1e-12)
    np.testing.assert_allclose(run.left / run.root, (size * drawn)[9:], rtol=1e-12)
    np.testing.assert_allclose(run.w, clean(), atol=1e-12)


def test_the_recordings_are_those_of_the_fit():
    solution = hj.refine(TRUTH, recording(clean() + noise(jax.random.key(4), 0.0)))
    shorter = hj.Recording(T[:300], U[:300], clean()[:300])
    of_more_noise = recording(clean() + 2 * noise(jax.random.key(4), 0.0))
    told = "not the recordings that the model was refined on"
    for other, why in ((shorter, ".*at most 300"), (of_more_noise, ": .* 0 begins")):
        with pytest.raises(hj.InputError, match=told + why):
            hj.bootstrap(solution, other, key=jax.random.key(0))


def test_weights_are_those_of_the_fit_unless_its_own_are_given(monkeypatch):
    """And with them a sensor that has said -999 for a while stays out."""
    weights, w = np.ones(len(T)), np.array(clean() + noise(jax.random.key(4), 0.0))
    weights[100:160], w[100:160] = 0, -999
    record, draws = recording(w), {"key": jax.random.key(0), "samples": 2}
    solution, asked = hj.refine(TRUTH, record, weights=[weights]), []

    def refits(law, group, runs, blocks, weights, options, keys):
        asked.append((runs, weights))
        return {"du": jnp.ones(2)}, jnp.ones(2, bool)

    monkeypatch.setattr(_refine, "_refits", refits)
    for how in ({}, {"weights": [weights]}, {"weights": [3 * weights]}):
        hj.bootstrap(solution, record, **how, **draws)
        ((run,), (used,)) = asked.pop()
        np.testing.assert_array_equal(used > 0, weights > 0)
        np.testing.assert_array_equal(run.rows, np.flatnonzero(weights))
        assert np.max(np.abs(run.left)) < 0.1
    for how in ({"weights": [np.ones(len(T))]}, {"lead_in": 40}):
        with pytest.raises(hj.InputError, match="not those that the model was refined"):
            hj.bootstrap(solution, record, **how, **draws)


def test_a_first_sample_without_weight_tells_of_no_other_recording():
    weights, w = np.ones(len(T)), np.array(clean() + noise(jax.random.key(4), 0.0))
    weights[0], w[0] = 0, w[0] + 1
    fit = Refined.of(hj.refine(TRUTH, recording(w), weights=[weights]))
    _refine.check_fitted_on((recording(w),), fit, "bootstrap(model, recordings)")
    w[1] += 1  # of samples behind the first one nothing is asked
    _refine.check_fitted_on((recording(w),), fit, "bootstrap(model, recordings)")


@pytest.mark.slow
def test_options_are_those_of_a_fit():
    record = recording(clean() + noise(jax.random.key(4), 0.0))
    again = hj.bootstrap(
        TRUTH, [record], key=jax.random.key(0), samples=3, weights="range", starts=2
    )
    assert again.failed == 0 and again.values["du"].shape == (3,)


def test_one_fit_alone_has_no_standard_error():
    with pytest.raises(hj.InputError, match=r"`samples` must be at least 2.*got 1"):
        hj.bootstrap(TRUTH, recording(clean()), key=jax.random.key(0), samples=1)


def test_fits_that_failed_have_no_say(monkeypatch):
    found = jnp.array([1.0, 2.0, 90.0, 4.0]), jnp.array([True, True, False, True])
    monkeypatch.setattr(_refine, "_refits", lambda *_: ({"w*|du|": found[0]}, found[1]))
    record = recording(clean() + noise(jax.random.key(4), 0.0))
    again = hj.bootstrap(TRUTH, record, key=jax.random.key(0), samples=4, fixed=["du"])
    assert again.failed == 1
    error = np.std([1.0, 2.0, 4.0], ddof=1)
    np.testing.assert_allclose(again.standard_errors["w*|du|"], error, rtol=1e-12)


def test_blocks_are_neighbours_of_a_ring_about_their_mean():
    left = 5 + np.random.default_rng(6).normal(size=60)
    drawn = jax.vmap(lambda key: _refine.redrawn(key, jnp.asarray(left), 7))(
        jax.random.split(jax.random.key(0), 300)
    )
    apart = np.abs(np.asarray(drawn)[..., None] - (left - np.mean(left)))
    rows = np.argmin(apart, axis=-1)
    assert drawn.shape == (300, 60) and np.max(np.min(apart, axis=-1)) < 1e-12
    starts = rows[:, ::7]
    places = np.repeat(starts, 7, axis=1)[:, :60] + np.arange(60) % 7
    assert np.all(rows == places % 60)
    assert set(starts.ravel()) == set(range(60))


@pytest.mark.parametrize("block", [0, 482])
def test_blocks_fit_into_the_recording(block):
    record = recording(clean())
    message = f"`block` must lie between 1 and 481 samples, got {block}"
    with pytest.raises(hj.InputError, match=message):
        hj.bootstrap(TRUTH, record, key=jax.random.key(0), block=block)
