"""The kernel: single steps, their derivatives, and how many are taken."""

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
from jaxtyping import Array
from scipy.integrate import odeint

import hystjax as hj
from hystjax import RESULTS
from hystjax.library import at
from hystjax.models import BoucWen, BoucWenOscillator, Dahl, Duhem, SparseModel
from hystjax.refinement._certainty import (
    astray,
    enough,
    enough_steps,
    known_to,
    warn_of_lines,
)
from hystjax.signals import Signals
from hystjax.simulation import (
    Adaptive,
    Automatic,
    FixedStep,
    _steps,
    march,
    step,
    trajectory,
)
from hystjax.simulation._steps import _apart, abreast, run

RNG = np.random.default_rng(40)
T = np.linspace(0.0, 12.0, 61)
RANDOM = np.cumsum(RNG.normal(size=61)) / 4
RECORD = hj.Recording(T, RANDOM, RANDOM)
MEMORY = {"du": 0.3, "w*|du|": -0.5, "play(u,0.3)": 0.4, "lag(u,1.5)": 0.2, "w": -0.4}
MODELS = {
    "Duhem": Duhem(0.4, 0.5, 0.25),
    "memory": SparseModel.from_terms(MEMORY),
    "value": SparseModel.from_terms({"play(u,0.3)": 0.4, "u^2": 0.1}, target="value"),
    "oscillator": BoucWenOscillator(1.0, 0.4, 2.0, 1.5, 0.8, -0.4),
}


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_steps_one_by_one_are_the_trajectory(model):
    path, w0 = RECORD.path, jnp.asarray(0.3)
    grid, m = path.grid(2), model.memory.first(path)
    state = model.start(m, at(path.signals(), 0), w0), m
    states = [state]
    advance = eqx.filter_jit(lambda state, i: step(model, state, at(grid, i)))
    for i in range(len(grid.steps)):
        state = advance(state, jnp.array(i))
        states.append(state)
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *states[::2])
    for found, expected in zip(
        jax.tree.leaves(trajectory(model, path, w0, 2)),
        jax.tree.leaves(stacked),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("name", ["memory", "oscillator"])
def test_two_runs_abreast_are_each_of_them(name, smooth):
    record = RECORD.with_input(lambda t: jnp.sin(2.7 * t)) if smooth else RECORD
    model, path, w0 = MODELS[name], record.path, jnp.asarray(0.3)
    least = path.least_substeps
    found = eqx.filter_jit(abreast)(model, path, w0, least)
    for substeps, w in zip((least, 2 * least), found, strict=True):
        alone = hj.simulate(model, path, w0=w0, method=FixedStep(substeps)).w
        np.testing.assert_allclose(w, alone, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("samples", "wanted"), [(2401, False), (61, True)])
def test_care_for_kinks_is_compiled_where_it_is_wanted(monkeypatch, samples, wanted):
    """With the same result as in one program, which has it in any case."""
    compiled, with_care = [], _steps._with_care

    def watched(*arguments, **more):
        compiled.append(arguments)
        return with_care(*arguments, **more)

    monkeypatch.setattr(_steps, "_with_care", watched)
    law = SparseModel.from_terms({"u": 1.0, "w*|w|": -1.0})
    t = np.linspace(0.0, 12.0, samples)
    record = hj.Recording(t, np.sin(t), np.sin(t))
    ran = hj.simulate(law, record)
    assert bool(compiled) == wanted
    whole = eqx.filter_jit(hj.simulate)(law, record)
    np.testing.assert_allclose(ran.w, whole.w, rtol=1e-12, atol=1e-14)
    assert int(ran.stats["num_steps"]) == int(whole.stats["num_steps"])
    assert float(ran.stats["error"]) == pytest.approx(
        float(whole.stats["error"]), rel=1e-3
    )


@pytest.mark.parametrize(
    ("smooth", "substeps"),  # of a smooth input two at least
    [*((False, n) for n in (1, 2, 5, 8)), *((True, n) for n in (2, 5, 8))],
)
def test_rows_of_an_interval_are_rows_of_the_grid(smooth, substeps):
    """The one is for numbers of steps that are not known when it is compiled."""
    record = RECORD.with_input(lambda t: jnp.sin(2.7 * t)) if smooth else RECORD
    path = record.path
    grid = jax.tree.map(lambda leaf: leaf.reshape(-1, substeps), path.grid(substeps))

    def row(interval, i, substeps):
        ends = (path.node(interval, j, substeps) for j in (i, i + 1))
        return path.stretch(interval, *ends)

    for i in range(substeps):
        arguments = path.intervals(), jnp.array(i), jnp.array(substeps)
        found = jax.vmap(row, (0, None, None))(*arguments)
        for a, b in zip(
            jax.tree.leaves(found),
            jax.tree.leaves(at(grid, (slice(None), i))),
            strict=True,
        ):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-13)


# ------------------------------------------------------------------------- derivatives


