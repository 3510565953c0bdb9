"""What a record leaves open elsewhere: laws that follow as well, and how far they go
apart under inputs beyond the recorded ones."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of

import hystjax as hj
from hystjax.discovery import _choosing, _explore
from hystjax.discovery._choosing import (
    _moved,
    _runs,
    _under_other_names,
    _why,
    elsewhere,
    from_the_others,
    running_away,
    runs_decide,
)
from hystjax.discovery._layout import NEAR, _waves, layout, multisines
from hystjax.discovery._setting import Setting
from hystjax.discovery.search import Trial
from hystjax.models import SparseModel
from hystjax.regression import Alias
from hystjax.simulation import FixedStep

T = np.linspace(0, 40, 641)
TRUTH = {"du": 0.5, "w*|du|": -1.2}
LIBRARY = hj.library.Polynomial(2, ("w", "u", "du", "|du|")).part([1, 2, 3, 8])
ALL = hj.library.Polynomial(2)
STEPS = FixedStep(4)
# Inputs 1.5 times as large, three times and half as fast.
CHANGED = ((1.5, 1.0), (1.0, 3.0), (1.0, 0.5))


def noisy(excitation):
    clean = hj.generate(SparseModel.from_terms(TRUTH), excitation, T, method=STEPS)
    noise = 0.02 * np.std(clean.w) * np.random.default_rng(1).normal(size=len(T))
    return hj.Recording(T, clean.u, clean.w + noise)


@dataclass
class Refinement:
    """What a refinement tells of the errors of a law."""

    value: SparseModel
    covariance: np.ndarray

    def of_numbers(self):
        return tuple(self.value.parameters()), self.covariance


def surely(terms):
    """The law refined on a record without noise."""
    return Refinement(SparseModel.from_terms(terms), np.zeros((len(terms),) * 2))


@pytest.fixture(scope="module")
def found():
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    return record, hj.discover(record, LIBRARY)


def test_a_term_that_the_excitation_cannot_tell_is_tried_elsewhere(found):
    """A triangle has one |u'|, so that w|u'| is w, but not at another speed."""
    record, solution = found
    assert LIBRARY.names == ("w", "u", "du", "w*|du|")
    law = solution.value.terms()
    assert set(law) == {"w", "du"}  # the plainer one
    speed = float(jnp.max(jnp.abs(jnp.diff(record.u) / jnp.diff(record.t))))
    other = {"du": law["du"], "w*|du|": law["w"] / speed}
    start = float(solution.stats["w0"][0])

    mine, its = (
        np.array([*runs_elsewhere(record, terms, start)]) for terms in (law, other)
    )
    expected = np.max(np.sqrt(np.mean((mine - its) ** 2, axis=1)))
    assert expected > 0.1
    assert solution.stats["apart"] == pytest.approx(expected, rel=1e-3)


def runs_elsewhere(record, terms, w0=0.0):
    """Of a law, over the range of the recorded output, where its triangle of amplitude
    1 and speed 0.4 is larger, faster or slower, and under multisines."""
    lines, cubic = hj.interpolation.Linear(), hj.interpolation.Cubic()
    changed = [(T / f, a * record.u, lines) for a, f in CHANGED]
    waves = [(T, wave, cubic) for wave in multisines_of_a_triangle(1.5, 0.4)]
    law = SparseModel.from_terms(terms)
    for t, u, between in (*changed, *waves):
        there = hj.Recording(t, u, record.w, interpolation=between)
        yield hj.simulate(law, there, w0=w0, method=STEPS).w / jnp.ptp(record.w)


def multisines_of_a_triangle(amplitude, speed):
    """Of its root mean square, about the frequency that this and its speed make."""
    rms = amplitude / np.sqrt(3)
    own = amplitude * speed / rms
    for lines, phases in _waves():
        sines = np.sin(own * lines * T[:, None] + phases)
        wave = rms * np.sqrt(2 / len(lines)) * np.sum(sines, axis=1)
        yield from (wave, -wave)


def test_multisines_are_as_large_as_the_larger_input_and_change_as_their_slopes_say():
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    held = layout((record,), None, 2, True)
    waves = multisines(held.outside, 1)
    assert len(waves.w) == 2 * len(list(_waves()))
    steps, (start, middle, end) = waves.grid.steps, waves.grid[1:]
    # Simpson's rule over each step, of the slope.
    change = steps / 6 * (start.du + 4 * middle.du + end.du)
    np.testing.assert_allclose(change, end.u - start.u, atol=1e-8)
    for row, expected in zip(end.u, multisines_of_a_triangle(1.5, 0.4), strict=True):
        at_samples = np.interp(T, waves.t[0, 0] + np.cumsum(steps[0]), row)
        np.testing.assert_allclose(at_samples[1:], expected[1:], atol=5e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("unchecked")
def test_where_an_output_has_one_sign_its_size_is_tried_in_its_place():
    """Larger triangles leave the output where it was, above zero: there |w| is w. An
    input of another waveform takes it below, where the law in w runs away."""
    terms = {"|w|": 0.25, "w*|w|": -0.6, "u*du": 0.15, "du*|w|": -0.16}
    clean = hj.generate(
        SparseModel.from_terms(terms),
        hj.excitation.Triangle(1.0, 0.16, 10),
        np.linspace(0, 62.5, 1001),
    )
    setting = Setting((clean,), layout((clean,), None, 2, True), ALL, 4, 4, 3.0)
    in_w = {"w": 0.25, "w^2": -0.6, "u*du": 0.15, "w*du": -0.16}
    law = Trial(in_w, criterion=0.0, starts=(0.0,))
    found = elsewhere(setting, ALL, [law], surely(in_w), hj.aliases(clean, ALL))
    assert found.apart > 0.05 and found.marked


def test_the_law_is_marked(found):
    record, solution = found
    share = solution.stats["apart"]
    assert (
        f"by up to {100 * share:.2g} % of the output's range" in solution.stats["why"]
    )
    assert solution.stats["marked"]
    assert float(solution.value.fitted_range.apart) == pytest.approx(share)
    faster = hj.Recording(record.t / 3, record.u, record.w)
    with pytest.warns(UserWarning, match=f"differ by some {100 * share:.2g} %"):
        hj.simulate(solution.value, faster)


@pytest.mark.slow
def test_an_excitation_that_tells_all_terms_leaves_nothing_open():
    record = noisy(hj.excitation.DecayingSine(1.0, 0.2, 20.0))
    solution = hj.discover(record, LIBRARY)
    assert set(solution.value.terms()) == set(TRUTH)
    assert solution.stats["apart"] < 0.01 and not solution.stats["marked"]
    assert "follow as well" not in solution.stats["why"]


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    "other, reach, counts",
    [
        ({"w": -0.48, "du": 0.5}, np.inf, True),  # w for w|u'|, where |u'| is 0.4
        ({"w": -0.48, "du": 0.5}, 1.0, False),  # it gets farther than it may
        ({"du": 0.1}, np.inf, False),  # it stays, and does not follow
    ],
)
def test_only_laws_that_follow_and_stay_are_held_against_the_chosen_one(
    other, reach, counts
):
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    setting = Setting((record,), layout((record,), None, 2, True), LIBRARY, 2, 2, 0.0)
    setting = setting._replace(reach=reach)
    laws = [Trial(x, criterion=0.0, starts=(0.0,)) for x in (TRUTH, other)]
    found = elsewhere(setting, LIBRARY, laws, surely(TRUTH), ())
    assert (found.apart > 0.1) if counts else (found.apart == 0)


def test_how_well_laws_follow_is_by_the_weights():
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    weights = np.where(np.arange(len(T)) < 50, 0.0, 1 + np.arange(len(T)) % 3)
    held = layout((record,), [weights], 2, True)
    setting = Setting((record,), held, LIBRARY, 2, 2, 0.0)
    laws = [TRUTH, {"w": -0.48, "du": 0.5}]
    found = _runs(setting, LIBRARY, laws, Trial(TRUTH, starts=(0.0,))).squares
    mean = np.mean(weights[weights > 0])
    for terms, squares in zip(laws, found, strict=True):
        run = hj.simulate(
            SparseModel.from_terms(terms), record, w0=0.0, method=FixedStep(2)
        )
        expected = np.sum(weights / mean * np.asarray(run.w - record.w) ** 2)
        assert squares == pytest.approx(expected, rel=1e-6)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("times, marked", [(0.8, True), (1.25, False)])
def test_a_law_is_marked_where_others_go_farther_than_noise_moves_its_own_run(
    times, marked
):
    """By three standard errors, which the law's rate is uncertain by."""
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))  # w|u'| is w there
    other = {"du": 0.5, "w*|du|": -1.08, "w": -0.048}
    moved = {"du": 0.5, "w*|du|": -1.2 * 1.01}
    own, rival, shifted = (
        np.array([*runs_elsewhere(record, terms)]) for terms in (TRUTH, other, moved)
    )
    far, unsure = (
        np.sqrt(np.mean((each - own) ** 2, axis=1)) for each in (rival, shifted)
    )
    assert 0.01 < np.max(far) < 0.05
    step = times * np.max((far / unsure)[far > 0.01]) / 3 * 0.012
    share = 0.25  # of the samples that are worth independent ones
    covariance = np.diag([0.0, share * step**2])

    setting = Setting((record,), layout((record,), None, 2, True), LIBRARY, 3, 2, 99.0)
    judged = {"criterion": 0.0, "starts": (0.0,), "independent": share}
    laws = [Trial(x, **judged) for x in (TRUTH, other)]
    fit = Refinement(SparseModel.from_terms(TRUTH), covariance)
    found = elsewhere(setting, LIBRARY, laws, fit, ())
    assert found.apart == pytest.approx(np.max(far), rel=1e-2)
    assert found.marked == marked and bool(found.in_words()) == marked


