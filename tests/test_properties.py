"""Properties of hysteresis against closed-form loops."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of
from hypothesis import assume, given, strategies as st
from scipy.integrate import quad

import hystjax as hj
from hystjax.models import (
    BoucWen,
    BoucWenOscillator,
    Duhem,
    FittedRange,
    PrandtlIshlinskii,
    SparseModel,
)
from hystjax.refinement import statements
from hystjax.signals.excitation import Sine
from hystjax.simulation.properties import (
    Drive,
    dissipation,
    examine,
    incongruency,
    memory_loss,
    rate_dependence,
    rests,
    run,
    steepness,
)

ALPHA, BETA, GAMMA = 0.4, 0.5, 0.25
DUHEM = Duhem(ALPHA, BETA, GAMMA)
DRIVE = Drive(-2.0, 3.0, 7.0, 0.3, cycles=30)


class Branches:
    """w' = |u'| (alpha u - beta w) + gamma u' from turning point to turning point."""

    def __init__(self, alpha, beta, gamma):
        self.slope, self.beta = alpha / beta, beta
        self.offset = (gamma - alpha / beta) / beta

    def at(self, u, u0, w0, up):
        """w at u on the branch from (u0, w0): it falls exponentially to a line."""
        shift = self.offset if up else -self.offset
        start = w0 - self.slope * u0 - shift
        return self.slope * u + shift + start * np.exp(-self.beta * np.abs(u - u0))

    def follow(self, u, w, *turns):
        """w at the last of several turning points."""
        for turn in turns:
            u, w = turn, self.at(turn, u, w, turn > u)
        return w

    def steady(self, low, high):
        """w at `low` on the loop that closes: one cycle maps w to c + d w."""
        c = self.follow(low, 0.0, high, low)
        d = self.follow(low, 1.0, high, low) - c
        return c / (1 - d)


CLOSED = Branches(ALPHA, BETA, GAMMA)
LOW, HIGH = -2.0, 3.0
INNER = LOW + 0.25 * (HIGH - LOW), LOW + 0.75 * (HIGH - LOW)
START = CLOSED.steady(LOW, HIGH)
TOP = CLOSED.at(HIGH, LOW, START, True)


def loop(closed=CLOSED):
    """Both branches of the steady loop, at the inputs of `DRIVE`."""
    u = np.linspace(LOW, HIGH, DRIVE.steps + 1)
    bottom = closed.steady(LOW, HIGH)
    up = closed.at(u, LOW, bottom, True)
    return u, np.stack([up, closed.at(u[::-1], HIGH, up[-1], False)])


def test_a_run_is_the_closed_form_of_a_duhem_law():
    found = run(DUHEM, DRIVE, 0.75, 0.25)
    _, expected = loop()
    np.testing.assert_allclose(found.w[:2], expected, atol=1e-8)
    low, high = INNER
    end = CLOSED.follow(LOW, START, high, low)
    np.testing.assert_allclose(found.w[-1, -1], end, atol=1e-8)
    np.testing.assert_allclose(found.range, np.ptp(expected), rtol=1e-8)


