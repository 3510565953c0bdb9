"""Networks that map samples to samples, against closed forms and hand-written loops."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import hystjax as hj
from hystjax.library import Polynomial
from hystjax.reproduce.baselines import FCN, GRU, LSTM, MLP, TCN, Stage
from hystjax.reproduce.baselines._networks import Taps, _Misfit
from hystjax.reproduce.baselines._rates import size as count

SMALL = (LSTM(width=4), GRU(width=4), TCN(width=4, depth=3, kernel=2), FCN(width=4))
BRIEF = (Stage(50, 60),)


def name(baseline):
    return type(baseline).__name__


@pytest.fixture(scope="module")
def record():
    """A hysteretic device under a decaying sine, 100 samples a period."""
    t = np.linspace(0, 10, 1001)
    sine = hj.excitation.DecayingSine(1.0, 1.0, 10.0)
    device = hj.models.BoucWen(1.0, 0.5, 2.0)
    return hj.generate(device, sine, t, method=hj.simulation.FixedStep(4))


def untrained(baseline, record):
    stages = (Stage(50, 1),)
    return replace(baseline, stages=stages).fit(record, key=jax.random.key(1)).value


def size(baseline):
    return count(baseline.network(jax.random.key(0)))


@pytest.mark.parametrize("width", [1, 7])
def test_sizes_of_recurrent_networks_are_those_of_their_equations(width):
    readout = width + 1
    # Four gates, each of sample, state and bias; two states to start with.
    gates = 4 * width * (2 + width + 1)
    assert size(LSTM(width=width)) == gates + 2 * width * (3 + 1) + readout
    # Three gates; the candidate has a bias inside its reset gate too.
    gates = 3 * width * (2 + width + 1) + width
    assert size(GRU(width=width)) == gates + width * (3 + 1) + readout


@pytest.mark.parametrize(
    ("width", "depth", "kernel"), [(4, 1, 2), (6, 3, 5), (2, 2, 3)]
)
def test_sizes_of_convolutional_networks_are_those_of_their_layers(
    width, depth, kernel
):
    def layer(before, after, kernel):
        return after * (before * kernel + 1)

    around = 0 if width == 2 else layer(2, width, 1)
    first, other = layer(2, width, kernel), layer(width, width, kernel)
    tcn = TCN(width=width, depth=depth, kernel=kernel)
    assert size(tcn) == first + (2 * depth - 1) * other + around + width + 1
    wide = layer(2, width, 8) + layer(width, 2 * width, 5) + layer(2 * width, width, 3)
    assert size(FCN(width=width)) == wide + width + 1


def test_reach_is_that_of_the_sources():
    def reach(baseline):
        return baseline.network(jax.random.key(0)).reach

    assert reach(FCN()) == 8 + 5 + 3 - 3
    assert reach(TCN(depth=4, kernel=3)) == 2 * 2 * (1 + 2 + 4 + 8)


@pytest.mark.parametrize(("kernel", "dilation"), [(1, 1), (3, 1), (3, 4), (2, 7)])
def test_taps_are_a_convolution(kernel, dilation):
    taps = Taps(2, 5, kernel, dilation, jax.random.key(0))
    weight = jnp.moveaxis(taps.weights.weight.reshape(5, kernel, 2), 1, 2)
    theirs = eqx.nn.Conv1d(2, 5, kernel, dilation=dilation, key=jax.random.key(1))
    bias = jnp.asarray(taps.weights.bias)[:, None]
    theirs = eqx.tree_at(lambda c: (c.weight, c.bias), theirs, (weight, bias))
    x = jax.random.normal(jax.random.key(2), (40, 2), jnp.float32)
    np.testing.assert_allclose(taps(x), theirs(x.T).T, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("baseline", SMALL, ids=name)
def test_no_output_depends_on_a_later_input(baseline, record):
    response = eqx.filter_jit(untrained(baseline, record).response)

    @settings(max_examples=20)
    @given(st.integers(1, 58), st.floats(-2, 2))
    def later_input_does_not_matter(row, value):
        u, w0 = np.array(record.u[100:160]), record.w[100]
        before = np.asarray(response(jnp.asarray(u), w0))
        u[row + 1 :] += value
        after = np.asarray(response(jnp.asarray(u), w0))
        np.testing.assert_array_equal(before[: row + 1], after[: row + 1])

    later_input_does_not_matter()


@pytest.mark.parametrize("baseline", SMALL, ids=name)
def test_each_output_depends_on_input_so_far(baseline, record):
    model = untrained(baseline, record)
    u, w0 = record.u[100:130], record.w[100]
    effect = np.asarray(jax.jit(jax.jacobian(model.response))(u, w0))
    assert np.all(np.triu(effect, 1)[1:] == 0)
    assert np.all(np.diag(effect) != 0)


@pytest.mark.parametrize("baseline", SMALL, ids=name)
def test_only_recurrent_networks_start_from_the_first_output(baseline, record):
    model = untrained(baseline, record)
    slope = jax.jit(jax.jacobian(model.response, 1))
    effect = slope(record.u[:30], record.w[0])
    assert bool(effect[0] != 0) == isinstance(baseline, LSTM | GRU)


def test_lstm_is_that_of_its_equations(record):
    model = untrained(LSTM(width=3), record)
    network = model.network
    slope = np.append(np.diff(record.u)[:1], np.diff(record.u)) / 0.01
    inputs = np.stack([record.u, slope], axis=1)
    inputs = (inputs - inputs.mean(0)) / inputs.std(0)
    w = np.asarray(record.w)
    first = np.append(inputs[0], (w[0] - w.mean()) / w.std())
    h, c = np.split(np.tanh(network.start.weight @ first + network.start.bias), 2)
    outputs = []
    for x in inputs:
        gates = network.cell.weight_ih @ x + network.cell.weight_hh @ h
        i, f, g, o = np.split(gates + network.cell.bias, 4)
        i, f, o = (1 / (1 + np.exp(-gate)) for gate in (i, f, o))
        c = f * c + i * np.tanh(g)
        h = o * np.tanh(c)
        outputs.append(network.readout.weight[0] @ h + network.readout.bias[0])
    expected = w.mean() + w.std() * np.array(outputs)
    np.testing.assert_allclose(hj.simulate(model, record).w, expected, atol=2e-5)


def test_misfit_is_that_of_the_windows_drawn(record):
    inputs, output = jnp.stack([record.u, record.u], 1), record.w
    key = jax.random.key(3)
    starts = np.asarray(jax.random.randint(key, (10,), 0, 902))

    def network(inputs, w0):
        return 2 * inputs[:, 0] + w0

    squares = [
        (2 * record.u[s : s + 100] + record.w[s] - record.w[s : s + 100]) ** 2
        for s in starts
    ]
    assert _Misfit(inputs, output, 100)(network, key) == pytest.approx(np.mean(squares))
    whole = (2 * record.u + record.w[0] - record.w) ** 2
    assert _Misfit(inputs, output, 1001)(network, key) == pytest.approx(whole.mean())


@pytest.mark.parametrize(
    "baseline",
    [
        LSTM(width=8, stages=(Stage(100, 300), Stage(500, 50))),
        pytest.param(
            GRU(width=8, stages=(Stage(100, 300), Stage(500, 50))),
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            TCN(width=8, depth=4, kernel=3, stages=(Stage(250, 1000),)),
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            FCN(width=16, stages=(Stage(250, 1000),), rate=5e-3),
            marks=pytest.mark.slow,
        ),
    ],
    ids=name,
)
def test_networks_learn_hysteresis_that_no_linear_map_has(baseline, record):
    solution = baseline.fit(record, key=jax.random.key(0))
    epochs = sum(stage.epochs for stage in baseline.stages)
    assert solution.stats["losses"].shape == (epochs,)
    error = hj.judge(solution.value, record).errors["nrmse"]
    # The least of linear maps of the input, its slope and their past of 32 samples.
    lags = [np.roll(record.u, k)[32:] for k in range(33)]
    features = np.stack([np.ones(len(record) - 32), *lags], 1)
    w = np.asarray(record.w)[32:]
    residual = w - features @ np.linalg.lstsq(features, w)[0]
    linear = np.sqrt(np.mean(residual**2)) / np.ptp(record.w)
    assert linear > 0.03
    assert error < linear / 3
    assert solution.result == hj.RESULTS.successful


@pytest.mark.parametrize("baseline", SMALL, ids=name)
def test_simulation_keeps_names_and_starts_where_told(baseline, record):
    model = untrained(baseline, record)
    run = hj.simulate(model, record.window(100, 200), w0=0.3)
    expected = model.response(record.u[100:200], jnp.array(0.3))
    np.testing.assert_allclose(run.w, expected, atol=1e-5)
    assert run.w.dtype == record.w.dtype and np.all(run.t == record.t[100:200])
    assert model.names == record.names
    assert f"{model.size} weights, every 0.01 s" in str(model)


def test_samples_must_be_at_the_interval_of_the_model(record):
    model = untrained(SMALL[1], record)
    coarse = record.resample(record.t[::2])
    with pytest.raises(hj.InputError, match=r"every 0\.02 s, and .* 0\.01 s only"):
        hj.judge(model, coarse)
    slow = hj.Recording(1.05 * record.t, record.u, record.w)
    with pytest.raises(hj.InputError, match=r"every 0\.0105 s, and .* 0\.01 s only"):
        hj.simulate(model, slow)
    uneven = record.resample(np.append(record.t[:5], record.t[7:]))
    with pytest.raises(hj.InputError, match="needs evenly sampled times"):
        hj.simulate(model, uneven)
    with pytest.raises(hj.InputError, match="GRU needs evenly sampled times"):
        SMALL[1].fit(uneven, key=jax.random.key(0))


def test_networks_need_a_key_and_windows_that_fit(record):
    with pytest.raises(hj.InputError, match="needs a `key`"):
        LSTM().fit(record)
    with pytest.raises(hj.InputError, match=r"window of 5000 .* recording has 1001"):
        LSTM().fit(record, key=jax.random.key(0))


@pytest.mark.usefixtures("unchecked")
def test_sizes_of_networks_are_counts():
    every = (
        *((Stage, {"window": 5, "epochs": 5}, each) for each in ("window", "epochs")),
        *((TCN, {}, each) for each in ("width", "depth", "kernel")),
        *((network, {}, "width") for network in (FCN, GRU)),
        *(
            (MLP, {"library": Polynomial(1)}, each)
            for each in ("width", "depth", "epochs")
        ),
    )
    for network, others, name in every:
        with pytest.raises(hj.InputError, match=f"`{name}` must be at least 1, got 0"):
            network(**{**others, name: 0})
        with pytest.raises(hj.InputError, match=f"`{name}` must be a whole number"):
            network(**{**others, name: 2.5})


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("stages", [(), Stage(50, 2), ((50, 2),)])
def test_a_training_has_stages(stages):
    with pytest.raises(hj.InputError, match=r"`stages` must be one `Stage` or more"):
        GRU(stages=stages)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("rate", [0.0, -1e-2, "fast"])
def test_a_training_has_a_rate(rate):
    with pytest.raises(hj.InputError, match="`rate` must be"):
        TCN(rate=rate)


@pytest.mark.usefixtures("unchecked")
def test_networks_say_what_is_no_recording_and_no_key(record):
    key = jax.random.key(0)
    for network in (GRU(stages=BRIEF), MLP(Polynomial(1))):
        with pytest.raises(hj.InputError, match="`recording` must be a `Recording`"):
            network.fit([record, record], key=key)
        with pytest.raises(hj.InputError, match=r"`key` must be a key .* the number 0"):
            network.fit(record, key=0)
        with pytest.raises(hj.InputError, match="`key` must be one key, got 3"):
            network.fit(record, key=jax.random.split(key, 3))


def test_seed_decides_the_training(record):
    brief = GRU(width=2, stages=(Stage(100, 5),))
    one, again, other = (
        brief.fit(record, key=jax.random.key(k)).stats["losses"] for k in (0, 0, 1)
    )
    assert np.array_equal(one, again) and not np.array_equal(one, other)
