"""What a record leaves open elsewhere: laws that follow as well, and how far they go
apart under inputs beyond the recorded ones."""

import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.discovery._choosing import _under_other_names, apart, from_the_others, told
from hystjax.discovery._layout import _waves, layout, multisines
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


def noisy(excitation):
    clean = hj.generate(SparseModel.from_terms(TRUTH), excitation, T, method=STEPS)
    noise = 0.02 * np.std(clean.w) * np.random.default_rng(1).normal(size=len(T))
    return hj.Recording(T, clean.u, clean.w + noise)


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

    def distance(t, u, between):
        there = hj.Recording(t, u, record.w, interpolation=between)
        mine, its = (
            hj.simulate(SparseModel.from_terms(each), there, w0=start, method=STEPS).w
            for each in (law, other)
        )
        return float(jnp.sqrt(jnp.mean((mine - its) ** 2)) / jnp.ptp(record.w))

    lines, cubic = hj.interpolation.Linear(), hj.interpolation.Cubic()
    changed = ((T / f, a * record.u) for a, f in ((1.5, 1), (1, 3), (1, 0.5)))
    expected = max(distance(*each, lines) for each in changed)
    assert expected > 0.1
    waves = multisines_of_a_triangle(1.5, 0.4)
    expected = max(expected, *(distance(T, wave, cubic) for wave in waves))
    assert solution.stats["apart"] == pytest.approx(expected, rel=1e-3)


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
    found = apart(setting, ALL, [law], hj.aliases(clean, ALL))
    assert found > 0.05


def test_the_law_is_marked(found):
    record, solution = found
    share = solution.stats["apart"]
    assert (
        f"by up to {100 * share:.2g} % of the output's range" in solution.stats["why"]
    )
    assert float(solution.value.fitted_range.apart) == pytest.approx(share)
    faster = hj.Recording(record.t / 3, record.u, record.w)
    with pytest.warns(UserWarning, match=f"differ by some {100 * share:.2g} %"):
        hj.simulate(solution.value, faster)


def test_an_excitation_that_tells_all_terms_leaves_nothing_open():
    record = noisy(hj.excitation.DecayingSine(1.0, 0.2, 20.0))
    solution = hj.discover(record, LIBRARY)
    assert set(solution.value.terms()) == set(TRUTH)
    assert solution.stats["apart"] < 0.01
    assert "follow as well" not in solution.stats["why"]


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
    laws = [Trial(x, criterion=0.0, starts=(0.0,)) for x in (TRUTH, other)]
    found = apart(setting._replace(reach=reach), LIBRARY, laws, ())
    assert (found > 0.1) if counts else (found == 0)


def judged(terms, *blocks):
    """A law as it is after blocks have judged it."""
    return Trial(terms, starts=(0.0,), blocks=blocks or (1.0, 1.0))


def beyond(*laws, guard=True):
    record = noisy(hj.excitation.Triangle(1.0, 0.1, 4))
    setting = Setting((record,), layout((record,), None, 2, guard), LIBRARY, 2, 2, 0.0)
    return record, from_the_others(setting, LIBRARY, laws), told(setting, laws)


def test_laws_go_as_far_from_the_others_as_their_free_runs_do():
    laws = [TRUTH, {"du": 0.5, "w": -0.48}, {"du": 0.6, "w*|du|": -1.2}]
    record, found, by_runs = beyond(*map(judged, laws))
    span = jnp.ptp(record.w)

    def outputs(terms):
        law = SparseModel.from_terms(terms)
        for larger, faster in ((1.5, 1), (1, 3), (1, 0.5)):
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