MODELS = {
    "Bouc-Wen": BoucWen(5.0, 0.25, 0.5),
    "rate dependent": SparseModel.from_terms(
        {"w": -2.4, "lag(u,0.1)": 0.6, "w*|w|": -0.1}
    ),
    "hidden": BoucWenOscillator(1.0, 2.0, 9.0, 4.0, 0.5, 0.3),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_run_is_what_simulate_says(name):
    model, drive = MODELS[name], Drive(-1.0, 1.0, 4.0, 0.1, cycles=2)
    found = run(model, drive, 0.75, 0.25, speed=2.0)
    corners = np.array([-1.0, 1, -1, 1, -1, 0.5, -0.5])
    t = np.concatenate([[0], np.cumsum(np.abs(np.diff(corners)) / 8)])
    times = np.unique(np.concatenate([np.linspace(0, t[-1], 2001), t]))
    path = hj.interpolation.Linear().path(
        jnp.asarray(times), jnp.asarray(np.interp(times, t, corners))
    )
    w = np.asarray(hj.simulate(model, path, w0=0.1).w)
    at_corners = w[np.searchsorted(times, t)]
    size = np.max(np.abs(w))
    np.testing.assert_allclose(found.w[:, 0], at_corners[2:-1], atol=2e-5 * size)
    np.testing.assert_allclose(found.w[-1, -1], at_corners[-1], atol=2e-5 * size)


@pytest.mark.parametrize("model", [DUHEM, BoucWen(5, 0.25, 0.5), BoucWen(1, 1, -1, 2)])
def test_laws_of_degree_one_do_not_depend_on_rate(model):
    assert rate_dependence(model, DRIVE, (0.01, 1.0, 300.0)) < 1e-11


def test_rate_dependence_of_relaxation():
    """At rate r, w' = a u - b w + c u' is the Duhem law with a/r, b/r and c."""
    a, b, c = 3.0, 5.0, 0.2
    law = SparseModel.from_terms({"u": a, "w": -b, "du": c})
    loops = [loop(Branches(a / r, b / r, c))[1] for r in (7 / 4, 7.0, 28.0)]
    expected = np.max(np.ptp(loops, axis=0)) / np.ptp(loops)
    for order in ((), ((4.0, 0.25, 1.0),)):  # those speeds are the default
        found = rate_dependence(law, DRIVE, *order)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_steepness_of_a_duhem_law():
    u, branches = loop()
    slopes = np.diff(branches) / np.diff([u, u[::-1]])
    expected = np.min(slopes, axis=1) * (HIGH - LOW) / np.ptp(branches)
    np.testing.assert_allclose(steepness(DUHEM, DRIVE), expected, rtol=1e-6)


def test_memory_loss_of_a_duhem_law():
    low, high = INNER
    rising = CLOSED.at(high, LOW, START, True)
    falling = CLOSED.at(low, HIGH, TOP, False)
    gaps = (
        CLOSED.follow(high, rising, low, high) - rising,
        CLOSED.follow(low, falling, high, low) - falling,
    )
    expected = np.max(np.abs(gaps)) / np.ptp(loop()[1])
    np.testing.assert_allclose(memory_loss(DUHEM, DRIVE), expected, rtol=1e-6)


def test_memory_is_lost_alike_where_branches_change_places():
    """The other way round, for -u and -w, a law has its rising branch where it had the
    falling one."""
    lost = [
        memory_loss(
            SparseModel.from_terms({"u^2*|du|": bend, "w*|du|": -0.5, "du": 0.25}),
            Drive(*ends, 7.0, cycles=30),
        )
        for bend, ends in ((0.3, (LOW, HIGH)), (-0.3, (-HIGH, -LOW)))
    ]
    np.testing.assert_allclose(*lost, rtol=1e-6)


def test_incongruency_of_a_duhem_law():
    low, high = INNER
    falling = np.linspace(high, low, DRIVE.steps + 1)
    rising = falling[::-1]

    def shape(down, up):
        both = np.stack([down, up])
        return both - np.mean(both)

    w = CLOSED.follow(LOW, START, high, low, high)
    down = CLOSED.at(falling, high, w, False)
    one = shape(down, CLOSED.at(rising, low, down[-1], True))
    w = CLOSED.follow(HIGH, TOP, low, high, low)
    up = CLOSED.at(rising, low, w, True)
    other = shape(CLOSED.at(falling, high, up[-1], False), up)
    expected = np.max(np.abs(one - other)) / np.ptp(one)
    assert expected > 1e-3
    np.testing.assert_allclose(incongruency(DUHEM, DRIVE), expected, rtol=1e-5)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_work_of_a_duhem_law(share):
    low, high = 0.5 - 2.5 * share, 0.5 + 2.5 * share
    start = CLOSED.steady(low, high)
    top = CLOSED.at(high, low, start, True)
    up, _ = quad(CLOSED.at, low, high, (low, start, True))
    down, _ = quad(CLOSED.at, low, high, (high, top, False))
    found = dissipation(DUHEM, DRIVE, (share,), (1.0, 3.0))
    np.testing.assert_allclose(found.work, [[up - down] * 2], rtol=1e-7)
    assert np.all(found.closure < 1e-5)


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e6])
@pytest.mark.parametrize("cycles", [1, 2])
def test_the_closure_of_a_loop_that_has_not_settled(cycles, unit):
    """A share of the range, whatever the output's unit."""
    law = Duhem(ALPHA * unit, BETA, GAMMA * unit)
    drive = Drive(LOW, HIGH, 7.0, -3.0 * unit, cycles=cycles)
    found = dissipation(law, drive, (1.0,))
    start = CLOSED.follow(LOW, -3.0, *(HIGH, LOW) * (cycles - 1))
    top, end = (CLOSED.follow(LOW, start, *turns) for turns in ((HIGH,), (HIGH, LOW)))
    u = np.linspace(LOW, HIGH, DRIVE.steps + 1)
    both = CLOSED.at(u, LOW, start, True), CLOSED.at(u, HIGH, top, False)
    expected = abs(end - start) / np.ptp(both)
    assert expected > 0.005
    np.testing.assert_allclose(found.closure, [[expected]], rtol=1e-5)
    up, _ = quad(CLOSED.at, LOW, HIGH, (LOW, start, True))
    down, _ = quad(CLOSED.at, LOW, HIGH, (HIGH, top, False))
    np.testing.assert_allclose(found.work, [[unit * (up - down)]], rtol=1e-6)
    share = (up - down) / ((HIGH - LOW) * np.ptp(both))
    np.testing.assert_allclose(found.share, [[share]], rtol=1e-6)


