"""Devices whose own output is hidden: of w = y^2 + c only w is recorded."""

import math
import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hystjax as hj
from hystjax.discovery import _hidden
from hystjax.models import AbstractModel, Butterfly, Duhem
from hystjax.regression._identify import told_apart
from hystjax.reproduce import _simulated as study
from hystjax.reproduce._published import ASYMMETRIC, EXPERIMENT_7

SLOW = pytest.mark.slow
NAMED = {"names": ("field", "strain"), "units": ("kV/mm", "%")}
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
        "w = y^2 - 1, y' = 0.2 u' + 0.6 |u'| + 0.4 u |u'| - 0.85 y |u'|"
    )
    assert repr(model).startswith(str(model))
    own = hj.library.Custom({"slow": lambda w, u, du: jnp.tanh(w) * du})
    law = hj.models.SparseModel(own, np.ones(1), np.ones(1, bool))
    assert "y' = 1 slow" in str(Butterfly(law))


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


@SLOW
@pytest.mark.parametrize("noise, most", [(0.0, 1e-6), (0.01, 1e-3), (0.05, 5e-3)])
def test_all_random_starts_find_the_butterfly_of_the_paper(noise, most):
    """Limits for one butterfly with noise of so much of its standard deviation."""
    clean = study.butterfly(EXPERIMENT_7.record(), 0.0)
    errors = study.attempts(clean, EXPERIMENT_7.law, noise, jax.random.key(7)).errors
    assert errors.shape == (study.STARTS,)
    assert float(jnp.max(errors)) < most


class Deaf(AbstractModel):
    """What does not pass on the parameters of its law."""

    law: AbstractModel

    def rate(self, x, m, now):
        return self.law.rate(x, m, now)

    def output(self, x, m, now):
        return x

    def parameters(self):
        return {}


def noisy(seed):
    w = by_scipy(0.4, 0.85, 0.2, 0.0, -0.5, 0.0)
    error = np.random.default_rng(seed).normal(size=len(T))
    return replace(record(w + 0.05 * np.std(w) * error), **NAMED)


def hidden(seed, library, **more):
    return hj.discover(
        noisy(seed),
        library,
        around=Butterfly,
        size=2.0,
        key=jax.random.key(0),
        **more,
    )


@pytest.fixture(scope="module")
def few():
    """The law of a butterfly among four terms."""
    terms = (*TRUTH, "u")
    library = hj.library.Library(tuple(map(hj.library.Term.parse, terms)))
    return library, hidden(3, library, starts=2, largest=3)


def is_the_truth(model):
    """Whether all terms are those of the truth, near enough, up to the sign of y."""
    found = model.device.terms()
    sign = np.sign(found.get("du", 0.0))
    signs = {"du": sign, "w*|du|": 1.0, "u*|du|": sign}
    assert found.keys() == TRUTH.keys()
    assert float(model.offset) == pytest.approx(-0.5, abs=0.05)
    for name, value in found.items():
        assert value * signs[name] == pytest.approx(TRUTH[name], rel=0.05)


@pytest.mark.slow
def test_the_hidden_law_is_found_among_few(few):
    library, solution = few
    is_the_truth(solution.value)
    assert solution.value.device.library.names == library.names
    assert (solution.value.names, solution.value.units) == tuple(NAMED.values())
    assert re.search(r"noise_floor +\S+ %\n", str(solution))
    assert solution.stats["weights"] is None and solution.stats["aliases"] == ()
    trials = solution.stats["candidates"]
    assert trials[0].support == tuple(TRUTH)
    assert solution.stats["alike"] == hj.search.alike(trials)
    assert solution.stats["frontier"] == hj.search.frontier(trials)
    assert set(solution.stats["frontier"]) == {1, 2, 3}


