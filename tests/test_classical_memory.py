"""Classical models with memory: SciPy over every stretch, closed forms, and what they
promise."""

import itertools
import sys
import warnings

import classical_equations as by_hand
import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import hystjax as hj
from hystjax import InputError
from hystjax.models import (
    BoucWen,
    BoucWenBaberNoori,
    BoucWenForce,
    ColemanHodgdon,
    Dahl,
    Duhem,
    Everett,
    InverseJilesAtherton,
    JilesAtherton,
    Langevin,
    LuGre,
    MaxwellSlip,
    PrandtlIshlinskii,
    Preisach,
    RambergOsgood,
    Tellinen,
    Uniaxial,
    _guess,
)
from hystjax.models._forces import _centres
from hystjax.models._guess import _slope, stretches, wide_loop
from hystjax.signals import Signals
from hystjax.simulation import Adaptive, FixedStep

TURNS = np.array([0.0, 1.0, -0.8, 0.5, -0.4, 0.9])  # a first curve, and inner loops
STRAIGHT = 24  # samples from one turning point to the next


def through(turns):
    """Inputs that go straight from one turning point to the next."""
    legs = itertools.pairwise(turns)
    straight = [np.linspace(a, b, STRAIGHT, endpoint=False) for a, b in legs]
    return np.concatenate([*straight, turns[-1:]])


U = through(TURNS)
T = 0.1 * np.arange(len(U))


def run(model, scale, method):
    record = hj.Recording(T, scale * U, np.zeros_like(U))
    return np.asarray(hj.simulate(model, record, method=method).w)


def by_scipy(rate, x, scale, output=lambda u, du, x: x[0]):
    """Outputs of x' = rate(u, u', x) at the samples, interval by interval."""
    x, found = np.atleast_1d(np.asarray(x, float)), []
    for i, (t, u) in enumerate(zip(T, scale * U, strict=True)):
        last = i == len(T) - 1
        du = scale * (U[i] - U[i - 1] if last else U[i + 1] - U[i]) / 0.1
        found.append(output(u, du, x))
        if not last:

            def field(s, x, u=u, du=du, t=t):
                return rate(u + du * (s - t), du, x)

            ran = solve_ivp(
                field, (t, T[i + 1]), x, "DOP853", rtol=1e-11, atol=1e-13 * scale
            )
            x = ran.y[:, -1]
    return np.array(found)


STEEL = (1.3e6, 40.0, 50.0, 6e-5, 0.15)
JA = JilesAtherton(*STEEL)
MAJOR = (1.4, 60.0, 80.0, 1e-3)
CURVE = (1.3, 60.0, 1e-3, 0.015, 0.3)
BRISTLES = (2e3, 8.0, 0.6, 1.0, 1.5, 0.1)
SPRING = (0.1, 50.0, 12.0, 8.0, 1.5)
PINCHED = (0.1, 50.0, 12.0, 4.0, 1.2, 0.05, 0.04, 0.7, 0.1, 0.5, 0.1, 0.01, 0.3)
ODES = {  # the model, the amplitude, its rate and its output by hand, and the start
    "JilesAtherton": (JA, 250.0, (by_hand.jiles_atherton(*STEEL),), 0.0),
    "InverseJilesAtherton": (
        InverseJilesAtherton(JA),
        1.4,
        (by_hand.inverse_jiles_atherton(*STEEL),),
        0.0,
    ),
    "Tellinen": (Tellinen(*MAJOR), 250.0, (by_hand.tellinen(*MAJOR),), 0.0),
    "ColemanHodgdon": (
        ColemanHodgdon(*CURVE),
        250.0,
        (by_hand.coleman_hodgdon(*CURVE),),
        0.0,
    ),
    "Dahl": (Dahl(600.0, 5.0, 1.5), 0.1, (by_hand.dahl(600.0, 5.0, 1.5),), 0.0),
    "LuGre": (LuGre(*BRISTLES), 0.1, by_hand.lugre(*BRISTLES), 0.0),
    "BoucWenForce": (BoucWenForce(*SPRING), 0.3, by_hand.bouc_wen_force(*SPRING), 0.0),
    "BoucWenBaberNoori": (
        BoucWenBaberNoori(*PINCHED),
        0.4,
        by_hand.baber_noori(*PINCHED),
        [0.0, 0.0],
    ),
}


@pytest.mark.parametrize("name", ODES)
def test_models_agree_with_scipy_over_turning_points(name):
    model, scale, (rate, *output), start = ODES[name]
    expected = by_scipy(rate, start, scale, *output)
    found = run(model, scale, Adaptive(rtol=1e-10))
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * size)


AT_BOUNDS = {  # on which fits may end, each with the numbers of the equations by hand
    "JilesAtherton": ({"coupling": 0.0, "reversibility": 0.0}, (*STEEL[:3], 0.0, 0.0)),
    "Tellinen": ({"slope": 0.0}, (*MAJOR[:3], 0.0)),
    "ColemanHodgdon": ({"slope": 0.0, "following": 1.0}, (1.3, 60.0, 0.0, 0.015, 1.0)),
    "LuGre": ({"micro": 0.0, "viscous": 0.0}, (2e3, 0.0, 0.0, 1.0, 1.5, 0.1)),
    "BoucWenForce": ({"alpha": 0.0}, (0.0, *SPRING[1:])),
    "BoucWenBaberNoori": (
        {"alpha": 0.0, "zeta_s": 0.0},
        (0.0, *PINCHED[1:7], 0.0, *PINCHED[8:]),
    ),
}
BY_HAND = {
    "JilesAtherton": by_hand.jiles_atherton,
    "Tellinen": by_hand.tellinen,
    "ColemanHodgdon": by_hand.coleman_hodgdon,
    "LuGre": by_hand.lugre,
    "BoucWenForce": by_hand.bouc_wen_force,
    "BoucWenBaberNoori": by_hand.baber_noori,
}


@pytest.mark.parametrize("name", AT_BOUNDS)
def test_models_are_some_where_fits_may_end_on_a_bound(name, tmp_path):
    model, scale, _, start = ODES[name]
    ends, numbers = AT_BOUNDS[name]
    fitted, given = model.with_parameters(ends), type(model)(*numbers)
    assert fitted.parameters() == given.parameters()
    hj.save(tmp_path / "law.json", fitted)
    assert eqx.tree_equal(hj.load(tmp_path / "law.json"), fitted)
    equations = BY_HAND[name](*numbers)
    equations = equations if isinstance(equations, tuple) else (equations,)
    rate, *output = equations
    expected = by_scipy(rate, start, scale, *output)
    found = run(given, scale, Adaptive(rtol=1e-10))
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize(
    "make",
    [
        lambda n: BoucWen(1.0, 0.5, 0.2, n),
        lambda n: BoucWenForce(0.1, 5.0, 1.0, 0.2, n),
        lambda n: RambergOsgood(5.0, 2.0, 1.0 + n),
        lambda n: Dahl(5.0, 1.0, n),
        lambda limit: MaxwellSlip([1.0, 2.0], [0.3, limit]),
    ],
)
def test_exponents_and_limits_may_end_on_their_bound(make, tmp_path):
    hj.save(tmp_path / "law.json", make(0.0))
    assert eqx.tree_equal(hj.load(tmp_path / "law.json"), make(0.0))


# ------------------------------------------------------------- anhysteretic curves


def test_the_langevin_function_loses_no_digits():
    """Nor do its first two derivatives, of which fits are made."""
    h = np.array([0.0, 1e-9, -1e-4, 0.3, -0.999, 1.001, 2.5, -20.0, 400.0])
    curve = Langevin()
    value, slope = jax.vmap(curve)(jnp.asarray(h))
    bend = jax.vmap(jax.grad(lambda h: curve(h)[1]))(jnp.asarray(h))
    with mpmath.workdps(80):

        def exact(x, order):
            if x == 0:
                return [0, mpmath.mpf(1) / 3, 0][order]
            x = mpmath.mpf(float(x))
            sinh, cosh = mpmath.sinh(x), mpmath.cosh(x)
            return [
                cosh / sinh - 1 / x,
                1 / x**2 - 1 / sinh**2,
                2 * cosh / sinh**3 - 2 / x**3,
            ][order]

        for found, order in ((value, 0), (slope, 1), (bend, 2)):
            expected = [float(exact(x, order)) for x in h]
            # The slope vanishes far out, where it counts beside 1.
            atol = 1e-15 if order else 0
            np.testing.assert_allclose(found, expected, rtol=1e-13, atol=atol)