@pytest.mark.usefixtures("unchecked")
def test_what_errors_move_a_law_by_has_their_covariance():
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    setting = Setting((record,), layout((record,), None, 2, True), LIBRARY, 3, 2, 99.0)
    covariance = np.array([[0.04, 0.03], [0.03, 0.09]])
    fit = Refinement(SparseModel.from_terms(TRUTH), covariance)
    moved = _moved(setting, Trial(TRUTH, criterion=0.0, starts=(0.0,)), fit)
    steps = np.array([[law[name] - x for name, x in TRUTH.items()] for law in moved])
    np.testing.assert_allclose(steps.T @ steps, covariance, rtol=1e-12)


def judged(terms, *blocks):
    """A law as it is after blocks have judged it."""
    return Trial(terms, starts=(0.0,), blocks=blocks or (1.0, 1.0))


def beyond(*laws, guard=True):
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    setting = Setting((record,), layout((record,), None, 2, guard), LIBRARY, 2, 2, 0.0)
    return record, from_the_others(setting, LIBRARY, laws), runs_decide(setting, laws)


def test_laws_go_as_far_from_the_others_as_their_free_runs_do():
    laws = [TRUTH, {"du": 0.5, "w": -0.48}, {"du": 0.6, "w*|du|": -1.2}]
    record, found, by_runs = beyond(*map(judged, laws))
    span = jnp.ptp(record.w)

    def outputs(terms):
        law = SparseModel.from_terms(terms)
        for larger, faster in CHANGED:
            there = hj.Recording(record.t / faster, larger * record.u, record.w)
            yield hj.simulate(law, there, w0=0.0, method=STEPS).w / span

    each = [np.array(list(outputs(terms))) for terms in laws]
    expected = [sum(np.sqrt(np.mean((a - b) ** 2)) for b in each) for a in each]
    assert by_runs
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    # Of w |u'| twice and w once, the one with the usual slope is in the middle.
    assert min(expected) == expected[0]


