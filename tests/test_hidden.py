"""Laws of what nobody measures, found from input and output alone."""

import functools
import re
import time
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play
from scipy.optimize import least_squares

import hystjax as hj
from hystjax.discovery import _discover, _hidden, _setting, search
from hystjax.discovery._layout import layout
from hystjax.models import BoucWenOscillator, Butterfly, Oscillator
from hystjax.reproduce import _oscillators
from hystjax.signals.excitation import Multisine
from hystjax.simulation import FixedStep

PERIOD = 1024
STEP = 0.1  # s; the oscillator below swings once in about 3 s
TRUTH = BoucWenOscillator(1.0, 0.2, 2.0, 3.0, 2.0, -1.5)
TERMS = {"du", "w*|du|", "du*|w|"}
LIBRARY = hj.library.Polynomial(2, ("w", "du", "|du|", "|w|"))
OWN = {"mass": 1.0, "damping": 0.2, "stiffness": 2.0}


def around(law):
    """Nothing is known but what adds up."""
    return Oscillator(1.0, 1.0, 1.0, law)


def recorded(model=TRUTH, noise=0.01):
    """Three periods of a multisine, settled, with noise of so much of the output's
    standard deviation."""
    frequencies = np.arange(3, 90) / (PERIOD * STEP)
    force = Multisine(frequencies, 2.0, key=jax.random.key(2))
    times = STEP * jnp.arange(4 * PERIOD)
    run = hj.simulate(model, force.path(times), w0=0.0, method=FixedStep(4))
    rec = hj.Recording(times, run.u, run.w, interpolation=hj.interpolation.Cubic())
    error = np.random.default_rng(1).normal(size=len(times)) * noise * np.std(run.w)
    noisy = hj.Recording(rec.t, rec.u, rec.w + error, interpolation=rec.interpolation)
    return noisy.window(PERIOD, 4 * PERIOD)


@functools.cache
def averaged():
    """The mean of these periods."""
    return hj.steady(recorded(), PERIOD)


# ------------------------------------------------------------------------ one period


def test_one_period_is_the_mean_of_all_behind_a_lead_in():
    t = np.arange(3 * 50 + 7.0)
    u = np.sin(2 * np.pi * t / 50)
    w = np.random.default_rng(0).normal(size=len(t))
    found, weight = hj.steady(hj.Recording(t, u, w), 50, lead_in=20)
    mean = (w[:50] + w[50:100] + w[100:150]) / 3
    np.testing.assert_allclose(found.w, np.concatenate([mean[30:], mean]), atol=1e-14)
    np.testing.assert_allclose(found.t, t[30:100], atol=1e-12)
    np.testing.assert_allclose(found.u, u[30:100], atol=1e-14)
    np.testing.assert_array_equal(weight, [0.0] * 20 + [1.0] * 50)
    assert len(hj.steady(hj.Recording(t, u, w), 50)[0]) == 75


@pytest.mark.parametrize(
    "given, message",
    [
        ({"period": 80}, "two periods"),
        ({"period": 2}, "3 samples or more"),
        ({"period": 49}, "does not repeat itself every 49 samples"),
        ({"period": 50, "lead_in": 51}, "between 0 and the period"),
    ],
)
def test_what_is_no_period_is_refused(given, message):
    t = np.arange(150.0)
    rec = hj.Recording(t, np.sin(2 * np.pi * t / 50), np.cos(t))
    with pytest.raises(hj.InputError, match=message):
        hj.steady(rec, **given)


@pytest.mark.parametrize("uneven", [True, False])
def test_a_period_that_cannot_go_round_is_named_by_what_was_called(uneven):
    t, ramp = np.arange(150.0), np.arange(150.0) % 50
    rec = hj.Recording(t + uneven * t**2, ramp, np.cos(t))
    with pytest.raises(hj.InputError, match="`steady` "):
        hj.steady(rec, 50)


# ---------------------------------------------------------------------- what is seen


def smooth(t):
    return jnp.sin(0.7 * t) + 0.4 * jnp.sin(1.9 * t + 1)