@pytest.mark.parametrize("anisotropy", [3.0, -3.0, 100.0, -100.0])
def test_means_over_directions_are_integrals(anisotropy):
    curve = Uniaxial(anisotropy, 0.6)
    for h in (-0.5, 7.0, 100.0):

        def moment(power, h=h):
            best = np.clip(-h / (2 * anisotropy), -1, 1) if anisotropy < 0 else 1.0
            top = h * best + anisotropy * best**2

            def density(x):
                return np.exp(h * x + anisotropy * x * x - top) * x**power

            edges = sorted({-1, -0.99, -0.9, best, 0.9, 0.99, 1})
            return sum(
                quad(density, a, b, epsabs=0, epsrel=1e-13)[0]
                for a, b in itertools.pairwise(edges)
                if a < b
            )

        mean = moment(1) / moment(0)
        variance = moment(2) / moment(0) - mean**2
        value, slope = curve(jnp.asarray(h))
        expected = 0.6 * mean + 0.4 * by_hand.langevin(h)
        assert float(value) == pytest.approx(expected, rel=1e-10)
        expected = 0.6 * variance + 0.4 * by_hand.langevin_slope(h)
        assert float(slope) == pytest.approx(expected, rel=1e-8)


# ----------------------------------------------------------------- Jiles and Atherton


def test_susceptibility_is_never_negative():
    """Wherever a device may come to be, and with any coupling."""
    rng = np.random.default_rng(0)
    fields, ms = rng.normal(size=(2, 10_000)) * [[200.0], [1e6]]
    couplings = 10 ** rng.uniform(-7, -2, 10_000)

    def chi(coupling, field, m, way):
        model = JilesAtherton(1.3e6, 40.0, 50.0, coupling, 0.15)
        return model.susceptibility(field, m, way)

    for way in (-1.0, 1.0):
        found = jax.vmap(chi, (0, 0, 0, None))(couplings, fields, ms, way)
        assert np.all(np.isfinite(found)) and np.all(found >= 0)
        # By the definition, up to a slope of 10 000 times that without coupling.
        rows, steep = zip(couplings, fields, ms, found, strict=True), []
        for coupling, field, m, chi_of_it in itertools.islice(rows, 1000):
            by_definition = by_hand.susceptibility(1.3e6, 40.0, 50.0, coupling, 0.15)
            with np.errstate(over="ignore"):
                expected = by_definition(field, m, way)
            if 0 <= coupling * expected < 9999:
                assert float(chi_of_it) == pytest.approx(expected, rel=1e-6, abs=1e-3)
                steep.append(coupling * expected)
        assert max(steep) > 20


def test_without_the_clamp_susceptibility_would_be_negative():
    """Just after the upper tip of a loop, where M has not come to Man."""
    record = hj.Recording(T, 250 * U, np.zeros_like(U))
    b = np.asarray(hj.simulate(JA, record, method=FixedStep(8)).w)
    tip = STRAIGHT
    parts = JA.components(jnp.asarray(250 * U), jnp.asarray(b))
    assert parts.total[tip] < parts.anhysteretic[tip]
    steps = np.diff(b - by_hand.MU0 * 250 * U) / np.diff(U)
    assert np.min(steps) >= -1e-12
    np.testing.assert_allclose(
        parts.irreversible + parts.reversible, parts.total, rtol=1e-12
    )
    # M = (1 - c) Mirr + c Man, of the Langevin function at He = H + alpha M.
    saturation, width, _, coupling, c = STEEL
    effective = (250 * U + coupling * np.asarray(parts.total)) / width
    drawn_to = saturation * np.array([by_hand.langevin(h) for h in effective])
    np.testing.assert_allclose(parts.anhysteretic, drawn_to, rtol=1e-9, atol=1e-3)
    whole = (1 - c) * parts.irreversible + c * drawn_to
    np.testing.assert_allclose(parts.total, whole, rtol=1e-9, atol=1e-3)


def test_a_spring_that_slips_at_once_has_derivatives():
    """Without lam the slip is of no width before the first energy; with 1e-12 it is,
    and the force is the same."""
    rate, force = by_hand.baber_noori(*PINCHED[:-1], 1e-12)
    expected = by_scipy(rate, [0.0, 0.0], 0.4, force)
    numbers = (*PINCHED[:-1], 0.0)
    model = BoucWenBaberNoori(*numbers)
    found = run(model, 0.4, Adaptive(rtol=1e-10))
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * size)
    record = hj.Recording(T, 0.4 * U, np.zeros_like(U))

    @jax.jit
    @jax.jacfwd
    def slopes(numbers):
        bent = BoucWenBaberNoori(*numbers)
        return hj.simulate(bent, record, method=FixedStep(2)).w

    assert np.all(np.isfinite(slopes(jnp.asarray(numbers))))


def test_of_a_magnet_without_losses_nothing_is_irreversible():
    """M is Man, of the Langevin function without a coupling."""
    field = np.linspace(-300.0, 300.0, 61)
    m = 1.3e6 * np.array([by_hand.langevin(h / 40.0) for h in field])
    lossless = JilesAtherton(1.3e6, 40.0, 50.0, 0.0, 1.0)
    parts = lossless.components(field, by_hand.MU0 * (field + m))
    np.testing.assert_allclose(parts.irreversible, 0.0, atol=1e-6 * 1.3e6)
    np.testing.assert_allclose(parts.reversible, m, rtol=1e-6, atol=1e-3)


def test_the_inverse_leads_back_to_the_field():
    fine = np.linspace(0, T[-1], 2001)
    h = np.interp(fine, T, 250 * U)
    b = hj.simulate(JA, hj.Recording(fine, h, 0 * h), method=FixedStep(8)).w
    inverse = InverseJilesAtherton(JA)
    back = hj.simulate(inverse, hj.Recording(fine, b, h), method=FixedStep(8)).w
    # b is a straight line between its samples here, which it was not above.
    np.testing.assert_allclose(back, h, atol=2e-3 * 250)


# ---------------------------------------------------------------------- closed forms


def test_dahl_decays_with_the_distance():
    model = Dahl(600.0, 5.0)
    found, f = [0.0], 0.0
    for step in np.diff(0.1 * U):
        limit = 5 * np.sign(step)
        f = limit + (f - limit) * np.exp(-600 * abs(step) / 5)
        found.append(f)
    np.testing.assert_allclose(run(model, 0.1, Adaptive()), found, atol=1e-8)
    assert set(model.terms()) == {"du", "w*|du|"}
    assert Dahl(600.0, 5.0, 2.0).addends() is None


def test_a_spring_that_yields_starts_at_its_first_force():
    model, seen = BoucWenForce(*SPRING), jnp.array(1.5)
    now = Signals(*map(jnp.asarray, (0.0, 0.4, 1.0)))
    assert float(model.output(model.start((), now, seen), (), now)) == 1.5


