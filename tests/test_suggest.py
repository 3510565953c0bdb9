"""Which inputs would tell apart what one sine cannot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.library import Library, Polynomial, Term
from hystjax.models import FittedRange, SparseModel

T = np.linspace(0, 20, 2000)
LAW = hj.models.Duhem(0.4, 0.5, 0.25)


def recording(u):
    record = hj.Recording(T, u, np.zeros_like(T))
    return hj.Recording(T, u, hj.simulate(LAW, record, w0=0.0).w)


@pytest.fixture(scope="module")
def sine():
    return recording(75 + 75 * np.sin(2 * np.pi * T))


def test_one_sine_makes_squares_equal_and_others_do_not(sine):
    library = Polynomial(2, ("u", "du"))
    found = hj.suggest_excitation(LAW, sine, library)
    assert len(found) == 3
    assert all(each.resolved == ("du^2",) for each in found)
    for each in found:
        u = np.asarray(each.u)
        assert u.min() >= 0 and u.max() <= 150
        # By NumPy: the share of u'^2 that is no mix of the terms before it.
        du = np.gradient(u, T)
        columns = np.column_stack([np.ones_like(u), u, du, u**2, u * du])
        left = du**2 - columns @ np.linalg.lstsq(columns, du**2)[0]
        assert np.linalg.norm(left) > 0.05 * np.linalg.norm(du**2)


def test_what_resolves_most_comes_first(sine):
    found = hj.suggest_excitation(LAW, sine, Polynomial(4, ("u", "du")))
    sizes = [len(each.resolved) for each in found]
    assert len(set(sizes)) > 1 and sizes == sorted(sizes, reverse=True)


def test_terms_are_those_of_degree_two_where_none_are_given(sine):
    named = [each.resolved for each in hj.suggest_excitation(LAW, sine)]
    given = hj.suggest_excitation(LAW, sine, Polynomial(2))
    assert named == [each.resolved for each in given] and named


def test_noise_on_the_input_makes_its_main_frequency_no_other():
    rng = np.random.default_rng(3)
    u = np.sin(2 * np.pi * T / 5) + 0.01 * rng.normal(size=len(T))
    found = hj.suggest_excitation(
        LAW, recording(u), hj.library.Play([0.1, 0.2, 0.3]), tolerance=0.2
    )
    sines = [each for each in found if each.excitation.startswith("a sine")]
    assert sines
    for each in sines:
        power = np.abs(np.fft.rfft(each.u - np.mean(each.u)))
        assert np.argmax(power) == 4  # periods in the 20 s


def test_what_is_always_equal_is_never_promised(sine):
    library = Library(tuple(map(Term.parse, ("du^2", "|du|^2", "w^2", "|w|^2"))))
    assert hj.suggest_excitation(LAW, sine, library) == ()


def test_a_record_that_tells_everything_needs_no_other():
    rng = np.random.default_rng(2)
    slow = np.cumsum(rng.normal(size=2000))
    library = Polynomial(2, ("u", "du"))
    assert hj.suggest_excitation(LAW, recording(slow), library) == ()


@pytest.mark.slow
def test_laws_that_diverge_suggest_nothing(sine):
    wild = SparseModel.from_terms({"w": 1e4, "1": 1.0})
    assert hj.suggest_excitation(wild, sine, Polynomial(2)) == ()


@pytest.mark.slow
def test_laws_that_lose_the_recording_promise_nothing_by_others():
    """w' = 10 (w^2 - w + u) runs away above u = 0.25, unless that is soon over: under a
    sine of 0.3 always, and under one that decays from there never."""
    law = SparseModel.from_terms({"w^2": 10.0, "w": -10.0, "u": 10.0})
    u = 0.3 * np.sin(0.2 * np.pi * T)
    record = hj.Recording(T, u, u)
    assert hj.suggest_excitation(law, record, Polynomial(2, ("u", "du"))) == ()


def test_a_law_that_settles_within_a_sample_suggests_as_its_limit_does(sine):
    """Of w' = (u - w) / tau, w is u for a short tau: what tells squares of the input
    apart tells those of the output."""
    law = SparseModel.from_terms({"w": -1e3, "u": 1e3})
    library = Library(tuple(map(Term.parse, ("1", "w", "du", "w^2", "w*du", "du^2"))))
    settled = hj.Recording(T, sine.u, sine.u)
    found = hj.suggest_excitation(law, settled, library)
    assert [each.resolved for each in found] == [("du^2",)] * 3


def test_inputs_to_try_may_go_faster_than_the_recorded_one(sine, recwarn):
    law = SparseModel.from_terms({"w": -1.0, "u": 0.01})  # depends on the rate
    law = law.fitted_on(FittedRange.of([sine]))
    assert len(hj.suggest_excitation(law, sine, Polynomial(2, ("u", "du")))) == 3
    assert not recwarn.list


def test_a_law_of_the_rate_needs_the_times(sine):
    settles = SparseModel.from_terms({"u": 1.0, "w": -1.0})
    untimed = hj.Recording(None, sine.u, sine.w)
    with pytest.raises(hj.InputError, match=r"no clock .* this SparseModel depends"):
        hj.suggest_excitation(settles, untimed, Polynomial(2, ("u", "du")))


def test_a_constant_input_is_refused(sine, unchecked):
    still = sine.with_input(jnp.ones_like(sine.u))
    with pytest.raises(hj.InputError, match="without change there is no hysteresis"):
        hj.suggest_excitation(LAW, still, Polynomial(2))


@pytest.mark.usefixtures("unchecked")
def test_a_law_is_called_by_its_name(sine):
    with pytest.raises(hj.InputError, match="`law` must be a model"):
        hj.suggest_excitation(sine, sine, Polynomial(2))
    with pytest.raises(hj.InputError, match="`law` must be a model"):
        hj.complete(sine, sine, key=jax.random.key(0))


def test_without_a_clock_no_term_of_the_rate_is_resolved():
    phase = np.linspace(0, 20, 500)
    law = SparseModel.from_terms({"u*|du|": 1.0, "w*|du|": -1.0, "du": 0.3})
    bare = hj.Recording(None, np.sin(phase), 0 * phase)
    record = hj.Recording(None, bare.u, hj.simulate(law, bare, w0=0.0).w)
    resolved = {x for each in hj.suggest_excitation(law, record) for x in each.resolved}
    assert not resolved & {"du^2", "|du|^2", "1", "w", "u"}
    with pytest.raises(hj.InputError, match="no clock, and every term"):
        hj.suggest_excitation(law, record, Polynomial(2, ("u", "w")))