def test_an_output_that_sees_the_speed_jumps_at_the_turns():
    """Of w = u + c u' the loop is a parallelogram: 2 c rate high, and as long as the
    input goes."""
    damper = SparseModel.from_terms({"u": 1.0, "du": 0.5}, target="value")
    drive = Drive(-1.0, 1.0, 2.0, steps=4, cycles=2)
    found = dissipation(damper, drive, (0.5, 1.0), (1.0, 3.0))
    np.testing.assert_allclose(found.work, [[2.0, 6.0], [4.0, 12.0]], rtol=1e-12)
    np.testing.assert_allclose(found.closure, 0, atol=1e-12)
    u = np.linspace(-1, 1, 5)
    loop = run(damper, drive)
    np.testing.assert_allclose(loop.w, [u + 1, u[::-1] - 1], atol=1e-12)
    assert memory_loss(damper, drive) < 1e-12


def test_shares_of_a_loop_without_height_are_0():
    """Within a backlash nothing moves; over the whole stroke its loop is 2 - 1.2 high
    and 1.2 wide."""
    backlash = PrandtlIshlinskii([0.6], [1.0], 0.1)
    drive = Drive(-1.0, 1.0, 2.0, cycles=2, steps=40)
    found = examine(backlash, drive)
    expected = [[0.0], [0.0], [-1.2 / 2]]
    np.testing.assert_allclose(found.dissipation.share, expected, rtol=1e-12)
    assert found.incongruency == found.memory_loss == 0
    assert not np.any(found.dissipation.closure)
    still = examine(backlash, drive.shrunk(0.25))
    shares = still._replace(dissipation=still.dissipation[1:])
    assert not any(np.any(each) for each in jax.tree.leaves(shares))


def test_the_sign_of_work():
    """A force that friction adds to is higher while the input rises; relaxation lags,
    so that its output is lower then."""
    friction = BoucWen(1.0, 2.0, 0.0)
    relaxation = SparseModel.from_terms({"u": 3.0, "w": -3.0})
    assert dissipation(friction, DRIVE).work.min() > 0
    assert dissipation(relaxation, DRIVE).work.max() < 0


numbers = st.floats(-3, 3)


@given(a=numbers, b=numbers, c=st.floats(0.5, 3), low=numbers, width=st.floats(0.5, 5))
def test_a_function_of_the_input_has_every_property(a, b, c, low, width):
    """w' = (a + b u + c u^2) u' is the derivative of a cubic."""
    cubic = SparseModel.from_terms({"du": a, "u*du": b, "u^2*du": c})
    found = examine(cubic, Drive(low, low + width, 2.0))
    w = np.polyval([c / 3, b / 2, a, 0], np.linspace(low, low + width, 401))
    # Rounding of the cubic's values, where they differ by little.
    rounding = 1e-9 + 1e-12 * np.max(np.abs(w)) / np.ptp(w)
    assert found.rate_dependence < rounding
    assert found.incongruency < 100 * rounding
    assert found.memory_loss < rounding
    assert np.all(np.abs(found.dissipation.share) < 100 * rounding)
    slopes = np.diff(w) * 400 / np.ptp(w)
    np.testing.assert_allclose(
        found.steepness, np.min(slopes), atol=1e-6 * np.max(np.abs(slopes))
    )