def test_brittle_friction_slides_alike_both_ways():
    """With the exponent 1/2 the force comes to the Coulomb force on the way, and stays
    there."""
    t = np.linspace(0, 10, 401)
    for way in (1.0, -1.0):
        u = way * np.linspace(0.0, 0.05, len(t))
        left = np.maximum(1 - 600 * np.abs(u) / (2 * 5.0), 0.0)
        expected = way * 5 * (1 - left**2)
        record = hj.Recording(t, u, 0 * u)
        found = hj.simulate(Dahl(600.0, 5.0, 0.5), record, method=FixedStep(32)).w
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_coleman_hodgdon_between_turning_points():
    model = ColemanHodgdon(*CURVE)

    def f(u):
        return 1e-3 * u + 1.3 * np.tanh(u / 60)

    def held_back(x):  # f' - g
        return 0.7 * 1.3 / 60 / np.cosh(x / 60) ** 2

    found, w = [0.0], 0.0
    turns = 250 * TURNS
    for start, end in itertools.pairwise(turns):

        def there(x, end=end):
            return held_back(x) * np.exp(-0.015 * abs(end - x))

        missing = quad(there, start, end, epsabs=1e-13)[0]
        w = f(end) + (w - f(start)) * np.exp(-0.015 * abs(end - start)) - missing
        found.append(w)
    np.testing.assert_allclose(
        run(model, 250.0, Adaptive())[::STRAIGHT], found, atol=1e-8
    )


def test_lugre_slides_and_sticks():
    for v in (0.02, -0.1, 0.5):
        t = np.linspace(0, 2, 401)
        record = hj.Recording(t, v * t, 0 * t)
        w = hj.simulate(LuGre(*BRISTLES), record, method=FixedStep(16)).w
        g = 1.0 + 0.5 * np.exp(-((v / 0.1) ** 2))
        slides = g * np.sign(v) + 0.6 * v
        assert float(w[-1]) == pytest.approx(slides, rel=1e-8)
        assert float(LuGre(*BRISTLES).steady(v)) == pytest.approx(slides, rel=1e-12)
    # Far below the static force it is a spring and a damper.
    t = np.linspace(0, 1, 401)
    u = 1e-9 * np.sin(20 * t)
    w = hj.simulate(LuGre(*BRISTLES), hj.Recording(t, u, 0 * t), method=FixedStep(4)).w
    v = np.diff(u) / np.diff(t)
    np.testing.assert_allclose(w[:-1], 2e3 * u[:-1] + 8.6 * v, atol=1e-4 * 2e-6)


def test_elements_that_slip_are_a_sum_of_stops():
    stiffnesses, limits = np.array([3.0, 2.0, 1.0]), np.array([0.1, 0.3, 0.7])
    model = MaxwellSlip(stiffnesses, limits)
    expected = by_hand.slips(U, stiffnesses, limits)
    np.testing.assert_allclose(run(model, 1.0, FixedStep(1)), expected, atol=1e-14)
    assert model.terms() == {
        "u": 6.0,
        "play(u,0.1)": -3.0,
        "play(u,0.3)": -2.0,
        "play(u,0.7)": -1.0,
    }


@pytest.mark.slow
def test_a_guess_of_elements_that_slip_is_close_whatever_their_limits_are():
    """Under an input with loops of many sizes, of which a grid tells all limits; from
    far-off ones fits ended up to six times the noise away."""
    s = np.linspace(0, 1, 401)
    waves = ((0.6, 4, 1.0), (0.4, 14, 2.0), (0.3, 22, 0.0))
    u = sum(size * np.sin(rate * np.pi * s + phase) for size, rate, phase in waves)
    every = [0.1, 0.25, 0.3, 0.8], [0.5, 0.55, 0.6, 0.75], [0.2, 0.7], [0.3]
    for limits in every:
        stiffnesses = np.array([3.0, 1.0, 2.0, 4.0])[: len(limits)]
        w = by_hand.slips(u, stiffnesses, np.array(limits))
        record = hj.Recording(s, u, w)
        for count in (4, 6):
            guess = MaxwellSlip.guess(record, count)
            assert len(guess.limits) == count
            assert np.all(guess.stiffnesses > 0)  # which a fit could not leave again
            left = hj.simulate(guess, record).w - w
            assert np.std(left) < 0.01 * np.std(w)
    for count in (0, -1):
        with pytest.raises(InputError, match="`elements` must be"):
            MaxwellSlip.guess(record, count)


@pytest.mark.parametrize("share", [(10.0, 1.0, 3.0, 3.0), (10.0, 1.0, 0.1, 3.0)])
def test_elements_that_stand_for_others_move_them_least(share):
    at, share = np.array([1.0, 2.0, 10.0, 11.0]), np.array(share)
    options = []
    for i in range(3):
        pair = slice(i, i + 2)
        centre = np.average(at[pair], weights=share[pair])
        moved = np.sum(share[pair] * (at[pair] - centre) ** 2)
        options.append((moved, [*at[:i], centre, *at[i + 2 :]]))
    np.testing.assert_allclose(_centres(at, share, 3, 12.0), min(options)[1])
    # Too few are filled up in the middle of the widest gap, one after the other.
    filled = _centres(np.array([0.1]), np.array([1.0]), 3, 1.0)
    np.testing.assert_allclose(filled, [0.1, 0.325, 0.55])


# ------------------------------------------------------------------------ closed loops


@pytest.mark.parametrize(("width", "atol"), [(80.0, 1e-7), (20.0, 1e-5)])
def test_tellinen_stays_on_its_major_loop(width, atol):
    """Where its flanks are narrower than the loop too."""
    model = Tellinen(1.4, 60.0, width, 1e-3)
    t = np.linspace(0, 1, 801)
    for way in (1.0, -1.0):
        u = way * np.linspace(-4e3, 4e3, 801)
        branch = model.branch(u, way)
        record = hj.Recording(t, u, branch)
        w = hj.simulate(model, record, method=FixedStep(8)).w
        np.testing.assert_allclose(w, branch, atol=atol)


def test_tellinen_closes_inner_loops():
    """And about the middle, whatever the offset that they start with."""
    model = Tellinen(*MAJOR)
    t = np.arange(0, 40 + 1 / 64, 1 / 32)
    u = 90 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t))
    for w0 in (0.3, -0.5):
        w = hj.simulate(model, hj.Recording(t, u, 0 * t + w0), method=FixedStep(8)).w
        cycle, before = np.asarray(w[-33:]), np.asarray(w[-65:-32])
        np.testing.assert_allclose(cycle, before, atol=1e-6)
        np.testing.assert_allclose(cycle[:17], -cycle[16:], atol=1e-6)
        assert np.ptp(cycle[[0, 16, 32]]) > 0.1  # at u = 0: a loop, and no curve


STEELY = (200.0, 0.4, 7.0)


def yielding(u, depth=32):
    model = RambergOsgood(*STEELY, depth=depth)
    record = hj.Recording(np.arange(len(u)), u, np.zeros_like(u))
    return np.asarray(hj.simulate(model, record, method=FixedStep(1)).w)


def test_ramberg_osgood_on_an_inner_loop():
    """A first curve, a branch, an inner loop that closes, the branch before it, and the
    first curve again."""
    turns = 6e-3 * np.array([0.0, 1.0, -0.5, 0.3, -0.5, -0.9, 1.5])
    w = yielding(through(turns))[::STRAIGHT]

    def branch(u, u0, w0):
        return w0 + 2 * by_hand.skeleton((u - u0) / 2, *STEELY)

    top = by_hand.skeleton(turns[1], *STEELY)
    low = branch(turns[2], turns[1], top)
    end = branch(turns[5], turns[1], top)  # as if there had been no inner loop
    beyond = by_hand.skeleton(turns[6], *STEELY)
    expected = [0.0, top, low, branch(turns[3], turns[2], low), low, end, beyond]
    np.testing.assert_allclose(w, expected, rtol=1e-12)


TURNS_24 = st.lists(st.floats(-1, 1, allow_subnormal=False), min_size=24, max_size=24)


@settings(max_examples=20, deadline=None)
@given(turns=TURNS_24)
def test_masing_rules_are_those_of_a_list_that_is_popped(turns):
    u = 6e-3 * np.array(turns)
    found, expected = yielding(u), by_hand.masing(u, *STEELY)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(turns=TURNS_24)