@pytest.mark.parametrize(
    "laws, guard",
    [
        ([judged(TRUTH), judged({"du": 0.1})], True),  # of two neither is the middle
        ([judged(TRUTH), judged({"du": 0.1}), judged({})], True),  # no law at all
        ([judged(TRUTH), judged({"du": 0.1}), Trial({"w": -1.0})], True),  # by evidence
        ([judged(TRUTH), judged({"du": 0.1}), judged({"w": -1.0})], False),
    ],
)
def test_runs_beyond_the_record_do_not_always_tell(laws, guard):
    _, found, by_runs = beyond(*laws, guard=guard)
    assert not by_runs and found == [0.0] * len(laws)


# An output that was never below zero tells neither |w| from w nor w |w| from w²; from
# below zero the first law comes back, the second does not, nor do those of |u'|.
BACK, AWAY = {"du": 1.0, "w": -1.0}, {"du": 1.0, "|w|": -1.0}
FASTER = {"du": 1.0, "|du|*|w|": -4.0}


@pytest.mark.parametrize(
    "laws, guard, expected",
    [
        ([BACK, AWAY], True, [0, np.inf]),
        ([AWAY, BACK, FASTER], True, [np.inf, 0, np.inf]),
        ([AWAY, FASTER], True, [np.inf, np.inf]),
        ([AWAY], True, [0]),  # there is no other
        ([AWAY, {}], True, [0, 0]),  # or there may be no law
        ([AWAY, BACK], False, [0, 0]),  # and nobody wants to know
    ],
)
def test_laws_that_run_away_under_other_waveforms(laws, guard, expected):
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    held = layout((record,), None, 2, guard)
    setting = Setting((record,), held, ALL, 2, 2, 0.0, 3.0)
    near = [Trial(terms, criterion=0.0, starts=(0.0,)) for terms in laws]
    assert running_away(setting, ALL, near) == expected