def plain(advance, model, x, rows):
    """The loop without a rule for its derivative."""

    def next_state(x, row):
        x = advance(model, x, row)
        return x, x

    return jax.lax.scan(next_state, x, rows)[1]


def swing(model, x, row):
    """Two numbers and an array, coupled, driven by a force."""
    y, v = x
    force = row["force"] - model["k"] * y - model["c"] * v[0] + 0.1 * jnp.sin(v[1])
    return y + 0.1 * v[0], v + 0.1 * jnp.stack([force, y - v[1] ** 2])


def test_the_derivative_of_many_steps_is_that_of_their_loop():
    model = {"k": jnp.asarray(1.3), "c": jnp.asarray(0.2)}
    x = jnp.asarray(0.5), jnp.array([0.1, -0.3])
    rows = {"force": jnp.asarray(RNG.normal(size=40))}

    def summary(function):
        def total(model, x, rows):
            y, v = function(swing, model, x, rows)
            return jnp.stack([jnp.sum(jnp.sin(y[-40:])), jnp.sum(v[-40:] ** 2)])

        return total

    ours, loop = jax.jit(summary(march)), jax.jit(summary(plain))
    np.testing.assert_allclose(ours(model, x, rows), loop(model, x, rows), rtol=1e-13)
    for jacobian in (jax.jacfwd, jax.jacrev):
        found = jax.jit(jacobian(ours, (0, 1, 2)))(model, x, rows)
        expected = jax.jit(jacobian(loop, (0, 1, 2)))(model, x, rows)
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)
    # One part alone, and several at once.
    one, its_loop = (
        jax.jit(jax.grad(lambda k, f=f: f(model | {"k": k}, x, rows)[0]))
        for f in (ours, loop)
    )
    np.testing.assert_allclose(one(model["k"]), its_loop(model["k"]), rtol=1e-9)
    lanes = jnp.linspace(0.5, 2.0, 5)
    batch = jax.jit(jax.vmap(jax.grad(lambda k: ours(model | {"k": k}, x, rows)[1])))
    single = jax.jit(jax.grad(lambda k: loop(model | {"k": k}, x, rows)[1]))
    np.testing.assert_allclose(batch(lanes), [single(k) for k in lanes], rtol=1e-9)


GRADIENTS = {f"fixed, {name}": (m, FixedStep(2)) for name, m in MODELS.items()}
GRADIENTS |= {
    f"automatic, {name}": (MODELS[name], Automatic(1e-11))
    for name in ("Duhem", "oscillator")
}


@pytest.mark.parametrize(
    ("model", "method"),
    [
        pytest.param(*each, id=n, marks=[pytest.mark.slow] * ("automatic, o" in n))
        for n, each in GRADIENTS.items()
    ],
)
def test_gradients_of_simulations_are_those_of_differences(model, method):
    """Of few errors of steps: those of two simulations do not go with each other."""
    names = [n for n in model.parameters() if not n.endswith(".radius")]
    values = jnp.stack([model.parameters()[n] for n in names])

    @jax.jit
    def loss(values):
        built = model.with_parameters(dict(zip(names, values, strict=True)))
        return jnp.sum(hj.simulate(built, RECORD, w0=0.3, method=method).w ** 2)

    h = 1e-5
    forward, reverse = (
        jax.jit(jax.jacfwd(loss))(values),
        jax.jit(jax.grad(loss))(values),
    )
    # The derivative of steps across a kink of |w| is right to their own length.
    now = Signals(*jnp.zeros(3))
    x = model.start(model.memory.start(now), now, now.u)
    near = 2e-3 if isinstance(method, Automatic) and model.kinks(x) else 1e-6
    for i in range(len(names)):
        change = jnp.zeros(len(names)).at[i].set(h)
        expected = (loss(values + change) - loss(values - change)) / (2 * h)
        assert forward[i] == pytest.approx(float(expected), rel=near, abs=1e-6)
    np.testing.assert_allclose(reverse, forward, rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_second_derivatives_are_those_of_a_closed_form():
    """Of a sum of squares, in which products of first derivatives have a part; of laws
    for which two steps a sample are enough, and not even eight."""
    t, coulomb = np.linspace(0.0, 1.0, 9), 5.0
    ramp = hj.Recording(t, t, 0 * t)

    def loss(stiffness):
        return jnp.sum(hj.simulate(Dahl(stiffness, coulomb), ramp, w0=0.0).w ** 2)

    curvature = jax.jit(jax.jacfwd(jax.jacfwd(loss)))
    for stiffness in (2.0, 100.0):
        left = np.exp(-stiffness * t / coulomb)
        w, first, second = coulomb * (1 - left), t * left, -(t**2) * left / coulomb
        expected = np.sum(2 * first**2 + 2 * w * second)
        assert curvature(stiffness) == pytest.approx(expected, rel=1e-6)


def test_gradients_with_the_input():
    def loss(u):
        record = hj.Recording(T, u, u)
        return jnp.sum(hj.simulate(MODELS["Duhem"], record, w0=0.0).w ** 2)

    u, h = jnp.asarray(RANDOM), 1e-6
    gradient = jax.grad(loss)(u)
    for i in (1, 17, 40, 60):
        change = jnp.zeros(61).at[i].set(h)
        expected = (loss(u + change) - loss(u - change)) / (2 * h)
        assert gradient[i] == pytest.approx(float(expected), rel=1e-6, abs=1e-6)


# ---------------------------------------------------------------------- enough of them

TERMS = ("1", "w", "u", "du", "w*|w|", "u*|du|", "w*|du|", "du*|w|")


def by_lsoda(law, record, w0):
    """The output by SciPy, from knot to knot of the input."""
    terms, t, u = law.terms(), np.asarray(record.t), np.asarray(record.u)
    c = [terms.get(name, 0.0) for name in TERMS]

    def rate(w, now, i):
        (w,), slope = w, (u[i + 1] - u[i]) / (t[i + 1] - t[i])
        x, speed = u[i] + slope * (now - t[i]), abs(slope)
        steady = c[0] + c[1] * w + c[2] * x + c[3] * slope + c[4] * w * abs(w)
        return [steady + speed * (c[5] * x + c[6] * w) + c[7] * slope * abs(w)]

    w, out = w0, [w0]
    for i in range(len(t) - 1):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ran = odeint(rate, [w], t[i : i + 2], args=(i,), rtol=1e-11, atol=1e-13)
        w = float(ran[-1, 0])
        out.append(w)
    return np.array(out)


def drawn(seed):
    """A law and a record: some slow, some stiff, some sampled coarsely."""
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=8) * [0.3, 1, 1, 1, 0.3, 0.5, 1, 0.5]
    coefficients[[1, 6]] = -np.abs(coefficients[[1, 6]])  # most laws are stable
    coefficients[4] = -abs(coefficients[4])
    coefficients[1] *= 10 ** rng.uniform(-1, 4 if seed % 5 == 0 else 1)  # stiff
    t = np.cumsum(rng.uniform(0.5, 1.5, 61)) * 10 ** rng.uniform(-2, 0)
    turns = np.sin(np.linspace(0, rng.uniform(5, 60), 61))  # down to six a cycle
    terms = dict(zip(TERMS, coefficients, strict=True))
    return SparseModel.from_terms(terms), hj.Recording(t, turns, turns)