def test_masing_is_a_stack_of_many_stops(turns):
    """The first curve by straight lines is a sum of stops, and so is all else."""
    knots = 6e-3 * np.linspace(0, 1, 401)
    levels = np.array([by_hand.skeleton(each, *STEELY) for each in knots])
    slopes = np.append(np.diff(levels) / np.diff(knots), 0.0)
    u = 6e-3 * np.array(turns)
    expected = by_hand.slips(u, -np.diff(slopes), knots[1:])
    np.testing.assert_allclose(yielding(u), expected, atol=2e-5 * levels[-1])


def test_loops_deeper_than_the_memory_are_left_out():
    u = 6e-3 * np.array([0.0, 1.0, -0.9, 0.8, -0.7, 0.8, -0.9, 1.0])
    deep, found = yielding(u), yielding(u, depth=3)
    np.testing.assert_allclose(found[-2:], deep[-2:], rtol=1e-12)
    # Inside of the second turn there is one curve, up and down.
    low = found[2]
    curve = [low + 2 * by_hand.skeleton((x - u[2]) / 2, *STEELY) for x in u[3:6]]
    np.testing.assert_allclose(found[3:6], curve, rtol=1e-12)
    assert np.all(np.isfinite(found))


@eqx.filter_jit
def stresses(model, strains):
    """Of each strain the stress and its first two derivatives."""

    def slope(strain):
        return jax.grad(model.first)(strain)

    return [jax.vmap(f)(strains) for f in (model.first, slope, jax.grad(slope))]


def test_the_stress_of_a_strain_is_exact_with_its_derivatives():
    for n in (1.2, 3.0, 30.0):
        model = RambergOsgood(200.0, 0.4, n)
        strains = jnp.array([1e-7, 2e-3, -0.05, 3.0])
        found, slopes, bends = stresses(model, strains)
        expected = [by_hand.skeleton(float(each), 200.0, 0.4, n) for each in strains]
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        plastic = n * 3 / 7 * np.abs(found / 0.4) ** (n - 1)
        steep = 200 / (1 + plastic)
        np.testing.assert_allclose(slopes, steep, rtol=1e-10)
        # Of the inverse function, by the second derivative of the strain.
        bend = -(steep**3) * (n - 1) * plastic / found / 200
        np.testing.assert_allclose(bends, bend, rtol=1e-8)
    value, slope, _ = stresses(RambergOsgood(*STEELY), jnp.zeros(4))
    assert np.all(value == 0) and np.all(slope == 200)


# --------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Dahl(-1.0, 5.0), "`stiffness` must be positive and finite, got -1.0"),
        (lambda: Dahl(np.inf, 5.0), "`stiffness` must be positive and finite, got inf"),
        (
            lambda: JilesAtherton(1e6, 100.0, np.nan, 1e-4, 0.1),
            "`pinning` must be positive and finite, got nan",
        ),
        (
            lambda: JilesAtherton(1e6, 1.0, 1.0, 1e-5, 1.1),
            "`reversibility` must be at least 0 and at most 1, got 1.1",
        ),
        (lambda: JilesAtherton(1e6, 0.0, 1.0, 1e-5, 0.1), "`width` must be positive"),
        (lambda: RambergOsgood(1.0, 1.0, 0.5), "`n` must be at least 1 and finite"),
        (lambda: RambergOsgood(1.0, 1.0, 5.0, depth=0), "`depth` must be at least 1"),
        (lambda: RambergOsgood(1.0, 1.0, 5.0, depth=2.5), "`depth` must be a whole"),
        (
            lambda: BoucWenForce(1.2, 1.0, 1.0, 1.0),
            "`alpha` must be at least 0 and below 1",
        ),
        (lambda: MaxwellSlip([1.0, 2.0], [0.1]), "arrays of one length"),
        (lambda: MaxwellSlip([1.0], [-0.1]), "`limits` must be zero or more"),
        (lambda: MaxwellSlip([], []), "a number for each element"),
        (lambda: MaxwellSlip([[1.0]], [[0.1]]), r"each element.*shapes \(1, 1\)"),
        (lambda: Dahl("600", 5.0), "`stiffness` must be a real number.*the text '600'"),
        (lambda: Dahl(600.0, 5j), "`coulomb` must be a real number.*5j"),
        (
            lambda: JilesAtherton(1e6, 1.0, 1.0, 1e-5, 0.5, np.tanh),
            "`anhysteretic` must be a curve",
        ),
        (lambda: InverseJilesAtherton(Dahl(1.0, 1.0)), "`JilesAtherton`, got a Dahl"),
        (lambda: Tellinen(1.0, jnp.ones(2), 1.0), "`coercive` must be a number"),
        (
            lambda: Duhem(np.array([0.0, 1.0]), 1.0, 1.0),
            r"each of a tuple of them, must be a number, got an array of shape \(2,\)",
        ),
    ],
)
def test_parameters_that_make_no_sense_are_refused(unchecked, make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("text", ["a", b"a", ["a"], [1.0, "a"]])
def test_texts_are_refused_without_a_warning(unchecked, text):
    """Of NumPy, where one is the name of a type."""
    with pytest.raises(InputError, match="must be real numbers"):
        MaxwellSlip(text, [0.1])


CLASSICAL = [
    BoucWenBaberNoori,
    BoucWenForce,
    ColemanHodgdon,
    Dahl,
    InverseJilesAtherton,
    JilesAtherton,
    LuGre,
    MaxwellSlip,
    RambergOsgood,
    Tellinen,
]


@pytest.mark.parametrize("cls", [Dahl, RambergOsgood])
def test_loops_about_several_inputs_are_read_one_by_one(cls):
    """Their widest ways up and down share no input."""
    ways = [0.0, 0.3, 0.1, 0.3, 0.6, 0.4, 0.6, 1.0, 0.8, 1.0]
    u = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(ways)])
    truth = {
        Dahl: Dahl(300.0, 5.0),
        RambergOsgood: RambergOsgood(600.0, 20.0, 5.0),
    }[cls]
    record = hj.Recording(np.arange(len(u)) * 0.01, u, 0 * u)
    record = hj.Recording(record.t, u, hj.simulate(truth, record, w0=0.0).w)
    guess = hj.simulate(cls.guess(record), record).w
    assert np.std(guess - record.w) < 0.3 * np.std(record.w)


@pytest.mark.parametrize("cls", [Tellinen, ColemanHodgdon, JilesAtherton])
def test_a_loop_that_falls_from_tip_to_tip_is_of_no_magnet(cls):
    t = np.linspace(0, 20, 400)
    record = hj.Recording(None, np.sin(t), -np.tanh(2 * np.sin(t + 0.3)))
    with pytest.raises(
        InputError, match=r"does not rise from tip to tip.*opposite sign"
    ):
        cls.guess(record)


def test_slopes_are_those_of_a_fit_with_a_level_for_every_stretch():
    rng = np.random.default_rng(0)
    u = np.concatenate([np.linspace(a, -a, 30) for a in (1, -1, 1, -1)])
    w = u + 0.1 * rng.normal(size=len(u))
    wide = stretches(u)
    rows, levels = [], []
    for i, each in enumerate(wide):
        x = (u[each.rows] - u[each.rows][0]) / abs(each.width)
        near = np.abs(x) <= 0.2
        level = np.zeros((near.sum(), len(wide)))
        level[:, i] = 1
        rows.append(np.column_stack([x, x * np.abs(x)])[near])
        levels.append((level, w[each.rows][near] / abs(each.width)))
    columns = np.hstack([np.vstack(rows), np.vstack([level for level, _ in levels])])
    found, *_ = np.linalg.lstsq(columns, np.concatenate([y for _, y in levels]))
    assert _slope(u, w, wide, after=True) == pytest.approx(found[0], rel=1e-9)


