"""The weak form, against quadrature and against closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import hystjax as hj
from hystjax.library import Library, Term
from hystjax.regression.formulation import Pointwise, WeakForm
from hystjax.simulation import FixedStep

T = np.linspace(0, 6, 1201)
LIBRARY = Library(tuple(map(Term.parse, ("1", "w", "u*|du|"))))


def exact(t):
    return hj.interpolation.Exact(jnp.sin).path(jnp.asarray(t), jnp.sin(t))


def test_equations_are_integrals_against_test_functions():
    m = 200
    rows, right = WeakForm(m).equations(LIBRARY, exact(T), jnp.cos(T))
    starts = np.arange(0, len(T) - 2 * m, m // 16)
    assert rows.shape == (len(starts), 3)
    for k in (0, 17, len(starts) - 1):
        first, last = T[starts[k]], T[starts[k] + 2 * m]
        reach, centre = (last - first) / 2, (last + first) / 2

        def phi(t, centre=centre, reach=reach):
            return (1 - ((t - centre) / reach) ** 2) ** 4

        def slope(t, centre=centre, reach=reach):
            x = (t - centre) / reach
            return -8 * x * (1 - x**2) ** 3 / reach

        def term(t):
            return np.sin(t) * abs(np.cos(t))

        turns = [x for x in (np.pi / 2, 3 * np.pi / 2) if first < x < last] or None
        expected = [
            quad(phi, first, last)[0],
            quad(lambda t, phi=phi: phi(t) * np.cos(t), first, last)[0],
            quad(lambda t, phi=phi: phi(t) * term(t), first, last, points=turns)[0],
        ]
        np.testing.assert_allclose(rows[k], expected, rtol=0, atol=2e-5)
        left = -quad(lambda t, slope=slope: slope(t) * np.cos(t), first, last)[0]
        assert float(right[k]) == pytest.approx(left, abs=2e-5)


@pytest.mark.parametrize("uneven", [False, True])
def test_turning_points_at_samples_cost_no_accuracy(uneven):
    # w = 2 u + t over straight lines: w' = 1 + 2 u' in every interval.
    t = np.arange(200.0)
    t = t + 0.3 * np.random.default_rng(0).uniform(-1, 1, 200) if uneven else t
    u = np.abs(t % 40 - 20)
    path = hj.interpolation.Linear().path(jnp.asarray(t), jnp.asarray(u))
    library = Library(tuple(map(Term.parse, ("1", "du"))))
    rows, right = WeakForm(15).equations(library, path, jnp.asarray(2 * u + t))
    # The test functions are curves over an interval, which the middle stands for.
    solution = np.linalg.lstsq(rows, right)[0]
    np.testing.assert_allclose(solution, [1.0, 2.0], rtol=5e-3)


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_uneven_times_and_an_output_far_from_zero_cost_no_accuracy(offset):
    """A constant times phi' integrates to nothing on any grid."""
    t, rng = np.linspace(0, 20 * np.pi, 1000), np.random.default_rng(0)
    t[1:-1] += 0.3 * (t[1] - t[0]) * rng.uniform(-1, 1, 998)
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    record = hj.generate(law, hj.excitation.Sine(1.0, 0.5 / np.pi), t)
    moved = hj.Recording(t, record.u, record.w + offset)
    found = hj.identify(
        moved,
        hj.library.Duhem(),
        hj.regression.LeastSquares(),
        formulation=WeakForm(20),
    )
    terms = found.value.terms()
    # w' = 0.25 u' + 0.4 u |u'| - 0.5 (w - offset) |u'|, and what the rule leaves.
    assert terms["du"] == pytest.approx(0.25, rel=2e-3)
    assert terms["u*|du|"] == pytest.approx(0.4, rel=2e-3)
    assert terms["w*|du|"] == pytest.approx(-0.5, rel=2e-3)
    assert terms["|du|"] == pytest.approx(0.5 * offset, rel=2e-3, abs=1e-3)
    assert found.stats["residual"] < 1e-3


@pytest.mark.parametrize("m", [5, 40, 48])
def test_as_many_equations_are_made_as_are_counted(m):
    for n in (100, 117, 200):
        form = WeakForm(m)
        rows, right = eqx.filter_eval_shape(
            lambda path, w, form=form: form.equations(LIBRARY, path, w),
            exact(T[:n]),
            jnp.cos(T[:n]),
        )
        assert len(rows) == len(right) == form.count(n)
        assert len(form.weights(jnp.ones(n))) == len(rows)


def test_equations_are_counted_before_they_are_solved():
    record = hj.Recording(
        T[:100], np.sin(T[:100]), np.random.default_rng(0).normal(size=100)
    )
    with pytest.raises(hj.InputError, match=r"makes 2 equations .* for 21 terms"):
        hj.identify(record, formulation=WeakForm(48))


def test_noise_spoils_it_less_than_differences():
    truth = hj.models.Duhem(0.4, 0.5, 0.25)
    sine = hj.excitation.Sine(1.0, 1 / (2 * np.pi))
    t = np.linspace(0, 20 * np.pi, 1000)
    expected = np.array([0.25, 0.4, -0.5])

    def error(how, key):
        how_made = {"additive": 0.1, "key": key, "method": FixedStep(4)}
        record = hj.generate(truth, sine, t, **how_made)
        library = Library(tuple(map(Term.parse, ("du", "u*|du|", "w*|du|"))))
        least_squares = hj.regression.LeastSquares()
        law = hj.identify(record, library, least_squares, formulation=how).value
        return np.linalg.norm(law.coefficients - expected)

    keys = jax.random.split(jax.random.key(0), 5)
    weak = [error(WeakForm(20), key) for key in keys]
    differences = Pointwise(hj.differentiation.FiniteDifference())
    pointwise = [error(differences, key) for key in keys]
    assert np.median(weak) < 0.5 * np.median(pointwise)


def test_a_differentiation_stands_for_its_pointwise_equations():
    record = hj.Recording(T, np.sin(T), np.cos(T))
    smooth = hj.differentiation.SavitzkyGolay(11)
    named, alone, weak = (
        hj.identify(record, LIBRARY, **how).value.coefficients
        for how in (
            {"formulation": Pointwise(smooth)},
            {"differentiation": smooth},
            {"formulation": WeakForm(5), "differentiation": smooth},
        )
    )
    np.testing.assert_array_equal(alone, named)
    plain = hj.identify(record, LIBRARY, formulation=WeakForm(5)).value.coefficients
    np.testing.assert_array_equal(weak, plain)


def test_wrong_widths_are_told():
    with pytest.raises(hj.InputError, match=r"`half_width` must be at least 2.*got 1"):
        WeakForm(1)
    with pytest.raises(
        hj.InputError, match=r"41 samples, got 30.*smaller `half_width`"
    ):
        WeakForm(20).equations(LIBRARY, exact(T[:30]), jnp.cos(T[:30]))
