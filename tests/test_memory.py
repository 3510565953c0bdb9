"""Play and lag: exact along any input, as variables of laws, in every verb."""

import dataclasses
import itertools
import warnings

import classical_equations as by_hand
import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import exp1

import hystjax as hj
from hystjax import InputError
from hystjax.library import Kind, Lag, Library, LogCreep, Play, Polynomial, Term, Track
from hystjax.models import SparseModel, Started
from hystjax.regression.formulation import Direct
from hystjax.signals import Cubic, Signals
from hystjax.simulation import Adaptive, Automatic, FixedStep

RNG = np.random.default_rng(30)
T = np.linspace(0.0, 20.0, 801)
WALK = 0.1 * np.cumsum(RNG.normal(size=801))
RADII, WEIGHTS = np.array([0.0, 0.1, 0.25, 0.5]), np.array([0.3, 0.4, 0.3, 0.2])


def stack(radii=RADII, weights=WEIGHTS, **named):
    terms = {f"play(u,{r})": w for r, w in zip(radii, weights, strict=True)}
    return SparseModel.from_terms(terms, target="value", **named)


WALKED = hj.Recording(T, WALK, by_hand.plays(WALK, RADII) @ WEIGHTS)
SHORT = WALKED.window(0, 120)
METHODS = [FixedStep(1), FixedStep(3), Adaptive(), Automatic()]


# ------------------------------------------------------------------------- exactness


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_plays_are_exact_for_straight_lines(method):
    ran = hj.simulate(stack(), WALKED, method=method)
    np.testing.assert_allclose(ran.w, WALKED.w, rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", [FixedStep(2), Adaptive(), Automatic()], ids=repr)
def test_plays_are_exact_where_the_input_turns_between_samples(method):
    """A sine turns at odd multiples of pi / 2: from one to the next a play goes through
    the values that a dense sampling with the turns in it gives."""
    t = np.linspace(0, 12, 31)
    record = hj.Recording(t, np.sin(t), t).with_input(jnp.sin)
    turns = np.pi / 2 + np.pi * np.arange(4)
    dense = np.sort(np.r_[t, turns])
    expected = by_hand.plays(np.sin(dense), RADII)[np.isin(dense, t)] @ WEIGHTS
    ran = hj.simulate(stack(), record, method=method)
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", [FixedStep(2), Adaptive(), Automatic()], ids=repr)
@pytest.mark.parametrize("time", [0.05, 0.7, 30.0])
def test_lags_are_those_of_scipy(method, time):
    # One program for all times: the constant is a leaf of the law.
    law = SparseModel.from_terms({"lag(u,1.0)": 1.0}, target="value")
    law = law.with_parameters({"lag(u,1.0).time": jnp.asarray(time)})

    def reference(u, pieces):
        z, out = [u(pieces[0])], [u(pieces[0])]
        for a, b in itertools.pairwise(pieces):
            rate = lambda t, z: (u(t) - z) / time  # noqa: E731
            ran = solve_ivp(rate, (a, b), z, "DOP853", rtol=1e-12, atol=1e-13)
            z = ran.y[:, -1]
            out.append(z[0])
        return np.array(out)

    t = T[:200]
    smooth = hj.Recording(t, np.sin(t), t).with_input(jnp.sin)
    w = hj.simulate(law, smooth, method=method).w
    np.testing.assert_allclose(w, reference(np.sin, t), rtol=0, atol=1e-9)
    straight = hj.Recording(t[::10], WALK[:200:10], t[::10])
    knots = lambda x: np.interp(x, t[::10], WALK[:200:10])  # noqa: E731
    w = hj.simulate(law, straight, method=method).w
    np.testing.assert_allclose(w, reference(knots, t[::10]), rtol=0, atol=1e-9)


CREPT = {"u": 1.0, "creep(u,0.1,1000.0)": 0.05}


def test_creep_goes_with_the_logarithm_of_time(tmp_path):
    """After a step each decade between both times adds as much: the integral over the
    times of lags has a closed form."""
    t = np.concatenate([[0, 1e-6], np.geomspace(1e-3, 1e4, 400)])
    u = np.where(t > 0, 2.0, 0.0)
    law = SparseModel.from_terms(CREPT, target="value")
    w = hj.simulate(law, hj.Recording(t, u, u)).w
    after = t[1:]
    decades = np.log(1e4) + exp1(after / 0.1) - exp1(after / 1000)
    expected = 2 + 0.05 * 2 * decades / np.log(10)
    np.testing.assert_allclose(w[1:], expected, rtol=0, atol=0.012 * 0.1)
    python = {}
    exec(hj.export.to_python(law), python)
    memory, by_hand = python["start"](u[0]), []
    for i in range(len(t)):
        if i:
            memory = python["after"](memory, u[i - 1], u[i], t[i] - t[i - 1])
        by_hand.append(python["value"](u[i], memory))
    np.testing.assert_allclose(w, by_hand, rtol=0, atol=1e-12)
    hj.save(tmp_path / "law.json", law)
    assert hj.load(tmp_path / "law.json").terms() == law.terms()


@pytest.mark.slow
def test_creep_is_found_by_one_linear_fit_and_its_times_stay():
    play = "play(u,0.4)"
    law = SparseModel.from_terms(
        CREPT | {f"creep({play},0.1,1000.0)": 0.2}, target="value"
    )
    t = np.linspace(0, 200, 4001)
    u = np.sin(t / 5) * np.exp(-t / 300)
    w = hj.simulate(law, hj.Recording(t, u, u)).w
    library = Library((Term(),)) + Polynomial(1, ("u",), constant=False)
    for of in ("u", play):
        library = library + LogCreep(0.1, 1000, of)
    rec = hj.Recording(t, u, w)
    found = hj.identify(
        rec, library, hj.regression.LeastSquares(), formulation=Direct()
    )
    for name, coefficient in law.terms().items():
        assert abs(found.value.terms()[name] - coefficient) < 1e-9
    free = set(law.parameters())
    assert free == {*law.terms(), f"{play}.radius"}


def test_creep_of_plays_is_not_linear():
    for name, kind in (("u", Kind.LINEAR), ("play(u,0.4)", Kind.RATE_DEPENDENT)):
        for term in (f"creep({name},0.1,10.0)", f"lag({name},0.1)"):
            law = SparseModel.from_terms({term: 1.0}, target="value")
            assert law.kind is kind


def test_a_lag_is_exact_for_cubic_inputs_whatever_the_step():
    """z = e^(-t/a) (z0 - P(0)) + P(t) with P = u - a u' + a^2 u'' - a^3 u'''."""
    a, h = 0.8, np.array([1e-9, 1e-4, 0.3, 0.79, 0.81, 5.0, 800.0])
    u = np.polynomial.Polynomial([0.3, -1.0, 0.5, 0.02])
    particular = sum((-a) ** k * u.deriv(k) if k else u for k in range(4))
    expected = np.exp(-h / a) * (0.7 - particular(0.0)) + particular(h)
    before = Signals(jnp.zeros(7), jnp.full(7, u(0.0)), jnp.full(7, u.deriv()(0.0)))
    now = Signals(jnp.asarray(h), jnp.asarray(u(h)), jnp.asarray(u.deriv()(h)))
    library = Lag([a])
    after = jax.vmap(lambda b, n: library.memory.after((jnp.array([0.7]),), b, n))
    (found,) = after(before, now)
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-12)