@pytest.mark.slow
def test_a_trial_of_a_hidden_law_tells_what_was_fitted(few):
    """Its numbers give the error and the criterion that it tells."""
    _, solution = few
    seen = noisy(3)
    for trial in solution.stats["candidates"][:2]:
        law = hj.models.SparseModel.from_terms(trial.terms)
        own = {name: jnp.array(x) for name, x in trial.own.items()}
        model = Butterfly(law).with_parameters(own)
        run = hj.simulate(model, seen, method=hj.simulation.FixedStep(2))
        error = float(hj.metrics.rmse(seen.w, run.w))
        assert trial.kept is None and trial.own.keys() == {"offset", "y0"}
        assert trial.rmse == pytest.approx(error, rel=1e-9)
        assert trial.squares == pytest.approx(len(T) * error**2, rel=1e-9)
        assert trial.starts == (pytest.approx(float(run.w[0]), rel=1e-9),)
        size = len(trial.terms)
        choices = 2 * math.log(math.comb(4, size))
        unknowns = size + 2  # and no start: a hidden one is the model's own
        # The best law leaves white noise: all samples are independent.
        criterion = 2 * len(T) * math.log(error) + unknowns * math.log(len(T)) + choices
        assert trial.criterion == pytest.approx(criterion, rel=1e-9)


def test_terms_along_an_unknown_output_are_those_that_the_input_tells_apart():
    library = hj.library.Polynomial(2, ("w", "u", "du", "|du|"))
    draws = _hidden.Draws(2.0, 1, jax.random.key(1))
    problem = _hidden.blind((noisy(3),), library, draws)
    kept = np.asarray(told_apart(problem))
    lost = {name for name, k in zip(library.names, kept, strict=True) if not k}
    assert lost == {"du^2", "|du|^2"}  # of 4 sin t: 16 - u^2, whatever the output


@SLOW
def test_the_hidden_law_is_found_among_the_candidates():
    solution = hidden(3, SMALL, starts=4, largest=3)
    is_the_truth(solution.value)
    first, *others = solution.stats["candidates"]
    assert first.terms.keys() == TRUTH.keys()
    assert [c.criterion for c in others] == sorted(c.criterion for c in others)
    assert set(solution.stats["frontier"]) == {1, 2, 3}


@pytest.mark.parametrize(
    "setup, offset, terms",
    [
        (EXPERIMENT_7, 0.0, TRUTH.keys()),
        (ASYMMETRIC, study.OFFSET, {*TRUTH, "|du|"}),
    ],
    ids=["experiment 7", "asymmetric"],
)
@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 29])
def test_the_hidden_law_is_found_in_the_whole_library(setup, offset, terms, seed):
    clean = study.butterfly(setup.record(), offset)
    found = study.structure(study._noisy(clean, 0.05, jax.random.key(seed)))
    assert found.value.device.terms().keys() == terms


@pytest.mark.parametrize(
    "given, message",
    [
        ({"size": 2.0}, "give `size`.* and a `key`"),
        ({"key": jax.random.key(0)}, "give `size`.* and a `key`"),
        ({"size": -1.0, "key": jax.random.key(0)}, "`size` must be positive"),
        ({"around": None, "size": 2.0}, "without `around` none are drawn"),
        (
            {"around": Butterfly(Duhem(0.4, 0.5, 0.25))},
            "`around` must be a function.*got a Butterfly",
        ),
        (
            {"around": lambda law: 3, "size": 2.0, "key": jax.random.key(0)},
            "`around` must make a model",
        ),
        (
            {"around": Deaf, "size": 2.0, "key": jax.random.key(0)},
            "has no parameter 'du', though its law has",
        ),
    ],
)
def test_what_random_laws_need_is_told(unchecked, given, message):
    with pytest.raises(hj.InputError, match=message):
        hj.discover(noisy(3), SMALL, **{"around": Butterfly} | given)


@SLOW
def test_what_is_inside_of_a_model_has_no_inclusion(few):
    with pytest.raises(hj.InputError, match="a Butterfly around a law"):
        hj.inclusion(few[1], noisy(3), key=jax.random.key(0))