def test_a_hidden_force_and_its_rate_are_seen_through_noise():
    """A spring without memory beside the others: z = 3 y, and z' = 3 y'."""
    t = STEP * jnp.arange(2001)
    y, v, a = (
        jax.vmap(f)(t) for f in (smooth, jax.grad(smooth), jax.grad(jax.grad(smooth)))
    )
    u = 1.0 * a + 0.2 * v + 5.0 * y
    error = 1e-3 * np.random.default_rng(4).normal(size=len(t))
    rec = hj.Recording(t, u, y + error)
    law = hj.models.SparseModel.from_terms({"du": 3.0, "w": 1.0})
    model = Oscillator(*OWN.values(), law)
    (one,) = _hidden.seen((rec,), model, law.library, None)
    inside = slice(100, -100)
    # Noise above the band is left out; where the record ends the mirror has a bend.
    assert np.std(np.asarray(one.w - y)[inside]) < 0.6e-3
    np.testing.assert_allclose(one.rate(y)[inside], v[inside], atol=1e-5)
    terms, rates = one.equations(model, law.library, np.array([0, 1]))
    half = one.half_width
    x = np.linspace(-1, 1, 2 * half + 1)
    bump = (1 - x**2) ** 4 / np.sum((1 - x**2) ** 4)
    starts = one.first + one.stride * np.arange(len(one.good))
    means = [bump @ np.asarray(3 * y)[i : i + 2 * half + 1] for i in starts]
    slopes = [bump @ np.asarray(3 * v)[i : i + 2 * half + 1] for i in starts]
    np.testing.assert_allclose(terms[:, 1], means, atol=5e-3)
    np.testing.assert_allclose(3 * terms[:, 0], slopes, atol=5e-3)
    np.testing.assert_allclose(rates, slopes, atol=2e-2)


def test_stops_of_a_hidden_position_are_seen():
    """A value that remembers: z = 3 stop(y, 0.5), of a loop over many samples."""
    t, many = STEP * jnp.arange(2001), 50
    y, v, a = (
        jax.vmap(f)(t) for f in (smooth, jax.grad(smooth), jax.grad(jax.grad(smooth)))
    )
    fine = np.asarray(jax.vmap(smooth)(STEP / many * jnp.arange(many * 2000 + 1)))
    z = 3 * (fine - play(fine, 0.5))[::many]
    rec = hj.Recording(t, 1.0 * a + 0.2 * v + 2.0 * y + z, y)
    library = hj.library.Stop([0.5, 0.8])
    model = search.OfValue(around)(_setting.nothing(library))
    model = model.with_parameters({k: jnp.asarray(x) for k, x in OWN.items()})
    (one,) = _hidden.seen((rec,), model, library, None, "value")
    terms, values = one.equations(model, library, np.array([0]))
    x = np.linspace(-1, 1, 2 * one.half_width + 1)
    bump = (1 - x**2) ** 4 / np.sum((1 - x**2) ** 4)
    starts = one.first + one.stride * np.arange(len(one.good))
    means = [bump @ z[i : i + 2 * one.half_width + 1] for i in starts]
    np.testing.assert_allclose(3 * terms[:, 0], means, atol=5e-3)
    np.testing.assert_allclose(values, means, atol=2e-2)


@pytest.mark.parametrize(
    "given, message",
    [
        ({"target": "slope"}, "must be 'rate' or 'value'"),
        (
            {"target": "value", "formulation": hj.formulation.WeakForm(20)},
            r"of the value, such as `formulation\.Direct\(\)`, got `WeakForm`",
        ),
        ({"target": "value", "around": around}, "leave out .*'w'"),
        ({"target": "value", "around": Butterfly, "size": 1.0}, "leave out"),
        ({"around": lambda law: law}, "no numbers but the law's.*leave `around` out"),
        ({"around": hj.models.Instrumented}, "no numbers but the law's"),
    ],
)
def test_what_is_no_hidden_law_is_refused(given, message):
    rec, _ = averaged()
    key = {"key": jax.random.key(0)} if "size" in given else {}
    library = LIBRARY if given.get("around") is around else hj.library.Stop([0.5])
    with pytest.raises(hj.InputError, match=message):
        hj.discover(rec, library, **given, **key)