# It forgets within half a sample, of 1/16 s. Half as fast, steps are twice as long.
STIFF = {"w": -30.0, "u": 30.0}


def stiffly_recorded(steps):
    """Samples of that law, by which laws are tried in so many steps each."""
    clean = hj.generate(SparseModel.from_terms(STIFF), hj.excitation.Sine(1.0, 0.1), T)
    record = hj.Recording(T, clean.u, clean.w, interpolation=hj.interpolation.Cubic())
    held = layout((record,), None, steps, True)
    return Setting((record,), held, ALL, 2, 2, 0.0, NEAR)


@pytest.mark.slow
def test_steps_that_are_too_long_refuse_no_law():
    """It follows inputs of any speed, and so does what is fitted to its record; a law
    that grows does not, whatever its steps."""
    setting = stiffly_recorded(1)
    known = setting.layout.in_its_own_steps()
    assert known.outside.substeps < setting.layout.outside.substeps

    stays, away = (
        Trial(STIFF, starts=(0.0,)),
        Trial({"w": 3.0, "u": 1.0}, starts=(0.0,)),
    )
    ((law, _),) = _explore.refined(setting, [stays], _explore.ENOUGH)
    coarse = setting._replace(layout=known)
    (by_its_own,) = _explore.looked_beyond(coarse, [law])
    assert by_its_own.beyond > 1e3
    assert law.beyond == pytest.approx(1.5, abs=0.01)

    found = _explore.looked_beyond(setting, [stays, away])
    assert found[0].beyond == pytest.approx(1.5, abs=0.01)
    assert found[1].beyond > 1e3


def test_it_is_said_that_a_plainer_law_runs_away():
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    held = layout((record,), None, 2, True)
    setting = Setting((record,), held, ALL, 3, 2, 0.0, 3.0)
    longer = Trial(BACK | {"u": 0.1}, criterion=1.0, starts=(0.0,), squares=1.0)
    plain = Trial(AWAY, criterion=0.0, starts=(0.0,), squares=1.0)
    words = "it is the plainest of those that do not run away under other waveforms"
    assert words in _why(setting, (longer, plain), (longer, plain))
    assert "do not run away" not in _why(setting, (longer, plain), (plain, longer))


@pytest.mark.parametrize(
    "law, away",
    [pytest.param(BACK, False, marks=pytest.mark.slow), (AWAY, True), (FASTER, True)],
)
def test_they_do_by_adaptive_steps(law, away):
    model, far = SparseModel.from_terms(law), 0.0
    for wave in multisines_of_a_triangle(1.5, 0.4):
        there = hj.Recording(T, wave, T, interpolation=hj.interpolation.Cubic())
        method = hj.simulation.Adaptive()
        w = hj.simulate(model, there, w0=0.0, method=method, throw=False).w
        far = max(far, np.max(np.abs(np.nan_to_num(w, nan=np.inf))))
    assert (far > 1e3) == away and (far < 10) != away


