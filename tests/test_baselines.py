"""Baselines against scikit-learn, SciPy and a plain L-BFGS."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from scipy.integrate import solve_ivp
from sklearn import linear_model

import hystjax as hj
from hystjax.library import BoucWen, Library, Polynomial, Term
from hystjax.reproduce import baselines


@pytest.fixture(scope="module")
def record():
    sine = hj.excitation.Sine(1.0, 0.5)
    law = hj.models.BoucWen(1.0, 0.5, 2.0, names=("V", "x"))
    method = hj.simulation.FixedStep(8)
    return hj.generate(law, sine, np.linspace(0, 6, 300), method=method)


@pytest.fixture(scope="module")
def trained(record):
    network = baselines.MLP(BoucWen(), width=8, depth=2, epochs=205)
    return network.fit(record, key=jax.random.key(0))


@pytest.mark.parametrize("ridge", [0.0, 1.0])
@pytest.mark.parametrize("rows", [None, np.arange(0, 300, 7)])
def test_linear_is_that_of_scikit_learn(record, ridge, rows):
    law = baselines.Linear(BoucWen(), ridge).fit(record, rows=rows).value
    chosen = slice(None) if rows is None else rows
    difference = hj.differentiation.FiniteDifference()
    _, dw = difference.estimate(record.t, record.w)
    _, du = difference.estimate(record.t, record.u)
    features = np.asarray(BoucWen()(record.w, record.u, du))[chosen]
    theirs = (
        linear_model.Ridge(ridge, solver="cholesky")
        if ridge
        else linear_model.LinearRegression()
    ).fit(features, np.asarray(dw)[chosen])
    expected = [theirs.intercept_, *theirs.coef_]
    names = ("1", *BoucWen().names)
    terms = law.terms()
    np.testing.assert_allclose([terms[name] for name in names], expected, rtol=1e-8)
    assert law.names == ("V", "x")


def test_the_intercept_is_no_feature():
    with pytest.raises(hj.InputError, match="must not hold the constant 1"):
        baselines.Linear(Polynomial(1))


def test_rates_of_the_true_law_are_its_derivative(record):
    truth = hj.models.BoucWen(1.0, 0.5, 2.0)
    rows = np.array([5, 50, 120])
    measured, predicted = baselines.rates(truth, record, rows=rows)
    cosine = np.pi * np.cos(np.pi * np.asarray(record.t))[rows]
    w = np.asarray(record.w)[rows]
    exact = cosine - 0.5 * abs(cosine) * w - 2 * cosine * abs(w)
    np.testing.assert_allclose(predicted, exact, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(measured, exact, rtol=0.02, atol=0.02)


@pytest.mark.parametrize(
    "other",
    [
        hj.models.BoucWenOscillator(1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        hj.models.BoucWenForce(0.1, 1.0, 0.5, 0.5, 1.0),
        hj.models.Instrumented(hj.models.BoucWen(1.0, 0.5, 2.0), output_gain=2.0),
        hj.models.PrandtlIshlinskii([0.0, 0.1], [0.4, 0.2]),
        hj.models.SparseModel.from_terms({"u": 0.6}, target="value"),
    ],
    ids=lambda model: type(model).__name__,
)
def test_rates_are_for_laws_whose_state_is_the_output(record, other):
    with pytest.raises(hj.InputError, match=f"got an? {type(other).__name__}"):
        baselines.rates(other, record)


@pytest.mark.usefixtures("unchecked")
def test_what_is_no_library_or_recording_is_named(record):
    for baseline in (baselines.Linear, baselines.MLP):
        with pytest.raises(hj.InputError, match=r"`library` must be .* the text 'du'"):
            baseline("du")
    with pytest.raises(hj.InputError, match="`recording` must be a `Recording`"):
        baselines.Linear(BoucWen()).fit([record, record])
    with pytest.raises(hj.InputError, match="`recording` must be a `Recording`"):
        baselines.rates(hj.models.BoucWen(1.0, 0.5, 2.0), record.w)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.arange(290, 310), "from 0 to 299; got some from 290 to 309"),
        (np.arange(-3, 5), "from 0 to 299; got some from -3 to 4"),
        (np.arange(8.0), "numbers of samples, .* got an array of shape"),
        (np.ones(300, bool), "numbers of samples, .* got an array of shape"),
        (np.zeros(0, int), "numbers of samples, .* got an array of shape"),
    ],
)
def test_rows_are_samples_of_the_recording(record, rows, message):
    with pytest.raises(hj.InputError, match=message):
        baselines.Linear(BoucWen()).fit(record, rows=rows)
    with pytest.raises(hj.InputError, match=message):
        baselines.rates(hj.models.BoucWen(1.0, 0.5, 2.0), record, rows=rows)


@pytest.mark.usefixtures("unchecked")
def test_rows_may_be_a_list(record):
    linear = baselines.Linear(BoucWen())
    listed = linear.fit(record, rows=list(range(50))).value
    cut = linear.fit(record, rows=np.arange(50)).value
    assert listed.terms() == cut.terms()


@pytest.mark.slow
def test_network_learns_and_runs_free(record, trained):
    losses = trained.stats["losses"]
    assert losses.shape == (205,)
    assert losses[-1] < 1e-2 * losses[0]
    law = trained.value
    trajectory = hj.simulate(law, record)

    *inner, last = [
        (np.asarray(layer.weight), np.asarray(layer.bias))
        for layer in law.network.layers
    ]

    def rate(t, w):
        du = np.pi * np.cos(np.pi * t)
        x = np.array([du, w[0] * abs(du), du * abs(w[0])])
        for weight, bias in inner:
            x = np.tanh(weight @ x + bias)
        return last[0] @ x + last[1]

    span = (0.0, float(record.t[-1]))
    theirs = solve_ivp(rate, span, [0.0], t_eval=record.t, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(trajectory.w, theirs.y[0], atol=1e-5)
    assert str(law) == "w' = a network 3-8-8-1 of u', w |u'|, u' |w|"


def test_network_of_the_paper_has_its_size():
    network = baselines.MLP(BoucWen()).network(jax.random.key(0))
    law = baselines.NeuralLaw(BoucWen(), network)
    assert law.size == (3 + 1) * 20 + 4 * (20 + 1) * 20 + 20 + 1
    for layer in network.layers:
        bound = 5 / 3 * np.sqrt(6 / sum(layer.weight.shape))
        assert 0.5 * bound < np.max(np.abs(layer.weight)) <= bound
        assert np.all(layer.bias == 0)


def test_parameters_of_a_network_can_be_replaced(record, trained):
    law = trained.value
    values = law.parameters()
    assert len(values) == law.size
    doubled = law.with_parameters({name: 2 * x for name, x in values.items()})
    for ours, theirs in zip(doubled.network.layers, law.network.layers, strict=True):
        np.testing.assert_array_equal(ours.weight, 2 * theirs.weight)
        np.testing.assert_array_equal(ours.bias, 2 * theirs.bias)
    # The last parameter is the last bias, which adds to the rate.
    last = f"p{law.size - 1}"
    moved = law.with_parameters({last: values[last] + 1})
    before, after = (baselines.rates(each, record)[1] for each in (law, moved))
    np.testing.assert_allclose(after, before + 1)


def test_parameters_that_a_network_lacks_are_refused(trained):
    law = trained.value
    for name in (f"p{law.size}", "p-1", "alpha"):
        with pytest.raises(hj.InputError, match=rf"'{name}'.* p0 to p{law.size - 1}\."):
            law.with_parameters({name: 1.0})


def test_seed_decides_the_network():
    network = baselines.MLP(Library((Term.parse("u"),)), width=4, depth=1)
    one, again, other = (
        network.network(jax.random.key(k)).layers[0].weight for k in (0, 0, 1)
    )
    assert np.array_equal(one, again) and not np.array_equal(one, other)


def test_network_needs_a_key(record):
    with pytest.raises(hj.InputError, match=r"needs a `key`"):
        baselines.MLP(BoucWen()).fit(record)


def rosenbrock(x):
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


def minimised(optimiser, steps=40):
    """Points that an optimiser visits."""
    x = jnp.linspace(-1.0, 1.2, 4)
    state, points = optimiser.init(x), []
    step = jax.jit(optimiser.update)
    for _ in range(steps):
        change, state = step(jax.grad(rosenbrock)(x), state, x)
        x = optax.apply_updates(x, change)
        points.append(x)
    return np.array(points)


def cautious_by_hand(memory, least, steps=40):
    """L-BFGS by the two loops of Nocedal (1980), with PyTorch's rule; and how many
    pairs the rule left out."""
    slope = jax.jit(jax.grad(rosenbrock))
    x = np.linspace(-1.0, 1.2, 4)
    old_x, old_g, pairs, points, left_out = None, None, [], [], 0
    for _ in range(steps):
        g = np.asarray(slope(x))
        if old_g is None:
            scale = min(1.0, 1 / np.linalg.norm(g))
        else:
            s, y = x - old_x, g - old_g
            if s @ y > least:
                pairs = [*pairs, (s, y)][-memory:]
            else:
                left_out += 1
            s, y = pairs[-1]
            scale = s @ y / (y @ y)
        q, shares = g.copy(), []
        for s, y in reversed(pairs):
            shares.append(s @ q / (s @ y))
            q -= shares[-1] * y
        q *= scale
        for (s, y), share in zip(pairs, reversed(shares), strict=True):
            q += s * (share - y @ q / (s @ y))
        old_x, old_g, x = x, g, x - 0.1 * q
        points.append(x)
    return np.array(points), left_out


def test_cautious_lbfgs_that_takes_all_steps_is_plain():
    plain = optax.lbfgs(0.1, memory_size=5, linesearch=None)
    ours = baselines.cautious_lbfgs(0.1, 5, least=-np.inf)
    np.testing.assert_allclose(minimised(ours), minimised(plain), rtol=1e-10)


def test_cautious_lbfgs_leaves_out_flat_steps():
    expected, left_out = cautious_by_hand(memory=5, least=0.02)
    assert 5 <= left_out <= 35
    ours = baselines.cautious_lbfgs(0.1, 5, least=0.02)
    np.testing.assert_allclose(minimised(ours), expected, rtol=1e-6)