def test_a_spring_that_hardens_has_no_limit_to_slip_at():
    numbers = {"alpha": 0.1, "k": 50.0, "beta": 3.0, "gamma": -5.0, "n": 1.5}
    plain = BoucWenForce(**numbers)
    pinched = BoucWenBaberNoori(**numbers, zeta_s=0.8)
    record = hj.Recording(T, 0.3 * U, 0 * U)
    outputs = [hj.simulate(m, record, w0=0.0).w for m in (plain, pinched)]
    np.testing.assert_allclose(*outputs, rtol=1e-6, atol=1e-6 * np.ptp(outputs[0]))

    def run_of(model, record):
        return hj.simulate(model, record, w0=0.0, method=FixedStep(1)).w

    straight = BoucWenBaberNoori(**(numbers | {"n": 0.0}), zeta_s=0.8)
    change = jax.jacfwd(
        lambda n: run_of(eqx.tree_at(lambda m: m.n, straight, n), record)
    )(jnp.asarray(0.0))
    assert np.all(np.isfinite(change))


def test_springs_that_slip_on_the_first_way_are_guessed():
    """Under an input to one side of zero limits go up to the farthest input."""
    turns = (0, 1, 0.2, 1, 0.2, 1)
    u = np.concatenate([np.linspace(a, b, 80) for a, b in itertools.pairwise(turns)])
    w = by_hand.slips(
        u, np.array([3.0, 2.0, 1.0, 2.0]), np.array([0.05, 0.15, 0.4, 0.8])
    )
    record = hj.Recording(None, u, w)
    left = hj.simulate(MaxwellSlip.guess(record, 6), record).w - w
    assert np.std(left) < 0.02 * np.std(w)


def test_terms_of_one_name_are_one():
    assert MaxwellSlip([1.0, 2.0], [0.1, 0.1]).terms() == {
        "u": 3.0,
        "play(u,0.1)": -3.0,
    }
    assert MaxwellSlip([1.0, 2.0], [0.0, 0.1]).terms() == {
        "u": 2.0,
        "play(u,0.1)": -2.0,
    }
    assert BoucWen(1.0, 0.5, 0.2, 0.0).terms()["du"] == pytest.approx(0.8)
    never = MaxwellSlip([1.0, 0.6], [0.1, np.inf])
    assert never.terms() == {"u": 1.6, "play(u,0.1)": -1.0}
    assert "play" in hj.export.to_c(never)
    plays = hj.models.PrandtlIshlinskii([0.1, np.inf], [1.0, 2.0])
    assert plays.terms() == {"play(u,0.1)": 1.0}


def test_a_given_state_goes_to_where_the_first_input_lets_it():
    law = RambergOsgood(600.0, 20.0, 5.0, depth=6)
    u = np.array([0.1, -0.05, 0.03, -0.08, 0.0])
    whole = hj.simulate(law, hj.Recording(None, u, u)).w
    begun = hj.models.Started(law, jnp.array([0.1, -0.05, 0.03, 0.03, 0.03, 0.03]))
    rows = u[[3, 3, 4]]  # which begins at rest
    after = hj.simulate(begun, hj.Recording(None, rows, rows)).w
    np.testing.assert_allclose(after[1:], whole[3:], rtol=1e-12)


@pytest.mark.parametrize("cls", CLASSICAL)
def test_guesses_refuse_records_without_a_loop(cls):
    t = np.arange(100.0)
    with pytest.raises(InputError, match="at least 16 samples, got 5"):
        cls.guess(hj.Recording(t[:5], t[:5], t[:5]))
    with pytest.raises(InputError, match="one direction only"):
        cls.guess(hj.Recording(t, t, t))
    with pytest.raises(InputError, match="is constant"):
        cls.guess(hj.Recording(t, np.sin(t), 0 * t))
    u = np.sin(t / 5)
    with pytest.raises(InputError, match="has no loop"):
        cls.guess(hj.Recording(t, u, 2 * u))
    for leaping in (t % 20, np.sign(u)):  # back at once, and both ways
        with pytest.raises(InputError, match="leaps from end to end"):
            cls.guess(hj.Recording(t, leaping, np.sin(t)))
    lags = cls in (ColemanHodgdon, JilesAtherton, Tellinen)
    with pytest.raises(InputError, match="the other way round"):
        cls.guess(hj.Recording(t, u, np.sin(t / 5 + (0.4 if lags else -0.4))))


@pytest.mark.parametrize("cls", [*CLASSICAL, Everett, Preisach, PrandtlIshlinskii])
def test_guesses_are_of_one_recording(cls, unchecked):
    record = hj.Recording(T, U, U)
    with pytest.raises(
        InputError, match="`recording` must be a `Recording`, got a list"
    ):
        cls.guess([record])


def test_guesses_say_where_nothing_is_magnetised():
    t = np.arange(100.0) / 5
    field, density = 1e4 * np.sin(t), 1e-3 * np.sin(t - 0.3)  # 1e4 mu0 is 0.01 T
    for cls, columns in (
        (JilesAtherton, (field, density)),
        (InverseJilesAtherton, (density, field)),
    ):
        with pytest.raises(InputError, match=r"no magnet.*empty space to 0\.01"):
            cls.guess(hj.Recording(t, *columns))


@pytest.mark.parametrize(
    ("field_unit", "density_unit"),
    [("kA/m", "T"), ("A/m", "mT"), ("Oe", "G"), ("T", "A/m"), ("A/m", "A/m")],
)
def test_guesses_of_magnets_refuse_units_in_which_mu0_is_another(
    field_unit, density_unit
):
    t = np.arange(100.0) / 5
    field, density = 100 * np.sin(t), np.sin(t - 0.3)
    over_field = hj.Recording(t, field, density, units=(field_unit, density_unit))
    over_density = hj.Recording(t, density, field, units=(density_unit, field_unit))
    with pytest.raises(InputError, match=r"has the units.*in_si"):
        JilesAtherton.guess(over_field)
    with pytest.raises(InputError, match=r"has the units.*in_si"):
        InverseJilesAtherton.guess(over_density)


@pytest.mark.parametrize("way", [1, -1])
def test_guesses_of_magnets_are_the_same_from_units_that_were_converted(way):
    t = np.arange(100.0) / 5
    columns = 100 * np.sin(t), np.sin(t - 0.3)
    factors = 4e-3 * np.pi, 1e4  # Oe and G
    cgs = [factor * column for factor, column in zip(factors, columns, strict=True)]
    cls = JilesAtherton if way == 1 else InverseJilesAtherton
    asked = cls.guess(hj.Recording(t, *columns[::way])).parameters()
    units = ("Oe", "G") if way == 1 else ("G", "Oe")
    record = hj.Recording(t, *cgs[::way], units=units)
    found = cls.guess(hj.loops.in_si(record)).parameters()
    for name, value in asked.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-9)


PERIOD = 2 * np.pi * np.arange(241) / 240
READ_OFF_A_LOOP = [cls for cls in CLASSICAL if cls not in (LuGre, MaxwellSlip)]


def cycled(rising, falling, ends, samples=401):
    """Two cycles between two inputs, of branches that are functions of the input."""
    up = np.linspace(*ends, samples)
    u = np.concatenate([up[:-1], up[:0:-1], up[:-1], up[::-1]])
    way = np.tile(np.repeat([1, -1], samples - 1), 2)
    way = np.append(way, -1)
    w = np.where(way > 0, rising(u), falling(u))
    return hj.Recording(None, u, w)


def test_guesses_do_not_hang_on_the_way_that_noise_took_first():
    t = np.linspace(0, 3, 601)
    u = 0.1 * np.sin(2 * np.pi * t)
    spring = RambergOsgood(600.0, 20.0, 6.0)
    w = np.asarray(hj.simulate(spring, hj.Recording(t, u, u)).w)[-201:]
    once, noisy = u[-201:], u[-201:].copy()
    noisy[1] = noisy[0] - 1e-6
    clean, other = (
        RambergOsgood.guess(hj.Recording(t[-201:], x, w)).parameters()
        for x in (once, noisy)
    )
    for name, value in clean.items():
        np.testing.assert_allclose(other[name], value, rtol=1e-2)