def test_samples_without_weight_are_not_looked_at():
    rec, _ = averaged()
    weight = jnp.ones(len(rec)).at[700:720].set(0.0)
    model = around(_setting.nothing(LIBRARY))
    one, all_of_it = (
        _hidden.seen((rec,), model, LIBRARY, given)[0] for given in ([weight], None)
    )
    half = one.half_width
    starts = one.first + one.stride * np.arange(len(one.good))
    sees = (starts + 2 * half >= 700) & (starts < 720)
    np.testing.assert_array_equal(one.good, ~sees)
    assert np.all(all_of_it.good)
    # The band is told without them.
    assert abs(one.first - all_of_it.first) <= one.stride
    spoilt = hj.Recording(rec.t, rec.u, rec.w.at[705].set(1e3))
    (other,) = _hidden.seen((spoilt,), model, LIBRARY, [weight])
    clear = np.ones(len(one.w), bool)
    clear[690:730] = False  # beside the way across
    assert np.max(np.abs(other.w - all_of_it.w)[clear]) < 0.02 * np.std(rec.w)
    np.testing.assert_array_equal(other.w, one.w)
    with pytest.raises(hj.InputError, match="too few samples in a row") as error:
        _hidden.seen((rec,), model, LIBRARY, [0 * weight])
    (edge,) = map(int, re.findall(r"(\d+) at each end", str(error.value)))
    assert 0 < edge <= all_of_it.first and starts[-1] + 2 * half < len(one.w) - edge


def test_records_that_tell_no_derivatives_are_refused():
    rec, _ = averaged()
    uneven = np.asarray(rec.t) + 0.3 * STEP * np.sin(np.arange(len(rec)))
    model = around(_setting.nothing(LIBRARY))
    with pytest.raises(hj.InputError, match=r"evenly sampled.*give `size` and `key`"):
        _hidden.seen((hj.Recording(uneven, rec.u, rec.w),), model, LIBRARY, None)
    with pytest.raises(hj.InputError, match="no clock"):
        _hidden.seen((hj.Recording(None, rec.u, rec.w),), model, LIBRARY, None)


def test_only_models_that_tell_their_law_are_seen_through():
    law = _setting.nothing(LIBRARY)
    assert _hidden.tells(around(law))
    assert not _hidden.tells(Butterfly(law))
    assert not _hidden.tells(3)


# ------------------------------------------------------------------- the projection


@pytest.fixture(scope="module")
def stage():
    """The laws that projection finds, and what they are found in."""
    rec, weight = averaged()
    names = ["w", "du", "w*|du|", "du*|w|", "|du|", "w*|w|"]
    library = LIBRARY.part([LIBRARY.names.index(name) for name in names])
    laid_out = layout((rec,), [weight], 2, False)
    setting = _setting.Setting((rec,), laid_out, library, 4, 4, 0.0, around=around)
    model = around(_setting.nothing(library))
    seen = _hidden.seen((rec,), model, library, [weight])
    (stage,) = _hidden.projected(setting, seen)
    return library, seen[0], stage


@pytest.mark.slow
def test_where_least_is_hidden_is_a_linear_fit_of_the_force(stage):
    """u = mass y'' + damping y' + stiffness y + z with the least z, of NumPy."""
    library, seen, _ = stage
    v = seen.rate(seen.w)
    columns = np.column_stack([seen.rate(v), v, seen.w])
    expected = np.linalg.lstsq(columns, np.asarray(seen.u), rcond=None)[0]
    start = {name: jnp.asarray(3.0) for name in OWN}  # is no matter
    found = jax.jit(lambda own: _hidden.Inside((seen,), around, library).least(own))(
        start
    )
    np.testing.assert_allclose([found[name] for name in OWN], expected, rtol=1e-6)


def test_projection_finds_the_terms_and_the_numbers(stage):
    _, _, found = stage
    best = [guesses[0] for guesses in found.guesses]
    assert [len(guess.terms) for guess in best] == [1, 2, 3, 4]
    assert set(best[2].terms) == TERMS
    second = found.guesses[2][1]
    assert best[2].squares < second.squares / 4
    assert best[3].squares > best[2].squares / 2  # a fourth term adds little
    for name, value in OWN.items():
        assert best[2].own[name] == pytest.approx(value, abs=0.1)
    truth = {"du": 3.0, "w*|du|": -2.0, "du*|w|": 1.5}
    assert best[2].terms == pytest.approx(truth, rel=0.2)