@jax.jit
def signal_of_play(radius, u):
    (p,) = Play(radius[None]).signals(hj.Recording(None, u, u).path).values()
    return p


@given(st.lists(st.floats(-2, 2), min_size=12, max_size=12), st.floats(0, 1))
def test_plays_stay_within_their_radius_and_move_only_when_pulled(inputs, radius):
    u = jnp.asarray(inputs)
    p = signal_of_play(jnp.asarray(radius), u)
    assert jnp.all(jnp.abs(p - u) <= radius + 1e-12)
    inside = jnp.abs(p[:-1] - u[1:]) < radius - 1e-12
    # To rounding: where a line ends is computed from where it started.
    assert jnp.all((jnp.abs(p[1:] - p[:-1]) <= 1e-15) | ~inside)


def test_memory_is_known_at_any_time():
    library = Play([0.2, 0.4]) + Lag([0.5])
    times = np.sort(RNG.uniform(0, 20, 300))
    track = Track(library.memory, WALKED.path)
    found = eqx.filter_jit(track.values)(jnp.asarray(times))
    dense = np.sort(np.r_[T, times])
    u = np.interp(dense, T, WALK)
    expected = by_hand.plays(u, np.array([0.2, 0.4]))[np.isin(dense, times)]
    np.testing.assert_allclose(found["play(u,0.2)"], expected[:, 0], atol=1e-14)
    np.testing.assert_allclose(found["play(u,0.4)"], expected[:, 1], atol=1e-14)
    lags = hj.Recording(dense, u, u)
    (expected,) = Lag([0.5]).signals(lags.path).values()
    expected = np.asarray(expected)[np.isin(dense, times)]
    np.testing.assert_allclose(found["lag(u,0.5)"], expected, atol=1e-12)


@pytest.mark.parametrize("radius", [0.0, 0.13, 0.4])
def test_the_derivative_with_the_radius(radius):
    @jax.jit
    def outputs(radius):
        (p,) = Play(jnp.array([radius])).signals(SHORT.path).values()
        return p

    h = 1e-7  # at 0 a radius can only grow
    low, high = (radius, radius + h) if radius == 0 else (radius - h, radius + h)
    expected = (outputs(high) - outputs(low)) / (high - low)
    for jacobian in (jax.jacfwd, jax.jacrev):
        found = jax.jit(jacobian(outputs))(jnp.asarray(radius))
        # Between the two radii some samples pass from one side to the other.
        agree = np.isclose(found, expected, rtol=0, atol=1e-6)
        assert np.mean(agree) > 0.99 and set(np.unique(found)) <= {-1.0, 0.0, 1.0}


def test_the_derivative_with_the_time_constant():
    @jax.jit
    def outputs(time):
        (z,) = Lag(jnp.array([time])).signals(SHORT.path).values()
        return z

    h = 1e-5
    expected = (outputs(0.7 + h) - outputs(0.7 - h)) / (2 * h)
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(jacobian(outputs))(0.7), expected, atol=1e-8)


def test_the_sign_of_a_radius_has_no_meaning():
    """So that a fit needs no bound on it; on either side its slope is the other way."""
    name = "play(u,0.25).radius"

    @jax.jit
    def last(radius):
        law = stack().with_parameters({name: radius})
        return hj.simulate(law, SHORT, method=FixedStep(1)).w

    radii = jnp.array([0.2, -0.2])
    one, other = jax.vmap(last)(radii)
    expected = by_hand.plays(WALK[:120], np.array([0.0, 0.1, 0.2, 0.5])) @ WEIGHTS
    for found in (one, other):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
    up, down = jax.vmap(jax.jacfwd(last))(radii)
    np.testing.assert_array_equal(up, -down)


# ----------------------------------------------------------------------------- windows