def test_default_simulations_are_as_accurate_as_asked_or_say_so():
    """Fifty laws and records that no rule was settled on: the error is within ten times
    of what was asked."""
    fast = 0
    for seed in range(50):
        law, record = drawn(1000 + seed)
        expected = by_lsoda(law, record, 0.1)
        ran = hj.simulate(law, record, w0=0.1, throw=False)
        if not np.all(np.isfinite(expected)) or np.max(np.abs(expected)) > 1e6:
            continue
        error = np.max(np.abs(np.asarray(ran.w) - expected))
        scale = max(np.max(np.abs(expected)), np.max(np.abs(record.w)))
        asked = 1e-7 if "error" in ran.stats else 1e-6  # of what takes over
        assert ran.result != RESULTS.successful or error < 10 * asked * scale, seed
        fast += ran.result == RESULTS.successful and "error" in ran.stats
    assert fast > 35


def test_more_steps_are_taken_where_they_are_needed():
    law = BoucWen(1.0, 0.5, 0.5, 1.0)
    times = np.linspace(0, 12, 3000), np.linspace(0, 12, 30)
    fine, coarse = (hj.Recording(t, np.sin(t), np.sin(t)) for t in times)
    few, many = (hj.simulate(law, r, w0=0.0).stats for r in (fine, coarse))
    assert few["num_steps"] == 2 * 2999 and many["num_steps"] > 4 * 29
    assert few["error"] < 1e-7 and many["error"] < 1e-7


def test_steps_are_counted():
    """So many in each of the intervals, one fewer than there are samples."""
    for substeps in (1, 3):
        ran = hj.simulate(
            MODELS["Duhem"], RECORD, w0=0.0, method=FixedStep(substeps), throw=False
        )
        assert ran.stats["num_steps"] == substeps * (len(T) - 1)


@pytest.mark.slow
def test_a_stiff_law_goes_to_another_method():
    law = SparseModel.from_terms({"w": -1e6, "u": 1e6})
    ran = hj.simulate(law, RECORD, w0=0.0)
    assert ran.result == RESULTS.successful and "error" not in ran.stats
    np.testing.assert_allclose(ran.w[1:], RANDOM[1:], atol=1e-5)
    # Where it cannot, the result says so, and the others of a batch do not mind.
    batch = jax.vmap(
        lambda k: hj.simulate(
            SparseModel.from_terms({"w": -1.0, "u": 1.0}).with_parameters({"w": -k}),
            RECORD,
            w0=0.0,
            throw=False,
        )
    )(jnp.array([1.0, 600.0]))
    good = [bool(each == RESULTS.successful) for each in _each(batch.result)]
    assert good == [True, False]
    assert bool(_each(batch.result)[1] == RESULTS.inaccurate)


