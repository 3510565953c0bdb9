"""Devices whose own output is hidden: of w = y^2 + c only w is recorded."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hystjax as hj
from hystjax.models import Butterfly, Duhem
from hystjax.reproduce import _butterfly as study
from hystjax.reproduce._published import ASYMMETRIC, EXPERIMENT_7

T = np.linspace(0, 10 * np.pi, 1000)
TRUTH = {"du": 0.2, "w*|du|": -0.85, "u*|du|": 0.4}
SMALL = hj.library.Library(
    hj.library.Duhem().terms + hj.library.Polynomial(1, ("w", "u")).terms
)


def by_scipy(alpha, beta, gamma, bias, offset, start):
    """A butterfly under 4 sin t."""

    def rate(t, y):
        u, du = 4 * np.sin(t), 4 * np.cos(t)
        return (bias + alpha * u - beta * y) * abs(du) + gamma * du

    y = solve_ivp(rate, T[[0, -1]], [start], "RK45", T, rtol=1e-9, atol=1e-11).y[0]
    return y**2 + offset


def record(w):
    sine = lambda t: 4 * jnp.sin(t)  # noqa: E731
    return hj.Recording(T, 4 * np.sin(T), w).with_input(sine)


def test_a_butterfly_is_the_square_of_its_device():
    model = Butterfly(Duhem((0.6, 0.4), 0.85, 0.2), -1.0, 0.3)
    expected = by_scipy(0.4, 0.85, 0.2, 0.6, -1.0, 0.3)
    run = hj.simulate(model, record(expected))
    np.testing.assert_allclose(run.w, expected, rtol=0, atol=1e-6)
    assert model.hidden
    assert str(model) == (
        "w = y^2 -1, y' = 0.2 u' + 0.6 |u'| + 0.4 u |u'| - 0.85 y |u'|"
    )
    assert repr(model).startswith("Butterfly(")


def test_the_first_hidden_value_is_fitted_with_the_law():
    start = Butterfly(Duhem((0.1, 0.3), 0.5, 0.4), 0.0, 0.1)
    seen = record(by_scipy(0.4, 0.85, 0.2, 0.6, -1.0, 0.3))
    solution = hj.refine(start, seen, substeps=8)
    found = solution.value.parameters()
    truth = dict(zip(found, (0.6, 0.4, 0.85, 0.2, -1.0, 0.3), strict=True))
    assert list(found) == ["alpha[0]", "alpha[1]", "beta", "gamma", "offset", "y0"]
    sign = np.sign(float(found["y0"]))  # the mirror image is as good
    for name, value in truth.items():
        even = name in ("beta", "offset")
        assert float(found[name]) * (1 if even else sign) == pytest.approx(value, 1e-5)
    assert float(solution.stats["w0"][0]) == pytest.approx(0.3**2 - 1, abs=1e-5)


def test_a_fixed_first_value_follows_the_parameters_that_give_it():
    """The start of a device behind an unknown gain depends on that gain."""
    device = Duhem(0.4, 0.5, 0.25)
    truth = hj.models.Instrumented(device, output_gain=2.0)
    seen = record(np.full_like(T, 1.0) + 0 * T)
    w = np.asarray(hj.simulate(truth, seen, w0=1.0).w)
    guess = hj.models.Instrumented(device, output_gain=1.5)
    kept = list(device.parameters())
    solution = hj.refine(guess, record(w), fixed=kept, free_start=False, substeps=8)
    assert float(solution.value.parameters()["output_gain"]) == pytest.approx(2, 1e-6)


@pytest.mark.parametrize("noise, most", [(0.0, 1e-6), (0.01, 1e-3), (0.05, 5e-3)])
def test_all_random_starts_find_the_butterfly_of_the_paper(noise, most):
    """Limits for one butterfly with noise of so much of its standard deviation."""
    clean = study.butterfly(EXPERIMENT_7.record(), 0.0)
    errors = study.attempts(clean, EXPERIMENT_7.law, noise, jax.random.key(7)).errors
    assert errors.shape == (study.STARTS,)
    assert float(jnp.max(errors)) < most


def noisy(seed):
    w = by_scipy(0.4, 0.85, 0.2, 0.0, -0.5, 0.0)
    error = np.random.default_rng(seed).normal(size=len(T))
    return record(w + 0.05 * np.std(w) * error)


def test_the_hidden_law_is_found_among_the_candidates():
    solution = hj.discover_hidden(
        noisy(3), SMALL, Butterfly, size=2.0, key=jax.random.key(0), starts=4
    )
    law = solution.value.device
    assert law.terms().keys() == TRUTH.keys()
    assert float(solution.value.offset) == pytest.approx(-0.5, abs=0.05)
    sign = np.sign(law.terms()["du"])
    for name, value in law.terms().items():
        even = name == "w*|du|"
        assert value * (1 if even else sign) == pytest.approx(TRUTH[name], rel=0.05)
    candidates = solution.stats["candidates"]
    assert [c.criterion for c in candidates] == sorted(c.criterion for c in candidates)
    assert candidates[0].terms.keys() == TRUTH.keys()
    assert set(solution.stats["frontier"]) == {1, 2, 3}


@pytest.mark.slow
@pytest.mark.parametrize(
    "setup, offset, terms",
    [
        (EXPERIMENT_7, 0.0, TRUTH.keys()),
        (ASYMMETRIC, study.OFFSET, {*TRUTH, "|du|"}),
    ],
    ids=["experiment 7", "asymmetric"],
)
@pytest.mark.parametrize("seed", [1, 29])
def test_the_hidden_law_is_found_in_the_whole_library(setup, offset, terms, seed):
    clean = study.butterfly(setup.record(), offset)
    found = study.structure(study._noisy(clean, 0.05, jax.random.key(seed)))
    assert found.value.device.terms().keys() == terms


@pytest.mark.parametrize("name", ["largest", "width", "starts"])
def test_wrong_sizes_are_told(name):
    more = {"size": 2.0, "key": jax.random.key(0), name: 0}
    with pytest.raises(hj.InputError, match=f"`{name}` must be at least 1, got 0"):
        hj.discover_hidden(noisy(3), SMALL, Butterfly, **more)
    with pytest.raises(hj.InputError, match="`size`"):
        hj.discover_hidden(noisy(3), SMALL, Butterfly, size=-1.0, key=more["key"])