def test_windows_remember_what_came_before_them():
    whole = hj.simulate(stack(), WALKED).w
    window = WALKED.window(300, 500)
    np.testing.assert_allclose(hj.simulate(stack(), window).w, whole[300:500])
    again = window.window(50, 150)
    np.testing.assert_allclose(hj.simulate(stack(), again).w, whole[350:450])
    _, second = WALKED.split(0.5)
    half = round(0.5 * 801)
    np.testing.assert_allclose(hj.simulate(stack(), second).w, whole[half:])
    later = WALKED.between(10.0, 15.0)
    inside = (T >= 10) & (T < 15)
    np.testing.assert_allclose(hj.simulate(stack(), later).w, whole[inside])
    finer = WALKED.resample(np.linspace(T[400], T[600], 601))
    np.testing.assert_allclose(hj.simulate(stack(), finer).w[::3], whole[400:601])

    fresh = by_hand.plays(WALK[300:500], RADII) @ WEIGHTS
    np.testing.assert_allclose(hj.simulate(stack(), window.afresh()).w, fresh)
    assert not np.allclose(fresh, whole[300:500], atol=1e-3)
    other = window.with_input(np.asarray(window.u) + 1.0)
    assert other.past is None


def test_windows_of_smooth_inputs_remember_too():
    """The turning points in what came before lie between its samples."""
    t = np.linspace(0, 20, 400)
    u = np.sin(t) * np.exp(-t / 30)
    record = hj.Recording(t, u, u, interpolation=Cubic())
    law = SparseModel.from_terms(
        {"play(u,0.4)": 1.0, "lag(u,3.0)": 1.0}, target="value"
    )
    whole, part = (
        hj.simulate(law, record).w,
        hj.simulate(law, record.window(250, 400)).w,
    )
    np.testing.assert_allclose(part, whole[250:], rtol=0, atol=1e-8)


def test_what_came_before_is_no_matter_to_laws_without_memory():
    law = SparseModel.from_terms({"du": 1.0, "w*|du|": -0.5})
    window = WALKED.window(300, 500)
    ran, fresh = hj.simulate(law, window), hj.simulate(law, window.afresh())
    np.testing.assert_array_equal(ran.w, fresh.w)


def test_identify_and_refine_use_what_came_before():
    window = WALKED.window(300, 500)
    found = hj.identify(
        window, Play(RADII), hj.regression.LeastSquares(), formulation=Direct()
    )
    values = list(found.value.terms().values())
    np.testing.assert_allclose(values, WEIGHTS, rtol=1e-9)
    start = stack(RADII * 1.05)
    refined = hj.refine(start, [window, WALKED.window(600, 801), WALKED.window(0, 90)])
    numbers = refined.value.parameters()
    radii = [x for name, x in numbers.items() if name.endswith(".radius")]
    np.testing.assert_allclose(list(numbers.values())[:4], WEIGHTS, rtol=1e-9)
    np.testing.assert_allclose(radii, RADII[1:], rtol=1e-9)


def test_a_first_memory_that_nobody_knows_is_fitted(tmp_path):
    radii, weights = np.array([0.3, 0.8]), np.array([1.0, 0.7])
    before = by_hand.plays(WALK[:101], radii)[-1]
    window, law = WALKED.window(100, 300), stack(radii, weights)
    w = by_hand.plays(WALK[100:300], radii, before) @ weights
    blind = hj.Recording(window.t, window.u, w)
    resumed = Started.at_rest(law, blind)
    at_rest = by_hand.plays(WALK[100:101], radii)[-1]
    np.testing.assert_allclose(resumed.state[0], at_rest)
    assert np.max(np.abs(at_rest - before)) > 0.1
    found = hj.refine(resumed, blind, fixed=list(law.parameters()))
    np.testing.assert_allclose(found.value.state[0], before, atol=1e-9)
    assert set(found.stats["standard_errors"]) == {"state.0[0]", "state.0[1]"}
    # What the input did before a window is then no matter.
    np.testing.assert_allclose(hj.simulate(found.value, window).w, w, atol=1e-9)
    hj.save(tmp_path / "law.json", found.value)
    again = hj.load(tmp_path / "law.json")
    np.testing.assert_array_equal(again.state[0], found.value.state[0])
    assert str(again) == str(found.value)


@pytest.mark.parametrize("front", [False, True])
def test_a_first_memory_is_the_given_one_inside_of_others_too(front):
    """Whatever the input did before a window; but what is in front of it saw that."""
    radii, state = np.array([0.3, 0.8]), np.array([-0.2, 0.1])
    law = hj.models.PrandtlIshlinskii(radii, np.ones(2))
    started = Started(law, jnp.asarray(state))
    signal = 2.0 * WALK
    model = hj.models.Instrumented(started, input_gain=2.0)
    if front:
        signal = 2.0 * by_hand.play(WALK, 0.1)
        model = hj.models.Behind(model, "play(u,0.1)")
    expected = np.sum(by_hand.plays(signal[100:300], radii, state), axis=1)
    window = WALKED.window(100, 300)
    found = hj.simulate(model, window).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    # Matched from there as well: what it was made from is the minimum.
    free = ["weights[0]", "weights[1]"]
    fixed = [name for name in model.parameters() if name not in free]
    made = eqx.tree_at(lambda each: each.w, window, jnp.asarray(expected))
    fit = hj.refine(model, made, fixed=fixed)
    numbers = [float(fit.value.parameters()[name]) for name in free]
    np.testing.assert_allclose(numbers, 1.0, atol=1e-9)
    assert fit.stats["rmse"][0] < 1e-9


