import jax
import numpy as np
import pytest
import scipy.integrate

import hystjax as hj
from hystjax.signals.excitation import Sine, Triangle

LAW = hj.models.Duhem(0.4, 0.5, 0.25, names=("voltage", "stroke"), units=("V", "µm"))
SINE = Sine(1.5, 0.2)
T = np.linspace(0, 20, 4001)


def test_recording_is_the_law_integrated_by_scipy():
    def rate(t, w):
        u, du = 1.5 * np.sin(0.4 * np.pi * t), 0.6 * np.pi * np.cos(0.4 * np.pi * t)
        return (0.4 * u - 0.5 * w) * abs(du) + 0.25 * du

    record = hj.generate(LAW, SINE, T, w0=0.3)
    expected = scipy.integrate.solve_ivp(
        rate, (0, 20), [0.3], t_eval=T, rtol=1e-10, atol=1e-10, max_step=0.01
    )
    np.testing.assert_allclose(record.w, expected.y[0], atol=1e-7)
    np.testing.assert_allclose(record.u, 1.5 * np.sin(0.4 * np.pi * T), atol=1e-12)
    assert (record.names, record.units) == (("voltage", "stroke"), ("V", "µm"))


@pytest.mark.parametrize("unit", [1e-9, pytest.param(1e9, marks=pytest.mark.slow)])
def test_no_unit_of_the_output_costs_accuracy(unit):
    """A friction force from rest: nothing but the law tells how large it will be.
    Damping of 1e-6 is as good as none."""

    def rate(t, z):
        v = 0.6 * np.pi * np.cos(0.4 * np.pi * t)
        return 20 * (v - np.abs(v) * z / (0.5 + 0.3 * np.exp(-((v / 0.7) ** 2))))

    ends = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
    expected = scipy.integrate.solve_ivp(rate, (0, 20), [0.0], t_eval=T[::25], **ends)
    friction = hj.models.LuGre(
        20 * unit, 1e-6 * unit, 1e-6 * unit, 0.5 * unit, 0.8 * unit, 0.7
    )
    record = hj.generate(friction, SINE, T[::25])
    np.testing.assert_allclose(record.w / unit, expected.y[0], rtol=0, atol=1e-5)


@pytest.mark.slow
def test_recording_knows_its_input_between_samples():
    between = np.linspace(0.013, 19.9, 57)
    u, du = hj.generate(LAW, SINE, T[::50]).path.at(between)
    np.testing.assert_allclose(u, 1.5 * np.sin(0.4 * np.pi * between), atol=1e-12)
    np.testing.assert_allclose(du, 0.6 * np.pi * np.cos(0.4 * np.pi * between))
    triangle = Triangle(1.0, 0.2, periods=4)
    record = hj.generate(LAW, triangle, triangle.samples(50))
    assert isinstance(record.interpolation, hj.interpolation.Linear)


@pytest.mark.parametrize(
    ("additive", "multiplicative"), [(0.05, 0.0), (0.0, 0.1), (0.2, 0.3)]
)
def test_noise_has_the_size_asked_for(additive, multiplicative):
    clean = np.asarray(hj.generate(LAW, SINE, T).w)
    noisy = hj.generate(
        LAW,
        SINE,
        T,
        additive=additive,
        multiplicative=multiplicative,
        key=jax.random.key(5),
    )
    np.testing.assert_array_equal(noisy.u, hj.generate(LAW, SINE, T).u)
    scale = np.hypot(additive * np.std(clean), multiplicative * np.abs(clean))
    moving = scale > 0
    normal = (np.asarray(noisy.w) - clean)[moving] / scale[moving]
    n = normal.size
    # Mean, variance, lag-one correlation and kurtosis of white Gaussian noise, each
    # within five of its standard errors.
    assert abs(np.mean(normal)) < 5 / n**0.5
    assert abs(np.var(normal) - 1) < 5 * (2 / n) ** 0.5
    assert abs(np.mean(normal[1:] * normal[:-1])) < 5 / n**0.5
    assert abs(np.mean(normal**4) - 3) < 5 * (96 / n) ** 0.5


def test_additive_noise_is_the_same_beside_a_multiplicative_one():
    def generated(**levels):
        key = jax.random.key(3)
        return np.asarray(hj.generate(LAW, SINE, T[:99], key=key, **levels).w)

    alone = generated(additive=0.1) - generated()
    beside = generated(additive=0.1, multiplicative=0.5) - generated(multiplicative=0.5)
    np.testing.assert_allclose(beside, alone, rtol=1e-9)


def test_key_decides_the_noise():
    def noisy(seed):
        key = jax.random.key(seed)
        return np.asarray(hj.generate(LAW, SINE, T[:99], additive=0.1, key=key).w)

    np.testing.assert_array_equal(noisy(1), noisy(1))
    assert not np.any(noisy(1)[1:] == noisy(2)[1:])


def test_levels_of_noise_may_be_traced():
    def noisy(level):
        key = jax.random.key(1)
        return hj.generate(LAW, SINE, T[:99], additive=level, key=key).w

    levels = np.array([0.0, 0.1])
    expected = [noisy(level) for level in levels.tolist()]
    np.testing.assert_allclose(jax.vmap(noisy)(levels), expected, rtol=1e-12)


@pytest.mark.parametrize("noise", [{"additive": 0.1}, {"multiplicative": 0.1}])
def test_noise_needs_a_key(noise):
    with pytest.raises(hj.InputError, match=r"needs a `key`.*jax\.random\.key"):
        hj.generate(LAW, SINE, T, **noise)


@pytest.mark.parametrize("name", ["additive", "multiplicative"])
@pytest.mark.parametrize("level", [-0.1, np.nan])
def test_noise_levels_are_not_negative(name, level):
    with pytest.raises(hj.InputError, match=f"`{name}` must be zero or more, got"):
        hj.generate(LAW, SINE, T, key=jax.random.key(0), **{name: level})


def test_law_that_diverges_raises():
    explosive = hj.models.SparseModel.from_terms({"w^2": 1.0})
    with pytest.raises(hj.ComputationError, match=r"did not stay finite.*row"):
        hj.generate(explosive, SINE, T, w0=1.0)