@pytest.mark.slow
def test_a_force_that_chatters_is_told_as_well_as_it_is_known():
    """Dahl's force with hardly any exponent is elastic until it slides, and then goes
    to and fro about its limit: a play's stop, which no method follows closely."""
    law = hj.models.Dahl(10.0, 1.0, 0.007)
    t = np.linspace(0.0, 12.0, 1201)
    u = np.sin(2 * t) + np.sin(0.7 * t)
    record = hj.Recording(t, u, np.zeros_like(u))
    ran = hj.simulate(law, record)
    assert ran.result == RESULTS.inaccurate
    assert 0 < ran.stats["error"] < 0.01
    lost = hj.simulate(law, record, method=Automatic().otherwise, throw=False)
    assert lost.result != RESULTS.successful
    w = [0.0]
    for change in np.diff(u):
        w.append(np.clip(w[-1] + 10.0 * change, -1.0, 1.0))
    # But for the exponent itself, which bends a little before it slides.
    np.testing.assert_allclose(ran.w, w, atol=0.05)


def _each(results):
    return [jax.tree.map(lambda leaf, i=i: leaf[i], results) for i in range(2)]


def test_a_law_that_diverges_is_lost_and_not_stiff():
    """w' = w^2 from 1 is infinite at t = 1."""
    law = SparseModel.from_terms({"w^2": 1.0})
    ran = hj.simulate(law, RECORD, w0=1.0, throw=False)
    assert ran.result == RESULTS.diverged
    lost = np.flatnonzero(~np.isfinite(np.asarray(ran.w)))[0]
    assert 0.8 < T[lost] < 1.6


def test_coarse_steps_that_are_lost_are_followed_by_finer_ones():
    """w' = -w^2 from 1 is 1 / (1 + t). Steps of 10, 5 and 2.5 s leap below zero, from
    where all leads to -inf, of which infinitely much is no small share."""
    law, t = SparseModel.from_terms({"w^2": -1.0}), np.linspace(0, 600, 61)
    still, method = hj.Recording(t, 0 * t, 0 * t), Automatic(1e-5, otherwise=None)
    ran = hj.simulate(law, still, w0=1.0, method=method, throw=False)
    assert ran.result == RESULTS.successful and ran.stats["error"] < 1e-5
    np.testing.assert_allclose(ran.w, 1 / (1 + t), rtol=0, atol=1e-5)


class Clock(hj.models.AbstractModel):
    """x' = 1, with a kink where it is 0.1, which hardly shows from far, and one where
    it is 0.8, of which steps to it fall short."""

    def start(self, m, now, seen):
        return jnp.zeros_like(seen)

    def rate(self, x, m, now):
        return jnp.ones_like(x)

    def output(self, x, m, now):
        return x

    def kinks(self, x):
        return jnp.tanh(40 * (x - 0.1)), x**3 - 0.8**3


def test_steps_that_are_cut_at_a_kink_do_not_look_for_those_behind():
    t = np.linspace(0.0, 3.0, 4)
    path = hj.Recording(t, 0 * t, 0 * t).path
    w = run(Clock(), path, jnp.zeros(()), jnp.array(1))
    np.testing.assert_allclose(w, t, rtol=0, atol=1e-14)


class Unsure(hj.simulation.AbstractSimulation):
    """Tells no error."""

    other: Any = None

    @property
    def otherwise(self):
        return self.other

    def integrate(self, model, path, w0, scale):
        w, _, stats = FixedStep(2).integrate(model, path, w0, scale)
        return w, RESULTS.inaccurate, stats


def test_a_method_that_knows_no_error_may_fail_in_both_ways():
    law = Duhem(0.4, 0.5, 0.25)
    method = Unsure(Unsure())
    ran = hj.simulate(law, RECORD, w0=0.1, method=method, throw=False)
    assert ran.result == RESULTS.inaccurate


def test_an_output_that_is_lost_is_infinitely_far_off():
    fine = jnp.array([0.0, 1.0, -2.5])
    for lost in (math.inf, math.nan):
        coarse = fine.at[1].set(lost)
        assert _apart(coarse, fine) == _apart(fine, coarse) == math.inf
    assert _apart(fine, fine + jnp.array([0.25, -0.5, 0.0])) == 0.5


@pytest.mark.slow
def test_tolerances_of_numpy_are_those_of_python():
    law, rtol = MODELS["Duhem"], np.geomspace(1e-5, 1e-3, 3)[0]
    for method in (Automatic, Adaptive):
        one, other = (
            hj.simulate(law, RECORD, w0=0.0, method=method(rtol=each)).w
            for each in (1e-5, rtol)
        )
        np.testing.assert_array_equal(one, other)


