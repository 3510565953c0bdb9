"""Devices in series: friction, springs and curves behind a play, a stop or a lag."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import hystjax as hj
from hystjax import InputError
from hystjax.library._joint import Operators
from hystjax.library._operators import Lag, Play, Travel, stretches
from hystjax.models import Behind, Dahl, Duhem, Instrumented, LuGre, MaxwellSlip
from hystjax.signals import Cubic, Signals
from hystjax.simulation import Adaptive, Automatic, FixedStep

T = np.linspace(0.0, 8.0, 161)
U = 1.2 * np.sin(1.9 * T) * np.exp(-T / 12) + 0.4 * np.sin(4.7 * T)
RECORD = hj.Recording(T, U, np.full_like(T, 0.1))
RELAXING = hj.models.SparseModel.from_terms({"1": -0.1, "u": 0.5, "w": -1.2, "du": 0.3})


SIGNALS = {
    "play(u,0.3)": lambda u: play(u, 0.3),
    "stop(u,0.5)": lambda u: u - play(u, 0.5),
    "stop(play(u,0.2),0.4)": lambda u: play(u, 0.2) - play(play(u, 0.2), 0.4),
}


@pytest.mark.parametrize("front", SIGNALS)
@pytest.mark.parametrize("device", [Dahl(3.0, 0.8), Duhem(0.4, 0.5, 0.25)], ids=repr)
def test_a_law_behind_plays_is_that_law_of_the_signal(device, front):
    """At samples, for it does not matter when between them the signal goes."""
    method = FixedStep(64)
    found = hj.simulate(Behind(device, front), RECORD, method=method).w
    alone = hj.Recording(T, SIGNALS[front](U), RECORD.w)
    expected = hj.simulate(device, alone, method=method).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def relaxing_by_hand(radius):
    """The law of the rate by SciPy, from kink to kink of the play."""
    w, p, out = 0.1, play(U[:1], radius)[0], [0.1]
    for t, u, later, end in zip(T[:-1], U[:-1], T[1:], U[1:], strict=True):
        du = (end - u) / (later - t)
        wait = np.clip((radius - np.sign(du) * (u - p)) / abs(du), 0, later - t)
        for first, last, slope in ((t, t + wait, 0.0), (t + wait, later, du)):

            def rate(time, w, first=first, slope=slope, p=p):
                return -0.1 + 0.5 * (p + slope * (time - first)) - 1.2 * w + 0.3 * slope

            if last > first:
                ran = solve_ivp(rate, (first, last), [w], rtol=1e-11, atol=1e-13)
                w, p = ran.y[0, -1], p + slope * (last - first)
        out.append(w)
    return np.array(out)


@pytest.mark.parametrize(
    "method", [FixedStep(2), Automatic(), Adaptive(rtol=1e-11)], ids=repr
)
def test_a_law_of_the_rate_loses_nothing_where_the_play_starts(method):
    """By two steps a sample of fourth order already: steps are cut there."""
    found = hj.simulate(Behind(RELAXING, "play(u,0.3)"), RECORD, method=method).w
    np.testing.assert_allclose(found, relaxing_by_hand(0.3), rtol=0, atol=2e-9)


@pytest.mark.parametrize(
    "front",
    ["play(u,0.3)", pytest.param("lag(play(u,0.1),0.4)", marks=pytest.mark.slow)],
)
def test_smooth_inputs_are_followed_too(front):
    record = hj.Recording(T[::4], U[::4], RECORD.w[::4], interpolation=Cubic())
    model = Behind(LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7), front)
    found = hj.simulate(model, record, method=FixedStep(64)).w
    reference = hj.simulate(model, record, method=Adaptive()).w
    np.testing.assert_allclose(found, reference, rtol=0, atol=1e-7)


@pytest.mark.parametrize("rates", [(0.0, 0.0), (1.0, 4.0)], ids=str)
def test_steps_are_cut_where_a_cubic_has_come_so_far(rates):
    """A play inside of one step, and where a lag turns: times by SciPy."""
    curve = CubicHermiteSpline([1.0, 1.4], [0.2, 1.2], rates)
    before, now = (
        Signals(*map(jnp.asarray, (t, float(curve(t)), rate)))
        for t, rate in zip((1.0, 1.4), rates, strict=True)
    )
    for wait in (0.05, 0.3, 0.6, 0.9):
        change = (1 - wait) / 2
        travel = Travel(*map(jnp.asarray, (-0.1, change - 0.1, wait)))
        _, (start, stop), (_, end) = stretches(before, now, travel)
        for found, gone in ((start, wait), (stop, wait + change)):
            t = brentq(lambda t, u=0.2 + gone: curve(t) - u, 1.0, 1.4, xtol=1e-14)
            assert float(found.t) == pytest.approx(t, abs=1e-12)
            assert float(found.du) == pytest.approx(curve(t, 1), rel=1e-9)
        moved = [float(each.u) for each in (start, stop, end)]
        assert moved == pytest.approx([-0.1, change - 0.1, change - 0.1])
    for time, first in ((0.2, 0.3), (0.2, 0.6), (2.0, 0.5), (0.1, 0.9)):
        z = solve_ivp(
            lambda t, z, time=time: (curve(t) - z) / time,
            *((1.0, 1.4), [first]),
            dense_output=True,
            **{"rtol": 1e-11, "atol": 1e-12},
        ).sol
        t = brentq(lambda t, z=z: curve(t) - z(t)[0], 1.0, 1.4)
        _, turn, end = Lag.course(jnp.array([time]), jnp.array([first]), before, now)
        assert float(turn.t) == pytest.approx(t, abs=1e-3)
        assert float(turn.u) == pytest.approx(z(t)[0], abs=1e-6)
        assert float(end.u) == pytest.approx(z(1.4)[0], abs=1e-8)


def test_the_parts_of_a_step_follow_each_other():
    """Of a lag behind a play, which waits, goes along and waits: to its last state."""
    memory = Operators((Lag(Play(Play("u", 0.3), 0.2), 0.4),), {})
    before, now = (
        Signals(*map(jnp.asarray, each)) for each in ((1.0, 0.2, 1.0), (1.4, 1.2, 4.0))
    )
    states = jnp.array([0.1]), jnp.array([0.05]), jnp.array([0.6])
    parts = list(memory.course(states, before, now))
    assert len(parts) == 6
    for (_, end), (start, _) in itertools.pairwise(parts):
        assert float(start.t) == pytest.approx(float(end.t))
        assert float(start.u) == pytest.approx(float(end.u), abs=1e-3)  # at a turn
    last = memory.after(states, before, now)[-1][0]
    assert float(parts[-1][1].u) == pytest.approx(float(last), abs=1e-12)


def test_a_play_on_its_edge_goes_along_whatever_is_rounded():
    memory = Operators((Play("u", 0.3),), {})
    now = Signals(*map(jnp.asarray, (30.0, 0.7, 1.5)))
    for above, rate in ((4e-16, 1.5), (1e-9, 0.0)):
        found = memory.signals((jnp.array([0.7 - 0.3 + above]),), now)
        assert float(found["play(u,0.3)"].du) == rate


def test_a_device_with_a_memory_of_its_own_remembers_within_a_step():
    """A lag in the device behind a play is the lag of that play; so is what flows."""
    terms = {"lag({},0.1)": 0.8, "w": -1.2}
    front = "play(u,0.3)"
    device, whole = (
        hj.models.SparseModel.from_terms({k.format(of): x for k, x in terms.items()})
        for of in ("u", front)
    )
    record = hj.Recording(T, U + 1.0, RECORD.w)  # begins where the play is not at u
    found = hj.simulate(Behind(device, front), record, method=FixedStep(2)).w
    # The whole law's steps go on over the kinks of the play.
    expected = hj.simulate(whole, record, method=FixedStep(64)).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_fronts_in_series_are_a_chain():
    friction = Dahl(3.0, 0.8)
    both = Behind(Behind(friction, "stop(u,0.4)"), "play(u,0.2)")
    chain = Behind(friction, "stop(play(u,0.2),0.4)")
    found, expected = (
        hj.simulate(model, RECORD, method=FixedStep(32)).w for model in (both, chain)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert list(both.parameters())[2:] == ["exponent", "stop.radius", "play.radius"]


def test_a_lag_of_a_lag_is_the_difference_of_two():
    """Where the input is straight, but for the cubic that is taken in each step."""
    inner = hj.models.SparseModel.from_terms({"lag(u,0.9)": 1.0}, target="value")
    found = hj.simulate(Behind(inner, "lag(u,0.3)"), RECORD).w
    terms = {"lag(u,0.9)": 0.9 / 0.6, "lag(u,0.3)": -0.3 / 0.6}
    known = hj.models.SparseModel.from_terms(terms, target="value")
    expected = hj.simulate(known, RECORD).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_a_play_without_width_is_not_there():
    friction = Dahl(3.0, 0.8)
    model = Behind(friction, "play(u,0.0)")
    assert model.parameters() == friction.parameters()
    found, expected = (
        hj.simulate(each, RECORD, method=FixedStep(2)).w for each in (model, friction)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("front", "name"),
    [
        ("play(u,0.3)", "play.radius"),
        pytest.param("lag(u,0.4)", "lag.time", marks=pytest.mark.slow),
    ],
)
def test_derivatives_in_the_front_are_differences(front, name):
    model = Behind(LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7), front)

    def output(value):
        changed = model.with_parameters({name: value})
        w = hj.simulate(changed, RECORD, method=FixedStep(2)).w
        return jnp.sum(jnp.cos(jnp.arange(len(T))) * w)

    value, h = model.parameters()[name], 1e-6
    run = jax.jit(output)
    expected = (run(value + h) - run(value - h)) / (2 * h)
    forward, reverse = (jax.jit(each(output))(value) for each in (jax.jacfwd, jax.grad))
    np.testing.assert_allclose(forward, expected, rtol=1e-5)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)


@pytest.mark.parametrize(
    "front",
    [
        pytest.param("play(u,0.3)", marks=pytest.mark.slow),
        pytest.param("lag(u,0.4)", marks=pytest.mark.thorough),
    ],
)
def test_the_front_is_fitted_beside_the_device(front):
    truth = Behind(Dahl(3.0, 0.8), front)
    w = np.asarray(hj.simulate(truth, RECORD, w0=0.0).w)
    noise = 0.01 * np.std(w) * np.random.default_rng(2).normal(size=len(T))
    record = hj.Recording(T, U, w + noise)
    fixed = ("exponent",)
    off = {name: 1.2 * x for name, x in truth.parameters().items() if name not in fixed}
    solution = hj.refine(truth.with_parameters(off), record, fixed=fixed)
    errors = solution.stats["standard_errors"]
    assert errors.keys() == off.keys()
    for name, error in errors.items():
        found, expected = (m.parameters()[name] for m in (solution.value, truth))
        assert abs(found - expected) < 4 * error < 0.1, name


@pytest.mark.slow
def test_a_backlash_is_inverted_and_has_no_margin_where_it_waits():
    model = Behind(MaxwellSlip([1.0, 0.6], [0.4, 5.0]), "play(u,0.2)")
    w = np.asarray(hj.simulate(model, RECORD).w)
    record = hj.Recording(T, U, w)
    solution = hj.invert(model, record)
    assert bool(solution.result == hj.RESULTS.successful)
    np.testing.assert_allclose(solution.value.w, w, rtol=0, atol=1e-9)
    again = hj.simulate(model, hj.Recording(T, solution.value.u, w)).w
    np.testing.assert_allclose(again, w, rtol=0, atol=1e-9)
    margin = np.asarray(solution.stats["margin"])
    p = play(U, 0.2)
    waits = np.abs(np.diff(p[:-1])) + np.abs(np.diff(p[1:])) == 0
    assert np.all(margin[1:-1][waits] == 0)


def test_what_depends_on_the_rate():
    friction = Dahl(3.0, 0.8)
    assert Behind(friction, "stop(play(u,0.1),0.3)").rate_independent is True
    assert Behind(friction, "lag(play(u,0.1),0.3)").rate_independent is False
    assert Behind(RELAXING, "play(u,0.1)").rate_independent is False
    drive = hj.properties.Drive(-1.0, 1.0, 1.0)
    for front, least, most in (("play(u,0.1)", 0, 1e-6), ("lag(u,0.3)", 1e-2, 1)):
        found = hj.properties.rate_dependence(Behind(friction, front), drive)
        assert least <= float(jnp.max(jnp.asarray(found))) <= most


def test_parameters_text_and_what_is_inside():
    model = Behind(Dahl(3.0, 0.8), "stop(play(u,0.1),0.3)", units=("mm", "N"))
    own = {"play.radius": 0.1, "stop(play).radius": 0.3}
    assert {k: float(x) for k, x in model.parameters().items() if k in own} == own
    assert all(model.bounds()[name] == (0.0, np.inf) for name in own)
    known = {"stiffness": "N mm^-1", "coulomb": "N"}
    assert model.number_units() == dict.fromkeys(own, "mm") | known
    assert str(model) == f"{model.device} behind stop(play(u, 0.1), 0.3)"
    moved = model.with_parameters({"play.radius": jnp.asarray(0.15)})
    assert str(moved).endswith("behind stop(play(u, 0.15), 0.3)")
    assert moved.settled().front.names == ("stop(play(u,0.15),0.3)",)
    assert float(moved.settled().parameters()["play.radius"]) == 0.15
    terms = {"u": 0.4, "play(u,0.2)": 0.3}
    inside = hj.models.SparseModel.from_terms(terms, target="value")
    turned = Behind(inside, "lag(u,0.3)").with_parameters({"play(u,0.2).radius": -0.25})
    assert turned.settled().parameters()["play(u,0.25).radius"] == 0.25
    now = hj.signals.Signals(*map(jnp.asarray, (0.0, 0.5, 1.0)))
    signal, force = model.inner(jnp.asarray(0.2), model.memory.start(now), now)
    assert float(signal) == pytest.approx(0.3) and float(force) == 0.2
    assert Behind(RELAXING, hj.library.Lag([0.5])).number_units()["lag.time"] == "s"


@pytest.mark.parametrize(
    ("front", "message"),
    [
        ("play(u,-0.1)", r"`front` must be one play.*got 'play\(u,-0.1\)'"),
        ("u", "`front` must be one play"),
        (hj.library.Play([0.1, 0.2]), r"got the terms play\(u,0.1\), play\(u,0.2\)"),
        (hj.library.Polynomial(1, ("u",)), "got the terms 1, u"),
        (hj.library.Play([0.1]) * hj.library.Play([0.1]), r"play\(u,0.1\)\^2"),
    ],
)
def test_fronts_that_are_none(front, message):
    with pytest.raises(InputError, match=message):
        Behind(Dahl(3.0, 0.8), front)


def test_two_fronts_with_one_name_are_refused():
    inner = Behind(Dahl(3.0, 0.8), "play(u,0.1)")
    with pytest.raises(InputError, match=r"both have a number 'play.radius'"):
        Behind(inner, "play(u,0.2)")


def test_wrappers_see_the_same_steps():
    """Gains, and a start, around a device behind a play: its steps are cut too."""
    model = Behind(RELAXING, "play(u,0.3)")
    gained = Instrumented(model, input_gain=2.0, output_gain=0.5)
    half = hj.Recording(T, U / 2, RECORD.w / 2)
    method = FixedStep(2)
    expected = np.asarray(hj.simulate(model, RECORD, method=method).w)
    found = hj.simulate(gained, half, method=method).w
    np.testing.assert_allclose(found, expected / 2, rtol=0, atol=1e-12)
    started = hj.models.Started.at_rest(model, RECORD)
    found = hj.simulate(started, RECORD, method=method).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_what_flows_behind_a_play_is_not_written_in_other_languages():
    model = Behind(Dahl(3.0, 0.8), "play(u,0.1)")
    for outer in (model, Instrumented(model, output_gain=2.0)):
        with pytest.raises(InputError, match="steps are cut inside"):
            hj.export.to_c(outer)
