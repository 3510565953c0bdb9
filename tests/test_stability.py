"""Terms selected from halves of the equations."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.library import Library, Polynomial
from hystjax.regression import STLSQ
from hystjax.regression.differentiation import FiniteDifference
from hystjax.regression.formulation import AbstractFormulation, Pointwise, WeakForm
from hystjax.simulation import FixedStep

KEY = jax.random.key(3)
T = np.linspace(0, 20 * np.pi, 1001)
REC = hj.Recording(T, np.sin(T), np.cos(T))
SHORTER = REC.window(0, 500)


def test_the_terms_that_suit_a_record_are_all_that_need_samples():
    """As in `identify`: of 21 terms 8 suit a record without a clock."""
    rng = np.random.default_rng(0)
    u, w = rng.normal(size=(2, 20))
    found = hj.stability(
        hj.Recording(None, u, w),
        Polynomial(2),
        STLSQ(0.1),
        key=KEY,
        samples=4,
        block=2,
        formulation=Pointwise(FiniteDifference()),
    )
    assert len(found.names) == 8


class Given(AbstractFormulation):
    """Equations that a test has made up, by the length of the recording."""

    rows: dict[int, jax.Array]

    def equations(self, library, path, w):
        rows = self.rows[len(w)]
        return rows[:, :-1], rows[:, -1]


def selected(*tables, **options):
    """From one or two given tables of equations, the targets last."""
    recordings = (REC, SHORTER)[: len(tables)]
    rows = {
        len(r): jnp.asarray(table, float)
        for r, table in zip(recordings, tables, strict=True)
    }
    library = Library(Polynomial(2).terms[: len(tables[0][0]) - 1])
    return hj.stability(
        recordings, library, key=KEY, formulation=Given(rows), **options
    )


def test_two_blocks_by_hand():
    # In either block both columns and the target have the same root mean square:
    # normalised coefficients are (0.6, 0.8) from the one, (1, 0) from the other.
    table = [[1, 0, 0.6], [0, 1, 0.8], [1, 0, 1], [0, 1, 0]]
    found = selected(table, block=2, thresholds=[0.5, 0.7, 0.9])
    np.testing.assert_array_equal(found.probabilities, [[1, 0.5], [0.5, 0.5], [0.5, 0]])
    assert found.largest.tolist() == [1, 0.5]
    assert (found.number, found.candidates) == (1.5, 2)
    assert found.bound(1.0) == pytest.approx(1.5**2 / 2)
    assert found.bound(0.75) == pytest.approx(1.5**2 / (0.5 * 2))
    assert found.terms(0.6) == {"1": 1.0}
    turned = selected(table, block=2, thresholds=[0.9, 0.7, 0.5])
    np.testing.assert_array_equal(turned.probabilities, found.probabilities[::-1])
    assert turned.number == found.number
    later = dataclasses.replace(found, probabilities=jnp.array([[0.7, 0.9]] * 3))
    assert list(later.terms(0.6)) == [found.names[1], found.names[0]]
    with pytest.raises(hj.InputError, match=r"`cutoff` must be above 0\.5.*got 0\.5"):
        found.terms(0.5)
    with pytest.raises(hj.InputError, match=r"`cutoff` .* got 1\.1"):
        found.bound(1.1)


def copies(terms, counts):
    """Equations of one term each: its coefficient is 1."""
    rows = np.eye(len(terms))[list(terms)]
    return np.repeat(np.column_stack([rows, np.ones(len(terms))]), counts, axis=0)


def test_halves_are_complementary():
    # A term is selected from the half that holds its block: from one of each pair.
    found = selected(copies(range(6), 3), block=3, thresholds=[1e-3])
    np.testing.assert_array_equal(found.probabilities, np.full((1, 6), 0.5))
    assert found.number == 3


def test_of_an_odd_number_of_blocks_one_is_in_neither_half():
    found = selected(copies(range(7), 3), block=3, thresholds=[1e-3])
    assert found.number == 3 and float(jnp.sum(found.probabilities)) == 3
    assert 0 < np.ptp(np.asarray(found.probabilities)) < 0.2


def test_blocks_hold_each_equation_once():
    # Blocks of 3 and 4 rows: were one filled up with those of the next, a term would be
    # in two blocks, and in more than one half of a pair. A fourth row is its own term.
    table = copies(range(7), [3, 3, 3, 3, 3, 3, 1])
    found = selected(table[:12], table[12:], block=3, thresholds=[1e-3])
    np.testing.assert_array_equal(found.probabilities, np.full((1, 7), 0.5))
    assert found.number == 3.5


def test_equal_terms_count_once():
    table = np.random.default_rng(0).normal(size=(100, 4))
    table[:, 2] = 2 * table[:, 0] - table[:, 1]
    table[:, 3] = table[:, 0] - table[:, 1]
    found = selected(table, thresholds=[0.1])
    assert found.candidates == 2 and found.number == 2
    assert found.probabilities.tolist() == [[1, 1, 0]]
    # Nor do they share a coefficient, as by a ridge they would.
    table[:, 2] = table[:, 3] = table[:, 0]
    found = selected(table, thresholds=[0.6], regression=STLSQ(ridge=1e-3))
    assert found.candidates == 2 and found.probabilities.tolist() == [[1, 0, 0]]


def test_a_block_is_a_twentieth_of_all_equations():
    with pytest.raises(hj.InputError, match="`block` of 1 makes 39 of 39 equations"):
        selected(copies(range(20), [2] * 19 + [1]))


LAW = {"du": 0.25, "w*|du|": -0.5, "u*|du|": 0.4}


@functools.cache
def multisine():
    frequencies = np.array([3, 7, 11]) / (20 * np.pi)
    excitation = hj.excitation.Multisine(frequencies, 0.7, key=jax.random.key(0))
    u = jax.vmap(excitation)(T)
    law = hj.models.SparseModel.from_terms(LAW)
    run = hj.simulate(law, hj.Recording(T, u, u), w0=0.0, method=FixedStep())
    return hj.Recording(T, u, run.w)


@pytest.mark.parametrize("how", [None, Pointwise(FiniteDifference())])
def test_the_terms_of_a_clean_strong_law_are_certain(how):
    found = hj.stability(
        multisine(), Polynomial(2), key=KEY, samples=20, formulation=how
    )
    assert found.terms(1.0).keys() >= LAW.keys()
    largest = dict(zip(found.names, found.largest.tolist(), strict=True))
    assert max(v for name, v in largest.items() if name not in LAW) < 0.5


CUTOFFS = (0.6, 0.75, 0.9)


@pytest.mark.slow
def test_false_terms_under_noise_stay_below_the_bound():
    # Targets that have nothing to do with any column: whatever is selected is false.
    library = Library(Polynomial(2).terms[:20])

    def false(key):
        given = Given({len(REC): jax.random.normal(key, (200, 21))})
        options = {"thresholds": [0.15, 0.2, 0.3], "samples": 25}
        found = hj.stability(REC, library, key=key, formulation=given, **options)
        counts = [jnp.sum(found.largest >= cutoff) for cutoff in CUTOFFS]
        bounds = [found.bound(cutoff) for cutoff in CUTOFFS]
        return jnp.array(counts), jnp.array(bounds)

    counts, bounds = jax.jit(jax.vmap(false))(jax.random.split(KEY, 100))
    counts, bounds = np.mean(counts, axis=0), np.mean(bounds, axis=0)
    assert np.all(counts < bounds)
    assert counts[0] > 0 and np.all(bounds < 5)


def test_the_same_under_jit_and_from_the_same_key():
    options = {"samples": 10, "formulation": WeakForm(10)}
    record, library = multisine(), Polynomial(2)
    eager = hj.stability(record, library, key=KEY, **options)
    jitted = jax.jit(lambda key: hj.stability(record, library, key=key, **options))
    np.testing.assert_array_equal(jitted(KEY).probabilities, eager.probabilities)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "`samples` must be at least 1"),
        ({"block": 0}, "`block` must be at least 1"),
        ({"block": 1000}, "`block` of 1000 makes 1 of .* fewer equations than .* 21"),
        ({"thresholds": []}, "`thresholds` is empty"),
        ({"thresholds": [0.0, 1.0]}, "`thresholds` must be positive"),
        ({"thresholds": 0.1}, "`thresholds` must be 1-D"),
    ],
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(hj.InputError, match=message):
        hj.stability(REC, Polynomial(2), key=KEY, **options)
