import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given

from hystjax import InputError
from hystjax.signals.excitation import (
    Chirp,
    DecayingSine,
    FirstOrderReversalCurves,
    GrowingSine,
    ModulatedSine,
    Multisine,
    Sine,
    Triangle,
)

KEY = jax.random.key(3)
TIMES = np.linspace(0, 2, 1001)

# name: excitation, the same by NumPy or SciPy, its derivative by hand
CLOSED_FORMS = {
    "sine": (
        Sine(2.0, 1.5, phase=0.3, offset=-1.0),
        lambda t: 2 * np.sin(3 * np.pi * t + 0.3) - 1,
        lambda t: 6 * np.pi * np.cos(3 * np.pi * t + 0.3),
    ),
    "growing": (
        GrowingSine(2.0, 1 / (2 * np.pi), phase=0.3),
        lambda t: 2 * t * np.sin(t + 0.3),
        lambda t: 2 * np.sin(t + 0.3) + 2 * t * np.cos(t + 0.3),
    ),
    "decaying": (
        DecayingSine(3.0, 2.0, time_constant=0.5, phase=0.4),
        lambda t: 3 * np.exp(-2 * t) * np.sin(4 * np.pi * t + 0.4),
        lambda t: (
            12 * np.pi * np.exp(-2 * t) * np.cos(4 * np.pi * t + 0.4)
            - 6 * np.exp(-2 * t) * np.sin(4 * np.pi * t + 0.4)
        ),
    ),
    "modulated": (
        ModulatedSine(2.0, 5.0, depth=0.5, modulation_frequency=0.5),
        lambda t: 2 * (1 + 0.5 * np.sin(np.pi * t)) * np.sin(10 * np.pi * t),
        lambda t: (
            np.pi * np.cos(np.pi * t) * np.sin(10 * np.pi * t)
            + 20 * np.pi * (1 + 0.5 * np.sin(np.pi * t)) * np.cos(10 * np.pi * t)
        ),
    ),
    "chirp": (
        Chirp(1.5, 1.0, 6.0, duration=2.0, phase=np.pi / 6),
        lambda t: 1.5 * scipy.signal.chirp(t, 1, 2, 6, phi=-60),
        lambda t: (
            3
            * np.pi
            * (1 + 2.5 * t)
            * np.cos(2 * np.pi * (t + 1.25 * t**2) + np.pi / 6)
        ),
    ),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_smooth_excitations_and_their_paths_follow_the_closed_form(name):
    excitation, value, slope = CLOSED_FORMS[name]
    np.testing.assert_allclose(jax.vmap(excitation)(TIMES), value(TIMES), atol=1e-12)
    u, du = excitation.path(TIMES).samples()
    np.testing.assert_allclose(u, value(TIMES), atol=1e-12)
    np.testing.assert_allclose(du, slope(TIMES), atol=1e-10)
    between = TIMES[:-1] + 0.3 * np.diff(TIMES)
    u, du = excitation.path(TIMES).at(jnp.asarray(between))
    np.testing.assert_allclose(u, value(between), atol=1e-12)
    np.testing.assert_allclose(du, slope(between), atol=1e-10)


def test_variation_of_a_sine_is_four_amplitudes_a_period():
    variation = Sine(2.5, 3.0, phase=0.2).path(TIMES).variation()
    np.testing.assert_allclose(variation[-1], 4 * 2.5 * 3.0 * 2.0, rtol=1e-10)


@given(
    lines=st.sets(st.integers(1, 40), min_size=1, max_size=12),
    rms=st.floats(0.1, 100),
    seed=st.integers(0, 2**31),
)
def test_multisine_has_its_rms_and_a_flat_spectrum_on_its_lines_only(lines, rms, seed):
    fundamental, n = 0.5, 128
    lines = np.sort(list(lines))
    multisine = Multisine(fundamental * lines, rms, key=jax.random.key(seed))
    u = np.asarray(jax.vmap(multisine)(np.arange(n) / (n * fundamental)))
    np.testing.assert_allclose(np.sqrt(np.mean(u**2)), rms, rtol=1e-10)
    spectrum = 2 / n * np.abs(np.fft.rfft(u))
    expected = np.zeros(n // 2 + 1)
    expected[lines] = rms * np.sqrt(2 / len(lines))
    np.testing.assert_allclose(spectrum, expected, atol=1e-10 * rms)


def test_multisine_phases_fill_the_circle_and_depend_on_the_key():
    frequencies = np.arange(1, 4001)
    phases = Multisine(frequencies, 1.0, key=KEY).phases
    counts, _ = np.histogram(phases, bins=8, range=(0, 2 * np.pi))
    assert counts.sum() == 4000
    assert scipy.stats.chisquare(counts).pvalue > 1e-3
    other = Multisine(frequencies, 1.0, key=jax.random.key(4)).phases
    assert np.max(np.abs(phases - other)) > 1


def test_crest_factor_of_many_random_phases_is_that_of_noise():
    multisine = Multisine(np.arange(1, 513), 1.0, key=KEY)
    u = np.asarray(jax.vmap(multisine)(np.arange(4096) / 4096))
    assert 2.5 < np.max(np.abs(u)) < 5  # sqrt(2 * 512) = 32 were the phases equal


def test_triangle_is_scipys():
    triangle = Triangle(2.0, 0.5, periods=3, offset=1.0)
    t = np.linspace(0, 6, 601)
    expected = 1 + 2 * scipy.signal.sawtooth(2 * np.pi * (0.5 * t + 0.25), width=0.5)
    np.testing.assert_allclose(jax.vmap(triangle)(t), expected, atol=1e-12)
    corners = [0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6]
    np.testing.assert_allclose(triangle.corners()[0], corners)
    assert float(jax.grad(triangle)(1.0)) == pytest.approx(-4)
    assert float(triangle(9.0)) == 1.0  # at rest when over


def test_reversal_curves_turn_at_their_reversal_points():
    curves = FirstOrderReversalCurves(10.0, [4.0, -2.0, -10.0], rate=2.0)
    t, u = curves.corners()
    np.testing.assert_allclose(u, [10, 4, 10, -2, 10, -10, 10])
    np.testing.assert_allclose(t, [0, 3, 6, 12, 18, 28, 38])
    path = curves.path(np.arange(0, 38.25, 0.25))
    turned_at, turned = path.turning_points()
    np.testing.assert_allclose(turned_at, t[1:-1])
    np.testing.assert_allclose(turned, u[1:-1])
    np.testing.assert_allclose(np.abs(path.samples()[1][:-1]), 2.0)
    np.testing.assert_allclose(path.variation()[-1], 2 * (6 + 12 + 20))


@pytest.mark.parametrize("steps", [1, 3, 10])
def test_samples_hold_every_corner_and_make_an_exact_path(steps):
    curves = FirstOrderReversalCurves(1.0, [0.3, -0.7, -1 / 3], rate=0.7)
    t = curves.samples(steps)
    corner_times, corner_values = curves.corners()
    assert t.shape == (6 * steps + 1,)
    np.testing.assert_array_equal(t[::steps], corner_times)
    fine = np.linspace(0, float(t[-1]), 501)
    u, _ = curves.path(t).at(jnp.asarray(fine))
    expected = np.interp(fine, corner_times, corner_values)
    np.testing.assert_allclose(u, expected, atol=1e-12)


def test_a_modulated_amplitude_may_go_to_zero():
    t, deep = 1.53, ModulatedSine(2.0, 5.0, 1.0, modulation_frequency=0.5, phase=0.7)
    expected = 2 * (1 + np.sin(np.pi * t)) * np.sin(10 * np.pi * t + 0.7)
    np.testing.assert_allclose(deep(t), expected, atol=1e-12)


def test_corner_between_samples_is_refused():
    triangle = Triangle(1.0, 1.0, periods=2)
    triangle.path(np.linspace(0, 2, 9))
    triangle.path(np.arange(201) * 0.01)  # 0.25 is the 25th but for rounding
    triangle.path(np.linspace(0.3, 0.7, 7))  # no corner in there
    with jax.enable_x64(False):  # late times are rounded by more than early ones
        Triangle(1.0, 10.0, periods=100).path(np.arange(4001) * 0.0025)
    with pytest.raises(InputError, match=r"4 corner.*first at 0\.25 s.*samples\("):
        triangle.path(np.linspace(0, 2, 8))


def test_excitations_work_under_jit_grad_and_vmap():
    def mean_square(amplitude):
        return jnp.mean(jax.vmap(Sine(amplitude, 1.0))(TIMES[:-1]) ** 2)

    np.testing.assert_allclose(jax.jit(mean_square)(3.0), 4.5, rtol=1e-12)
    np.testing.assert_allclose(jax.grad(mean_square)(3.0), 3.0, rtol=1e-12)
    np.testing.assert_allclose(
        jax.vmap(mean_square)(jnp.array([1.0, 2.0])), [0.5, 2.0], rtol=1e-12
    )

    def end(rate):
        curves = FirstOrderReversalCurves(1.0, jnp.array([-1.0]), rate)
        return curves.path(curves.samples(4)).variation()[-1]

    np.testing.assert_allclose(jax.jit(end)(2.0), 4.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sine(np.nan, 1.0), "`amplitude` must be finite"),
        (lambda: Sine("big", 1.0), "`amplitude` must be one real number, got 'big'"),
        (lambda: Sine([1.0, 2.0], 1.0), "`amplitude` must be one real number"),
        (lambda: Sine(1.0, 0.0), "`frequency` must be positive"),
        (lambda: Sine(1.0, 1.0, phase=np.inf), "`phase` must be finite"),
        (lambda: GrowingSine(1.0, -1.0), "`frequency` must be positive"),
        (lambda: DecayingSine(1.0, 1.0, 0.0), "`time_constant` must be positive"),
        (lambda: ModulatedSine(1.0, 1.0, 50.0, 0.1), "`depth` .* not a percentage"),
        (lambda: ModulatedSine(1.0, 1.0, -0.1, 0.1), "`depth` must be zero or more"),
        (lambda: Chirp(1.0, -1.0, 2.0, 1.0), "`start` must be zero or more"),
        (lambda: Chirp(1.0, 1.0, 2.0, 0.0), "`duration` must be positive"),
        (lambda: Multisine([], 1.0, key=KEY), "at least 1 samples, got 0"),
        (lambda: Multisine([1.0, 0.0], 1.0, key=KEY), "`frequencies` must be positive"),
        (lambda: Multisine([1.0, 2.0, 1.0], 1.0, key=KEY), "distinct, but 1 Hz"),
        (lambda: Multisine([1.0], -1.0, key=KEY), "`rms` must be positive"),
        (lambda: Triangle(1.0, 1.0, 0), "`periods` must be at least 1"),
        (lambda: Triangle(1.0, 1.0, 1.5), "`periods` must be a whole number"),
        (lambda: Triangle(1.0, 1.0, 1).samples(0), "`n_per_segment` must be at least"),
        (lambda: FirstOrderReversalCurves(1.0, [], 1.0), "at least 1 samples"),
        (lambda: FirstOrderReversalCurves(1.0, [0.0, 1.0], 1.0), "must lie below"),
        (lambda: FirstOrderReversalCurves(1.0, [0.0], 0.0), "`rate` must be positive"),
        (lambda: Sine(1.0, 1.0).path(np.array([0.0, 1.0, 0.5])), "`t` must increase"),
        (lambda: Sine(1.0, 1.0).path(np.array([0.0])), "at least 2 samples"),
    ],
)
def test_bad_arguments_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()