def test_bouc_wen_does_not_return():
    """Softening branches from one point have different slopes: Bouc-Wen drifts."""
    assert memory_loss(BoucWen(5.0, 0.25, 0.5), Drive(-1, 1, 1.0)) > 0.01


def test_a_law_that_diverges_has_no_finite_properties():
    growing = SparseModel.from_terms({"du": 1.0, "w*|du|": 30.0})
    found = examine(growing, DRIVE)
    assert not np.isfinite(found.memory_loss)
    assert not np.isfinite(found.dissipation.closure[-1, 0])


def test_models_come_in_batches_and_drives_too():
    models = jax.vmap(lambda beta: Duhem(ALPHA, beta, GAMMA))(jnp.array([0.3, BETA]))
    drives = jax.vmap(lambda high: Drive(LOW, high, 7.0, 0.3, cycles=30))(
        jnp.array([2.0, HIGH])
    )
    batch = eqx.filter_vmap(memory_loss)(models, drives)
    np.testing.assert_allclose(batch[1], memory_loss(DUHEM, DRIVE), rtol=1e-10)


@pytest.mark.slow
def test_a_drive_like_a_recording():
    record = hj.generate(DUHEM, Sine(2.0, 0.5), np.linspace(3, 7, 801))
    drive = Drive.like(record, cycles=3)
    ends = drive.low, drive.high, drive.rate
    np.testing.assert_allclose(ends, (-2.0, 2.0, 4.0), rtol=1e-4)
    assert drive.w0 == record.w[jnp.argmin(record.u)]
    assert drive.cycles == 3
    usual = Drive.like(record)
    assert usual.cycles == Drive(-2.0, 2.0, 4.0).cycles
    assert usual.steps == Drive(-2.0, 2.0, 4.0).steps
    for name in ("cycle", "w0"):  # which the recording tells
        with pytest.raises(TypeError, match=f"unexpected keyword argument '{name}'"):
            Drive.like(record, **{name: 3})


@pytest.mark.parametrize(
    "fields, message",
    [
        ({"low": 2.0}, "`low` must lie below `high`, got 2.0 and 1.0"),
        ({"rate": 0.0}, "`rate` must be positive, got 0.0"),
        ({"cycles": 0}, "`cycles` must be at least 1, got 0"),
        ({"steps": 5}, "`steps` must be even, for Simpson's rule, got 5"),
    ],
)
def test_bad_drives(fields, message):
    with pytest.raises(hj.InputError, match=message):
        Drive(**{"low": -1.0, "high": 1.0, "rate": 1.0, **fields})


# ------------------------------------------------------------------------------ rests


@given(
    st.lists(st.floats(-4, 4), min_size=3, max_size=3),
    st.floats(0.1, 10),
    st.booleans(),
)
def test_rests_are_the_roots_of_a_cubic(roots, size, rising):
    roots = np.sort(roots)
    assume(np.min(np.diff(roots)) > 0.05)
    size = size if rising else -size
    *others, third = np.polynomial.polynomial.polyfromroots(roots) * size
    terms = dict(zip(("1", "w", "w^2", "w^3"), (*others, third), strict=True))
    found = rests(SparseModel.from_terms({**terms, "du": 1.0}), 0.3, -5.0, 5.0)
    np.testing.assert_allclose(found.w[:3], roots, atol=1e-9)
    assert np.all(np.isnan(found.w[3:]))
    expected = [not rising, rising, not rising]
    assert found.stable[:3].tolist() == expected and not np.any(found.stable[3:])