def test_a_memory_alone_takes_no_steps():
    stack = hj.models.PrandtlIshlinskii([0.0, 0.2], [0.5, 0.3])
    beyond = hj.models.PrandtlIshlinskii([0.0, 0.2], [1.7e308, 1.7e308])
    for method in (Automatic(), FixedStep(2), Adaptive()):
        assert hj.simulate(stack, RECORD, method=method).stats["num_steps"] == 0
        # Finite at the first sample, and later more than a float holds.
        lost = hj.simulate(beyond, RECORD, method=method, throw=False)
        assert np.isfinite(lost.w[0]) and lost.result == RESULTS.diverged


@pytest.mark.parametrize("around", ["nothing", "instruments", "a start"])
def test_steps_end_where_a_spring_starts_to_slide(around):
    """Whatever is around it, so that a few steps a sample will do."""
    spring = SparseModel.from_terms({"stop(u,0.2)": 3.0, "u": 0.1}, target="value")
    half = SparseModel.from_terms({"stop(u,0.4)": 1.5, "u": 0.05}, target="value")
    at_rest = spring.memory.start(Signals(*jnp.zeros(3)))
    inside = {
        "nothing": spring,
        "instruments": hj.models.Instrumented(half, input_gain=2.0),
        "a start": hj.models.Started(spring, at_rest),
    }[around]
    machine = hj.models.Oscillator(1.0, 0.2, 1.0, inside)
    t = np.linspace(0, 20, 401)
    ran = hj.simulate(machine, hj.Recording(t, np.sin(1.3 * t), 0 * t), w0=0.0)
    assert ran.result == RESULTS.successful
    assert "error" in ran.stats and ran.stats["num_steps"] <= 16 * 400


def test_tolerances_are_kept():
    law = MODELS["Duhem"]
    expected = by_lsoda(SparseModel.from_terms(law.terms()), RECORD, 0.0)
    errors = []
    for rtol in (1e-3, 1e-6, 1e-9):
        ran = hj.simulate(law, RECORD, w0=0.0, method=Automatic(rtol))
        errors.append(np.max(np.abs(np.asarray(ran.w) - expected)))
        assert errors[-1] < rtol * np.max(np.abs(RANDOM))
    assert errors[2] < errors[0]


# ------------------------------------------------------------------------------- fits


@pytest.mark.slow
def test_a_fit_takes_the_steps_that_its_law_needs():
    """A loop of ten samples a cycle with a sharp knee: at one step a sample the fit of
    exact data ends beside the truth, which by itself it does not."""
    truth = {"du": 1.0, "w*|du|*|w|": -6.0, "du*|w|^2": -3.0}
    law = SparseModel.from_terms(truth)
    t = np.linspace(0, 30, 51)
    u = np.sin(t) * (1 + t / 20)
    w = hj.simulate(law, hj.Recording(t, u, u), w0=0.0, method=Adaptive()).w
    record = hj.Recording(t, u, w)
    start = SparseModel.from_terms({name: 0.8 * value for name, value in truth.items()})
    rough = hj.refine(start, record, substeps=1, throw=False)
    found = hj.refine(start, record)
    assert found.stats["substeps"] > 1
    for name, value in truth.items():
        assert found.value.terms()[name] == pytest.approx(value, rel=1e-4)
    apart = [abs(rough.value.terms()[n] / v - 1) for n, v in truth.items()]
    assert max(apart) > 1e-3
    finer = hj.simulate(found.value, record, w0=found.stats["w0"], method=Adaptive())
    error = np.sqrt(np.mean((np.asarray(finer.w) - np.asarray(record.w)) ** 2))
    assert error < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.95, 0.965, 1.02])
def test_a_stiff_law_is_not_left_for_an_output_of_zero(share):
    """Steps that are unstable where the fit begins lead it to a law that gives nothing,
    which itself needs no more of them."""
    truth = {"w": -28.0, "du": 2224.0, "w*|du|": -7276.0, "u*|w|": 946.0}
    t = np.linspace(0, 1, 101)
    record = hj.Recording(t, 0.04 * np.cos(3 * np.pi * t), np.full(101, 0.2))
    law = SparseModel.from_terms(truth)
    w = np.asarray(hj.simulate(law, record).w)
    noise = 0.05 * np.std(w) * np.random.default_rng(0).normal(size=len(t))
    start = SparseModel.from_terms({name: share * x for name, x in truth.items()})
    found = hj.refine(start, hj.Recording(t, record.u, w + noise))
    assert float(found.stats["rmse"][0]) == pytest.approx(np.std(noise), rel=0.1)
    for name, value in found.value.terms().items():
        assert abs(value - truth[name]) < 4 * float(
            found.stats["standard_errors"][name]
        )