@pytest.mark.parametrize("state", [0.0, np.zeros(3), (0.0, 0.0), np.zeros(2, int)])
def test_a_first_memory_of_another_kind_is_refused(state):
    law = hj.models.PrandtlIshlinskii([0.3, 0.8], [1.0, 1.0])
    with pytest.raises(hj.InputError, match=r"`state` must .* float\[2\]; got"):
        Started(law, state)
    assert "state[1]" in Started(law, np.zeros(2)).parameters()


def test_a_saved_state_is_of_the_same_plays_as_before(tmp_path):
    """In a product of plays, whose radii have gone past each other."""
    terms = {"u": 1.0, "play(u,0.21)*play(u,0.22)": 0.8}
    law = SparseModel.from_terms(terms, target="value").with_parameters(
        {"play(u,0.21).radius": 0.3, "play(u,0.22).radius": 0.15}
    )
    record = WALKED.window(100, 300)
    begun = Started.at_rest(law, record)
    moved = dict(zip(list(begun.parameters())[-2:], (0.25, -0.14), strict=True))
    begun = begun.with_parameters(moved)
    hj.save(tmp_path / "begun.json", begun)
    expected = hj.simulate(begun, record).w
    again = hj.simulate(hj.load(tmp_path / "begun.json"), record).w
    np.testing.assert_array_equal(again, expected)


# ------------------------------------------------------------------- laws of the value


def device(noise=0.0, seed=0, radii=np.linspace(0, 0.9, 10), u=WALK):
    weights = np.linspace(0.5, 0.1, len(radii))
    w = by_hand.plays(u, radii) @ weights
    drawn = np.random.default_rng(seed).standard_normal(len(u))
    return hj.Recording(T, u, w + noise * w.std() * drawn), radii, weights


def test_ten_plays_are_found_by_one_linear_fit():
    record, radii, weights = device()
    found = hj.identify(
        record, Play(radii), hj.regression.NonNegative(), formulation=Direct()
    )
    values = list(found.value.terms().values())
    np.testing.assert_allclose(values, weights, rtol=0, atol=1e-9)
    assert found.value.target == "value" and str(found.value).startswith("w = ")
    assert found.value.kind is Kind.RATE_INDEPENDENT
    ran = hj.simulate(found.value, record)
    np.testing.assert_allclose(ran.w, record.w, rtol=0, atol=1e-10)


def test_a_dictionary_of_plays_follows_an_input_that_it_has_not_seen():
    record, *_ = device(0.01, 4)
    other = np.sin(1.3 * T) + 0.6 * np.sin(3.7 * T)
    unseen, *_ = device(u=other * np.ptp(WALK) / np.ptp(other) / 2 + np.mean(WALK))
    library = Play(np.linspace(0, 1.2, 40))
    found = hj.identify(
        record, library, hj.regression.NonNegative(), formulation=Direct()
    ).value
    assert 100 * hj.judge(found, unseen).errors["nrmse"] < 0.3
    assert all(value > 0 for value in found.terms().values())


def test_radii_are_refined():
    record, radii, weights = device(0.005, 7, np.array([0.0, 0.2, 0.5, 0.8]))
    off = radii * [1, 1.1, 0.9, 1.1]
    refined = hj.refine(stack(off, weights), record)
    numbers, errors = refined.value.parameters(), refined.stats["standard_errors"]
    assert set(numbers) == set(errors) == set(refined.stats["certainty"].names)
    found = [x for name, x in numbers.items() if name.endswith(".radius")]
    spread = [float(e) for name, e in errors.items() if name.endswith(".radius")]
    assert np.all(np.abs(np.array(found) - radii[1:]) < 4 * np.array(spread))
    # Names show the numbers found, and nothing is rounded on the way.
    again = [float(name[7:-1]) for name in refined.value.terms()][1:]
    np.testing.assert_array_equal(again, found)
    held = hj.refine(stack(off, weights), record, fixed=list(numbers_of(off)))
    assert set(held.value.terms()) == set(stack(off, weights).terms())


def numbers_of(radii):
    return stack(radii).library.numbers


@pytest.mark.slow
def test_the_sensitivity_of_memory_is_that_of_differences():
    record, *_ = device(0.01, 3)
    law = SparseModel.from_terms(
        {"du": 0.5, "play(u,0.3)": 1.5, "w": -1.0, "u*lag(u,0.7)": 0.2}
    )
    parameters = hj.refinement.parameters(law, (), {}, {})
    assert parameters.change_memory
    samples = hj.refinement.samples([record.window(100, 300)], None, 2)
    objective = hj.refinement.Objective(
        parameters, samples, hj.refinement.Squares(), 1, 0.0, "state"
    )
    first = hj.refinement.first_unknowns(objective)
    jacobian = eqx.filter_jit(hj.refinement.linearised)(objective, first).jacobian

    @jax.jit
    @jax.vmap
    def outputs(values):
        unknowns = dataclasses.replace(first, values=values)
        return objective.run(unknowns).outputs[0]

    h = 1e-6 * np.eye(len(parameters.names))
    expected = (outputs(first.values + h) - outputs(first.values - h)) / 2e-6
    for name, ours, theirs in zip(
        parameters.names, jacobian.T[:-1], expected, strict=True
    ):
        close = np.isclose(ours, theirs, rtol=1e-5, atol=1e-6)
        assert np.mean(close) > 0.97, name


def test_laws_of_the_value_have_no_output_in_them():
    with pytest.raises(
        InputError, match=r"cannot hold w: leave out \['w', 'w\*\|du\|'\]"
    ):
        SparseModel.from_terms({"w": 1.0, "u": 1.0, "w*|du|": 1.0}, target="value")
    with pytest.raises(
        InputError, match=r"leave out \['w', '\|w\|', 'w\^2'.*`library`"
    ):
        hj.identify(WALKED, Polynomial(2), formulation=Direct())
    with pytest.raises(InputError, match="`target` must be 'rate' or 'value'"):
        SparseModel.from_terms({"u": 1.0}, target="output")