def test_guesses_of_yielding_springs_read_their_knee():
    """Bouc and Wen's for n = 1 and beta = gamma: elastic back to z = 0, and from there
    on exponential."""
    alpha, k, most = 0.2, 50.0, 0.1

    def rising(u):
        beyond = u + 0.5 - most  # of the lower tip, where z is -most
        z = np.where(
            beyond < 0, beyond, most * -np.expm1(-np.maximum(beyond, 0) / most)
        )
        return alpha * k * u + (1 - alpha) * k * z

    record = cycled(rising, lambda u: -rising(-u), (-0.5, 0.5))
    found = BoucWenForce.guess(record)
    assert float(found.alpha) == pytest.approx(alpha, abs=0.04)
    assert float(found.k) == pytest.approx(k, rel=0.2)
    assert float(found.beta) == float(found.gamma)
    assert float(found.beta + found.gamma) == pytest.approx(1 / most, rel=0.3)
    cycle = record.window(0, 801)
    pinched = BoucWenBaberNoori.guess(cycle)
    energy = np.trapezoid(cycle.w, cycle.u)
    assert float(pinched.psi * (pinched.beta + pinched.gamma)) == pytest.approx(0.5)
    half = 1 - np.exp(-float(pinched.p) * energy / 2)
    assert half == pytest.approx(0.5, abs=0.01)
    assert float(pinched.delta_nu) * energy == pytest.approx(0.1)


@pytest.mark.parametrize("bend", [0.5, 1.0, 4.0])
def test_guesses_of_friction_read_its_branches(bend):
    """Dahl's steady loop, of a contact that hardly comes to slide, and that does."""
    coulomb = 3.0

    def rising(u):
        return coulomb * (1 - np.exp(-bend * u) / np.cosh(bend))

    found = Dahl.guess(cycled(rising, lambda u: -rising(-u), (-1.0, 1.0)))
    assert float(found.coulomb) == pytest.approx(coulomb, rel=0.1)
    assert float(found.stiffness) == pytest.approx(coulomb * bend, rel=0.05)


def test_a_first_curve_and_the_way_back_are_a_loop():
    u = np.concatenate([np.linspace(0, 1, 201), np.linspace(1, -0.5, 301)[1:]])
    up, top = 3 * (1 - np.exp(-10 * u[:201])), 3 * (1 - np.exp(-10.0))
    down = -3 + (top + 3) * np.exp(-10 * (1 - u[201:]))
    found = Dahl.guess(hj.Recording(None, u, np.append(up, down)))
    assert float(found.coulomb) == pytest.approx(3.0, rel=0.1)


def test_guesses_of_friction_that_lacks_a_part_can_be_fitted():
    """Where it falls with speed nothing is viscous, where it rises nothing sticks, and
    where it is in proportion nothing slides: a fit could not leave zero again."""
    phase = np.linspace(0, 6 * np.pi, 601)
    way, speed = np.sign(np.cos(phase)), np.abs(np.cos(phase))
    for shape in (1 - 0.3 * speed, 1 + 0.3 * speed, speed):
        w = way * shape * (1 - np.exp(-30 * way * np.sin(phase)) / np.cosh(30))
        guess = LuGre.guess(hj.Recording(phase, np.sin(phase), w))
        for name, (lower, upper) in guess.bounds().items():
            assert lower < float(guess.parameters()[name]) < upper
        assert 1.01 * guess.coulomb < guess.static < 1.2


@pytest.mark.parametrize("middle", [0.0, 0.004])
def test_guesses_of_metals_read_the_curve_itself(middle):
    """Masing's branches, about any middle."""
    size = 6e-3
    curve = np.array([by_hand.skeleton(x, *STEELY) for x in np.linspace(0, size, 401)])

    def rising(u):
        share = (u - middle + size) / 2
        return 2 * np.interp(share, np.linspace(0, size, 401), curve) - curve[-1]

    ends = middle - size, middle + size
    found = RambergOsgood.guess(cycled(rising, lambda u: -rising(2 * middle - u), ends))
    for name, value in zip(("stiffness", "strength", "n"), STEELY, strict=True):
        assert float(getattr(found, name)) == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize(("middle", "lift"), [(0.0, 0.0), (40.0, 0.5)])
def test_guesses_of_magnets_read_tips_and_coercive_field(middle, lift):
    """Off a loop in closed form: a curve, half of a loop's height to both sides."""
    reach, slope = 300.0, 2e-4

    def half(u):
        return 0.2 * (1 - ((u - middle) / reach) ** 2)

    def curve(u):
        return 1.2 * np.tanh((u - middle) / 100) + slope * (u - middle)

    record = cycled(
        *(lambda u: lift + curve(u) - half(u), lambda u: lift + curve(u) + half(u)),
        (middle - reach, middle + reach),
    )
    coercive = brentq(lambda u: curve(u) - half(u), middle, middle + reach) - middle
    top, steepest = curve(middle + reach), 1.2 / 100 + slope
    found = Tellinen.guess(record)
    assert float(found.coercive) == pytest.approx(coercive, rel=0.03)
    rising = float(found.branch(reach, 1.0))  # about its own middle
    assert rising == pytest.approx(top, rel=0.1)
    found = JilesAtherton.guess(record)
    assert float(found.pinning) == pytest.approx(coercive, rel=0.03)
    assert float(found.saturation) > top / by_hand.MU0 - reach
    # The anhysteretic curve starts three times less steep than without coupling.
    start = float(found.saturation / found.width / 3)
    start /= 1 - float(found.coupling) * start
    assert 1 + start == pytest.approx(steepest / by_hand.MU0, rel=0.05)


@pytest.mark.parametrize("following", [0.1, 0.7])
@pytest.mark.parametrize(("middle", "lift"), [(0.0, 0.0), (40.0, 0.5)])
def test_guesses_of_laws_around_a_curve_read_it(middle, lift, following):
    """Off a steady loop: the law is linear in w, and of a symmetric loop the output at
    the lower tip that which makes the other one its mirror image."""
    numbers, reach = (1.2, 100.0, 2e-4, 0.015, following), 300.0
    rate = by_hand.coleman_hodgdon(*numbers)
    nodes = np.linspace(-reach, reach, 401)
    ran = solve_ivp(
        lambda u, x: [rate(u, 1.0, x)],
        (-reach, reach),
        [0.0],
        t_eval=nodes,
        rtol=1e-9,
        atol=1e-9,
    )
    left = np.exp(-numbers[3] * (nodes + reach))
    up = ran.y[0] - ran.y[0, -1] / (1 + left[-1]) * left

    def rising(u):
        return np.interp(u - middle, nodes, up)

    record = cycled(
        lambda u: lift + rising(u),
        lambda u: lift - rising(2 * middle - u),
        (middle - reach, middle + reach),
    )
    found = ColemanHodgdon.guess(record)
    for name, value, off in zip(
        ("saturation", "width", "slope", "pull", "following"),
        numbers,
        (0.1, 10.0, 2e-4, 0.003, 0.1),
        strict=True,
    ):
        assert float(getattr(found, name)) == pytest.approx(value, abs=off)


def stepped(rate, w, u):
    """Outputs at the inputs of a rate-independent law, by Heun's rule."""
    found = [w]
    for start, end in itertools.pairwise(u):
        du = end - start
        first = rate(start, du, [w])
        w += (first + rate(end, du, [w + first])) / 2
        found.append(w)
    return np.array(found)


ONE_SIDED = [0.0, 1.0, 0.0, 0.9, 0.2, 0.8, 0.0]
BIASED = [0.0, -1.0, -0.3, -1.0, -0.2, -0.9, -0.4]


@pytest.mark.parametrize("turns", [ONE_SIDED, BIASED], ids=["one side", "biased"])
@pytest.mark.parametrize(
    ("cls", "law", "numbers"),
    [
        (Tellinen, by_hand.tellinen, MAJOR),
        (ColemanHodgdon, by_hand.coleman_hodgdon, CURVE),
        (JilesAtherton, by_hand.jiles_atherton, STEEL),
        (InverseJilesAtherton, by_hand.jiles_atherton, STEEL),
    ],
)
def test_guesses_of_magnets_follow_loops_to_one_side(cls, law, numbers, turns):
    """Which lie to one side of the centre of these laws, and are not symmetric."""
    u = 250.0 * through(turns)
    clean = stepped(law(*numbers), 0.0, u)
    noise = 0.01 * np.ptp(clean) * np.random.default_rng(0).normal(size=len(u))
    columns = u, clean + noise
    way = -1 if cls is InverseJilesAtherton else 1
    found = cls.guess(hj.Recording(None, *columns[::way]))
    run = stepped(law(*map(float, found.parameters().values())), 0.0, u)
    assert float(hj.metrics.nrmse(clean, run)) < 0.1