def test_projection_ends_where_scipy_does(stage):
    library, seen, found = stage
    guess = found.guesses[2][0]
    law = _setting.nothing(library)
    rows = np.array([library.names.index(name) for name in guess.terms])

    @jax.jit
    def equations(numbers):
        return seen.equations(Oscillator(*numbers, law), library, rows)

    def misfit(numbers):
        terms, rates = map(np.asarray, equations(jnp.asarray(numbers)))
        # And a millionth of what the terms do, squared.
        scaled = terms / np.linalg.norm(terms, axis=0)
        whole = np.concatenate([scaled, 1e-3 * np.eye(len(rows))])
        rates = np.concatenate([rates, np.zeros(len(rows))])
        return rates - whole @ np.linalg.lstsq(whole, rates, rcond=None)[0]

    end = least_squares(misfit, list(OWN.values()), xtol=1e-12, ftol=1e-12)
    assert guess.squares == pytest.approx(2 * end.cost, rel=1e-4)
    numbers = [guess.own[name] for name in OWN]
    np.testing.assert_allclose(numbers, end.x, rtol=1e-2)


# ------------------------------------------------------------------------- discover


def test_a_device_is_told_by_other_laws_with_another_stiffness():
    """z less twice the position, with two more of stiffness, moves as it did: by free
    runs of both, and by hand for a law that is quadratic in z."""
    rec, weight = averaged()
    library = hj.library.Polynomial(3, ("w", "u", "du", "|du|"))
    laid_out = layout((rec,), [weight], 2, False)
    setting = _setting.Setting((rec,), laid_out, library, 3, 4, 0.0, around=around)
    seen = _hidden.seen((rec,), around(_setting.nothing(library)), library, [weight])
    found = {"w*|du|": -0.9, "u*|du|": -1.8, "u^2*du": 1.1}
    own = OWN | {"stiffness": 4.0}
    law = search.Trial(found, own=own)
    (told,) = _hidden.in_other_words(setting, seen, law)
    again = {"du": 2.0, "w*|du|": -0.9, "u^2*du": 1.1}
    assert told.terms == pytest.approx(again)
    assert told.own == pytest.approx(OWN)
    path = Multisine([0.1, 0.3], 2.0, key=jax.random.key(3)).path(STEP * np.arange(600))
    runs = []
    for each in (law, told):
        spring = hj.models.SparseModel.from_terms(each.terms)
        device = Oscillator(*(each.own[name] for name in OWN), spring)
        runs.append(np.asarray(hj.simulate(device, path, w0=0.0).w))
    np.testing.assert_allclose(*runs, atol=1e-6 * np.ptp(runs[0]))
    # (z + s y)^2 y' = z^2 y' + 2 s z y y' + s^2 y^2 y', less s y'.
    (same,) = _hidden.in_other_words(
        setting,
        seen,
        search.Trial({"w^2*du": 1.0, "w*u*du": -1.0, "u^2*du": 0.25}, own=OWN),
    )
    assert same.terms == pytest.approx({"du": -0.5, "w^2*du": 1.0})
    assert same.own["stiffness"] == pytest.approx(OWN["stiffness"] + 0.5)
    # Whatever is rounded: 0.36 - 1.2 s + s^2 is nothing at 0.6.
    squared = {"w^2*du": 1.0, "w*u*du": -1.2, "u^2*du": 0.36}
    (same,) = _hidden.in_other_words(setting, seen, search.Trial(squared, own=OWN))
    assert same.terms == pytest.approx({"du": -0.6, "w^2*du": 1.0})
    # Of no more terms, and of candidates.
    law = search.Trial({"w^2*du": 1.0, "du": 0.5}, own=OWN)
    assert not [*_hidden.in_other_words(setting, seen, law)]
    kept = [i for i, name in enumerate(library.names) if name != "u*|du|"]
    without = setting._replace(library=library.part(kept))
    law = search.Trial({"w*|du|": -0.9, "du": 2.0}, own=OWN)
    assert not [*_hidden.in_other_words(without, seen, law)]
    # What is all the stiffness's is no law; and no sum of terms has |z + s y|.
    law = search.Trial({"du": 3.0}, own=OWN)
    assert not [*_hidden.in_other_words(setting, seen, law)]
    law = search.Trial({"w*|du|*|w|": -1.0, "u*|du|*|w|": -2.0}, own=OWN)
    signals = ("w", "u", "du", "|du|", "|w|")
    setting = setting._replace(library=hj.library.Polynomial(3, signals))
    assert not [*_hidden.in_other_words(setting, seen, law)]


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("left", [-1.0, 1e6])
def test_no_other_words_are_tried_when_the_time_is_up(monkeypatch, left):
    law = search.Trial({"du": 1.0}, own=OWN)
    others = [search.Trial({"w": -1.0}, own=OWN)]
    for place, name, gives in (
        (_discover, "explore", (law,)),
        (_discover, "best_of_each_size", (law,)),
        (_hidden, "projected", ()),
        (_hidden, "in_other_words", others),
    ):
        monkeypatch.setattr(place, name, lambda *_, gives=gives: gives)
    monkeypatch.setattr(
        _discover,
        "with_guesses",
        lambda _, tried, guesses: tried | {each.support: each for each in guesses},
    )
    task = SimpleNamespace(
        draws=None, records=(None,), end=time.monotonic() + left, progress=False
    )
    tried = _discover._explored(task, None, None)
    assert tried == ((law,) if left < 0 else (law, *others))


