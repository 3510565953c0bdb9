"""Guesses and fits of classical models, and figures of them."""

import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax import InputError
from hystjax.models import Dahl, JilesAtherton, LuGre, Tellinen
from hystjax.reproduce import _classical
from hystjax.simulation import FixedStep


def check(name, noise, seeds):
    found = _classical.found(name, noise, range(seeds))
    assert min(found.within.values()) >= seeds - 1, found.within
    assert 0.9 < found.residual < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Dahl", "RambergOsgood"])
def test_a_guess_leads_to_the_truth(name):
    check(name, 0.10, 4)


FIRST = ("Dahl", "LuGre", "JilesAtherton")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow if n in FIRST else pytest.mark.thorough)
        for n in _classical.CASES
    ],
)
def test_every_guess_leads_to_the_truth(name):
    check(name, 0.05, 20)


@pytest.mark.parametrize("name", _classical.CASES)
def test_guesses_keep_names_and_units_and_follow_the_record(name):
    """With a tenth of noise: by half of what there is to follow, at worst."""
    clean = _classical.CASES[name].clean()
    noise = 0.1 * np.std(clean.w) * np.random.default_rng(1).normal(size=len(clean))
    record = hj.Recording(
        clean.t, clean.u, clean.w + noise, names=("a", "b"), units=("A", "B")
    )
    guess = type(_classical.CASES[name].truth).guess(record)
    assert guess.names == ("a", "b") and guess.units == ("A", "B")
    for key, (lower, upper) in guess.bounds().items():
        assert lower < float(guess.parameters()[key]) < upper
    # Near saturation a little more flux takes any field: of that a guess may be off.
    if name != "InverseJilesAtherton":
        run = hj.simulate(guess, clean.path, w0=clean.w[0])
        assert hj.metrics.rmse(clean.w, run.w) < 0.5 * np.std(clean.w)


def noisy_bristles(samples):
    """A LuGre, a record with 1 % of noise, and how much that is."""
    truth = LuGre(2e3, 8.0, 0.6, 1.0, 1.5, 0.1)
    t = np.linspace(0, 2 * np.pi, samples)
    still = hj.Recording(t, 0.1 * np.sin(4 * t), 0 * t)
    w = hj.simulate(truth, still, method=FixedStep(32)).w
    noise = 0.01 * float(np.std(w))
    w = w + noise * np.random.default_rng(0).normal(size=samples)
    return truth, hj.Recording(t, still.u, w), noise


def test_bristles_are_told_by_all_samples():
    """They settle within the way of a few samples after each turn."""
    truth, record, _ = noisy_bristles(801)
    guess = LuGre.guess(record).parameters()
    for name in ("stiffness", "micro"):
        assert float(guess[name] / truth.parameters()[name]) == pytest.approx(
            1, abs=0.1
        )


@pytest.mark.slow
def test_a_fit_that_its_steps_led_away_begins_again_with_more():
    """Of one step a sample those of these bristles are unstable."""
    truth, record, noise = noisy_bristles(801)
    fit = hj.refine(LuGre.guess(record), record)
    assert float(fit.stats["rmse"][0]) == pytest.approx(noise, rel=0.1)
    for name, error in fit.stats["standard_errors"].items():
        off = float(fit.value.parameters()[name] - truth.parameters()[name])
        assert abs(off) < 4 * float(error)


def test_a_clean_major_loop_tells_its_numbers_at_once():
    """By branches in closed form; lines through a share of the loop blur them a bit."""
    saturation, coercive, width, slope = 1.5, 60.0, 90.0, 1e-4
    rising = np.linspace(-600.0, 600.0, 301)
    u = np.r_[rising, rising[-2::-1]]
    way = np.r_[np.ones(301), -np.ones(300)]
    w = slope * u + 2 / np.pi * saturation * np.arctan((u - way * coercive) / width)
    guess = Tellinen.guess(hj.Recording(None, u, w))
    assert float(guess.saturation) == pytest.approx(saturation, rel=0.1)
    assert float(guess.coercive) == pytest.approx(coercive, rel=0.1)
    assert float(guess.width) == pytest.approx(width, rel=0.2)