@pytest.mark.parametrize("offset", [100, -100])
def test_an_offset_that_thresholds_would_take_for_the_law_is_warned_of(offset):
    truth = SparseModel.from_terms({"u": 1.0, "play(u,0.5)": 2.0}, target="value")
    w, u = np.asarray(hj.simulate(truth, WALKED).w), WALKED.u
    library = Library(tuple(map(Term.parse, ("1", "u", "play(u,0.5)"))))
    far = hj.Recording(WALKED.t, u, w + offset * np.std(w), units=("V", "µm"))
    dropped = hj.regression.STLSQ().threshold * np.sqrt(np.mean(far.w**2))
    said = f"changes by {np.std(w):.2g} µm .* below {dropped:.2g} µm are .* offset from"
    with pytest.warns(UserWarning, match=said):
        lost = hj.identify(far, library, formulation=Direct()).value
    assert lost.terms().keys() == {"1"}
    for settings in (
        hj.regression.STLSQ(1e-3),
        hj.regression.STLSQ(0.1, normalise=False),  # of coefficients, not of the output
        hj.regression.LeastSquares(),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = hj.identify(far, library, settings, formulation=Direct()).value
        assert found.terms()["play(u,0.5)"] == pytest.approx(2.0, rel=1e-9)
    rates = Library(tuple(map(Term.parse, ("u", "du"))))
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "the output is about")
        hj.identify(far, rates, throw=False)
    near = hj.Recording(WALKED.t, u, w)
    found = hj.identify(near, library, formulation=Direct()).value
    assert found.terms() == pytest.approx({"u": 1.0, "play(u,0.5)": 2.0}, rel=1e-9)


def test_laws_of_the_value_are_identified_under_jit():
    def coefficients(scale):
        scaled = hj.Recording(WALKED.t, WALKED.u, scale * WALKED.u)
        plays = hj.library.Play([0.1, 0.5])
        law = hj.identify(scaled, plays, formulation=Direct()).value
        return law.coefficients

    alone = coefficients(2.0)
    np.testing.assert_allclose(jax.jit(coefficients)(2.0), alone, rtol=1e-9)


# -------------------------------------------------------------------- laws of the rate


@pytest.fixture(scope="module")
def creeping():
    """w' = 0.25 u' + 0.4 u|u'| - 0.5 w|u'| + 0.3 (lag(u, 2 s) - u), by SciPy."""

    def u(t):
        return np.where(
            t < 15,
            np.exp(-t / 12) * np.sin(2 * t),
            np.exp(-15 / 12) * np.sin(30) + 0.8 * (t - 15) * (t < 16) + 0.8 * (t >= 16),
        )

    t = np.linspace(0, 30, 1201)
    inputs = u(t)

    def rate(time, x, i):
        w, z = x
        slope = (inputs[i + 1] - inputs[i]) / (t[i + 1] - t[i])
        now = inputs[i] + slope * (time - t[i])
        dw = 0.25 * slope + abs(slope) * (0.4 * now - 0.5 * w) + 0.3 * (z - now)
        return dw, (now - z) / 2.0

    x, out = np.array([0.0, inputs[0]]), [0.0]
    for i in range(len(t) - 1):
        ran = solve_ivp(rate, t[i : i + 2], x, args=(i,), rtol=1e-10, atol=1e-12)
        x = ran.y[:, -1]
        out.append(x[0])
    return hj.Recording(t, inputs, np.array(out))


CREEPING = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5, "lag(u,2.0)": 0.3, "u": -0.3}


def noisy(record, level, seed):
    drawn = np.random.default_rng(seed).standard_normal(len(record))
    w = np.asarray(record.w) + level * np.std(record.w) * drawn
    return hj.Recording(record.t, record.u, w)


@pytest.mark.slow
def test_a_law_with_memory_integrates_as_by_scipy(creeping):
    law = SparseModel.from_terms(CREEPING)
    for method in (FixedStep(2), Adaptive(), Automatic()):
        ran = hj.simulate(law, creeping, method=method)
        np.testing.assert_allclose(ran.w, creeping.w, rtol=0, atol=2e-8)


def test_the_time_constant_is_refined(creeping):
    start = dict(CREEPING) | {"lag(u,1.5)": 0.3}
    del start["lag(u,2.0)"]
    refined = hj.refine(SparseModel.from_terms(start), noisy(creeping, 0.01, 5))
    (name,) = (n for n in refined.value.parameters() if n.endswith(".time"))
    found, error = (
        refined.value.parameters()[name],
        refined.stats["standard_errors"][name],
    )
    assert abs(found - 2.0) < 4 * error < 0.5


def is_creeping(found):
    """Whether the terms on the grid are right, and the time within four standard
    errors."""
    if set(found.stats["candidates"][0].terms) != set(CREEPING):
        return False
    (name,) = (n for n in found.value.parameters() if n.endswith(".time"))
    error = found.stats["standard_errors"][name]
    return abs(found.value.parameters()[name] - 2.0) < 4 * error


@pytest.mark.thorough
def test_terms_with_memory_are_discovered_in_18_of_20_records(creeping):
    library = Polynomial(2, ("w", "u", "du", "|du|")) + Lag([0.5, 1.0, 2.0, 4.0, 8.0])
    right = 0
    for seed in range(100, 120):
        record = noisy(creeping, 0.01, seed)
        found = hj.discover(record, library, largest=5, throw=False)
        right += is_creeping(found)
    assert right >= 18


