"""Machines of a user's own, with a spring in them that nobody measures."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from two_masses import TwoMasses

import hystjax as hj
from hystjax.models._numbers import Bounded

STEP = 0.1
T = STEP * np.arange(301)
LAW = {"du": 3.0, "w*|du|": -2.0, "du*|w|": 1.5}
OWN = (1.0, 0.2, 2.0, 0.5, 0.3, 1.5)
TRUTH = TwoMasses(*OWN, hj.models.SparseModel.from_terms(LAW))
FORCE = hj.interpolation.Exact(
    lambda t: 2 * jnp.sin(1.3 * t) + 1.2 * jnp.sin(2.9 * t)
).path(jnp.asarray(T), None)


def by_scipy():
    """Both positions and the force between the masses."""

    def rate(t, state):
        y, v, x, s, z = state
        u = 2 * math.sin(1.3 * t) + 1.2 * math.sin(2.9 * t)
        dz = 3.0 * (v - s) - 2.0 * z * abs(v - s) + 1.5 * (v - s) * abs(z)
        first = (u - 0.2 * v - 2.0 * y - z) / 1.0
        return v, first, s, (z - 0.3 * s - 1.5 * x) / 0.5, dz

    settings = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": 0.02}
    y, _, x, _, z = solve_ivp(rate, T[[0, -1]], np.zeros(5), t_eval=T, **settings).y
    return y, x, z


@pytest.fixture(scope="module")
def positions():
    return by_scipy()


class Heavy(TwoMasses):
    """One whose first mass is known to be positive."""

    mass: jax.Array = eqx.field(converter=Bounded("mass"))


def test_bounds_are_those_of_the_machine_and_of_its_spring():
    spring = hj.models.BoucWen(3.0, 2.0, -1.5)
    machine = Heavy(*OWN, spring)
    assert machine.bounds() == {"mass": (0.0, np.inf), **spring.bounds()}
    assert spring.bounds()


def test_two_masses_go_where_their_equations_lead(positions):
    ours = hj.simulate(TRUTH, FORCE, w0=0.0).w  # in steps that end where v - s turns
    np.testing.assert_allclose(ours, positions[0], atol=1e-6)


def test_their_hidden_spring_is_told_by_the_first_position(positions):
    """Of its rates, which are known of the spline through a record without noise."""
    from scipy.interpolate import make_interp_spline

    def rate(signal):
        spline = make_interp_spline(T, np.asarray(signal), k=5)
        return jnp.asarray(spline.derivative()(T))

    y, x, z = positions
    u = FORCE.samples()[0]
    driver, force = TRUTH.hidden_signals(u, jnp.asarray(y), rate)
    np.testing.assert_allclose(force[5:-5], z[5:-5], atol=0.02)
    np.testing.assert_allclose(driver[5:-5], (y - x)[5:-5], atol=0.02)


@pytest.mark.slow
def test_their_numbers_are_fitted_and_kept(tmp_path, positions):
    noise = 1e-3 * np.std(positions[0]) * np.random.default_rng(2).normal(size=len(T))
    record = hj.Recording(
        T,
        FORCE.samples()[0],
        positions[0] + noise,
        interpolation=hj.interpolation.Cubic(),
    )
    signs = (1.2, 0.8) * 5
    off = zip(TRUTH.parameters().items(), signs, strict=False)
    start = TRUTH.with_parameters({name: s * x for (name, x), s in off})
    found = hj.refine(start, record, substeps=2)
    errors = found.stats["standard_errors"]
    for name, true in TRUTH.parameters().items():
        value = float(found.value.parameters()[name])
        assert abs(value - float(true)) < 5 * float(errors[name]), name
    hj.save(tmp_path / "law.json", found.value)
    assert eqx.tree_equal(hj.load(tmp_path / "law.json"), found.value)