def test_guesses_of_springs_that_weaken_and_slip_follow_biased_cycles():
    """Whose loops look softer than the spring was at first."""
    rate, force = by_hand.baber_noori(
        *(0.02, 50.0, 12.0, 4.0, 1.8),
        *(0.1, 0.02, 0.8, 0.1, 0.5, 0.05, 0.0, 0.5),
    )

    def follow(rate, force, u):
        x, found = np.zeros(2), [force(u[0], 0.0, np.zeros(2))]
        for start, end in itertools.pairwise(u):
            for at in np.linspace(start, end, 4, endpoint=False):
                du = (end - start) / 4
                first = np.array(rate(at, du, x))
                x = x + (first + np.array(rate(at + du, du, x + first))) / 2
            found.append(force(end, end - start, x))
        return np.array(found)

    u = 0.6 * through([0.5, *[0.9, 0.1] * 4])
    clean = follow(rate, force, u)
    noise = 0.01 * np.ptp(clean) * np.random.default_rng(0).normal(size=len(u))
    found = BoucWenBaberNoori.guess(hj.Recording(None, u, clean + noise))
    run = follow(*by_hand.baber_noori(*map(float, found.parameters().values())), u)
    assert float(hj.metrics.nrmse(clean, run)) < 0.2


@pytest.mark.slow
def test_guesses_of_inverse_magnets_follow_their_noisy_record():
    """Of tips that are far from saturation, and in it."""
    for top in (0.5, 1.2, 1.5):
        density = top * through([0.0, *[1.0, -1.0] * 3])
        t = np.arange(len(density)) / 10
        clean = hj.Recording(t, density, 0 * t, units=("T", "A/m"))
        field = np.asarray(hj.simulate(InverseJilesAtherton(JA), clean).w)
        noise = 0.01 * np.random.default_rng(0).normal(size=len(t))
        noisy = field + np.ptp(field) * noise
        record = hj.Recording(t, density, noisy, units=clean.units)
        run = hj.simulate(InverseJilesAtherton.guess(record), record)
        assert float(hj.metrics.nrmse(field, run.w)) < 0.15


@pytest.mark.parametrize("drift", [0.0, 0.02])
@pytest.mark.parametrize("cls", READ_OFF_A_LOOP)
def test_guesses_of_one_period_are_the_same_wherever_it_begins(cls, drift):
    """A loop has no first sample, be it a little open."""
    lags = cls in (ColemanHodgdon, JilesAtherton, Tellinen)

    def guessed(begun):
        angle = PERIOD + begun
        w = np.tanh(1.5 * np.cos(angle + (-0.3 if lags else 0.3)))
        w = w + drift * np.linspace(-0.5, 0.5, len(w))
        return cls.guess(hj.Recording(PERIOD, np.cos(angle), w)).parameters()

    whole = guessed(0.0)
    for begun in PERIOD[[27, 60, 77, 180]]:
        for name, value in guessed(begun).items():
            share = 1.0 if name == "following" else 0.0  # of one, and here nearly none
            near = {"rtol": 0.2, "atol": 0.05 * share} if drift else {"rtol": 1e-2}
            np.testing.assert_allclose(value, whole[name], **near)


def test_guesses_of_one_period_that_was_recorded_on_are_those_of_the_period():
    angle = PERIOD[60] + 2 * np.pi * np.arange(249) / 240
    u, w = np.cos(angle), np.tanh(1.5 * np.cos(angle - 0.3))
    one, more = (
        ColemanHodgdon.guess(hj.Recording(None, u[:n], w[:n])) for n in (241, 249)
    )
    for name, value in more.parameters().items():
        np.testing.assert_allclose(value, one.parameters()[name], rtol=1e-2)


def test_a_first_curve_is_not_taken_for_a_part_of_the_loop():
    """One period from zero on ends elsewhere than it began: its last quarter, which is
    on the loop, is no continuation of its first, which is not."""
    device = hj.models.PrandtlIshlinskii([0.0, 0.2, 0.5], [9.0, -4.0, -4.4])
    run = hj.simulate(device, hj.Recording(None, np.sin(PERIOD), 0 * PERIOD))
    whole, part = (
        Dahl.guess(hj.Recording(None, np.sin(PERIOD)[:stop], run.w[:stop]))
        for stop in (241, 181)
    )
    for name, value in part.parameters().items():
        assert whole.parameters()[name] == value


def test_friction_of_velocity_needs_a_clock():
    u = np.sin(np.arange(100) / 5)
    with pytest.raises(InputError, match="has no clock"):
        LuGre.guess(hj.Recording(None, u, u))


def test_fits_keep_parameters_where_they_make_sense():
    assert JA.bounds()["reversibility"] == (0.0, 1.0)
    assert InverseJilesAtherton(JA).bounds()["device.pinning"] == (0.0, np.inf)
    wrapped = hj.models.Instrumented(JA, input_gain=1.0)
    assert wrapped.bounds() == JA.bounds()
    assert hj.models.Duhem(0.4, 0.5, 0.25).bounds() == {}


def test_strains_far_from_where_the_first_curve_begins_are_refused():
    t = np.arange(100.0)
    rec = hj.Recording(t, np.sin(t / 5), np.sin(t / 5 + 0.4))
    shifted = [hj.Recording(t, np.asarray(rec.u) + far, rec.w) for far in (2.9, 3.2)]
    RambergOsgood.guess(shifted[0])
    with pytest.raises(InputError, match=r"from 2\.2\d* to 4\.1\d*, far from 0"):
        RambergOsgood.guess(shifted[1])
    with pytest.raises(InputError, match=r"from -4\.1\d* to -2\.2\d*, far from 0"):
        RambergOsgood.guess(hj.Recording(t, -shifted[1].u, -rec.w))


@pytest.mark.parametrize(
    ("cls", "name", "times"),  # the slope after a turn over that parameter
    [(Dahl, "stiffness", 2), (BoucWenForce, "k", 1), (BoucWenBaberNoori, "k", 1)],
)
def test_guesses_of_a_loop_without_slopes_yield_within_the_stroke(cls, name, times):
    phase = np.linspace(0, 6 * np.pi, 301)
    u = np.sin(phase)
    w = 3 * np.sign(np.diff(u, append=0.1))  # the tips slide the other way already
    guess = cls.guess(hj.Recording(phase, u, w))
    slope = times * guess.parameters()[name]
    assert 0 < 6 / slope <= np.ptp(u) * (1 + 1e-12)  # from -3 to 3
    with pytest.raises(InputError, match="does not rise from tip to tip"):
        RambergOsgood.guess(hj.Recording(phase, u, w))


@pytest.mark.parametrize("count", [16, 24, 32, 50])
def test_guesses_read_sparse_samples_that_all_cycles_share(count):
    # Dahl's steady loop in closed form: a whole number of samples a cycle, whose inputs
    # agree to a millionth of the stroke, and 2 % of noise.
    stiffness, coulomb = 20.0, 3.0
    bend = stiffness / coulomb
    rng = np.random.default_rng(count)
    phase = 2 * np.pi * (np.arange(12 * count) + 0.3) / count
    u = np.sin(phase) + 1e-6 * rng.normal(size=phase.size)
    way = np.sign(np.cos(phase))
    w = way * coulomb * (1 - np.exp(-bend * way * u) / np.cosh(bend))
    noisy = w + 0.02 * coulomb * rng.normal(size=w.size)
    found = Dahl.guess(hj.Recording(None, u, noisy))
    assert float(found.coulomb) == pytest.approx(coulomb, rel=0.06)