def is_the_stack(seed):
    """Whether w = 0.5 u + 0.2 u^2 + 0.4 play(u, 0.17) + 0.3 play(u, 0.44) is found in a
    record with noise of 1 %, its radii within four standard errors."""
    t = np.linspace(0, 30, 601)
    u = (0.3 + 0.025 * t) * np.sin(0.9 * t)
    w = 0.5 * u + 0.2 * u**2 + 0.4 * by_hand.play(u, 0.17) + 0.3 * by_hand.play(u, 0.44)
    record = noisy(hj.Recording(t, u, w), 0.01, seed)
    library = Polynomial(3, ("u",)) + Play(np.arange(1, 9) / 10)
    found = hj.discover(record, library, target="value", throw=False)
    radii = [n for n in found.value.parameters() if n.endswith(".radius")]
    if len(found.value.terms()) != 4 or len(radii) != 2:
        return False
    values = sorted((found.value.parameters()[n], n) for n in radii)
    errors = found.stats["standard_errors"]
    shares = hj.inclusion(found, record, key=jax.random.key(0), samples=20)
    assert set(list(shares)[:4]) == set(found.value.terms())
    return {"u", "u^2"} < set(found.value.terms()) and all(
        abs(radius - true) < 4 * errors[name] < 0.05
        for (radius, name), true in zip(values, (0.17, 0.44), strict=True)
    )


@pytest.mark.slow
def test_stacks_of_plays_are_discovered():
    assert is_the_stack(1)


@pytest.mark.thorough
def test_stacks_of_plays_are_discovered_in_18_of_20_records():
    assert sum(is_the_stack(seed) for seed in range(100, 120)) >= 18


@pytest.mark.parametrize(
    "how", [hj.formulation.WeakForm(12), None], ids=["weak form", "pointwise"]
)
def test_products_with_memory_are_regressed(creeping, how):
    """Of a law w' = 2 u' - 3 (w - play) + u' lag, made by the fine kernel."""
    law = SparseModel.from_terms(
        {"du": 2.0, "w": -3.0, "play(u,0.2)": 3.0, "du*lag(u,0.5)": 1.0}
    )
    t = np.linspace(0, 30, 3001)
    u = np.exp(-t / 20) * np.sin(2 * t)
    record = hj.Recording(t, u, hj.simulate(law, hj.Recording(t, u, u), w0=0.0).w)
    base = Polynomial(1, ("w", "u", "du"), constant=False)
    library = (
        base
        + Play([0.2, 0.4])
        + Polynomial(1, ("du",), constant=False) * Lag([0.5, 2.0])
    )
    settings = hj.regression.STLSQ(0.03)
    found = hj.identify(record, library, settings, formulation=how).value.terms()
    assert set(found) == set(law.terms())
    for name, value in law.terms().items():
        assert found[name] == pytest.approx(value, rel=0.02)


def test_aliases_name_operators():
    """A play so wide that the input never pulls it is zero."""
    library = Play([0.1, 50.0]) + Lag([1e-9])
    said = hj.aliases(WALKED, library, formulation=Direct())
    assert [alias.term for alias in said] == ["play(u,50.0)"]
    assert "nothing" in str(said[0])


# -------------------------------------------------------------- other verbs and edges


@pytest.mark.slow
def test_long_records_remember_across_chunks(tmp_path):
    library = Play([0.1, 0.3]) + Lag([0.5, 4.0]) + Polynomial(1, ("u", "du"))
    for name, column in (
        ("t", T),
        ("u", WALK),
        ("w", np.asarray(WALKED.w) + np.sin(T)),
    ):
        np.save(tmp_path / f"{name}.npy", column)
    paths = {name: tmp_path / f"{name}.npy" for name in "tuw"}
    settings = hj.regression.LeastSquares()
    record = hj.Recording(T, WALK, np.asarray(WALKED.w) + np.sin(T))
    for how in (Direct(), None):
        expected = hj.identify(record, library, settings, formulation=how).value
        for chunk in (57, 801):
            long = hj.LongRecording.from_npy(**paths, chunk=chunk)
            found = hj.identify(long, library, settings, formulation=how).value
            assert found.target == expected.target
            np.testing.assert_allclose(
                found.coefficients, expected.coefficients, rtol=1e-8, atol=1e-10
            )


def test_radii_are_swept():
    grid = hj.sweeping.Grid(radius=[0.05, 0.1, 0.3])

    def fit(radius):
        library = Play([radius]) + Polynomial(1, ("u",), constant=False)
        settings = hj.regression.LeastSquares()
        found = hj.identify(
            WALKED, library, settings, formulation=Direct(), throw=False
        )
        return {"left": found.stats["residual"]}

    swept = hj.sweep(fit, grid)["left"].to_numpy()
    expected = []
    for radius in (0.05, 0.1, 0.3):
        columns = np.column_stack([by_hand.play(WALK, radius), WALK])
        _, left, *_ = np.linalg.lstsq(columns, np.asarray(WALKED.w))
        expected.append(np.sqrt(left[0]) / np.linalg.norm(WALKED.w))
    np.testing.assert_allclose(swept, expected, rtol=1e-9)


