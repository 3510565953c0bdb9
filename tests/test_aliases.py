import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax import least_squares
from hystjax.least_squares import LeastSquaresProblem
from hystjax.library import Polynomial
from hystjax.signals.excitation import DecayingSine, Sine
from hystjax.simulation import FixedStep

LAW = hj.models.Duhem(0.4, 0.5, 0.25)
STEP = 0.01
T = np.arange(3001) * STEP
FREQUENCY = 0.35  # Hz


def found(excitation, library=None, law=LAW, **options):
    record = hj.generate(law, excitation, T, method=FixedStep(4))
    library = Polynomial(2) if library is None else library
    return {a.term: a for a in hj.aliases(record, library, **options)}


def test_one_sine_hides_squares_of_its_derivative():
    amplitude, omega = 1.5, 2 * np.pi * FREQUENCY
    aliases = found(Sine(amplitude, FREQUENCY))
    assert {"|w|^2", "|du|^2", "du^2"} <= aliases.keys()
    assert aliases["|w|^2"].combination == pytest.approx({"w^2": 1.0})
    assert aliases["|du|^2"].combination == pytest.approx({"du^2": 1.0})
    # (u'/omega)^2 = amplitude^2 - u^2, with the omega that a central difference sees.
    seen = (np.sin(omega * STEP) / STEP) ** 2
    expected = {"1": seen * amplitude**2, "u^2": -seen}
    assert aliases["du^2"].combination == pytest.approx(expected, rel=1e-4)
    assert all(alias.share < 0.01 for alias in aliases.values())


def test_decaying_sine_tells_them_apart():
    aliases = found(DecayingSine(1.5, FREQUENCY, 10.0))
    assert "du^2" not in aliases
    assert {"|w|^2", "|du|^2"} <= aliases.keys()  # equal under every excitation


def test_tolerance_is_the_share_that_must_be_new():
    library = Polynomial(1, ("u", "du")) + hj.library.Custom(
        {"nearly": lambda w, u, du: u + 0.1 * du / (2 * np.pi * FREQUENCY)}
    )
    # Sine and cosine are orthogonal: a tenth of the sum is new beside u alone.
    near = hj.library.Library((library.terms[1], library.terms[3]))
    (alias,) = found(Sine(1.0, FREQUENCY), near, tolerance=0.2).values()
    assert alias.term == "nearly"
    assert alias.combination == pytest.approx({"u": 1.0}, abs=0.02)
    assert alias.share == pytest.approx(0.1 / np.hypot(1, 0.1), rel=0.05)
    assert not found(Sine(1.0, FREQUENCY), near, tolerance=0.05)


def test_term_that_vanishes_has_no_rival():
    library = Polynomial(1, ("u",)) + hj.library.Custom(
        {"clipped": lambda w, u, du: jnp.maximum(u - 9, 0)}
    )
    (alias,) = found(Sine(1.0, FREQUENCY), library).values()
    assert (alias.term, alias.share, alias.combination) == ("clipped", 0.0, {})
    assert "nothing (it is zero here)" in str(alias)


def test_a_term_that_is_nearly_another_explains_nothing_itself():
    """All that is new in the second column would make up the third."""
    triangle = jnp.array([[2.0, 1.0, 0.0], [0.0, 0.005, 3.0], [0.0, 0.0, 0.0]])
    problem = LeastSquaresProblem(triangle, jnp.zeros(3), jnp.zeros(()), 3)
    (alias,) = least_squares.aliases(problem, ("a", "near", "b"))
    assert (alias.term, alias.combination) == ("near", pytest.approx({"a": 0.5}))
    assert alias.share == pytest.approx(0.005 / np.hypot(1, 0.005))


@pytest.mark.parametrize(
    ("combination", "words"),
    [
        ({"w^2": 1.0}, "x cannot be told from w^2 (0.3 % of it is new)"),
        ({"1": 2.0, "u^2": -1.0}, "x cannot be told from a mix of 1 and u^2 ("),
        ({"1": 2.0, "u": 1, "w": 1.0}, "x cannot be told from a mix of 1, u and w ("),
    ],
)
def test_words(combination, words):
    assert str(hj.Alias("x", 0.003, combination)).startswith(words)


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_units_are_no_matter(scale):
    """Squares of an input in nanometres are small beside all that is in volts."""
    record = hj.generate(LAW, Sine(1.5, FREQUENCY), T, method=FixedStep(4))
    scaled = hj.Recording(record.t, scale * record.u, record.w)
    one, other = (
        {a.term: a.combination for a in hj.aliases(each, Polynomial(2))}
        for each in (record, scaled)
    )
    assert list(one) == list(other)
    assert one["du^2"].keys() == other["du^2"].keys() == {"u^2", "1"}
    assert other["du^2"]["u^2"] == pytest.approx(one["du^2"]["u^2"])
    assert other["du^2"]["1"] == pytest.approx(scale**2 * one["du^2"]["1"])


def test_several_recordings_together_tell_more_apart():
    records = [
        hj.generate(LAW, Sine(a, FREQUENCY), T, method=FixedStep(4)) for a in (0.7, 1.5)
    ]
    library = Polynomial(2, ("u", "du"))
    names = [{a.term for a in hj.aliases(r, library)} for r in (records[0], records)]
    assert names == [{"du^2"}, set()]