@pytest.mark.parametrize("side", [-0.4, 0.4], ids=["lags", "ahead"])
@pytest.mark.parametrize("start", [0.3, 2.4, 3.5, 5.5])
def test_one_period_that_begins_between_its_tips_is_a_whole_loop(start, side):
    """An ellipse, on either branch, run through in either sense."""
    angle = start + np.linspace(0, 2 * np.pi, 401)
    u, w = np.sin(angle), 2 * np.sin(angle) + side * np.cos(angle)
    loop = wide_loop(hj.Recording(angle, u, w), lags=side < 0)
    np.testing.assert_allclose(loop.u[[0, -1]], (-1, 1), atol=1e-3)
    inside = np.abs(loop.u) < 0.8  # farther out an ellipse is no straight line
    half = side * np.sqrt(1 - loop.u[inside] ** 2)
    middle = 2 * loop.u[inside]
    np.testing.assert_allclose(loop.rising[inside], middle + half, atol=0.01)
    np.testing.assert_allclose(loop.falling[inside], middle - half, atol=0.01)


# ------------------------------------------------------------- the nearest of many


def tried(monkeypatch, cls, record):
    """What a guess holds against a record: how models are built, their numbers, a
    column each, and what comes after these."""

    class Enough(Exception):
        pass

    def seen(*arguments):
        raise Enough(*arguments)

    module = sys.modules[cls.__module__]
    with monkeypatch.context() as patched, pytest.raises(Enough) as found:
        for name in ("scaled", "nearest"):
            patched.setattr(module, name, seen, raising=False)
        cls.guess(record)
    return found.value.args


def to_one_side(law, numbers):
    u = 250.0 * through(ONE_SIDED)
    return hj.Recording(None, u, stepped(law(*numbers), 0.0, u))


SIDED = {
    Tellinen: to_one_side(by_hand.tellinen, MAJOR),
    ColemanHodgdon: to_one_side(by_hand.coleman_hodgdon, CURVE),
}


@pytest.mark.parametrize("cls", [*SIDED, BoucWenBaberNoori])
def test_what_guesses_try_is_the_same_in_all_units(monkeypatch, cls):
    record = SIDED.get(cls, cycled(lambda u: u**3 + 1 - u**2, lambda u: u**3, (-1, 1)))
    larger = hj.Recording(None, 10 * record.u, 3 * record.w)
    (_, one, *_), (_, other, *_) = (
        tried(monkeypatch, cls, each) for each in (record, larger)
    )
    for i in (0, len(one.T) // 2, -1):
        model = cls(*one[:, i])
        powers = model.dimensions()
        names = model.parameters()
        factors = [
            3.0 ** powers.get(x, (0,))[0] * 10.0 ** powers.get(x, (0, 0))[1]
            for x in names
        ]
        np.testing.assert_allclose(other[:, i], factors * one[:, i], rtol=1e-9)


@pytest.mark.parametrize("cls", SIDED)
def test_what_guesses_try_goes_through_the_farthest_point_and_grows_with_it(
    monkeypatch, cls
):
    record = SIDED[cls]
    build, columns, powers, (u, w) = tried(monkeypatch, cls, record)
    reach, top = np.max(u), np.max(w)
    if cls is Tellinen:
        saturation, coercive, width, slope = columns
        both = np.arctan((reach + np.stack([coercive, -coercive])) / width)
        middle = 2 / np.pi * saturation * np.mean(both, axis=0) + slope * reach
    else:
        saturation, width, slope, *_ = columns
        middle = saturation * np.tanh(reach / width) + slope * reach
    np.testing.assert_allclose(middle, top, rtol=1e-12)
    grown = columns * 2.0 ** np.array(powers)[:, None]
    larger = _guess._outputs(build, grown, (u, 2 * w))
    np.testing.assert_allclose(
        larger, 2 * _guess._outputs(build, columns, (u, w)), rtol=0, atol=1e-9 * top
    )


def test_the_nearest_of_many_is_the_one_whose_free_run_is():
    """By the rule of the midpoint, written out; runs that are lost are far off, and no
    scale is sought from them."""
    u, w = np.sin(np.linspace(0, 9, 1001)), [0.0]
    for start, du in zip(u, np.diff(u), strict=False):
        half = w[-1] + (abs(du) * (0.4 * start - 2.0 * w[-1]) + 0.5 * du) / 2
        middle = 0.4 * (start + du / 2) - 2.0 * half
        w.append(w[-1] + abs(du) * middle + 0.5 * du)
    bent = np.array([[0.4, 0, 0, 0], [2.0, 0, 0, 0], [0.5, 0, 0, 0]])
    found = _guess._outputs(Duhem, bent, (u, np.array(w)))
    np.testing.assert_allclose(found[0], w, rtol=0, atol=1e-12)
    # w' = slope u', and lost where beta is that large.
    zero, slopes = np.zeros(4), np.array([0.1, 2.0, 100.0, 2.0])
    columns = np.stack([zero, [0.0, 0.0, 0.0, 1e200], slopes])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scaled = _guess.scaled(Duhem, columns, (0, 0, 1), (u, 3 * u))
        columns[2] = 100.0, 90.0, 100.0, 2.0
        found = _guess.nearest(Duhem, columns, (u, 3 * u))
    # Made larger five times and smaller to a fifth at most.
    np.testing.assert_allclose(scaled[2, :3], [0.5, 3.0, 20.0], rtol=1e-9)
    np.testing.assert_allclose(found, [0.0, 0.0, 90.0])


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_course_begins_before_the_first_wide_stretch(way):
    """Whichever way that goes, and ends nine stretches later."""
    turns = way * np.array([0.0, 0.2, 0.1, 0.3, 0.05, 1.0, -1.0, *[0.5, -0.5] * 6])
    u, expected = through(turns), through(turns[4:14])
    found, w = _guess.course(hj.Recording(None, u, 2 * u + 1))
    np.testing.assert_allclose(w, 2 * found + 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[[0, -1]], expected[[0, -1]], atol=1e-12)
    way = np.sum(np.abs(np.diff(expected)))
    assert np.sum(np.abs(np.diff(found))) == pytest.approx(way, rel=0.01)
    assert np.median(np.abs(np.diff(found))) == pytest.approx(way / 1000)


@pytest.mark.parametrize("middle", [-0.2, -0.3, 0.2, 0.3])
def test_loops_are_off_centre_whose_middle_is_a_quarter_of_their_half(middle):
    record = cycled(lambda u: u - 1, lambda u: u + 1, (2 * middle - 2, 2 * middle + 2))
    assert wide_loop(record, lags=True).off_centre == (abs(middle) > 0.25)


def test_springs_wear_by_what_they_take_up_though_a_bias_gives_more_back(monkeypatch):
    whole = cycled(lambda u: u**3 + 1 - u**2, lambda u: u**3, (-1, 1)).window(0, 1400)
    _, columns, _ = tried(
        monkeypatch, BoucWenBaberNoori, hj.Recording(None, whole.u, whole.w - 20.0)
    )
    names = BoucWenBaberNoori(*columns[:, 0]).parameters()
    wear = dict(zip(names, columns, strict=True))
    assert np.trapezoid(whole.w - 20.0, whole.u) < 0
    assert all(np.all(wear[name] > 0) for name in ("delta_nu", "delta_eta", "p"))


def test_both_precisions_have_the_curve_in_one_process():
    t = 0.1 * np.arange(20)
    w = {}
    for double in (False, True):
        with jax.enable_x64(double):
            core = hj.models.JilesAtherton(1.5e6, 0.4, 0.5, 1e-7, 0.2)
            record = hj.Recording(t, np.sin(t), 0 * t)
            w[double] = hj.simulate(core, record, method=hj.simulation.FixedStep(2)).w
    assert (w[False].dtype, w[True].dtype) == (np.float32, np.float64)
    size = np.max(np.abs(w[True]))
    np.testing.assert_allclose(w[False], w[True], rtol=0, atol=1e-4 * size)
