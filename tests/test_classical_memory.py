"""Classical models with memory: SciPy over every stretch, closed forms, and what they
promise."""

import itertools

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
    BoucWenBaberNoori,
    BoucWenForce,
    ColemanHodgdon,
    Dahl,
    InverseJilesAtherton,
    JilesAtherton,
    Langevin,
    LuGre,
    MaxwellSlip,
    RambergOsgood,
    Tellinen,
    Uniaxial,
)
from hystjax.simulation import Adaptive, FixedStep

MU0 = 4e-7 * np.pi
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
    """Outputs of x' = rate(u, u', x) at the samples, interval by interval, and within
    each up to where a clamp or a knee is passed, by tolerances."""
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


# ---------------------------------------------------------------- equations once more


def langevin(h):
    return h / 3 - h**3 / 45 if abs(h) < 1e-4 else 1 / np.tanh(h) - 1 / h


def langevin_slope(h):
    return 1 / 3 - h**2 / 15 if abs(h) < 1e-3 else 1 / h**2 - 1 / np.sinh(h) ** 2


def jiles_atherton(ms, a, k, alpha, c):
    """dM/dH of Mirr and Man, as they are defined, not as they are eliminated."""

    def chi(h, m, way):
        he = h + alpha * m
        level, slope = ms * langevin(he / a), ms / a * langevin_slope(he / a)
        irreversible = (m - c * level) / (1 - c)
        pinned = max(0.0, way * (level - irreversible) / k)  # dMirr/dHe
        per_effective = (1 - c) * pinned + c * slope
        # dM = per_effective dHe, dHe = dH + alpha dM
        return per_effective / (1 - alpha * per_effective)

    return chi


STEEL = (1.3e6, 40.0, 50.0, 6e-5, 0.15)
JA = JilesAtherton(*STEEL)


def forward(h, dh, b):
    return MU0 * (1 + jiles_atherton(*STEEL)(h, b[0] / MU0 - h, np.sign(dh))) * dh


def backward(b, db, h):
    chi = jiles_atherton(*STEEL)(h[0], b / MU0 - h[0], np.sign(db))
    return db / MU0 / (1 + chi)


def tellinen(u, du, w):
    def branch(u, way):
        return 1e-3 * u + 2 / np.pi * 1.4 * np.arctan((u - way * 60) / 80)

    def steep(u, way):
        return 1e-3 + 2 / np.pi * 1.4 / 80 / (1 + ((u - way * 60) / 80) ** 2)

    way = np.sign(du)
    share = (branch(u, -way) - w[0]) / (branch(u, -way) - branch(u, way))
    return (1e-3 + share * (steep(u, way) - 1e-3)) * du


def coleman_hodgdon(u, du, w):
    f = 1e-3 * u + 1.3 * np.tanh(u / 60)
    g = 1e-3 + 0.3 * 1.3 / 60 / np.cosh(u / 60) ** 2
    return 0.015 * abs(du) * (f - w[0]) + g * du


def dahl(u, du, w):
    left = 1 - np.sign(du) * w[0] / 5
    return 600 * abs(left) ** 1.5 * np.sign(left) * du


LUGRE = LuGre(2e3, 8.0, 0.6, 1.0, 1.5, 0.1)


def bristle(du, z):
    g = 1.0 + 0.5 * np.exp(-((du / 0.1) ** 2))
    return du - 2e3 * abs(du) / g * z


def lugre_force(u, du, x):
    return 2e3 * x[0] + 8.0 * bristle(du, x[0]) + 0.6 * du


def bouc_wen(du, z, beta=12.0, gamma=8.0, n=1.5):
    return beta * abs(du) * abs(z) ** (n - 1) * z + gamma * du * abs(z) ** n


def spring(u, du, x):
    return 0.1 * 50 * u + 0.9 * 50 * x[0]


def baber_noori(u, du, x):
    z, e = x
    nu, eta = 1 + 0.05 * e, 1 + 0.04 * e
    last = (1 / (nu * 16.0)) ** (1 / 1.2)
    depth = 0.7 * (1 - np.exp(-0.5 * e))
    width = (0.1 + 0.01 * e) * (0.3 + depth)
    h = 1 - depth * np.exp(-((z * np.sign(du) - 0.1 * last) ** 2) / width**2)
    bend = nu * bouc_wen(du, z, 12.0, 4.0, 1.2)
    return [h / eta * (du - bend), 0.9 * 50 * z * du]