def test_a_first_friction_curve_is_read_where_the_contact_slides():
    t = np.linspace(0.0, 6.0, 2401)
    u = 0.1 * np.sin(2 * np.pi * t / 3)
    truth = LuGre(2e3, 8.0, 0.6, 1.0, 1.5, 0.05)
    run = hj.simulate(truth, hj.Recording(t, u, 0 * u), method=FixedStep(8))
    guess = LuGre.guess(hj.Recording(t, u, run.w))
    for name in ("viscous", "coulomb", "static", "stribeck"):
        expected = float(getattr(truth, name))
        assert float(getattr(guess, name)) == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_fits_stay_within_the_bounds_of_the_model():
    """A record that would have an exponent below 0, and one that is told otherwise."""
    record = _classical.CASES["Dahl"].clean()
    start = Dahl(600.0, 5.0, 1.5)
    flat = hj.Recording(record.t, record.u, 0.5 * np.sign(np.gradient(record.u)))
    found = hj.refine(start, flat, substeps=4, throw=False).value
    assert all(float(x) >= 0 for x in found.parameters().values())
    found = hj.refine(start, record, bounds={"exponent": (1.7, 3.0)}, throw=False).value
    assert float(found.exponent) == pytest.approx(1.7, abs=1e-6)


def test_tables_of_studies():
    row = _classical.Found("Dahl", 0.05, 2, {"a": 20, "b": 19}, 20, 0.99734)
    table = _classical.FoundTable("title", (row,))
    assert table.cells()[1] == ("Dahl", "5", "2", "19 of 20", "b", "0.9973")
    model = Dahl(1.0, 1.0)
    rows = (
        _classical.Judged("X", model, ("0.43T", "0.95T"), 1.0, "1.50T", 2.0),
        _classical.Judged("X", model, ("0.43T",), 1.0),
    )
    cells = _classical.SteelTable("title", rows).cells()
    assert cells[1] == ("X", "0.43T, 0.95T", "1", "1.50T", "2")
    assert cells[2] == ("X", "0.43T", "1", "-", "-")


@pytest.mark.slow
@pytest.mark.recordings
def test_a_steel_is_fitted_from_most_starts():
    loops = {n: hj.datasets.load("steel_m130_27s", n) for n in _classical.LOOPS}
    found, note = _classical.together("JilesAtherton", loops)
    assert "9 of 10 starts" in note or "10 of 10 starts" in note
    assert found.own < 3.0


@pytest.mark.slow
@pytest.mark.recordings
def test_preisach_s_operator_follows_a_steel_closer_than_tellinen_s_model():
    loops = {n: hj.datasets.load("steel_m130_27s", n) for n in _classical.LOOPS}
    found = _classical.left_out("Everett", loops, "0.95T")
    assert found.own < 2.54 and found.error < 4.41  # Tellinen's, docs/classical.md
    assert _classical.left_out("Everett", loops, None).error is None


# ------------------------------------------------------------------------------ figures

T = np.linspace(0, 2, 201)
U = 0.1 * np.sin(6 * T)
BRISTLES = LuGre(2e3, 8.0, 0.6, 1.0, 1.5, 0.1, names=("x", "F"), units=("m", "N"))


def drawn(figure):
    (ax,) = figure.axes
    return ax, {line.get_label(): line for line in ax.lines}


def test_the_friction_curve_is_that_of_steady_sliding():
    ax, lines = drawn(hj.plot.friction(BRISTLES))
    v, force = lines["steady sliding"].get_data()
    np.testing.assert_allclose(force, BRISTLES.steady(v))
    assert v.max() == pytest.approx(0.6)
    assert ax.get_xlabel() == "velocity (m/s)" and ax.get_ylabel() == "F (N)"
    record = hj.Recording(T, U, 0 * U, names=("x", "F"), units=("m", "N"))
    _, lines = drawn(hj.plot.friction(BRISTLES, record))
    assert len(lines["recorded"].get_xdata()) == len(T)
    with pytest.raises(InputError, match="no clock"):
        hj.plot.friction(BRISTLES, hj.Recording(None, U, 0 * U))


def test_parts_of_the_magnetisation_are_drawn():
    model = JilesAtherton(1.3e6, 40.0, 50.0, 6e-5, 0.15)
    record = hj.Recording(T, 2500 * U, 0 * U)
    ran = hj.simulate(model, record, method=FixedStep(4))
    _, lines = drawn(hj.plot.magnetisation(model, ran))
    parts = model.components(jnp.asarray(ran.u), ran.w)
    for name in ("anhysteretic", "irreversible", "reversible"):
        shown = lines[name].get_ydata()
        np.testing.assert_allclose(shown, getattr(parts, name) / 1e6)
    np.testing.assert_allclose(lines["magnetisation"].get_ydata(), parts.total / 1e6)