@pytest.mark.parametrize(
    ("error", "left", "enough"),
    [
        # A hundredth of what is left may change, and a millionth of the output.
        (0.01, 1.0, 2),
        (0.9e-5, 0.0, 2),
        # 15 times as much needs twice as many steps of fourth order, 17 times four.
        (0.15, 1.0, 4),
        (0.17, 1.0, 8),
        (1e3, 1.0, 16),
        (math.inf, 1.0, 16),
        (math.nan, 1.0, 16),
        (1.0, math.inf, 16),
        (1e300, 1e-300, 16),
    ],
)
def test_how_many_steps_are_enough(error, left, enough):
    assert enough_steps(2, error, left, spread=10.0) == enough
    assert enough_steps(16, math.inf, left, 10.0) == 32
    assert enough_steps(64, math.inf, left, 10.0) == 64


def left_by_a_fit(left, error, result=RESULTS.successful):
    """A fit of two steps a sample to an output that spreads by 10."""
    rmse, error = np.array([left]), np.array(error)
    return SimpleNamespace(
        value=None,
        result=result,
        rmse=rmse,
        residuals=rmse[:, None],
        step_error=error,
        spread=10.0,
        substeps=2,
    )


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("left", "error", "expected"),
    [
        (5.0, 0.4, False),
        (5.0, 0.6, True),  # more than a tenth of what is left
        (0.0, 0.09, False),  # of a record without noise
        (0.0, 0.11, True),
        (9.8, 0.0, False),
        (9.95, 0.0, True),  # which explains nothing
        (1.0, math.nan, True),
    ],
)
def test_fits_that_their_steps_led_astray(left, error, expected):
    assert astray(left_by_a_fit(left, error)) == expected
    assert astray(left_by_a_fit(left, error, RESULTS.diverged))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("lost", [False, True])
def test_a_recording_that_weights_leave_out_is_none_that_is_lost(lost):
    fit = left_by_a_fit(1.0, 0.0)
    fit.rmse = np.array([1.0, math.nan])
    fit.residuals = np.array([[1.0], [math.nan if lost else 0.0]])
    assert astray(fit) == lost


@pytest.mark.slow
@pytest.mark.parametrize("front", ["play", "stop"])
def test_what_moves_where_a_rate_jumps_has_a_derivative(front):
    """Of a device behind a play, which starts to move elsewhere if that is wider."""
    t = np.linspace(0.0, 12.0, 120)
    u = np.sin(1.7 * t) * np.exp(-t / 30) + 0.4 * np.sin(4.1 * t)
    device = hj.models.Behind(Dahl(3.0, 0.8), f"{front}(u,0.25)")

    def squares(radius, method):
        moved = device.with_parameters({f"{front}.radius": radius})
        record = hj.Recording(t, u, np.zeros_like(u))
        return jnp.sum(hj.simulate(moved, record, w0=0.0, method=method).w ** 2)

    h, radius = 1e-4, jnp.asarray(0.25)
    ahead, behind = (squares(radius + x, FixedStep(16)) for x in (h, -h))
    slope = jax.grad(squares)(radius, Adaptive())
    assert float(slope) == pytest.approx(float(ahead - behind) / (2 * h), rel=1e-4)


def test_a_run_that_is_lost_while_its_derivative_is_taken_says_so():
    law = SparseModel.from_terms({"w^2": 3.0, "u": 1.0})

    def end(x):
        method, model = FixedStep(2), law.with_parameters({"w^2": x})
        return hj.simulate(model, RECORD, w0=2.0, method=method).w[-1]

    with pytest.raises(hj.ComputationError, match="did not stay finite"):
        jax.grad(end)(jnp.asarray(3.0))


@pytest.mark.usefixtures("unchecked")
def test_what_lines_miss_is_told_beside_what_a_fit_leaves():
    """Over a step h they miss a sine by h^2/8 of its spread; the output's is 10."""
    t = np.linspace(0, 20, 401)
    line, sine = (hj.Recording(t, u, t) for u in (t, np.sin(t)))
    missed = t[1] ** 2 / 8
    for share, told in ((3.0, True), (3.6, False)):  # a third of what is left
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warn_of_lines((sine,), left_by_a_fit(10 * share * missed, 0.0))
        assert bool(caught) == told
        known = known_to((line, sine), share * missed)
        assert known == pytest.approx(missed, rel=0.02)
    assert known_to((line,), 1.0) == 1e-5