PINCHED = BoucWenBaberNoori(
    0.1, 50.0, 12.0, 4.0, 1.2, 0.05, 0.04, 0.7, 0.1, 0.5, 0.1, 0.01, 0.3
)
ODES = {
    "JilesAtherton": (JA, 250.0, lambda: by_scipy(forward, 0.0, 250.0)),
    "InverseJilesAtherton": (
        InverseJilesAtherton(JA),
        1.4,
        lambda: by_scipy(backward, 0.0, 1.4),
    ),
    "Tellinen": (
        Tellinen(1.4, 60.0, 80.0, 1e-3),
        250.0,
        lambda: by_scipy(tellinen, 0.0, 250.0),
    ),
    "ColemanHodgdon": (
        ColemanHodgdon(1.3, 60.0, 1e-3, 0.015, 0.3),
        250.0,
        lambda: by_scipy(coleman_hodgdon, 0.0, 250.0),
    ),
    "Dahl": (Dahl(600.0, 5.0, 1.5), 0.1, lambda: by_scipy(dahl, 0.0, 0.1)),
    "LuGre": (
        LUGRE,
        0.1,
        lambda: by_scipy(lambda u, du, z: bristle(du, z), 0.0, 0.1, lugre_force),
    ),
    "BoucWenForce": (
        BoucWenForce(0.1, 50.0, 12.0, 8.0, 1.5),
        0.3,
        lambda: by_scipy(lambda u, du, z: bouc_wen_rate(du, z[0]), 0.0, 0.3, spring),
    ),
    "BoucWenBaberNoori": (
        PINCHED,
        0.4,
        lambda: by_scipy(baber_noori, [0.0, 0.0], 0.4, spring),
    ),
}


def bouc_wen_rate(du, z):
    return du - bouc_wen(du, z)


@pytest.mark.parametrize("name", ODES)
def test_models_agree_with_scipy_over_turning_points(name):
    model, scale, equations = ODES[name]
    expected = equations()
    found = run(model, scale, Adaptive(rtol=1e-10))
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * size)


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
        expected = 0.6 * mean + 0.4 * langevin(h)
        assert float(value) == pytest.approx(expected, rel=1e-10)
        expected = 0.6 * variance + 0.4 * langevin_slope(h)
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


def test_without_the_clamp_susceptibility_would_be_negative():
    """Just after the upper tip of a loop, where M has not come to Man."""
    record = hj.Recording(T, 250 * U, np.zeros_like(U))
    b = np.asarray(hj.simulate(JA, record, method=FixedStep(8)).w)
    tip = STRAIGHT
    parts = JA.components(jnp.asarray(250 * U), jnp.asarray(b))
    assert parts.total[tip] < parts.anhysteretic[tip]
    steps = np.diff(b - MU0 * 250 * U) / np.diff(U)
    assert np.min(steps) >= -1e-12
    np.testing.assert_allclose(
        parts.irreversible + parts.reversible, parts.total, rtol=1e-12
    )


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


def test_coleman_hodgdon_between_turning_points():
    model = ColemanHodgdon(1.3, 60.0, 1e-3, 0.015, 0.3)

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
        w = hj.simulate(LUGRE, record, method=FixedStep(16)).w
        g = 1.0 + 0.5 * np.exp(-((v / 0.1) ** 2))
        slides = g * np.sign(v) + 0.6 * v
        assert float(w[-1]) == pytest.approx(slides, rel=1e-8)
        assert float(LUGRE.steady(v)) == pytest.approx(slides, rel=1e-12)
    # Far below the static force it is a spring and a damper.
    t = np.linspace(0, 1, 401)
    u = 1e-9 * np.sin(20 * t)
    w = hj.simulate(LUGRE, hj.Recording(t, u, 0 * t), method=FixedStep(4)).w
    v = np.diff(u) / np.diff(t)
    np.testing.assert_allclose(w[:-1], 2e3 * u[:-1] + 8.6 * v, atol=1e-4 * 2e-6)


def test_elements_that_slip_are_a_sum_of_stops():
    stiffnesses, limits = np.array([3.0, 2.0, 1.0]), np.array([0.1, 0.3, 0.7])
    model = MaxwellSlip(stiffnesses, limits)
    stretch, expected = np.zeros(3), []
    for step in np.diff(U, prepend=0.0):
        stretch = np.clip(stretch + step, -limits, limits)
        expected.append(stiffnesses @ stretch)
    np.testing.assert_allclose(run(model, 1.0, FixedStep(1)), expected, atol=1e-14)
    assert model.terms() == {
        "u": 6.0,
        "play(u,0.1)": -3.0,
        "play(u,0.3)": -2.0,
        "play(u,0.7)": -1.0,
    }


# ------------------------------------------------------------------------ closed loops


def test_tellinen_stays_on_its_major_loop():
    model = Tellinen(1.4, 60.0, 80.0, 1e-3)
    t = np.linspace(0, 1, 801)
    for way in (1.0, -1.0):
        u = way * np.linspace(-4e3, 4e3, 801)
        branch = model.branch(u, way)
        record = hj.Recording(t, u, branch)
        w = hj.simulate(model, record, method=FixedStep(8)).w
        np.testing.assert_allclose(w, branch, atol=1e-7)


def test_tellinen_closes_inner_loops():
    """And about the middle, whatever the offset that they start with."""
    model = Tellinen(1.4, 60.0, 80.0, 1e-3)
    t = np.arange(0, 40 + 1 / 64, 1 / 32)
    u = 90 * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t))
    for w0 in (0.3, -0.5):
        w = hj.simulate(model, hj.Recording(t, u, 0 * t + w0), method=FixedStep(8)).w
        cycle, before = np.asarray(w[-33:]), np.asarray(w[-65:-32])
        np.testing.assert_allclose(cycle, before, atol=1e-6)
        np.testing.assert_allclose(cycle[:17], -cycle[16:], atol=1e-6)
        assert np.ptp(cycle[[0, 16, 32]]) > 0.1  # at u = 0: a loop, and no curve