def test_laws_with_memory_are_saved_and_loaded(tmp_path):
    laws = [
        stack(names=("voltage", "stroke"), units=("V", "µm")),
        SparseModel.from_terms(CREEPING),
        stack().with_parameters({"play(u,0.1).radius": jnp.asarray(1 / 3)}),
    ]
    for law in laws:
        hj.save(tmp_path / "law.json", law)
        back = hj.load(tmp_path / "law.json")
        assert back.target == law.target and (back.names, back.units) == (
            law.names,
            law.units,
        )
        assert str(back) == str(law.settled())
        np.testing.assert_array_equal(
            hj.simulate(back, WALKED, w0=0.0).w, hj.simulate(law, WALKED, w0=0.0).w
        )


@pytest.mark.parametrize("law", [stack(), SparseModel.from_terms(CREEPING)], ids=str)
def test_exported_python_remembers(law):
    source = hj.export.to_python(law)
    namespace = {}
    exec(source, namespace)
    memory = namespace["start"](WALK[0])
    track = Track(law.memory, WALKED.path)
    for i in range(1, 60):
        memory = namespace["after"](memory, WALK[i - 1], WALK[i], T[i] - T[i - 1])
        m, now = (
            track.at(jnp.asarray(T[i])),
            Signals(jnp.asarray(T[i]), *map(jnp.asarray, (WALK[i], 0.7))),
        )
        if law.target == "value":
            found, expected = (
                namespace["value"](WALK[i], memory),
                law.output((), m, now),
            )
        else:
            found = namespace["rate"](0.3, WALK[i], 0.7, memory)
            expected = law.rate(jnp.asarray(0.3), m, now)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def test_how_operators_are_written():
    term = Term.parse("u*play(u,0.25)^2*lag(u,1.0)")
    assert term.name == "u*play(u,0.25)^2*lag(u,1.0)"
    assert term.text == "u play(u, 0.25)^2 lag(u, 1)"
    assert term.latex == r"u\,\mathrm{play}(u, 0.25)^{2}\,\mathrm{lag}(u, 1)"
    assert (Term.parse("lag(u,1)*play(u,0.250)^2*u")) == term
    assert (term.degree, term.driven, term.rate_degree) == (4, True, None)
    assert Term.parse("play(u,0.25)").rate_degree == 0
    names = (Play([0.1]) * Polynomial(1, ("w", "|du|")) + Lag([2])).names
    assert names == ("play(u,0.1)", "w*play(u,0.1)", "|du|*play(u,0.1)", "lag(u,2.0)")


SWINGING = hj.Recording(T[:101], np.sin(2 * T[:101]), np.sin(2 * T[:101]))
NEVER_MOVES = r"holds no term on.*play\(u,50.0\) cannot be told from nothing.*wider"


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Play([-0.1]), "`radii` must be zero or more"),
        (lambda: Lag([0.0]), "`times` must be positive"),
        (lambda: Play([0.1, 0.1]), r"got twice: \['play\(u,0.1\)'\]"),
        (lambda: Play([np.nan]), "`radii` has 1 value"),
        (lambda: Play([]), "`radii` is empty"),
        (lambda: Lag([]), "`times` is empty"),
        (lambda: Lag(0.5), r"`times` must be 1-D, got shape \(\). Put one number into"),
        (lambda: hj.discover(SWINGING, Play([50.0])), NEVER_MOVES),
        (lambda: Play([0.1], of="w"), "operators are of the input, `of='u'`; got 'w'"),
        (lambda: Term.parse("play(u,-0.1)"), "in the term"),
        (lambda: Term.parse("play(u,0.1"), "in the term"),
        (lambda: Term.parse("play(w,0.1)"), "in the term"),
        (lambda: Term.parse("lag(u,0)"), "in the term"),
        (lambda: Term.parse("lag(u,1)^-1"), "in the term"),
        (lambda: Term.parse("creep(u,2.0,1.0)"), "in the term"),
        (lambda: Term.parse("creep(u,1e-300,1e300)"), "in the term"),
        (lambda: LogCreep(1, 1), "`longest` must be more"),
        (lambda: LogCreep(1, 1e31), "30 decades at most"),
        (lambda: LogCreep(0, 1), "`shortest` must be positive"),
        (lambda: LogCreep(1, 10, "w"), "operators are of the input"),
        (
            lambda: eqx.filter_jit(lambda a, b: Play([a]) + Play([b]))(0.1, 0.2),
            "other numbers under one name",
        ),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_one_radius_in_several_terms_is_one_number():
    library = Play([0.1]) * Polynomial(2, ("u",))
    assert list(library.numbers) == ["play(u,0.1).radius"]
    law = SparseModel(library, jnp.ones(3), np.ones(3, bool), target="value")
    assert sum(name.endswith(".radius") for name in law.parameters()) == 1
    changed = law.with_parameters({"play(u,0.1).radius": jnp.asarray(0.2)})
    assert changed.settled().library == Play([0.2]) * Polynomial(2, ("u",))


def test_plays_that_have_come_to_one_radius_are_one(tmp_path):
    terms = {"play(u,0.1)": 0.4, "u": 2.0, "play(u,0.2)": 0.3}
    law = SparseModel.from_terms(terms, target="value")
    law = law.with_parameters({"play(u,0.2).radius": 0.1})
    assert law.settled().terms() == pytest.approx({"play(u,0.1)": 0.7, "u": 2.0})
    assert str(law) == "w = 0.7 play(u, 0.1) + 2 u"
    hj.save(tmp_path / "law.json", law)
    back, record = (
        hj.load(tmp_path / "law.json"),
        hj.Recording(None, [0, 1, 0.5], T[:3]),
    )
    np.testing.assert_allclose(hj.simulate(back, record).w, [0.0, 2.63, 1.42])
    assert "0.7 * play_u_0p1" in hj.export.to_python(law)
    # Terms that take no part add nothing, and go on taking none.
    library = Play([0.1, 0.2, 0.3]) + Polynomial(1, ("u",))
    support = np.array([True, True, False, False, False])
    part = SparseModel(
        library, jnp.array([0.4, 0.3, 9.0, 7.0, 7.0]), support, target="value"
    ).with_parameters({"play(u,0.2).radius": 0.1, "play(u,0.3).radius": 0.1})
    expected = {"play(u,0.1)": 0.7, "play(u,0.1).radius": 0.1}
    assert part.settled().parameters() == pytest.approx(expected)