@pytest.mark.slow
def test_what_lines_miss_of_a_rate_is_told_where_the_output_sees_it():
    """Of a step h they miss h/2 u'' there, and only h^2/8 u'' of the input."""
    t = np.linspace(0, 20, 401)
    u, noise = np.sin(t), 0.01 * np.random.default_rng(0).normal(size=401)
    law = SparseModel.from_terms({"u": 1.0, "du": 2.0}, target="value")
    cubic = hj.interpolation.Cubic()
    smooth = hj.Recording(t, u, u + 2 * np.cos(t) + noise, interpolation=cubic)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hj.refine(law, smooth)
        hj.refine(SparseModel.from_terms({"u": 1.0}, target="value"), smooth)
    with pytest.warns(UserWarning, match="of this model sees it by about (.*?) %") as c:
        hj.refine(law, hj.Recording(t, u, smooth.w))
    told = float(re.search(r"about (\S+) %", str(c[0].message))[1])
    missed = float(t[1] * np.std(u) / np.std(smooth.w))
    assert told == pytest.approx(100 * missed, rel=0.05)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("left", "error", "at_start", "expected"),
    [
        (9.8, 0.0, 5.0, 2),
        (9.95, 0.0, 0.05, 2),
        (9.95, 0.0, 5.0, 8),  # of 50 times what they may change
        (9.95, 5.0, 0.0, 8),
        (9.95, 0.0, math.nan, 16),
    ],
)
def test_a_fit_that_explains_nothing_has_the_steps_of_its_start(
    left, error, at_start, expected
):
    assert enough(left_by_a_fit(left, error), lambda: at_start) == expected


@pytest.mark.thorough
def test_a_law_that_turns_round_between_two_samples_is_discovered():
    """Friction whose force follows its direction at once, recorded coarsely: with one
    step a sample each law that explains the record is lost."""
    t = np.linspace(0, 10, 201)
    u = np.sin(2.5 * t)
    law = SparseModel.from_terms({"du": 60.0, "w*|du|": -60.0})
    w = hj.simulate(law, hj.Recording(t, u, u), w0=0.0).w
    noise = 0.02 * np.random.default_rng(0).normal(size=len(t))
    library = hj.library.Polynomial(2, ("w", "du", "|du|"))
    record = hj.Recording(t, u, w + noise)
    found = hj.discover(record, library, largest=2, width=3)
    assert set(found.value.terms()) == {"du", "w*|du|"}
    assert found.stats["substeps"] >= 4
    for name, value in found.value.terms().items():
        error = float(found.stats["standard_errors"][name])
        assert abs(value - law.terms()[name]) < 4 * error
    # Drawn again, too, with the steps that it needs.
    shares = hj.inclusion(found, record, key=jax.random.key(0), largest=2)
    assert shares["du"] == shares["w*|du|"] == 1.0


@pytest.mark.slow
def test_a_fit_with_too_few_steps_says_so():
    law = SparseModel.from_terms({"w": -40.0, "u": 40.0})
    t = np.linspace(0, 6, 61)
    record = hj.Recording(t, np.arcsin(np.sin(5 * t)), np.arcsin(np.sin(5 * t - 0.12)))
    with pytest.warns(UserWarning, match="with 1 steps a sample interval.*substeps"):
        hj.refine(
            SparseModel.from_terms({"w": -20.0, "u": 20.0}),
            record,
            substeps=1,
            throw=False,
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = hj.refine(law, record)
    assert found.stats["substeps"] > 1


def test_steps_of_fits_can_be_asked_under_jit():
    record = hj.Recording(T, RANDOM, hj.simulate(MODELS["Duhem"], RECORD, w0=0.0).w)
    found = eqx.filter_jit(lambda r: hj.refine(MODELS["Duhem"], r, throw=False))(record)
    assert found.stats["substeps"] == 1 and found.stats["step_error"] < 1e-3


def test_the_step_of_a_state_driven_by_time_alone():
    """y' = t by one step of a user's own model: exact, and at the right times."""

    class Ramp(hj.models.AbstractModel):
        def rate(self, x, m, now):
            return now.t

        def output(self, x, m, now):
            return x

    ran = hj.simulate(Ramp(), RECORD, w0=1.0)
    np.testing.assert_allclose(ran.w, 1 + T**2 / 2, rtol=1e-12)
    state = step(Ramp(), (jnp.asarray(0.0), ()), at(RECORD.path.grid(1), 5))
    np.testing.assert_allclose(state[0], (T[6] ** 2 - T[5] ** 2) / 2, rtol=1e-12)


class TwoLags(hj.models.AbstractModel):
    """Two lags in series, from rest; a state of two numbers, however kept."""

    speed: Array
    kept: Any = eqx.field(static=True)
    first: tuple = eqx.field(static=True)

    def start(self, m, now, seen):
        return self.kept(*self.first)

    def rate(self, x, m, now):
        first, last = x.values() if isinstance(x, dict) else x
        rates = self.speed * (now.u - first), self.speed * (first - last)
        return self.kept(*rates)

    def output(self, x, m, now):
        return x["b"] if isinstance(x, dict) else x[1]


def as_dict(first, last):
    return {"a": first, "b": last}


@pytest.mark.parametrize(
    "made",
    [(as_dict, (0.0, 0)), (lambda *x: x, (0.0, 0)), (lambda *x: jnp.array(x), (0, 0))],
    ids=["mixed", "plain", "whole"],
)
def test_states_that_start_as_plain_or_whole_numbers(made):
    """Under a ramp the second lag is at t - 2 T + (t + 2 T) exp(-t / T)."""
    t = np.linspace(0, 3, 31)
    expected = t - 1 + (t + 1) * np.exp(-2 * t)
    record = hj.Recording(t, t, expected)
    for method in (FixedStep(8), Automatic()):
        ran = hj.simulate(TwoLags(jnp.asarray(2.0), *made), record, method=method)
        np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-7)
    if made[0] is as_dict:
        found = hj.refine(TwoLags(jnp.asarray(1.5), *made), record, substeps=8).value
        assert float(found.speed) == pytest.approx(2.0, abs=1e-9)