STEELY = RambergOsgood(200.0, 0.4, 7.0)


def skeleton(strain, model=STEELY):
    k, y, n = (float(x) for x in model.parameters().values())

    def over(f):
        return f / k * (1 + 3 / 7 * abs(f / y) ** (n - 1)) - strain

    return brentq(over, -1e3 * y, 1e3 * y, xtol=1e-25, rtol=1e-14)


def test_ramberg_osgood_by_masing_rules_written_out():
    """First curve, a branch, an inner loop that closes, and the branch before it."""
    turns = 6e-3 * np.array([0.0, 1.0, -0.5, 0.3, -0.5, -0.9, 1.5])
    u = through(turns)
    w = hj.simulate(STEELY, hj.Recording(0.01 * np.arange(len(u)), u, 0 * u)).w

    def branch(u, u0, w0):
        return w0 + 2 * skeleton((u - u0) / 2)

    top = skeleton(turns[1])
    low = branch(turns[2], turns[1], top)
    high = branch(turns[3], turns[2], low)
    expected = {
        1: top,
        2: low,
        3: high,
        4: low,  # where the inner loop closes
        5: branch(turns[5], turns[1], top),  # as if there had been none
        6: skeleton(turns[6]),  # beyond all: on the first curve again
    }
    for i, value in expected.items():
        assert float(w[i * STRAIGHT]) == pytest.approx(value, rel=1e-12), i


@settings(max_examples=10, deadline=None)
@given(
    turns=st.lists(st.floats(-1, 1, allow_subnormal=False), min_size=24, max_size=24)
)
def test_masing_is_a_stack_of_many_stops(turns):
    """A curve of straight lines is the sum of stops; Masing's rules make of it what
    these do."""
    u = np.array(turns)
    # The curve through its values at 400 strains, as stops that yield there.
    knots = np.linspace(0, 1, 401)
    levels = np.array([skeleton(6e-3 * each) for each in knots])
    slopes = np.append(np.diff(levels) / np.diff(knots), 0.0)
    stiffnesses = -np.diff(slopes)
    stretch = np.zeros(400)
    expected = []
    for step in np.diff(u, prepend=0.0):
        stretch = np.clip(stretch + step, -knots[1:], knots[1:])
        expected.append(stiffnesses @ stretch)
    record = hj.Recording(np.arange(24.0), 6e-3 * u, 0 * u)
    found = hj.simulate(STEELY, record, method=FixedStep(1)).w
    np.testing.assert_allclose(found, expected, atol=2e-5 * levels[-1])


@eqx.filter_jit
def stresses(model, strains):
    return jax.vmap(jax.value_and_grad(model.first))(strains)


def test_the_stress_of_a_strain_is_exact_with_its_derivatives():
    for n in (1.2, 3.0, 30.0):
        model = RambergOsgood(200.0, 0.4, n)
        strains = jnp.array([1e-7, 2e-3, -0.05, 3.0])
        found, slopes = stresses(model, strains)
        expected = [skeleton(each, model) for each in strains]
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        steep = 200 / (1 + n * 3 / 7 * np.abs(found / 0.4) ** (n - 1))
        np.testing.assert_allclose(slopes, steep, rtol=1e-10)
    value, slope = stresses(STEELY, jnp.zeros(4))
    assert np.all(value == 0) and np.all(slope == 200)


def test_loops_deeper_than_the_memory_are_left_out():
    shallow = RambergOsgood(200.0, 0.4, 7.0, depth=3)
    turns = 6e-3 * np.array([0.0, 1.0, -0.9, 0.8, -0.7, 0.8, -0.9, 1.0])
    record = hj.Recording(np.arange(8.0), turns, 0 * turns)
    deep, found = (hj.simulate(m, record).w for m in (STEELY, shallow))
    np.testing.assert_allclose(found[-2:], deep[-2:], rtol=1e-12)
    assert np.all(np.isfinite(found))


# --------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Dahl(-1.0, 5.0), "`stiffness` must be positive, got -1.0"),
        (lambda: JilesAtherton(1e6, 1.0, 1.0, 1e-5, 1.0), "`reversibility` must be"),
        (lambda: RambergOsgood(1.0, 1.0, 0.5), "`n` must be positive and above 1"),
        (lambda: BoucWenForce(1.2, 1.0, 1.0, 1.0), "`alpha` must be below 1"),
        (lambda: MaxwellSlip([1.0, 2.0], [0.1]), "arrays of one length"),
        (lambda: MaxwellSlip([1.0], [-0.1]), "`limits` must be positive"),
        (lambda: Tellinen(1.0, jnp.ones(2), 1.0), "must be a number"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


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
    lags = cls in (ColemanHodgdon, JilesAtherton, Tellinen)
    with pytest.raises(InputError, match="the other way round"):
        cls.guess(hj.Recording(t, u, np.sin(t / 5 + (0.4 if lags else -0.4))))


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
