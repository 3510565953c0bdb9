"""The evolutionary fit, on records of known laws."""

import jax
import numpy as np
import pytest

import hystjax as hj
from hystjax.reproduce.baselines import DifferentialEvolution

TRUTH = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
BOUNDS = {"du": (-1.0, 1.0), "u*|du|": (-1.0, 1.0), "w*|du|": (-1.0, 0.5)}
KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def record():
    law = hj.models.SparseModel.from_terms(TRUTH)
    times = np.linspace(0, 4 * np.pi, 400)
    sine = hj.excitation.Sine(1.0, 1 / (2 * np.pi))
    record = hj.generate(law, sine, times, method=hj.simulation.FixedStep(4))
    return record.with_input(np.asarray(record.u))


def law(**terms):
    return hj.models.SparseModel.from_terms(dict.fromkeys(TRUTH, 0.0) | terms)


def test_evolution_finds_a_known_law(record):
    # Straight lines between samples instead of the sine: not quite the record's input.
    solution = DifferentialEvolution(law(), BOUNDS, tolerance=1e-6).fit(record, key=KEY)
    assert solution.result == hj.RESULTS.successful
    assert solution.value.terms() == pytest.approx(TRUTH, rel=2e-3)
    run = hj.simulate(solution.value, record).w
    loss = float(np.mean((run - record.w) ** 2) / np.var(record.w))
    assert float(solution.stats["loss"]) == pytest.approx(loss, rel=0.1)
    generations = int(solution.stats["num_steps"])
    assert solution.stats["simulations"] == (generations + 1) * 15 * 3


def test_parameters_without_bounds_keep_their_value(record):
    start = law(**{"du": 0.25, "w*|du|": -0.5})
    bounds = {"u*|du|": (0.0, 1.0)}
    found = DifferentialEvolution(start, bounds).fit(record, key=KEY).value.terms()
    assert (found["du"], found["w*|du|"]) == (0.25, -0.5)
    assert found["u*|du|"] == pytest.approx(0.4, rel=2e-2)


def test_laws_that_diverge_lose_and_do_not_spoil_the_search(record):
    bounds = {"w*|du|": (-1.0, 20.0)}
    start = law(**{"du": 0.25, "u*|du|": 0.4})
    found = DifferentialEvolution(start, bounds).fit(record, key=KEY)
    assert found.value.terms()["w*|du|"] == pytest.approx(-0.5, rel=2e-2)
    hopeless = DifferentialEvolution(start, {"w*|du|": (400.0, 500.0)}, generations=2)
    assert hopeless.fit(record, key=KEY).result == hj.RESULTS.diverged


def test_a_search_cut_short_says_so(record):
    solution = DifferentialEvolution(law(), BOUNDS, generations=2).fit(record, key=KEY)
    assert solution.result == hj.RESULTS.max_steps_reached


def test_seed_decides_the_search(record):
    search = DifferentialEvolution(law(), BOUNDS, generations=3)
    one, again, other = (
        search.fit(record, key=jax.random.key(k)).value.terms() for k in (0, 0, 1)
    )
    assert one == again != other


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({"w": (0.0, 1.0)}, r"of the model \(du, .*got 'w': \(0.0, 1.0\)"),
        ({"du": (1.0, 0.0)}, r"got 'du': \(1.0, 0.0\)"),
        ({"du": (0.0, np.inf)}, r"got 'du': \(0.0, inf\)"),
        ({"du": 1.0}, r"got 'du': 1\.0"),
        ({"du": ("low", "high")}, r"got 'du': \('low', 'high'\)"),
        ({"du": (0.0, 1.0, 2.0)}, r"got 'du': \(0.0, 1.0, 2.0\)"),
        ({}, r"for each parameter that is sought, of du, .*; got \{\}"),
        ([(0.0, 1.0)], r"such as \{'du': \(0.0, 1.0\)\}; got \[\(0.0, 1.0\)\]"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_bad_bounds(bounds, message):
    with pytest.raises(hj.InputError, match=message):
        DifferentialEvolution(law(), bounds)


def test_evolution_needs_a_key(record):
    with pytest.raises(hj.InputError, match="needs a `key`"):
        DifferentialEvolution(law(), BOUNDS).fit(record)


@pytest.mark.usefixtures("unchecked")
def test_evolution_says_what_is_no_model_recording_or_key(record):
    with pytest.raises(hj.InputError, match=r"`model` must be .* the class Duhem"):
        DifferentialEvolution(hj.models.Duhem, BOUNDS)
    search = DifferentialEvolution(law(), BOUNDS)
    with pytest.raises(hj.InputError, match="`recording` must be a `Recording`"):
        search.fit(record.w, key=KEY)
    with pytest.raises(hj.InputError, match=r"`key` must be a key .* the number 0"):
        search.fit(record, key=0)