@pytest.mark.thorough
def test_the_law_of_a_spring_is_found():
    rec, weight = averaged()
    found = hj.discover(rec, LIBRARY, around=around, weights=[weight], largest=3)
    assert set(found.value.spring.terms()) == TERMS
    values = {name: float(x) for name, x in found.value.parameters().items()}
    for name, value in OWN.items():
        assert values[name] == pytest.approx(value, rel=0.05)
    run = hj.simulate(found.value, recorded(), w0=float(recorded().w[0]))
    true = recorded(noise=0.0).w[-PERIOD:]
    off = np.sqrt(np.mean(np.asarray(run.w[-PERIOD:] - true) ** 2))
    assert off < 2e-3 * np.std(true)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize("rows", [slice(0, 60), slice(640, 700)])
def test_outputs_of_no_weight_at_the_ends_may_be_anything(rows):
    t, weights = STEP * np.arange(700), np.ones(700)
    weights[rows] = 0
    force = Multisine(np.arange(3, 63) / 70, 2.0, key=jax.random.key(1))
    run = hj.simulate(TRUTH, force.path(jnp.asarray(t)), w0=0.0)
    error = np.random.default_rng(1).normal(size=700) * 0.01 * np.std(run.w)
    y = np.where(weights > 0, run.w + error, 100.0)
    record = hj.Recording(t, run.u, y, interpolation=hj.interpolation.Cubic())
    found = hj.discover(record, LIBRARY, around=around, weights=[weights], largest=3)
    assert found.value.spring.terms().keys() == TERMS
    for name, x in OWN.items():
        error = float(found.stats["standard_errors"][name])
        assert abs(float(getattr(found.value, name)) - x) < 4 * error < 0.1


@pytest.mark.slow
def test_a_friction_force_is_found():
    truth = {"du": 3.0, "w*|du|": -2.0}
    law = hj.models.SparseModel.from_terms(truth)
    rec, weight = hj.steady(recorded(Oscillator(*OWN.values(), law)), PERIOD)
    found = hj.discover(rec, LIBRARY, around=around, weights=[weight]).value
    assert float(found.stiffness) == pytest.approx(OWN["stiffness"], rel=0.01)
    assert found.spring.terms() == pytest.approx(truth, rel=0.01)


STOPS = hj.library.Stop([0.2, 0.4, 0.8, 1.6]) + hj.library.Library(
    tuple(map(hj.library.Term.parse, ("u^3", "du*|du|")))
)


@pytest.mark.thorough
def test_a_spring_whose_end_slides_is_found_between_the_radii_tried():
    truth = hj.models.SparseModel.from_terms({"stop(u,0.5)": 3.0}, target="value")
    rec, weight = hj.steady(recorded(Oscillator(*OWN.values(), truth), 0.05), PERIOD)
    given = {"around": around, "target": "value", "weights": [weight], "largest": 2}
    found = hj.discover(rec, STOPS, **given)
    assert len(found.value.spring.terms()) == 1
    values, errors = found.value.parameters(), found.stats["standard_errors"]
    expected = [*OWN.values(), 3.0, 0.5]
    for (name, value), true in zip(values.items(), expected, strict=True):
        assert abs(float(value) - true) < 4 * errors[name], name


@pytest.mark.thorough
def test_no_end_slides_where_none_does():
    law = hj.models.SparseModel.from_terms({"du": 3.0})
    rec, weight = hj.steady(recorded(Oscillator(*OWN.values(), law), 0.05), PERIOD)
    given = {"around": around, "target": "value", "weights": [weight], "largest": 2}
    found = hj.discover(rec, STOPS, throw=False, **given)
    assert found.result == hj.RESULTS.no_law


