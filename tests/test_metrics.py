import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sklearn import metrics as sklearn_metrics

from hystjax import InputError, metrics

RNG = np.random.default_rng(18)
W = np.cumsum(RNG.normal(size=200)) + 3.0
W_HAT = W + 0.3 * RNG.normal(size=200)

ORACLES = {
    "rmse": sklearn_metrics.root_mean_squared_error,
    "nrmse": lambda w, v: sklearn_metrics.root_mean_squared_error(w, v) / np.ptp(w),
    "max_error": sklearn_metrics.max_error,
    "relative_error": lambda w, v: np.linalg.norm(v - w) / np.linalg.norm(w),
    "relative_squared_error": lambda w, v: np.mean((v - w) ** 2) / np.mean(w**2),
    "r2": sklearn_metrics.r2_score,
}


@pytest.mark.parametrize("name", ORACLES)
def test_metrics_equal_their_formulas(name):
    metric, oracle = getattr(metrics, name), ORACLES[name]
    np.testing.assert_allclose(metric(W, W_HAT), oracle(W, W_HAT), rtol=1e-12)
    perfect = 1.0 if name == "r2" else 0.0
    np.testing.assert_allclose(metric(W, W), perfect, atol=0)


@pytest.mark.parametrize("name", ORACLES)
def test_metrics_batch_and_compile(name):
    metric = getattr(metrics, name)
    batch = jnp.stack([W_HAT, W + 1.0, W])
    values = jax.jit(jax.vmap(metric, in_axes=(None, 0)))(jnp.asarray(W), batch)
    expected = [ORACLES[name](W, np.asarray(row)) for row in batch]
    np.testing.assert_allclose(values, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("made", [np.asarray, jnp.asarray])
@pytest.mark.parametrize("name", ORACLES)
def test_whole_weights_count_samples_so_many_times(name, made):
    """Those of weight 0 not at all, not even where they are NaN."""
    weights = RNG.integers(0, 4, 200)
    repeated = ORACLES[name](np.repeat(W, weights), np.repeat(W_HAT, weights))
    w, w_hat = (np.where(weights > 0, x, np.nan) for x in (W, W_HAT))
    found = getattr(metrics, name)(*map(made, (w, w_hat, weights)))
    np.testing.assert_allclose(found, repeated, rtol=1e-12)


@pytest.mark.parametrize("made", [np.asarray, jnp.asarray])
@pytest.mark.parametrize("type", [np.int8, np.uint8, np.int16, np.uint16])
@pytest.mark.parametrize("name", ORACLES)
def test_counts_of_a_converter_are_numbers(name, type, made):
    """Whose squares and differences leave what their few bits hold."""
    lowest, highest = np.iinfo(type).min, np.iinfo(type).max
    w, w_hat = RNG.integers(lowest, highest, (2, 200), endpoint=True)
    w[0] = lowest  # of which there is no negative
    found = getattr(metrics, name)(made(w.astype(type)), made(w_hat.astype(type)))
    np.testing.assert_allclose(found, ORACLES[name](w, w_hat), rtol=1e-12)


@pytest.mark.parametrize("name", ORACLES)
def test_signals_of_other_shapes_are_not_spread_over_each_other(unchecked, name):
    with pytest.raises(InputError, match=r"\(200,\) and \(200, 1\)"):
        getattr(metrics, name)(W, W_HAT[:, None])


@pytest.mark.parametrize("name", ORACLES)
@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (-np.eye(200)[7], r"`weights` must be zero or more, got -1 at \[7\]"),
        (np.zeros(200), "`weights` are all 0"),
    ],
)
def test_weights_that_are_none_are_refused(name, weights, message):
    with pytest.raises(InputError, match=message):
        getattr(metrics, name)(W, W_HAT, weights)


@pytest.mark.parametrize("name", ORACLES)
def test_signals_without_samples_are_refused(name):
    with pytest.raises(InputError, match="has no samples"):
        getattr(metrics, name)(np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("name", ORACLES)
def test_weights_may_be_traced_where_signals_are_not(name):
    weights = RNG.integers(0, 3, (2, 200)).astype(float)
    metric = getattr(metrics, name)
    found = jax.vmap(lambda each: metric(W, W_HAT, each))(weights)
    expected = [metric(W, W_HAT, each) for each in weights]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"rmse", "max_error"}))
def test_ratios_have_no_unit(name):
    metric = getattr(metrics, name)
    np.testing.assert_allclose(metric(1e6 * W, 1e6 * W_HAT), metric(W, W_HAT))


def test_a_law_that_diverged_has_no_error():
    """NaN and inf must show, not vanish in a mean."""
    lost = np.where(np.arange(200) < 150, W_HAT, np.inf)
    for name in ORACLES:
        assert not np.isfinite(getattr(metrics, name)(W, lost))


@pytest.mark.parametrize("name", sorted(set(ORACLES) - {"nrmse", "max_error"}))
def test_what_has_no_weight_is_in_no_derivative(name):
    """Though it is NaN, in both signals."""
    weights = np.where(np.arange(200) % 7 == 3, 0.0, 1.0)
    w, w_hat = (np.where(weights > 0, x, np.nan) for x in (W, W_HAT))
    found = jax.grad(getattr(metrics, name), 1)(*map(jnp.asarray, (w, w_hat, weights)))
    known = weights > 0
    kept = jax.grad(getattr(metrics, name), 1)(jnp.asarray(W[known]), W_HAT[known])
    assert np.all(np.asarray(found)[~known] == 0)
    np.testing.assert_allclose(np.asarray(found)[known], kept, rtol=1e-12)