INPUTS = {
    "multisine": (lambda t: np.sin(5 * t) + np.sin(7 * t + 1), True),
    "triangle": (lambda t: np.abs((t % 2) - 1), False),
    "walk": (lambda t: np.cumsum(np.random.default_rng(1).normal(size=len(t))), False),
    "slow sine": (lambda t: np.sin(0.05 * t), False),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", INPUTS)
def test_smooth_inputs_that_are_taken_for_straight_lines_are_told(name):
    """Of an output with 1 % of noise: what is missed of slow inputs is little."""
    (u, told), t = INPUTS[name], np.linspace(0, 40, 241)
    cubic = hj.interpolation.Cubic()
    smooth = hj.Recording(t, u(t), t, interpolation=cubic)
    method = FixedStep(8)  # fine enough for an output with noise
    w = np.asarray(hj.simulate(MODELS["Duhem"], smooth, w0=0.0, method=method).w)
    w = w + 0.01 * np.std(w) * np.random.default_rng(2).normal(size=len(t))
    for interpolation, expected in ((hj.interpolation.Linear(), told), (cubic, False)):
        record = hj.Recording(t, u(t), w, interpolation=interpolation)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            hj.refine(MODELS["Duhem"], record, throw=False)
        assert any("the input is smooth" in str(c.message) for c in caught) == expected


# ------------------------------------------------------------------- times out of order


def ended(verb, method, t):
    """How a verb ends, called on a recording whose times are traced."""
    record, law = hj.Recording(t, RANDOM, np.cos(T)), MODELS["Duhem"]
    if verb == "identify":
        return hj.identify(record, hj.library.Duhem(), throw=False).result
    if verb == "refine":
        return hj.refine(law, record, throw=False).result
    return hj.simulate(law, record, method=method, throw=False).result


@pytest.mark.parametrize(
    ("verb", "method"),
    [
        ("simulate", FixedStep()),
        ("simulate", Automatic()),
        ("simulate", Adaptive()),
        ("identify", None),
        pytest.param("refine", None, marks=pytest.mark.slow),
    ],
    ids=["fixed step", "automatic", "adaptive", "identify", "refine"],
)
def test_unsorted_times_under_vmap_end_in_a_result(verb, method):
    """Outside they are an `InputError`; a lane in order beside them is not touched."""
    swapped, repeated = T.copy(), T.copy()
    swapped[[30, 31]] = T[[31, 30]]
    repeated[30] = T[29]
    lanes = jnp.asarray(np.stack([T, T[::-1], swapped, repeated]))
    with pytest.raises(hj.InputError, match="`t` must increase strictly"):
        ended(verb, method, lanes[1])

    def lane(t):
        result = ended(verb, method, t)
        return result == RESULTS.successful, result == RESULTS.unsorted_time

    good, unsorted = jax.jit(jax.vmap(lane))(lanes)
    np.testing.assert_array_equal(good, [True, False, False, False])
    np.testing.assert_array_equal(unsorted, [False, True, True, True])


FULL = np.arange(1.0, 4.0)


@pytest.mark.parametrize(
    "method, many",
    [
        (Adaptive(), False),
        pytest.param(Adaptive.stiff(), False, marks=pytest.mark.slow),
        pytest.param(Adaptive(), True, marks=pytest.mark.slow),
    ],
    ids=["few", "implicit", "many"],
)
def test_derivatives_of_adaptive_steps_are_those_of_differences(method, many):
    """By three coefficients, or with them by all samples of the input."""
    t = np.linspace(0.0, 10.0, 150)
    u, along = jnp.asarray(np.sin(t) * np.exp(-t / 20)), np.cos(3 * t) * many

    def squares(coefficients, u, method):
        law = Duhem(*(0.1 * coefficients))
        record = hj.Recording(t, u, jnp.zeros_like(u))
        return jnp.sum(hj.simulate(law, record, method=method).w ** 2)

    by = (0, 1) if many else 0
    found = jax.jit(jax.grad(partial(squares, method=method), by))(FULL, u)
    by_coefficients, by_input = found if many else (found, jnp.zeros_like(u))
    slope = by_coefficients @ FULL + by_input @ along
    h = 1e-4
    # By steps that do not change with the numbers, as those of the method do.
    ahead, behind = (
        squares((1 + x) * FULL, u + x * along, FixedStep(16)) for x in (h, -h)
    )
    assert slope == pytest.approx(float(ahead - behind) / (2 * h), rel=1e-5)