@pytest.mark.slow
def test_no_hysteresis_is_found_where_there_is_none():
    """A spring without memory is one with the stiffness, and no law is left."""
    law = hj.models.SparseModel.from_terms({"du": 3.0})
    rec, weight = hj.steady(recorded(Oscillator(*OWN.values(), law)), PERIOD)
    given = {"around": around, "weights": [weight], "largest": 2}
    found = hj.discover(rec, LIBRARY, throw=False, **given)
    assert found.result == hj.RESULTS.no_law
    assert not found.value.spring.terms()
    own = OWN | {"stiffness": OWN["stiffness"] + 3.0}
    for name, value in own.items():
        assert float(getattr(found.value, name)) == pytest.approx(value, rel=0.01)
    with pytest.raises(hj.ComputationError, match=r"stiffness = .*nothing tells of"):
        hj.discover(rec, LIBRARY, **given)


def test_the_study_counts_what_its_seeds_lead_to():
    tried = [
        _oscillators.Tried(True, True, False, 40.0, 0.01, 1.0),
        _oscillators.Tried(False, True, False, 50.0, np.nan, 2.0),
        _oscillators.Tried(False, False, True, 60.0, np.nan, 9.0),
    ]
    table = _oscillators.HiddenTable(
        "", (_oscillators.Row("Dahl", "sweep", 0.05, (*tried,)),)
    )
    assert table.cells()[1] == (
        *("Dahl", "sweep", "5", "3", "1", "2", "1"),
        *("50", "1", "2"),
    )


def test_the_study_has_a_dash_where_no_seed_tells():
    tried = _oscillators.Tried(False, False, True, np.nan, np.nan, np.inf)
    row = _oscillators.Row("no memory", "sweep", 0.05, (tried, tried))
    cells = _oscillators.HiddenTable("", (row,)).cells()[1]
    assert cells[-3:] == ("-", "-", "diverged")


def test_the_study_counts_what_runs_away_as_infinitely_far_off():
    # Its force feeds the mass: y'' = -(2 - 30) y - ... grows like exp(5 t).
    law = hj.models.SparseModel.from_terms({"u": -30.0}, target="value")
    pushed = hj.models.Oscillator(1.0, 0.2, 2.0, law)
    assert _oscillators._missed(pushed, _oscillators.SPRINGS["Dahl"]) == np.inf


@pytest.mark.thorough
def test_the_study_finds_a_friction_force():
    (row,) = _oscillators.hidden(("Dahl",), ("multisine",), (0.01,), seeds=2).rows
    assert row.count("terms") == 2 and row.median("weakest") > 100
    assert row.median("unseen") < 1.2


@pytest.mark.recordings
@pytest.mark.thorough
def test_the_law_of_the_benchmark_is_found_from_its_noisy_record():
    """Nothing is known but a mass on a spring with something hysteretic beside it."""
    record = hj.datasets.load("boucwen_benchmark")
    rec, weight = hj.steady(record.window(0, 3 * 8192), 8192)
    found = hj.discover(rec, LIBRARY, around=around, weights=[weight])
    assert set(found.value.spring.terms()) == TERMS
    truth = BoucWenOscillator(2.0, 10.0, 5e4, 5e4, 800.0, -1100.0)
    ours, true = (
        hj.simulate(model, record.path, w0=0.0, method=FixedStep(steps)).w[3 * 8192 :]
        for model, steps in ((found.value, 8), (truth, 32))
    )
    assert np.sqrt(np.mean((ours - true) ** 2)) < 5e-7
    left = np.sqrt(np.mean((ours - record.w[3 * 8192 :]) ** 2))
    assert left < 7.4e-6 * (1 + 3 / np.sqrt(2 * 8192))


def test_before_and_after_what_is_known_an_output_goes_as_far_as_that():
    t, known = np.arange(12.0), (np.arange(12) > 2) & (np.arange(12) < 9)
    w = np.where(known, np.sin(t), 0.1)
    w[[0, 1, 10, 11]] = 1e9, -1e9, np.inf, 0.2
    low, high = np.min(w[known]), np.max(w[known])
    expected = [high, low, 0.1, *w[3:9], 0.1, high, 0.2]
    np.testing.assert_array_equal(_hidden._bridged(t, w, known), expected)