@pytest.mark.parametrize(
    "root, low, high",
    [
        (1.0, 0.9999, 3.0),
        (1.0, -3.0, 1.0001),
        (-1.0, -3.0, -0.9999),
        (1.0, 1.0, 3.0),
        (1.0, -3.0, 1.0),
        (0.3, 0.3, 1e3),
        (0.0, 0.0, 3.0),
    ],
)
@pytest.mark.parametrize("rate", [-1.0, 1.0])
def test_rests_at_the_ends_are_found(root, low, high, rate):
    """Of the law w' = rate (w - root), to which it returns or from which it runs."""
    law = SparseModel.from_terms({"1": -rate * root, "w": rate})
    found = rests(law, 0.0, low, high)
    np.testing.assert_allclose(found.w[0], root, rtol=1e-12, atol=1e-12)
    assert low <= found.w[0] <= high and np.all(np.isnan(found.w[1:]))
    assert found.stable[0] == (rate < 0)


def test_where_a_law_says_nothing_it_has_no_rest():
    """1 + sqrt(w) is no number below zero."""

    class Rising(Duhem):
        def rate(self, x, m, now):
            return 1 + jnp.sqrt(x)

    assert np.all(np.isnan(rests(Rising(1.0, 1.0, 1.0), 0.0, -1.0, 1.0).w))


@pytest.mark.slow
def test_a_law_settles_where_a_long_simulation_does():
    law = SparseModel.from_terms({"w": 176.8, "w*|w|": -2.284, "du": 1.0})
    found = rests(law, 0.0, -500.0, 500.0)
    np.testing.assert_allclose(
        found.w[:3], [-176.8 / 2.284, 0, 176.8 / 2.284], atol=1e-9
    )
    assert found.stable[:3].tolist() == [True, False, True]
    held = hj.Recording(np.linspace(0, 1, 101), np.zeros(101), np.full(101, 0.01))
    np.testing.assert_allclose(hj.simulate(law, held).w[-1], found.w[2], rtol=1e-6)


@pytest.mark.parametrize("low, high", [(0.0, 2.0), (-0.3, 1.1)])
def test_drift_is_that_half_way_between_the_bounds(low, high):
    law = SparseModel.from_terms({"w": -1.0, "w^2": 0.7})
    middle = (low + high) / 2
    expected = 0.7 * middle**2 - middle
    np.testing.assert_allclose(rests(law, 0.0, low, high).drift, expected, rtol=1e-12)


def test_rests_depend_on_where_the_input_is_held():
    law = SparseModel.from_terms({"w": -2.0, "u": 3.0, "u*|du|": 0.5})
    ends = jax.vmap(lambda u: rests(law, u, -10.0, 10.0))(jnp.array([-2.0, 0.0, 4.0]))
    np.testing.assert_allclose(ends.w[:, 0], [-3.0, 0.0, 6.0], atol=1e-9)
    assert np.all(np.isnan(ends.w[:, 1:]))
    assert np.all(ends.stable[:, 0])


def test_a_rate_independent_law_stands_still_anywhere():
    found = rests(DUHEM, 1.0, -5.0, 5.0)
    assert np.all(np.isnan(found.w)) and not np.any(found.stable)


def test_rests_move_with_the_numbers_of_a_law():
    def rest(numbers):
        law = SparseModel.from_terms({"1": 0.0, "w": 1.0, "u": 0.0})
        names, values = ("1", "w", "u"), numbers[:3]
        law = law.with_parameters(dict(zip(names, values, strict=True)))
        return rests(law, numbers[3], -2.0, 2.0).w[0]

    a, b, c, u = numbers = (0.1, -0.5, 0.3, 0.2)
    expected = [-1 / b, (a + c * u) / b**2, -u / b, -c / b]
    np.testing.assert_allclose(jax.grad(rest)(numbers), expected, rtol=1e-9)