def test_fits_keep_the_names_of_plays_that_have_come_to_be_the_input():
    law = SparseModel.from_terms({"play(u,0.1)": 0.4}, target="value")
    name, u = "play(u,0.1).radius", np.sin(T)
    start = law.with_parameters({name: 0.0})
    found = hj.refine(start, hj.Recording(T, u, 0.7 * u), fixed=[name])
    assert found.value.parameters() == pytest.approx({"play(u,0.1)": 0.7, name: 0.0})
    assert list(found.stats["standard_errors"]) == ["play(u,0.1)"]


# ------------------------------------------------------------ recordings without clock


def test_without_a_clock_rate_independent_terms_are_tried():
    record = hj.Recording(None, WALK, np.asarray(WALKED.w))
    found = hj.identify(record, Polynomial(2), hj.regression.LeastSquares()).value
    assert all(term.rate_degree == 1 for term in found.library.terms)
    direct = hj.identify(
        record,
        Play(RADII) + Lag([1.0]),
        hj.regression.LeastSquares(),
        formulation=Direct(),
    ).value
    np.testing.assert_allclose(list(direct.terms().values()), WEIGHTS, rtol=1e-9)
    assert len(direct.library) == 4
    for verb in (hj.identify, hj.aliases):
        with pytest.raises(InputError, match="no clock, and every term of `library`"):
            verb(record, Polynomial(1, ("w", "u")))


@pytest.mark.slow
def test_without_a_clock_the_period_is_no_matter():
    """The same law whatever the samples are taken to be apart."""
    t, u = T, np.exp(-T / 15) * np.sin(2 * T)
    law = SparseModel.from_terms({"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5})
    w = hj.simulate(law, hj.Recording(t, u, u), w0=0.0).w
    bare = hj.Recording(None, u, w)
    settings = hj.regression.STLSQ(0.05)
    one, other = (
        hj.identify(r, Polynomial(2), settings) for r in (bare, hj.Recording(t, u, w))
    )
    assert set(one.value.terms()) >= set(law.terms())
    refined = hj.refine(law, bare).value.terms()
    for name, value in law.terms().items():
        assert refined[name] == pytest.approx(value, rel=1e-6)
    assert other.value.library.names != one.value.library.names


def test_without_a_clock_laws_of_the_rate_are_refused():
    record = hj.Recording(None, WALK, WALK)
    law = SparseModel.from_terms({"w": -1.0, "u": 1.0})
    for verb in (hj.simulate, hj.judge, hj.refine):
        with pytest.raises(
            InputError, match=r"no clock.*SparseModel depends on the rate"
        ):
            verb(law, record)
    with pytest.raises(InputError, match="no clock"):
        hj.simulate(hj.models.BoucWenOscillator(1.0, 1, 1, 1, 1, 1), record)
    assert hj.judge(stack(), record).succeeded


def test_the_turning_point_of_a_play_in_closed_form():
    """A play of radius r that a sine has pulled up to 1 - r lets go at the turn, and is
    pulled again where the sine has fallen by 2 r."""
    t = np.linspace(0, 4, 41)
    record = hj.Recording(t, np.sin(t), t).with_input(jnp.sin)
    (p,) = Play([0.3]).signals(record.path).values()
    pulled = brentq(lambda x: np.sin(x) - (1 - 0.6), np.pi / 2, np.pi)
    still = (t > np.pi / 2) & (t < pulled)
    assert still.sum() > 5
    np.testing.assert_allclose(p[still], 0.7, rtol=0, atol=1e-12)
    np.testing.assert_allclose(p[t > pulled], np.sin(t[t > pulled]) + 0.3, atol=1e-12)


def test_a_library_with_memory_may_be_a_single_term():
    library = Library((Term.parse("play(u,0.5)"),))
    assert (
        library.memory.values(library.memory.start(Signals(0.0, 2.0, 0.0)), None)[
            "play(u,0.5)"
        ]
        == 1.5
    )


def test_a_start_is_of_the_terms_that_take_part():
    """Of a law over more candidates: a run leaves the others out."""
    t = np.linspace(0, 10, 200)
    record = hj.Recording(t, np.sin(t) + 0.5, 0 * t)
    library = hj.library.Polynomial(1, ("u",), constant=False)
    library = library + hj.library.Play([0.1, 0.4])
    part = np.array([True, False, True])
    law = SparseModel(library, jnp.array([1.0, 0.0, 0.5]), part, target="value")
    begun = Started.at_rest(law, record)
    expected = hj.simulate(law, record).w
    np.testing.assert_allclose(hj.simulate(begun, record).w, expected, atol=1e-14)
    moved = begun.with_parameters({"state.0[0]": 0.85})
    alone = SparseModel.from_terms({"u": 1.0, "play(u,0.4)": 0.5}, target="value")
    same = Started(alone, (jnp.array([0.85]),))
    run = hj.simulate(moved, record).w
    np.testing.assert_allclose(run, hj.simulate(same, record).w, atol=1e-14)
    with pytest.raises(hj.InputError, match="`state` must be of the arrays"):
        Started(law, (jnp.array([0.45, 0.85]),))