def test_terms_that_are_a_mix_take_the_place_of_each():
    alias = Alias("c", 0.0, {"a": 2.0, "b": -1.0})  # c = 2 a - b
    found = list(_under_other_names({"a": 3.0, "b": 1.0, "d": 5.0}, [alias]))
    assert found == [{"b": 2.5, "d": 5.0, "c": 1.5}, {"a": 5.0, "d": 5.0, "c": -1.0}]
    assert not list(_under_other_names({"a": 3.0}, [alias]))  # would need a term more


def test_several_terms_have_other_names_at_once():
    names = (("a", "A", 2.0), ("b", "B", 4.0), ("b", "C", 1.0))
    aliases = [Alias(other, 0.0, {own: share}) for own, other, share in names]
    found = list(_under_other_names({"a": 3.0, "b": 1.0, "d": 5.0}, aliases))
    alone = [{"A": 1.5, "b": 1.0}, {"a": 3.0, "B": 0.25}, {"a": 3.0, "C": 1.0}]
    together = [{"A": 1.5, "B": 0.25}, {"A": 1.5, "C": 1.0}]
    assert found == [{**each, "d": 5.0} for each in (*alone, *together)]


@pytest.mark.slow
def test_a_triangle_does_not_tell_a_speed_in_all_terms_from_one_in_none():
    """With the speed in one of its terms only the law would run away, and such laws
    are none that anyone would take."""
    library = hj.library.Polynomial(3, ("w", "u", "du", "|du|"))
    law = SparseModel.from_terms({"du": 0.36, "w^2*|du|": -1.2, "w*u*|du|": 0.6})
    excitation = hj.excitation.Triangle(1.0, 0.1, 4)
    clean = hj.generate(law, excitation, T, w0=0.1, method=STEPS)
    noise = 0.02 * np.std(clean.w) * np.random.default_rng(1).normal(size=len(T))
    record = hj.Recording(T, clean.u, clean.w + noise)
    terms = ["du", "w^2", "w*u", "w^2*|du|", "w*u*|du|"]
    part = library.part([library.names.index(name) for name in terms])
    found = hj.discover(record, part, largest=3, width=3)
    assert found.stats["apart"] > 0.01


@pytest.mark.usefixtures("unchecked")
def test_laws_that_other_waveforms_take_too_far_say_nothing(monkeypatch):
    """The chosen one may go there, and then counts as far as that."""
    setting = SimpleNamespace(layout=SimpleNamespace(outside=0), known={}, reach=3.0)
    most = _choosing._RUNS_AWAY * 3.0 / 2
    laws = [Trial(TRUTH, criterion=0.0, starts=(0.0,)) for _ in range(2)]
    for name, known in (("_moved", []), ("_uncertain", 0.0)):
        monkeypatch.setattr(_choosing, name, lambda *_, known=known: known)
    for chosen, other, apart in (
        (0.0, 0.9 * most, 0.9 * most),
        (0.0, 1.1 * most, 0.0),
        (0.0, np.inf, 0.0),
        (1.5 * most, 0.5 * most, 0.5 * most),
        (-1.5 * most, 0.5 * most, 1.5 * most),
        (-np.inf, 0.5 * most, 1.5 * most),
        (np.nan, 0.5 * most, 0.5 * most),
    ):
        waves = np.array([chosen, other])[:, None, None] * np.ones((2, 1, 4))
        ran = _choosing._Runs(np.ones(2), np.ones(2), np.zeros((2, 1, 4)), waves)
        monkeypatch.setattr(_choosing, "_runs", lambda *_, ran=ran: ran)
        found = elsewhere(setting, LIBRARY, laws, surely(TRUTH), ())
        assert found.apart == pytest.approx(apart)


@pytest.mark.usefixtures("unchecked")
def test_laws_are_refined_to_the_end_with_the_signs_that_are_known(monkeypatch):
    record = hj.Recording(T, np.sin(T), np.cos(T))
    setting: Any = Setting((record,), None, LIBRARY, 2, 2, 0.0)
    setting = setting._replace(signs={"w*|du|": -1.0, "du": 1.0, "u": 1.0})
    asked = []

    def refined(law, group, **options):
        asked.append(options)
        return fit_of(law).solution()

    monkeypatch.setattr(_choosing, "refine", refined)
    _choosing._to_the_end(setting, Trial(TRUTH, starts=(0.0,)))
    assert asked[0]["bounds"] == {"w*|du|": (-np.inf, 0.0), "du": (0.0, np.inf)}