def test_rests_are_of_laws_whose_output_is_their_state():
    with pytest.raises(hj.InputError, match="whose state is one number"):
        rests(BoucWenOscillator(1.0, 0.1, 1.0, 0.5, 0.4, 0.2), 0.0, -1.0, 1.0)
    # Whatever the strain was, a butterfly starts from the output that it hides.
    hiding = hj.models.Butterfly(SparseModel.from_terms({"w": 1.0, "w^3": -1.0}))
    for end in (2.0, 2e-4):  # in whatever unit
        with pytest.raises(hj.InputError, match="whose state is one number"):
            rests(hiding, 0.0, -end, end)
    with pytest.raises(hj.InputError, match="`low` must lie below `high`, got 1"):
        rests(DUHEM, 0.0, 1.0, 1.0)
    for name, place in (("u", 0), ("low", 1), ("high", 2)):
        arguments = np.array([0.0, -1.0, 1.0])
        arguments[place] = np.nan if name == "u" else np.inf
        with pytest.raises(hj.InputError, match=f"`{name}` must be finite"):
            rests(DUHEM, *arguments)


@pytest.mark.usefixtures("unchecked")
def test_rests_of_a_solution_are_those_of_its_model():
    law = SparseModel.from_terms({"1": 1.0, "w": -1.0})
    found = rests(hj.Solution(law, hj.RESULTS.successful, {}), 0.0, -3.0, 3.0)
    np.testing.assert_allclose(found.w[0], 1.0, rtol=1e-12)
    with pytest.raises(hj.InputError, match="`rests\\(model, u, low, high\\)`"):
        rests("law", 0.0, -3.0, 3.0)


def test_multiples_of_a_drive_are_positive():
    drive = Drive(-1.0, 1.0, 1.0, cycles=1, steps=2)
    for name, call in (
        ("speeds", lambda: rate_dependence(DUHEM, drive, (0.0, 1.0))),
        ("speeds", lambda: rate_dependence(DUHEM, drive, np.array([-1.0, 1.0]))),
        ("amplitudes", lambda: dissipation(DUHEM, drive, jnp.zeros(1))),
        ("amplitudes", lambda: dissipation(DUHEM, drive, (-0.5,))),
        ("speeds", lambda: dissipation(DUHEM, drive, (0.5,), (-1.0,))),
        ("speed", lambda: run(DUHEM, drive, speed=0.0)),
    ):
        with pytest.raises(hj.InputError, match=f"`{name}` must be positive"):
            call()
    with pytest.raises(hj.InputError, match="`speed` must be one number, got an array"):
        run(DUHEM, drive, speed=jnp.ones(2))


@pytest.mark.parametrize("constant, way", [(0.4, "rises by 0.7"), (-1.3, "falls by 1")])
def test_a_fit_says_that_its_law_never_rests(constant, way):
    """It moves on at the same pace whatever the output; one that stands still says
    nothing, nor does one that comes to rest."""
    reached = FittedRange(0.5, 1.5, 2.0)
    for terms, said in (
        ({"1": constant, "u": 0.3}, [f"held at 1 V it {way} µm/s, and never rests"]),
        ({"du": 1.0}, []),
        ({"w": -1.0, "u": 1.0}, []),
    ):
        model = SparseModel.from_terms(terms, units=("V", "µm")).fitted_on(reached)
        zero = jnp.zeros(())
        fading = hj.refinement.Fading(zero - 1, zero, zero, zero, zero)
        fit = fit_of(model, fading=fading, spread=jnp.array(2.0))
        found = [x for x in statements(fit.solution()) if "held" in x]
        assert [x.partition("input is ")[2] for x in found] == said


@pytest.mark.slow
def test_a_fit_says_that_its_law_has_several_rests():
    law = SparseModel.from_terms({"w": 1.0, "w*|w|": -1.0, "u": 2.0})
    record = hj.generate(law, Sine(1.5, 0.25), np.linspace(0, 12, 121), w0=0.5)
    (said,) = (x for x in statements(hj.refine(law, record)) if "held" in x)
    words = r"it leaves (\S+), and comes to rest at (\S+) or (\S+), whichever"
    found = re.search(words, said)
    assert found is not None
    middle = float(jnp.min(record.u) + jnp.max(record.u))  # twice it, of u
    rest = np.roots([-1.0, 1.0, middle])  # of w > 0, and of w < 0 the other sign
    other = np.roots([1.0, 1.0, middle])
    expected = [min(abs(rest), key=abs), min(other), max(rest)]
    np.testing.assert_allclose(
        np.array(found.groups(), float), expected, rtol=2e-2, atol=2e-2
    )
