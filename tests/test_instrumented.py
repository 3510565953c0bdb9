"""A device behind instruments, and the general Duhem law."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import hystjax as hj
from hystjax.models import Duhem, Instrumented, SparseModel
from hystjax.signals import Signals

T = np.linspace(0, 20, 2001)
DEVICE = Duhem(0.4, 0.5, 0.25)


def excitation(t):
    return 2 * jnp.exp(-0.05 * t) * jnp.sin(t)


def recorded(model, noise=0.0):
    """A free run of a model as a recording."""
    zero = hj.Recording(T, np.zeros_like(T), np.zeros_like(T)).with_input(excitation)
    w = np.asarray(hj.simulate(model, zero, w0=0.1).w)
    w = w + noise * np.random.default_rng(3).normal(size=w.shape)
    return hj.Recording(T, zero.u, w).with_input(excitation)


def test_instruments_are_what_they_say():
    gains = {"input_gain": 1.5, "input_offset": 0.2}
    outer = {"output_gain": -3.0, "output_offset": 0.7}
    record = recorded(DEVICE)
    seen = hj.simulate(Instrumented(DEVICE, **gains, **outer), record, w0=0.4).w
    driven = record.with_input(lambda t: 1.5 * excitation(t) + 0.2)
    inner = hj.simulate(DEVICE, driven, w0=(0.4 - 0.7) / -3.0).w
    np.testing.assert_allclose(seen, 0.7 - 3.0 * inner, rtol=0, atol=1e-7)


@pytest.mark.parametrize("gain", [1.5, -0.7])
def test_plays_behind_instruments_are_those_of_the_input_inside(gain):
    stack = hj.models.PrandtlIshlinskii([0.1, 0.4, 0.8], [0.5, 0.3, 0.2])
    path, inside = (
        hj.Recording(T, u, 0 * T).path for u in (np.sin(T), gain * np.sin(T) + 0.2)
    )
    method = hj.simulation.FixedStep(1)

    def seen(gain):
        device = Instrumented(stack, input_gain=gain, input_offset=0.2)
        return hj.simulate(device, path, w0=0.0, method=method).w

    expected = hj.simulate(stack, inside, w0=0.0, method=method).w
    w, change = jax.jvp(seen, (gain,), (1.0,))
    np.testing.assert_allclose(w, expected, rtol=0, atol=1e-14)
    step = 1e-6
    difference = (seen(gain + step) - seen(gain - step)) / (2 * step)
    # Where a play starts or stops to move within the step, both sides are seen.
    apart = np.abs(change - difference) > 1e-8
    assert np.mean(apart) < 0.01


def test_a_delay_moves_the_output():
    ideal, late = (
        np.asarray(hj.simulate(model, recorded(DEVICE), w0=0.1).w)
        for model in (DEVICE, Instrumented(DEVICE, delay=0.1))  # ten samples
    )
    np.testing.assert_allclose(late[10:], ideal[:-10], rtol=0, atol=1e-12)
    np.testing.assert_allclose(late[:10], ideal[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "around, seen, rows",
    [
        (lambda late: Instrumented(late, output_gain=-2.0), lambda y: -2.0 * y, 10),
        (lambda late: Instrumented(late, delay=0.05), lambda y: y, 15),
        (lambda late: hj.models.Butterfly(late, 0.3, 0.1), lambda y: y**2 + 0.3, 10),
    ],
    ids=["gain", "delay", "butterfly"],
)
def test_a_delay_inside_of_others_moves_the_output_too(around, seen, rows):
    late = Instrumented(DEVICE, delay=0.1)
    model = around(late)
    record, method = hj.Recording(T, np.sin(T), 0 * T), hj.simulation.FixedStep(1)
    ideal = np.asarray(hj.simulate(DEVICE, record, w0=0.1, method=method).w)
    found = hj.simulate(model, record, w0=seen(0.1), method=method).w
    np.testing.assert_allclose(found[rows:], seen(ideal[:-rows]), rtol=0, atol=1e-12)
    assert late.rate_independent is model.rate_independent is False
    with pytest.raises(hj.InputError, match="comes late"):
        hj.export.to_c(model)


@pytest.mark.parametrize(
    "truth, start",
    [
        ({"output_offset": 0.3}, {"output_offset": 0.0}),
        ({"delay": 0.137}, {"delay": 0.0}),
        pytest.param(
            {"input_offset": -0.2, "delay": 0.05},
            {"input_offset": 0.0, "delay": 0.01},
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda settings: ", ".join(settings),
)
def test_instruments_are_fitted_beside_the_law(truth, start):
    record = recorded(Instrumented(DEVICE, **truth), noise=1e-3)
    guess = Instrumented(Duhem(0.5, 0.4, 0.2), **start)
    solution = hj.refine(guess, record, substeps=4)
    found, errors = solution.value.parameters(), solution.stats["standard_errors"]
    expected = {"alpha": 0.4, "beta": 0.5, "gamma": 0.25, **truth}
    assert found.keys() == expected.keys() == errors.keys()
    for name, value in expected.items():
        assert abs(found[name] - value) < 4 * errors[name] + 1e-5
        assert errors[name] < 0.02
    assert float(solution.stats["rmse"][0]) == pytest.approx(1e-3, rel=0.1)
    assert float(solution.stats["fading"].exponent[0]) < 0


@pytest.mark.slow
def test_a_gain_that_the_law_can_take_over_is_named():
    law = SparseModel.from_terms({"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25})
    seen = Instrumented(law, output_gain=1.0)
    certainty = hj.refine(seen, recorded(DEVICE, 1e-3)).stats["certainty"]
    ((size, parts),) = certainty.undetermined(1e-6)
    assert size < 1e-8
    # Twice the gain is half the coefficients of the terms without w.
    assert parts.keys() == {"u*|du|", "du", "output_gain"}
    assert (
        np.sign(parts["u*|du|"])
        == np.sign(parts["du"])
        != np.sign(parts["output_gain"])
    )
    fixed = hj.refine(seen, recorded(DEVICE, 1e-3), fixed=("output_gain",))
    assert fixed.stats["certainty"].undetermined(1e-6) == ()


def test_hidden_devices_have_instruments_too():
    spring = hj.models.BoucWenOscillator(2.0, 10.0, 5e4, 5e4, 800.0, -1100.0)
    t = np.arange(600) / 750
    record = hj.Recording(t, 50 * np.sin(150 * t), np.zeros_like(t))
    ideal = hj.simulate(spring, record).w
    seen = hj.simulate(Instrumented(spring, output_gain=1e3), record).w
    np.testing.assert_allclose(seen, 1e3 * ideal, rtol=1e-6, atol=1e-9)
    assert Instrumented(spring).hidden and not Instrumented(DEVICE).hidden


def test_parameters_go_where_they_belong():
    model = Instrumented(DEVICE, delay=0.1, output_gain=2.0)
    assert list(model.parameters()) == [
        "alpha",
        "beta",
        "gamma",
        "output_gain",
        "delay",
    ]
    changed = model.with_parameters({"beta": jnp.array(0.9), "delay": jnp.array(0.2)})
    expected = {
        "alpha": 0.4,
        "beta": 0.9,
        "gamma": 0.25,
        "output_gain": 2,
        "delay": 0.2,
    }
    assert changed.parameters() == pytest.approx(expected)
    assert str(changed).endswith("(output_gain = 2, delay = 0.2)")
    assert str(Instrumented(DEVICE)) == f"{DEVICE} (ideal instruments)"


def test_parameters_that_are_there_twice_say_whose_they_are():
    device = hj.models.PrandtlIshlinskii([0.2], [1.0], 0.7)
    once = hj.models.Butterfly(device, offset=0.2)
    model = hj.models.Butterfly(once, offset=0.1)
    named = {"device.device.offset": 0.7, "device.offset": 0.2, "offset": 0.1}
    values = {name: float(x) for name, x in model.parameters().items()}
    assert values.items() >= named.items()
    assert len(values) == len(jax.tree.leaves(model))
    changed = model.with_parameters({"device.device.offset": 3.0, "offset": 2.0})
    offsets = changed.device.device.offset, changed.device.offset, changed.offset
    assert offsets == pytest.approx((3.0, 0.2, 2.0))
    friction = Instrumented(Instrumented(hj.models.Dahl(3.0, 0.8), delay=0.1), delay=0)
    assert friction.bounds() == hj.models.Dahl(3.0, 0.8).bounds()


@pytest.mark.parametrize(
    "model",
    [
        Instrumented(DEVICE, delay=0.1),
        hj.models.Oscillator(1.0, 0.2, 2.0, DEVICE),
    ],
    ids=lambda model: type(model).__name__,
)
def test_a_name_that_is_of_no_parameter_is_told_with_all_that_are(model):
    with pytest.raises(hj.InputError, match="'gaama'") as told:
        model.with_parameters({"gaama": 1.0})
    assert "Did you mean 'gamma'?" in str(told.value)
    assert f"parameters are {', '.join(model.parameters())}." in str(told.value)


# ------------------------------------------------------------------ the general Duhem

GENERAL = Duhem((0.1, 0.4, 0.0, -0.05), 0.5, (0.25, 0.0, 0.1))


def test_the_general_duhem_law_agrees_with_scipy():
    def rate(t, w):
        u, du = 2 * np.sin(t), 2 * np.cos(t)
        f, g = 0.1 + 0.4 * u - 0.05 * u**3, 0.25 + 0.1 * u**2
        return abs(du) * (f - 0.5 * w) + g * du

    turns = np.array([0, 0.5, 1.5, 2.5, 3.5, 4.5]) * np.pi
    record = hj.Recording(T, 2 * np.sin(T), 0 * T).with_input(lambda t: 2 * jnp.sin(t))
    ours, w0 = np.asarray(hj.simulate(GENERAL, record, w0=0.3).w), [0.3]
    for start, end in itertools.pairwise(turns):
        inside = T[(start <= T) & (end >= T)]
        run = scipy.integrate.solve_ivp(
            rate, (start, end), w0, t_eval=[*inside, end], rtol=1e-11, atol=1e-12
        )
        w0 = run.y[:, -1]
        expected = run.y[0, :-1]
        rows = (start <= T) & (end >= T)
        np.testing.assert_allclose(ours[rows], expected, rtol=0, atol=1e-7)


def test_the_general_duhem_law_says_what_it_computes():
    assert GENERAL.terms() == pytest.approx(
        {
            "du": 0.25,
            "u^2*du": 0.1,
            "|du|": 0.1,
            "u*|du|": 0.4,
            "u^3*|du|": -0.05,
            "w*|du|": -0.5,
        }
    )
    rng = np.random.default_rng(1)
    w, u, du = jnp.asarray(rng.normal(size=(3, 30)))
    now = Signals(jnp.zeros(30), u, du)
    ours, as_terms = (
        jax.vmap(law.rate)(w, (), now)
        for law in (GENERAL, SparseModel.from_terms(GENERAL.terms()))
    )
    np.testing.assert_allclose(ours, as_terms, rtol=1e-12, atol=1e-14)
    names = ["alpha[0]", "alpha[1]", "alpha[2]", "alpha[3]", "beta"]
    assert list(GENERAL.parameters()) == [*names, "gamma[0]", "gamma[1]", "gamma[2]"]


def test_the_general_duhem_law_is_refined():
    fixed = ("alpha[2]", "gamma[1]")
    record = recorded(GENERAL, 1e-3)
    start = Duhem((0.0, 0.3, 0.0, 0.0), 0.6, (0.3, 0.0, 0.0))
    solution = hj.refine(start, record, fixed=fixed)
    found, errors = solution.value.parameters(), solution.stats["standard_errors"]
    for name, value in GENERAL.parameters().items():
        assert abs(found[name] - value) <= 4 * errors.get(name, 0) + 1e-6


def test_a_batch_of_models_keeps_its_names():
    batch = jax.vmap(lambda beta: Duhem((0.1, 0.4), beta, 0.25))(jnp.arange(1.0, 4.0))
    assert list(batch.parameters()) == ["alpha[0]", "alpha[1]", "beta", "gamma"]


def test_a_polynomial_needs_a_coefficient():
    with pytest.raises(hj.InputError, match="at least one coefficient, got none"):
        Duhem((), 0.5, 0.25)
