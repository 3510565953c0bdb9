"""Turning points, cycles and their numbers, against closed forms and counts by hand."""

import dataclasses
import itertools
import re
import warnings
from pathlib import Path

import jax
import numpy as np
import pytest
import scipy.interpolate
import scipy.optimize
import scipy.stats
from classical_equations import play

import hystjax as hj
from hystjax import InputError
from hystjax.loops._corrections import Units
from hystjax.loops._cycle import Column, crossings
from hystjax.loops._reversals import half_cycles
from hystjax.loops._summary import _energies, compared
from hystjax.recording._as_measured import (
    half_window,
    noise,
    noise_beside_corners,
    quantum,
)
from hystjax.recording._notation import differ, is_unit, to_si

loops = hj.loops


def triangle(s):
    """From 1 at 0 to -1 at half a period and back."""
    s = np.mod(s, 1.0)
    return np.where(s < 0.5, 1 - 4 * s, 4 * s - 3)


LEVELS = np.array([-0.5, 0, 0.5])  # of the amplitude, where widths are taken
NOUGHT = (
    *("u_bias", "w_bias", "asymmetry", "drift", "pinching"),
    *("strength_degradation", "stiffness_degradation"),
)


def ellipse(s):
    u, w = 2 * np.cos(2 * np.pi * s), 3 * np.cos(2 * np.pi * s - 0.3)
    return (
        u,
        w,
        {
            "energy": -6 * np.pi * np.sin(0.3),
            "amplitude": 2,
            "saturation": 3 * np.cos(0.3),
            "secant_stiffness": 1.5 * np.cos(0.3),
            "peak_stiffness": 1.5,
            "remanence": 3 * np.sin(0.3),
            "coercivity": 2 * np.sin(0.3),
            "squareness": np.tan(0.3),
            "damping": np.tan(0.3) / 2,
            "lag": 0.3,
            "period": 1,
            "width": 4 * np.sin(0.3) * np.sqrt(1 - (np.cos(0.3) * LEVELS) ** 2),
            "cumulative_energy": -6 * np.pi * np.sin(0.3) * np.arange(1, 5),
            **dict.fromkeys(NOUGHT, 0),
        },
    )


def stop(s):
    """An elastic, then plastic spring of stiffness 1 and strength 0.3 under a triangle:
    a parallelogram."""
    u, r = triangle(s), 0.3
    falling = np.mod(s + 1e-12, 1.0) < 0.5
    w = np.where(falling, np.maximum(r - 1 + u, -r), np.minimum(1 + u - r, r))
    return (
        u,
        w,
        {
            "energy": 4 * r * (1 - r),
            "amplitude": 1,
            "saturation": r,
            "secant_stiffness": r,
            "tangent_stiffness": 1,
            "peak_stiffness": r,
            "damping": 2 * (1 - r) / np.pi,
            "coercivity": -(1 - r),
            "pinching": 0,
        },
    )


def bouc_wen(s):
    """z' = u' - |u'| z / z0 where z grows, z' = u' where it shrinks: the model with
    n = 1 and beta = gamma, settled under a triangle."""
    u, limit = triangle(s), 0.4

    def grown(way):
        return limit * -np.expm1(-way / limit)

    tip = scipy.optimize.brentq(lambda z: z - grown(2 - z), 0, limit, xtol=1e-15)
    falling = np.mod(s + 1e-12, 1.0) < 0.5
    sign = np.where(falling, 1, -1)
    way = 1 - sign * u  # since the last tip
    z = sign * np.where(way < tip, tip - way, -grown(np.maximum(way - tip, 0)))
    return (
        u,
        z,
        {
            "energy": 2 * (limit * (2 - tip) - limit * tip - tip**2 / 2),
            "saturation": tip,
            "tangent_stiffness": 1,
            "remanence": -grown(1 - tip),
            "squareness": -grown(1 - tip) / tip,
            # Coercivity, 1 - tip, is where the curvature jumps: 1.2e-6 off.
        },
    )


def rayleigh(s):
    """M = (chi + nu Hm) H ± nu (Hm² - H²) / 2."""
    u, chi, nu = triangle(s), 1.0, 0.5
    falling = np.mod(s + 1e-12, 1.0) < 0.5
    w = (chi + nu) * u + np.where(falling, 1, -1) * nu / 2 * (1 - u**2)
    return (
        u,
        w,
        {
            "energy": -4 / 3 * nu,
            "saturation": chi + nu,
            "remanence": nu / 2,
            "coercivity": (np.sqrt((chi + nu) ** 2 + nu**2) - chi - nu) / nu,
            "asymmetry": 0,
            "drift": 0,
        },
    )


@pytest.mark.parametrize("loop", [ellipse, stop, bouc_wen, rayleigh])
@pytest.mark.parametrize(("samples", "tolerance"), [(1000, 1e-6), (50, 1e-3)])
def test_numbers_are_those_of_closed_forms(loop, samples, tolerance):
    s = np.arange(4 * samples + 1) / samples
    u, w, truth = loop(s)
    found = loops.summary(hj.Recording(s, u, w))
    assert len(found.cycle) == 4
    for name, value in truth.items():
        value = np.reshape(value, (-1, *found[name].shape[1:]))
        apart = np.max(np.abs(found[name].values - value))
        assert apart <= tolerance * (np.max(np.abs(value)) or 1), (name, apart)


@pytest.mark.parametrize(("samples", "tolerance"), [(1000, 1e-6), (50, 1e-3)])
def test_a_smooth_loop_may_be_sampled_anywhere(samples, tolerance):
    s = 0.1 + (np.arange(5 * samples) + 0.37) / (samples + 0.123)
    u, w, truth = ellipse(s)
    found = loops.summary(hj.Recording(s, u, w))
    for name in ("energy", "amplitude", "remanence", "coercivity", "lag", "period"):
        np.testing.assert_allclose(found[name], truth[name], rtol=tolerance)


def unevenly(s, how):
    """Times of an instrument whose clock jitters, or that loses a fifth of its rows."""
    rng = np.random.default_rng(1)
    if how == "jitter":
        return s + 0.2 * (s[1] - s[0]) * rng.uniform(-1, 1, len(s))
    return np.delete(s, rng.choice(len(s), len(s) // 5, replace=False))


# Four samples in a row are lost once, where the path is taken for straight.
@pytest.mark.parametrize(("how", "area"), [("jitter", 1e-4), ("lost", 2e-3)])
def test_sampling_may_be_uneven(how, area):
    s = unevenly(np.arange(0.13, 5, 0.01), how)
    u, w, truth = ellipse(s)
    found = loops.summary(hj.Recording(s, u, w))
    tolerances = {"energy": area, "amplitude": 1e-6, "saturation": 3e-5, "lag": 1e-4}
    tolerances |= {"coercivity": 1e-4, "period": 1e-5}
    for name, tolerance in tolerances.items():
        np.testing.assert_allclose(found[name], truth[name], rtol=tolerance)
    # Over a tenth of the branch after a turn as where samples are even.
    even = np.arange(0, 5, 0.01)
    slope = loops.summary(hj.Recording(even, *ellipse(even)[:2])).tangent_stiffness[0]
    np.testing.assert_allclose(found.tangent_stiffness, slope, rtol=1e-3)


@pytest.mark.parametrize("loop", [ellipse, rayleigh])
@pytest.mark.parametrize("how", ["jitter", "lost"])
def test_standard_errors_cover_the_truth_however_uneven(loop, how):
    s = unevenly(np.arange(0.3, 100, 0.01), how)
    u, w, truth = loop(s)
    rng = np.random.default_rng(2)
    u, w = (x + 1e-3 * np.ptp(x) * rng.standard_normal(len(x)) for x in (u, w))
    found = loops.summary(hj.Recording(s, u, w)).isel(cycle=slice(1, -1))
    truth.setdefault("amplitude", 1)
    for name in ("amplitude", "saturation", "coercivity", "remanence"):
        pulls = (found[name] - truth[name]) / found[f"{name}_error"]
        assert 0.7 < float(np.sqrt(np.mean(pulls**2))) < 1.5, name


@pytest.mark.parametrize("loop", [stop, rayleigh])
def test_corners_of_the_input_may_lie_between_samples(loop):
    """Without noise, and with some that hides how far from the nearest one."""
    s = np.arange(0.37, 5 * 50) / 50.123
    u, w, truth = loop(s)
    found = loops.summary(hj.Recording(s, u, w))
    assert len(found.cycle) == 4
    truth |= {"amplitude": 1, "period": 1, "drift": 0}
    for name in ("amplitude", "saturation", "coercivity", "drift", "period"):
        # The record begins a little after a tip.
        np.testing.assert_allclose(found[name][1:], truth[name], rtol=0, atol=1e-9)
    s = np.arange(80 * 50) / 50.123
    u, w, _ = loop(s)
    rng = np.random.default_rng(0)
    noisy = [x + 1e-3 * np.ptp(x) * rng.standard_normal(len(x)) for x in (u, w)]
    found = loops.summary(hj.Recording(s, *noisy)).isel(cycle=slice(1, -1))
    z = (found.amplitude - 1) / found.amplitude_error
    assert 0.7 < float(np.sqrt(np.mean(z**2))) < 1.3
    z = (found.saturation - truth["saturation"]) / found.saturation_error
    assert float(np.mean(np.abs(z) < 3)) > 0.95


def test_corners_are_read_off_their_own_branches():
    """Of a sawtooth that rises within 3.3 samples and falls within 20.3."""
    s = np.arange(700) % 23.6
    u = np.where(s < 3.3, 2 * s / 3.3 - 1, 1 - 2 * (s - 3.3) / 20.3)
    found = loops.summary(hj.Recording(np.arange(700.0), u, u), threshold=0.3)
    np.testing.assert_allclose(found.u_max, 1, rtol=1e-9)
    np.testing.assert_allclose(found.u_min, -1, rtol=1e-9)


def test_corners_of_a_path_without_a_clock_are_where_it_was_read():
    """At even inputs, the tip by both branches: no line goes on beyond it."""
    down, up = np.linspace(1, -1, 129), np.linspace(-1, 1, 129)
    u = np.tile(np.concatenate([down, up]), 3)
    w = np.tanh(2 * u) + 0.3 * (1 - u**2) * np.where(
        np.arange(len(u)) % 258 < 129, 1, -1
    )
    found = loops.summary(hj.Recording(None, u, w))
    np.testing.assert_allclose(found.amplitude, 1, rtol=1e-12)
    np.testing.assert_allclose(found.saturation, np.tanh(2), rtol=1e-4)


def test_errors_cover_corners_at_samples_with_a_yield_close_by():
    """Three samples after each turn, which a wider window would reach into."""
    s = np.arange(150 * 20 + 1) / 20
    u, w, truth = stop(s)
    exact = loops.summary(hj.Recording(s, u, w)).saturation
    np.testing.assert_allclose(exact, truth["saturation"], rtol=1e-9)
    rng = np.random.default_rng(1)
    u, w = (x + 0.0025 * np.ptp(x) * rng.standard_normal(len(x)) for x in (u, w))
    found = loops.summary(hj.Recording(s, u, w))
    for name in ("amplitude", "saturation", "secant_stiffness", "damping"):
        apart = np.abs(found[name] - truth[name]) / found[f"{name}_error"]
        assert float(np.mean(apart < 3)) > 0.95, name


@pytest.mark.parametrize("loop", [ellipse, stop])
def test_energy_far_from_zero_is_that_around_it(loop):
    """As of a pressure, or counts, that hardly change."""
    s = np.linspace(0, 4, 401)
    u, w, truth = loop(s)
    numbers = loops.summary(hj.Recording(s, u + 1e7, w - 1e7))
    got = {name: numbers[name].values for name in ("energy", "damping")}
    for name, values in got.items():
        np.testing.assert_allclose(values, truth[name], rtol=1e-4)


def test_biases_are_those_of_an_ellipse_beside_its_axes():
    """u = a + 2 cos x and w = b + 3 cos(x - d)."""
    s, a, b, d = np.arange(4001) / 1000, 0.4, -0.7, 0.3
    u, w = a + 2 * np.cos(2 * np.pi * s), b + 3 * np.cos(2 * np.pi * s - d)
    found = loops.summary(hj.Recording(s, u, w))
    truth = {
        "u_max": a + 2,
        "u_min": a - 2,
        "w_max": b + 3 * np.cos(d),
        "w_min": b - 3 * np.cos(d),
        "asymmetry": b / (3 * np.cos(d)),
        # Where w = 0, cos(x - d) = -b / 3; where u = 0, cos x = -a / 2.
        "u_bias": a - 2 * np.cos(d) * b / 3,
        "w_bias": b - 3 * np.cos(d) * a / 2,
        "coercivity": 2 * np.sin(d) * np.sqrt(1 - (b / 3) ** 2),
        "remanence": 3 * np.sin(d) * np.sqrt(1 - (a / 2) ** 2),
    }
    for name, value in truth.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("samples", [51, 101, 401])
def test_an_output_with_a_corner_at_its_tip_reaches_as_far_as_the_tip(samples):
    """A triangle's, between samples; B over H of a core whose loop has an area of 0."""
    phase = 2 * np.pi * np.arange(3 * samples + 1) / samples
    wave = 2 / np.pi * np.arcsin(np.sin(phase))
    record = hj.Recording(phase, 100 * wave, wave**3 + 0.2 * wave, units=("A/m", "T"))
    found = hj.loops.summary(record)
    np.testing.assert_allclose(found.peak_stiffness, 1.2 / 100, rtol=1e-3)
    assert np.all(found.peak_stiffness >= found.secant_stiffness)
    np.testing.assert_allclose(hj.loops.core_loss(record).flux, 1.2, rtol=1e-3)


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.5, 0.9])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_leap_at_a_tip_is_the_mean_of_both_sides(phase, noise):
    """Dry friction beside a spring, wherever the samples are: at a tip the force is
    anywhere between those of both ways."""
    t = (np.arange(1201) + phase) / 400
    u, spring = np.sin(2 * np.pi * t), 0.3
    w = np.sign(np.cos(2 * np.pi * t)) + spring * u
    rng = np.random.default_rng(0)
    found = hj.loops.summary(hj.Recording(t, u, w + noise * rng.normal(size=len(t))))
    np.testing.assert_allclose(found.saturation, spring, atol=3 * noise + 1e-6)
    # The mean of two tips, less another, each off by 1.
    expected = np.sqrt(1 / 2 + 1) / 2
    np.testing.assert_allclose(found.saturation_error, expected, rtol=0.01)
    np.testing.assert_allclose(found.energy, 4.0, rtol=2e-3)
    np.testing.assert_allclose(found.peak_stiffness, 1 + spring, atol=3 * noise + 1e-3)


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.5, 0.9])
@pytest.mark.parametrize("force", [np.sign, np.asarray, lambda v: np.tanh(v / 0.002)])
def test_what_is_over_an_output_that_both_tips_share_is_none(phase, force):
    """Dampers, dry or viscous: where they turn their force is nothing on the whole."""
    t = (np.arange(1201) + phase) / 400
    u, w = np.sin(2 * np.pi * t), force(np.cos(2 * np.pi * t))
    found = hj.loops.summary(hj.Recording(t, u, w))
    for name in ("damping", "squareness", "coercivity", "asymmetry", "width"):
        assert np.all(np.isnan(found[name])), name
    np.testing.assert_allclose(found.saturation, 0, atol=1e-4)
    np.testing.assert_allclose(found.remanence, -1, rtol=1e-3)


def test_drift_and_pinching_of_a_loop_that_is_low_in_the_middle():
    """Half as high as 1/4 + |u|, from |u| = 1/2 on down to nothing at the tips."""
    s = np.arange(4001) / 1000
    u, falling = triangle(s), np.mod(s + 1e-12, 1.0) < 0.5
    half = np.minimum(0.25 + np.abs(u), 1.5 * (1 - np.abs(u)))
    loop = u + np.where(falling, 1, -1) * half
    found = loops.summary(hj.Recording(s, u, loop))
    np.testing.assert_allclose(found.pinching, 1 - 0.25 / 0.75, rtol=1e-9)
    found = loops.summary(hj.Recording(s, u, loop + 0.02 * s))
    np.testing.assert_allclose(found.drift, 0.02, rtol=1e-9)


def test_corners_between_samples_keep_their_area():
    # Yield comes between samples, turns come at them.
    s = np.arange(3 * 1000 + 1) / 1000
    u, r = triangle(s), 0.30123
    falling = np.mod(s + 1e-12, 1.0) < 0.5
    w = np.where(falling, np.maximum(r - 1 + u, -r), np.minimum(1 + u - r, r))
    energy = loops.summary(hj.Recording(s, u, w)).energy
    np.testing.assert_allclose(energy, 4 * r * (1 - r), rtol=1e-9)


@pytest.mark.parametrize(
    ("loop", "noise_u"),
    [
        (ellipse, 0.0),
        (stop, 0.02),
        pytest.param(ellipse, 0.02, marks=pytest.mark.thorough),
        pytest.param(stop, 0.0, marks=pytest.mark.thorough),
        pytest.param(rayleigh, 0.02, marks=pytest.mark.thorough),
    ],
)
def test_standard_errors_cover_the_truth(loop, noise_u):
    """500 cycles, each with noise of its own."""
    samples, cycles = 400, 500
    s = np.arange(cycles * samples + 1) / samples
    u, w, truth = loop(s)
    rng = np.random.default_rng(7)
    noisy = [
        x + share * x.std() * rng.standard_normal(len(x))
        for x, share in ((u, noise_u), (w, 0.05))
    ]
    found = loops.summary(hj.Recording(s, *noisy))
    assert len(found.cycle) == cycles
    names = {name for name in truth if f"{name}_error" in found}
    # It has no error without noise in the input, and with it only nearly a linear one.
    names.discard("amplitude")
    # All cycles share the error of the first.
    names -= {"strength_degradation", "stiffness_degradation"}
    assert {"energy", "saturation", "coercivity"} < names
    for name in names:
        apart = np.abs(found[name] - truth[name]) / found[f"{name}_error"]
        share = float(np.mean(apart < 1.96))
        assert 0.92 < share < 0.98, (name, share)


@pytest.mark.parametrize(("loop", "samples"), [(stop, 30), (stop, 50), (bouc_wen, 50)])
def test_standard_errors_of_coarse_records_are_the_scatter(loop, samples):
    """Where a fourth of the differences between neighbours, or more, is at corners."""
    s = np.arange(500 * samples + 1) / samples
    u, w, _ = loop(s)
    noise = 0.01 * w.std() * np.random.default_rng(3).standard_normal(len(w))
    found = loops.summary(hj.Recording(s, u, w + noise))
    for name in ("energy", "saturation", "remanence", "coercivity", "lag"):
        ratio = float(found[f"{name}_error"].mean() / found[name].std())
        assert 0.9 < ratio < 1.15, (name, ratio)


@pytest.mark.parametrize(
    ("samples", "share"),
    [(60, 5e-4), (100, 1e-3), (200, 2.5e-4), (500, 1.25e-3), (500, 0.02)],
)
def test_standard_errors_hold_where_slight_noise_hides_flat_tips(samples, share):
    """150 cycles, sampled at all phases; noise as a share of the ranges."""
    s = np.arange(150 * samples) / (samples + 0.123) - 0.05
    u, w, truth = ellipse(s)
    rng = np.random.default_rng(0)
    noisy = [x + share * np.ptp(x) * rng.standard_normal(len(x)) for x in (u, w)]
    found = loops.summary(hj.Recording(s, *noisy))
    names = ("amplitude", "saturation", "secant_stiffness", "damping", "drift", "lag")
    for name in names:
        z = (found[name] - truth[name]) / found[f"{name}_error"]
        assert 0.7 < float(np.sqrt(np.mean(z**2))) < 1.3, name


def held(s, share):
    """A triangle whose tips are cut off for a share of the time, from -1 to 1."""
    return np.clip(triangle(s) / (1 - share), -1.0, 1.0)


@pytest.mark.parametrize("share", [0.3, 0.6])
@pytest.mark.parametrize("samples", [200, 1000])
@pytest.mark.parametrize("smooth", [False, True])
def test_an_input_that_rests_at_its_tips_is_as_large_as_its_level(
    share, samples, smooth
):
    """And not as its largest sample there, or as where its ramps would meet; the tip is
    in the middle of the rest. After corners, and after smooth ends of ramps."""
    s = np.arange(60 * samples) / samples + 0.25
    u = held(s, share)
    u = np.sin(np.pi / 2 * u) if smooth else u
    columns = [u, u - play(u, 0.5)]
    rng = np.random.default_rng(0)
    noisy = [x + 0.005 * rng.standard_normal(len(x)) for x in columns]
    found = loops.summary(hj.Recording(s, *noisy))
    assert found.sizes["cycle"] == 59
    assert np.all(np.abs(found["period"] - 1) < 0.05)
    for name, truth in (("amplitude", 1.0), ("saturation", 0.5)):
        z = (found[name] - truth) / found[f"{name}_error"]
        assert 0.6 < float(np.sqrt(np.mean(z**2))) < 1.35, name
    assert np.all(np.abs(found["tangent_stiffness"] - 1) < 0.15)


def test_a_tip_is_in_the_middle_of_a_rest_without_noise_too():
    """Of an output that creeps there, as of a commanded input."""
    ramp, held = np.linspace(-1, 1, 100, endpoint=False), np.ones(100)
    u = np.tile(np.concatenate([ramp, held, -ramp, -held]), 3)
    t = 0.01 * np.arange(len(u))
    lag = hj.models.SparseModel.from_terms({"u": 2.0, "w": -2.0})
    w = u + 0.2 * np.asarray(hj.simulate(lag, hj.Recording(t, u, u), w0=-1.0).w)
    found = loops.summary(hj.Recording(t, u, w))
    noise = 1e-6 * np.random.default_rng(0).standard_normal(len(u))
    noisy = loops.summary(hj.Recording(t, u + noise, w))
    for name in ("w_max", "w_min", "tangent_stiffness", "damping", "period"):
        np.testing.assert_allclose(found[name], noisy[name], rtol=1e-4)
    # It rests from row 100 of a period to row 200.
    np.testing.assert_allclose(found.w_max[:2], w[[150, 550]], rtol=1e-9)
    np.testing.assert_allclose(found.u_max, 1, rtol=1e-12)


def test_a_few_rests_that_noise_hides_are_rests_where_the_others_are():
    s = np.arange(6 * 200) / 200 + 0.25
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u, w = held(s, 0.3) + 0.03 * rng.standard_normal((2, len(s)))
        found = loops.summary(hj.Recording(s, u, w), threshold=0.5)
        assert np.all(np.abs(found["amplitude"] - 1) < 0.05)


def test_branches_are_not_continued_beyond_a_rest_too_short_to_be_told():
    """Where both branches would meet, 5 % beyond, nothing was measured."""
    s = np.arange(60 * 1000) / 1000 + 0.25
    rng = np.random.default_rng(0)
    u, w = held(s, 0.1) + 0.01 * rng.standard_normal((2, len(s)))
    found = loops.summary(hj.Recording(s, u, w))
    assert np.all(np.abs(found["amplitude"] - 1) < 0.02)


def propagated(function, *parts):
    """The standard error of a function of numbers with errors, by differences."""
    values = [value for value, _ in parts]
    moved = [
        function(*values[:i], value + error / 100, *values[i + 1 :])
        - function(*values[:i], value - error / 100, *values[i + 1 :])
        for i, (value, error) in enumerate(parts)
    ]
    return 50 * np.linalg.norm(moved, axis=0)


def test_errors_of_ratios_are_those_of_their_parts():
    """Of a loop beside its axes, which weakens; the record ends at its tips, of which
    only one side is known."""
    s, rng = np.arange(801) / 200, np.random.default_rng(0)
    u, w, _ = ellipse(s)
    u, w = u + 0.02 * rng.normal(size=801), 0.9 + (1 - 0.1 * s) * w
    found = loops.summary(hj.Recording(s, u, w + 0.05 * rng.normal(size=801)))
    up, low, height, wide, area, remanent = (
        (found[name].values, found[f"{name}_error"].values)
        for name in ("w_max", "w_min", "saturation", "amplitude", "energy", "remanence")
    )
    damped = propagated(lambda e, a, b: e / a / b, area, height, wide)
    ratios = {
        "asymmetry": propagated(lambda a, b: (a + b) / (a - b), up, low),
        "secant_stiffness": propagated(np.divide, height, wide),
        "damping": damped / (2 * np.pi),
        "squareness": propagated(np.divide, remanent, height),
        # The upper tips are two of a cycle, whose mean is told.
        "drift": 2 * up[1],
    }
    for name, error in ratios.items():
        np.testing.assert_allclose(
            found[f"{name}_error"], error, rtol=1e-3, err_msg=name
        )


@pytest.mark.slow
def test_errors_of_degradation_are_the_scatter():
    """Of a loop that loses a tenth of its first height a cycle; swings take half."""
    s = np.arange(801) / 200
    lost = 1 - (0.975 - 0.1 * np.arange(4)) / 0.975
    pulls = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u, w, _ = ellipse(s)
        noisy = (1 - 0.1 * s) * w + 0.05 * rng.normal(size=801)
        found = loops.summary(hj.Recording(s, u + 0.02 * rng.normal(size=801), noisy))
        for name in ("strength_degradation", "stiffness_degradation"):
            assert found[f"{name}_error"][0] == 0
            off = found[name].values - lost[: len(found.cycle)]
            pulls.extend(off[1:] / found[f"{name}_error"].values[1:])
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.3


def test_noise_in_both_columns_is_in_the_area_once():
    """Of sums of products of independent noise, (u[i+1] - u[i-1]) w[i] / 2."""
    n = 20_000
    u, w = np.random.default_rng(0).standard_normal((2, n))
    columns = (Column(x, np.arange(float(n)), x, 1.0, 1, True) for x in (u, w))
    _, error, _ = _energies(*columns, np.array([[0, n // 2, n - 1]]))
    np.testing.assert_allclose(error, np.sqrt(n / 2), rtol=0.02)


def test_a_branch_passes_a_level_where_the_middle_passage_is():
    """Of several, near the average's, and on the branch, however flat noise is."""
    row = np.arange(60.0)
    levels = np.linspace(-11, 11, 200)
    passed = 30 + levels / 0.4
    for seed in range(3):
        x = 0.4 * (row - 30) + np.random.default_rng(seed).normal(size=60)
        near = np.rint(passed).astype(int)
        first, last = near - 2, np.minimum(near + 3, 59)
        noisy = Column(x, row, 0.4 * (row - 30), 1.0, 2, True)
        wide, _ = crossings(noisy, levels, 0 * near, 0 * near + 59)
        close, _ = crossings(noisy._replace(half=4), levels, first, last)
        assert np.all(np.abs(wide - passed) <= 2 + 1e-9)
        assert np.all((close >= first) & (close <= last))
    sine = np.sin(2 * np.pi * np.arange(-20, 21) / 25)  # zero at 7.5, 20 and 32.5
    end = np.array([40])
    exact = Column(sine, np.arange(41.0), sine, 0.0, 1, True)
    middle, _ = crossings(exact, np.zeros(1), 0 * end, end)
    np.testing.assert_allclose(middle, 20, atol=1e-9)


@pytest.mark.parametrize(("share", "inside"), [(0.02, True), (0.005, False)])
def test_an_axis_is_inside_of_a_loop_by_a_hundredth_of_its_swing(share, inside):
    """The ellipse u = a + 2 cos x, of which 0 is a share of the swing above the end."""
    s = np.arange(4001) / 1000
    u, w, _ = ellipse(s)
    a = 2 - 4 * share
    found = loops.summary(hj.Recording(s, u + a, w)).remanence
    expected = 3 * np.sin(0.3) * np.sqrt(1 - (a / 2) ** 2) if inside else np.nan
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def history(rng, turns, samples):
    """Turning points at random, and halves of cosines between them."""
    levels, sign = [0.0], rng.choice([-1, 1])
    while len(levels) < turns + 2:
        level = rng.uniform(-1, 1)
        if (level - levels[-1]) * sign > 0.02:
            levels.append(level)
            sign = -sign
    share = (1 - np.cos(np.pi * np.arange(samples) / samples)) / 2
    parts = [a + (b - a) * share for a, b in itertools.pairwise(levels)]
    return np.append(np.concatenate(parts), levels[-1])


def swings(x, threshold):
    """Turning points from which the column comes back by the threshold; by a loop."""
    rows, high, low, way = [], 0, 0, 0
    for i, value in enumerate(x):
        high = i if value > x[high] else high
        low = i if value < x[low] else low
        if way >= 0 and value < x[high] - threshold:
            rows, low, way = [*rows, high], i, -1
        elif way <= 0 and value > x[low] + threshold:
            rows, high, way = [*rows, low], i, 1
    return rows[1:]  # the first is where the record begins, or trembles


@pytest.mark.parametrize("histories", [50, pytest.param(1000, marks=pytest.mark.slow)])
def test_reversals_under_noise(histories):
    rng = np.random.default_rng(3)
    missed = false = 0
    samples, turns = 150, 20
    for _ in range(histories):
        clean = history(rng, turns, samples)
        sigma = 0.05 * clean.std()
        u = clean + sigma * rng.standard_normal(len(clean))
        rows = loops.reversals(hj.Recording(None, u, u)).rows
        for row in swings(clean, 4 * sigma):
            # Of several extrema that noise makes equal, any will do.
            alike = np.abs(clean[rows] - clean[row]) < 3 * sigma
            missed += not np.any(alike & (np.abs(rows - row) < 3 * samples))
        # One that the clean history does not go back by a noise level for.
        false += int(np.sum(np.abs(np.diff(clean[rows])) < sigma))
    cycles = histories * turns / 2
    assert missed == 0
    assert false <= cycles / 100


def test_windows_are_half_of_what_a_line_takes_to_move_beyond_noise():
    random = np.random.default_rng(0)
    slope, times = 0.2, 2.5  # 2.5 deviations in 12.5 samples, and in no 8
    column = slope * np.arange(5000.0) + random.normal(size=5000)
    assert half_window(column, 1.0, times) == 16 // 2


def test_noise_anywhere_in_a_long_column_is_seen():
    row = np.arange(300_000.0)
    column = np.sin(row / 1e4)
    column[150_000:] += np.random.default_rng(0).normal(size=150_000)
    assert noise(column, row) == pytest.approx(1, rel=0.05)


def test_noise_is_told_by_any_clock_and_at_any_height():
    rng = np.random.default_rng(0)
    even, uneven = np.linspace(0, 40, 4001), np.sort(rng.uniform(0, 40, 4001))
    for t in (even, uneven):
        for height in (0.0, 1e9):
            smooth = height + np.sin(t)
            column = smooth + 0.01 * rng.normal(size=t.size)
            assert noise(column, t) == pytest.approx(0.01, rel=0.05)
            assert noise(smooth, t) < 1e-6


def test_straight_lines_have_no_noise_and_corners_are_none():
    t = np.linspace(0, 40, 4001)  # whose steps are equal to rounding
    assert noise(np.abs(t / 5 % 2 - 1), t) == 0
    row = np.arange(4000.0)
    zigzag = np.abs((row + 4) % 16 - 8)  # a corner every eight samples
    sigmas = [
        noise_beside_corners(zigzag + 0.1 * rng.normal(size=row.size), row)
        for rng in map(np.random.default_rng, range(10))
    ]
    assert np.mean(sigmas) == pytest.approx(0.1, rel=0.04)


def test_the_step_of_a_rounded_column_is_seen():
    t, rng = np.linspace(0, 40, 4001), np.random.default_rng(0)
    column = np.sin(t) + 0.002 * rng.normal(size=t.size)
    assert quantum(np.round(column / 0.01) * 0.01) == pytest.approx(0.01)
    coarse = np.round(np.sin(t) / 0.003) * 0.003  # four fifths of which move
    assert quantum(coarse) == pytest.approx(0.003)
    assert quantum(column) == 0


@pytest.mark.parametrize(("samples", "share"), [(60, 0.015), (100, 0.01), (200, 0.005)])
def test_noise_turns_nothing_where_nothing_is_averaged(samples, share):
    t = np.arange(5 * samples + 1) / samples
    rng = np.random.default_rng(0)
    for _ in range(10):
        u = np.sin(2 * np.pi * t) + share * rng.standard_normal(len(t))
        found = loops.reversals(hj.Recording(t, u, u))
        assert (len(found), found.window) == (10, 1)


@pytest.mark.parametrize("samples", [4, 5, 6, 8])
def test_an_input_of_few_samples_a_cycle_turns_as_often_as_it_does(samples):
    for phase, wave in itertools.product(
        (0.0, 0.37), (triangle, lambda s: np.cos(2 * np.pi * s))
    ):
        u = wave((np.arange(12 * samples + 1) + phase) / samples)
        found = loops.reversals(hj.Recording(None, u, u))
        assert (len(found.cycles), found.window) == (12, 1)


def test_an_input_of_few_samples_a_swing_may_grow():
    tips = np.repeat([0.5, 1.0, 1.5, 2.0], 6) * np.tile([1, -1], 12)
    u = np.interp(np.arange(23 * 6 + 1) / 6, np.arange(24), tips)
    found = loops.reversals(hj.Recording(None, u, u))
    np.testing.assert_array_equal(found.rows, 6 * np.arange(24))


@pytest.mark.parametrize("held", [2, 5, 20])
def test_an_input_of_two_levels_turns_from_one_to_the_other(held):
    """Whose step is no rounding."""
    u = np.repeat(np.tile([3.0, -1.0], 8), held)
    found = loops.reversals(hj.Recording(np.arange(len(u)), u, u))
    np.testing.assert_array_equal(u[found.rows], [3, -1] * 8)


def test_slight_noise_at_flat_tips_turns_nothing():
    """Also where by chance it makes few swings, and all of them large."""
    s = np.arange(161) / 40 + 0.1
    for seed in (3, 219, 615):
        noise = 0.02 * np.random.default_rng(seed).standard_normal(161)
        u = np.cos(2 * np.pi * s) + noise
        assert len(loops.reversals(hj.Recording(s, u, u))) in (8, 9)


def test_turning_points_are_those_of_a_loop_over_samples():
    rng = np.random.default_rng(0)
    for _ in range(20):
        x = np.cumsum(rng.standard_normal(300))
        found = loops.reversals(hj.Recording(None, x, x), threshold=3.0)
        inner = [row for row in found.rows if 0 < row < len(x) - 1]
        wanted = swings(x, 3.0)
        # An end of the record may be a tip as well, and there may be one more.
        assert set(wanted) <= set(inner)
        assert len(inner) <= len(wanted) + 2
        assert np.all(np.diff(found.upper.astype(int)) != 0)


def test_of_a_single_turn_the_larger_swing_alone_has_its_end():
    row = np.arange(25.0)
    u = np.interp(row, [0, 4, 18, 24], [0, -0.4, 1, 0])
    for column, rows in ((u, [4, 18]), (u[::-1], [6, 20])):
        found = loops.reversals(hj.Recording(row, column, row), threshold=0.5)
        assert found.rows.tolist() == rows


def test_reversals_see_through_glitches_rests_and_uneven_samples():
    s = np.sort(np.random.default_rng(1).uniform(0, 5, 2000))
    u = np.sin(2 * np.pi * s)
    u = np.where(np.abs(u) > 0.9, np.sign(u) * 0.9, u)  # rests at the tips
    u[[300, 301, 900]] += 3.0
    found = loops.reversals(hj.Recording(s, u, u))
    assert len(found) == 10
    assert np.all(np.abs(np.abs(u[found.rows]) - 0.9) < 1e-12)
    assert f"{found.threshold:.4g}" in str(found)


@pytest.mark.parametrize("noise", [0.001, 0.01, 0.03])
@pytest.mark.parametrize("samples", [60, 200, 3000])
def test_noise_over_long_rests_is_no_reversal(samples, noise):
    s = np.arange(6 * samples) / samples + 0.25
    for seed in range(10):
        rng = np.random.default_rng(seed)
        u = held(s, 0.6) + noise * rng.standard_normal(len(s))
        assert len(loops.reversals(hj.Recording(s, u, u)).cycles) == 5


@pytest.mark.parametrize("wiggle", [0.0, 1e-6, 2e-3])
def test_a_start_at_rest_is_no_reversal(wiggle):
    """However it trembles below the threshold."""
    t = np.linspace(0, 5, 501)
    u = t * np.sin(2 * np.pi * t)
    u[:4] = wiggle * np.array([0.0, -1.0, 1.0, 0.0])
    rows = loops.reversals(hj.Recording(t, u, u), threshold=0.05).rows
    slope = np.sin(2 * np.pi * t) + 2 * np.pi * t * np.cos(2 * np.pi * t)
    turns = np.flatnonzero(np.diff(np.sign(slope[4:]))) + 4
    assert len(rows) == len(turns) == 10
    assert np.all(np.abs(rows - turns) <= 1)


def test_a_rounded_input_turns_where_it_does():
    u = np.round(2.5 * np.sin(np.linspace(0, 6 * np.pi, 3000)), 1)
    u[1000:2000:7] += 0.1  # flickers by its last digit
    assert len(loops.reversals(hj.Recording(None, u, u))) == 6


def test_an_input_that_flickers_between_two_steps_does_not_turn():
    up = np.arange(11)
    levels = 0.1 * np.concatenate([up, *[np.append(up[-2::-1], up[1:])] * 2])
    u = np.repeat(levels, 40)
    u[41::40] = levels[:-1]  # back to the level before, once
    found = loops.reversals(hj.Recording(np.arange(len(u)), u, u))
    assert found.noise == 0
    np.testing.assert_array_equal(u[found.rows], [0, 1, 0, 1, 0, 1])


def test_rows_that_repeat_say_nothing_without_a_clock():
    u, w, _ = stop(np.arange(201) / 100)
    once = loops.summary(hj.Recording(None, u, w))
    twice = loops.summary(hj.Recording(None, np.repeat(u, 2), np.repeat(w, 2)))
    for name in once.data_vars:
        np.testing.assert_array_equal(once[name], twice[name], err_msg=name)
    assert twice.turn.values.tolist() == (2 * once.turn.values).tolist()


def test_uneven_sampling_is_no_noise():
    t = np.sort(np.random.default_rng(4).uniform(0, 3, 3000))
    rng, u = np.random.default_rng(5), np.sin(2 * np.pi * t)
    assert loops.reversals(hj.Recording(t, u, u)).noise < 1e-5
    noisy = u + 0.01 * rng.standard_normal(len(u))
    found = loops.reversals(hj.Recording(t, noisy, u)).noise
    assert abs(found / 0.01 - 1) < 0.1


def test_cycles_are_recordings():
    t = np.linspace(0, 6 * np.pi, 3001)
    record = hj.Recording(t, 2 * np.sin(t), 3 * np.sin(t - 0.3), units=("V", "µm"))
    for rec in (record, hj.Recording(None, record.u, record.w)):
        parts = loops.cycles(rec)
        assert len(parts) == 2
        # From the first tip, a quarter of the 1000 samples of a period on.
        for part, first in zip(parts, (250, 1250), strict=True):
            rows = slice(first, first + 1001)
            np.testing.assert_array_equal(part.u, rec.u[rows])
            np.testing.assert_array_equal(part.w, rec.w[rows])
            assert part.clocked == rec.clocked
            assert part.units == rec.units


def test_a_single_loop_from_tip_to_tip_is_a_cycle():
    s = np.arange(201) / 200
    u, w, _ = rayleigh(s)
    found = loops.reversals(hj.Recording(None, u, w))
    assert found.rows.tolist() == [0, 100, 200]
    assert half_cycles(hj.Recording(None, u, w)) == 2
    assert loops.reversals(hj.Recording(None, u[:150], w[:150])).rows.tolist() == [
        0,
        100,
    ]


def test_rainflow_counts_as_the_standard_does():
    """The example of ASTM E1049-85, figure 6."""
    u = [-2.0, 1, -3, 5, -1, 3, -4, 4, -2]
    record = hj.Recording(None, u, np.zeros(9))
    count = loops.rainflow(record, threshold=0.5)
    # Of the points A to I, as they are counted: by hand the range, and the mean.
    pairs = ["EF", "AB", "BC", "CD", "DG", "GH", "HI"]
    rows = np.array([["ABCDEFGHI".index(point) for point in pair] for pair in pairs])
    np.testing.assert_array_equal(np.stack([count.start, count.stop], 1), rows)
    np.testing.assert_array_equal(count.range, [4, 3, 4, 8, 9, 8, 6])
    np.testing.assert_array_equal(count.mean, [1, -0.5, -1, 1, 0.5, 0, 1])
    np.testing.assert_array_equal(count.count, [1, *[0.5] * 6])
    inner = hj.Recording(None, np.array([-2.0, 1, -1, 1, -2]), np.zeros(5))
    closed = loops.rainflow(inner, threshold=0.5)  # as soon as it is as large
    assert (closed.start[0], closed.stop[0], closed.count[0]) == (1, 2, 1)
    even = np.array([1.0, -1, 1, -1, 1])  # whose ends are tips
    again = loops.rainflow(hj.Recording(None, even, even), threshold=0.5)
    assert again.range.tolist() == [2] * len(again.range) and again.count.sum() == 2
    with pytest.raises(InputError, match=r"no swing .* 0 reversals .* `threshold`"):
        loops.rainflow(record)  # by the default one all of it is noise


def test_rainflow_keeps_every_swing():
    u = np.cumsum(np.random.default_rng(2).standard_normal(500))
    record = hj.Recording(None, u, u)
    found = loops.reversals(record, threshold=1e-9)
    count = loops.rainflow(record, found=found)
    way = np.abs(np.diff(u)).sum()
    np.testing.assert_allclose(2 * np.sum(count.range * count.count), way, rtol=1e-12)


def degrading(cycles=6, samples=200):
    """A stop of falling strength behind a growing input."""
    s = np.arange(cycles * samples + 1) / samples
    u = triangle(s + 0.25) * (1 + np.floor(s))
    return s, u, u - play(u, 0.5)


def test_backbone_of_an_elastic_plastic_spring():
    s, u, w = degrading()
    first = loops.backbone(hj.Recording(s, u, w), kind="first")
    assert str(first).startswith("Backbone: points from zero input outwards, 7 to (6, ")
    np.testing.assert_allclose(first.u, np.arange(7))
    for sign in (1, -1):
        # The side that is loaded first.
        record = hj.Recording(s, -sign * u, -sign * w)
        side = loops.backbone(record)
        side_u, side_w = (
            (side.u, side.w) if sign > 0 else (side.u_negative, side.w_negative)
        )
        np.testing.assert_allclose(side_w, sign * np.minimum(np.abs(side_u), 0.5))
        two = loops.bilinear(side_u, side_w)
        np.testing.assert_allclose(two[:4], [1, 0, sign * 0.5, sign * 0.5], atol=1e-14)
        equal = loops.eeep(side_u, side_w)
        reach = np.abs(side_u[-1])
        np.testing.assert_allclose(
            [equal.elastic, equal.w_yield, equal.energy, equal.ductility],
            [1, sign * 0.5, 0.5 * reach - 0.125, reach / 0.5],
            rtol=1e-12,
        )


def test_a_side_that_is_loaded_second_begins_with_what_the_other_has_left():
    """An elastic spring of 3 that slides from 0.9 on; after 0.5 and back it is loaded
    by 0.6 at zero."""
    s = np.linspace(0, 2 * np.pi, 500)
    u = np.concatenate([size * np.sin(s) for size in (0.5, 1.0, 2.0)])
    w = 3 * (u - play(u, 0.3))
    side = loops.backbone(hj.Recording(None, u, w))
    assert side.u[0] == side.w[0] == side.u_negative[0] == 0
    np.testing.assert_allclose(side.w_negative[0], -0.6, atol=1e-4)
    np.testing.assert_allclose(loops.bilinear(side.u, side.w).elastic, 3, rtol=1e-9)
    for fit in (loops.bilinear, loops.eeep):
        with pytest.raises(hj.InputError, match="first"):
            fit(side.u_negative, side.w_negative)
    first = loops.backbone(hj.Recording(None, u, w), kind="first")
    np.testing.assert_allclose(first.w_negative[:2], [0, -0.9], atol=1e-4)


def test_noise_at_the_start_is_no_side_that_is_loaded():
    u = np.concatenate(
        [[0, -1e-4, 2e-4], np.linspace(0, 1, 50), np.linspace(1, -1, 99)]
    )
    w = 3 * (u - play(u, 0.3))
    side = loops.backbone(hj.Recording(None, u, w))
    np.testing.assert_allclose(side.w_negative[0], -0.9, atol=1e-3)
    np.testing.assert_allclose(side.w[0], 0, atol=1e-3)


@pytest.mark.parametrize("kind", ["envelope", "first"])
def test_a_side_to_which_the_input_never_comes_from_zero_has_no_points(kind):
    turns = 60 - 40 * np.cos(np.linspace(0, 4 * np.pi, 200))
    with pytest.raises(hj.InputError, match="from zero to no side"):
        loops.backbone(hj.Recording(None, turns, 5 + 0.13 * turns), kind=kind)
    u = (turns - 20) * np.linspace(1, 1.5, 200)
    side = loops.backbone(hj.Recording(None, u, u), kind=kind)
    assert len(side.u) > 2 and len(side.u_negative) == 0
    assert str(side).endswith("and none")
    figure = hj.plot.backbone(hj.Recording(None, u, u), side)
    assert len(figure.axes[0].lines) > 1


def test_cycles_of_nearly_one_amplitude_give_a_backbone_one_point():
    turns = [0, 1, -1, 1.01, -1.005, 1.005, -1, 2, -2, 2.01, -2.02, 0]
    u = np.interp(np.arange(551), 50 * np.arange(len(turns)), turns)
    side = loops.backbone(hj.Recording(None, u, 3 * u), kind="first")
    np.testing.assert_allclose(side.u, [0, 1, 2])
    np.testing.assert_allclose(side.w_negative, [0, -3, -6])


@pytest.mark.parametrize("sign", [1, -1])
def test_two_lines_are_those_of_least_squares(sign):
    """Exactly, and of noise no others on a grid of knots are closer."""
    u = sign * np.linspace(0.1, 3, 30)
    w = sign * np.where(np.abs(u) < 1.23, 2 * np.abs(u), 1.845 + 0.5 * np.abs(u))
    exact = [2, 0.5, sign * 1.23, sign * 2.46, 0]
    np.testing.assert_allclose(loops.bilinear(u, w), exact, rtol=1e-9, atol=1e-10)
    noisy = w + 0.05 * np.random.default_rng(2).normal(size=30)

    def missed(knot):
        x = np.abs(u)
        columns = sign * np.stack([np.minimum(x, knot), np.maximum(x - knot, 0)], 1)
        slopes = np.linalg.lstsq(columns, noisy)[0]
        return np.sqrt(np.mean((noisy - columns @ slopes) ** 2)), *slopes

    found = loops.bilinear(u, noisy)
    np.testing.assert_allclose(found.w_yield, found.elastic * found.u_yield, rtol=1e-12)
    rmse, *slopes = missed(abs(found.u_yield))
    np.testing.assert_allclose(found[:2], slopes, rtol=1e-9)
    np.testing.assert_allclose(found.rmse, rmse, rtol=1e-9)
    assert found.rmse <= min(missed(knot)[0] for knot in np.linspace(0.2, 2.9, 541))


def test_eeep_ends_where_the_specimen_has_failed():
    """Up to 10 at 10, then down: 80 % of the peak is reached at 12."""
    u = np.linspace(0, 20, 201)
    w = np.where(u < 10, u, 20 - u)
    found = loops.eeep(u, w)
    area = 50 + (10 + 8) / 2 * 2
    force = 12 - np.sqrt(144 - 2 * area)
    np.testing.assert_allclose(
        [found.u_ultimate, found.energy, found.w_yield], [12, area, force], rtol=1e-12
    )


def test_eeep_begins_at_the_origin():
    """Where the first point is beyond it, as in a table of tips, and where it is not:
    elastic to 1 at 1, then level."""
    u = np.array([0.3, 1.0, 1.5, 2.5])
    w = np.minimum(u, 1.0)
    found = loops.eeep(u, w)
    assert found == loops.eeep(np.append(0.0, u), np.append(0.0, w))
    np.testing.assert_allclose(found.energy, 0.5 + 1.5, rtol=1e-12)
    np.testing.assert_allclose([found.elastic, found.ductility], [1, 2.5], rtol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 0.7, 1 / 3])
def test_eeep_of_a_backbone_that_stiffens_yields_at_85_per_cent_of_its_peak(scale):
    """0.4 at 1, then up to 1 at 1.5: 0.55 below it, and 0.45 below a straight line as
    stiff as its beginning."""
    u, w = np.array([0.0, 1.0, 1.5]), scale * np.array([0.0, 0.4, 1.0])
    found = loops.eeep(u, w)
    np.testing.assert_allclose(found.energy, scale * (0.2 + 0.35), rtol=1e-12)
    np.testing.assert_allclose(found.w_yield, 0.85 * scale, rtol=1e-12)
    np.testing.assert_allclose(found.u_yield, 0.85 / 0.4, rtol=1e-12)
    straight = loops.eeep(u, scale * u / 1.5)  # which yields where it ends
    np.testing.assert_allclose(
        [straight.w_yield, straight.ductility], [scale, 1], rtol=1e-12
    )


def test_a_record_that_begins_on_its_way_has_no_tip_there():
    """From 1.5 down, and then cycles of 2 and 3."""
    s = np.linspace(0, 1, 30)
    ways = [1.5, -2.0, 2.0, -3.0, 3.0, 0.5]
    u = np.concatenate([a + (b - a) * s for a, b in itertools.pairwise(ways)])
    side = loops.backbone(hj.Recording(None, u, u), kind="first")
    np.testing.assert_allclose(side.u, [0, 2, 3])
    np.testing.assert_allclose(side.u_negative, [0, -2, -3])


def test_eeep_is_not_ended_by_chatter():
    """Elastic to 1 at 1, then a force that sticks and slips around 1, from 1.2 to 0.8;
    its peak comes first."""
    u = np.concatenate([np.linspace(0, 1, 11), 1 + 0.01 * np.arange(1, 901)])
    w = np.where(u <= 1, u, 1 + 0.2 * np.cos(2 * np.pi * 5 * (u - 1.01)))
    found = loops.eeep(u, w)
    assert found.peak == 1.2
    assert found.u_ultimate > 9.7  # the last time that it carries 0.96
    area = 0.5 + found.u_ultimate - 1
    np.testing.assert_allclose(found.energy, area, rtol=0.01)
    np.testing.assert_allclose(found.w_yield, 1.0, rtol=0.01)
    np.testing.assert_allclose(found.ductility, found.u_ultimate, rtol=0.01)


@pytest.mark.recordings
def test_eeep_of_a_damper_that_sticks_and_slips_spans_its_stroke():
    for name in ("0.5Hz_0.5in", "1Hz_0.5in", "0.5Hz_1in", "1Hz_1in"):
        record = hj.datasets.load("friction_damper", name)
        side = loops.backbone(record)
        for u, w in ((side.u, side.w), (side.u_negative, side.w_negative)):
            found, slides = loops.eeep(u, w), np.median(w[np.abs(u) > 0.1])
            assert 0.9 < found.w_yield / slides < 1.15
            # Once it breaks away with so much that by the standard it fails in sliding.
            if found.peak / slides < 1.35:
                assert found.u_ultimate / u[-1] > 0.9
                assert found.ductility > 2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("output", [0.0, 0.1])
def test_a_law_of_constant_output_has_no_lag(output):
    s = np.arange(401) / 100
    u = np.sin(2 * np.pi * s + 0.3)
    record, held = (hj.Recording(s, u, w) for w in (u, np.full(401, output)))
    still = hj.Trajectory(held.t, held.u, held.w, hj.RESULTS.successful, {})
    found = loops.side_by_side(record, {"still": still}).sel(source="still")
    assert np.all(np.isnan(found.lag)) and np.all(np.abs(found.saturation) < 1e-15)


def test_degradation_is_counted_from_the_first_cycle_of_an_amplitude():
    tips = np.array([1, -1, 1, -1, 1, -2, 2, -2, 2, -1, 1, -1, 1])
    forces = tips * (1 - 0.03 * np.arange(13))
    s = np.linspace(0, 12, 601)
    u, w = (np.interp(s, np.arange(13), x) for x in (tips, forces))
    found = loops.summary(hj.Recording(s, u, w))
    small = loops.summary(hj.Recording(s, 1e-4 * u, w))
    amplitude, strength = (np.abs(x[:-2:2] - x[1::2]) / 2 for x in (tips, forces))
    first = [0, 0, 2, 3, 2, 0]  # of first swings by 1, 1, 1.5, 2, 1.5, 1
    stiffness = strength / amplitude
    for name, x in (("strength", strength), ("stiffness", stiffness)):
        lost = found[f"{name}_degradation"]
        np.testing.assert_allclose(lost, 1 - x / x[first], rtol=0, atol=1e-12)
        # Whatever the unit.
        other = small[f"{name}_degradation"]
        np.testing.assert_allclose(other, lost, rtol=0, atol=1e-12)


@pytest.mark.parametrize("repeats", [2, 3])
def test_each_repeat_of_a_step_has_lost_what_it_has(repeats):
    """A test that goes from zero to zero, each repeat a fifth weaker."""
    phase = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    sizes = np.repeat([5, 10, 20], repeats)
    kept = 0.8 ** (np.arange(len(sizes)) % repeats)
    u = (sizes[:, None] * np.sin(phase)).ravel()
    found = loops.summary(hj.Recording(None, u, np.repeat(kept, 80) * u))
    lost = (1 - kept)[: len(found.cycle)]
    np.testing.assert_allclose(found.strength_degradation, lost, atol=1e-12)
    np.testing.assert_allclose(found.stiffness_degradation, lost, atol=1e-12)


def protocol(sign=1.0, rest=0, samples=400):
    """A cyclic test of a spring of 1 beside a play of radius 0.3 and slope 2: two
    cycles of each amplitude, from zero to zero, with rests between them."""
    wave = np.sin(2 * np.pi * np.arange(samples) / samples)
    sizes = (0.5, 0.5, 1.0, 1.0, 2.0, 2.0)
    cycles = [np.append(sign * size * wave, np.zeros(rest)) for size in sizes]
    u = np.append(np.concatenate(cycles), 0.0)
    return u, u + 2 * play(u, 0.3)


@pytest.mark.parametrize("clocked", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_cycles_from_zero_are_of_one_amplitude_each(sign, clocked):
    u, w = protocol(sign)
    t = 0.01 * np.arange(len(u))
    found = loops.summary(hj.Recording(t if clocked else None, u, w), begin="zero")
    np.testing.assert_array_equal(found["start"], 400 * np.arange(6))
    np.testing.assert_array_equal(found["stop"], 400 * np.arange(1, 7))
    np.testing.assert_array_equal(found["back"] - found["turn"], np.full(6, 200))
    size = np.repeat([0.5, 1.0, 2.0], 2)
    height = size + 2 * (size - 0.3)
    # Where the amplitude is a new one, cycles do not close: under straight lines then.
    fine_u, fine_w = protocol(sign, samples=40_000)
    parts = (fine_w[1:] + fine_w[:-1]) / 2 * np.diff(fine_u)
    energy = np.sum(parts.reshape(6, -1), axis=1)
    np.testing.assert_allclose(energy[1::2], -2.4 * (size - 0.3)[1::2], rtol=1e-7)
    wanted = {
        "amplitude": size,
        "saturation": height,
        "secant_stiffness": height / size,
        "peak_stiffness": height / size,
        "tangent_stiffness": np.ones(6),
        "energy": energy,
        "damping": -energy / (2 * np.pi * size * height),
        "remanence": np.minimum(2 * (size - 0.3), 0.6),
        "coercivity": np.full(6, 0.2),
        "asymmetry": np.zeros(6),
        "strength_degradation": np.zeros(6),
    }
    wanted["drift"] = np.diff(fine_w[::40_000])
    for name, value in wanted.items():
        np.testing.assert_allclose(found[name], value, rtol=2e-4, atol=1e-9)
    assert ("period" in found) == clocked
    if clocked:
        np.testing.assert_allclose(found["period"], 4.0, rtol=1e-9)
        # The integral by trapezoids: loops that grow do not close.
        first = np.exp(-2j * np.pi * np.arange(401) / 400)
        first[[0, -1]] /= 2
        waves = [
            [x[a : a + 401] @ first for a in found["start"].values] for x in (u, w)
        ]
        lag = np.angle(np.divide(*waves))
        np.testing.assert_allclose(found["lag"], lag, rtol=1e-9)


@pytest.mark.parametrize("clocked", [False, True])
def test_one_period_of_samples_is_a_cycle_from_zero(clocked):
    """It ends one sample before it comes round, or begins one later: where the input is
    not quite zero, and the output not yet what it is there."""
    u, w = protocol()
    t = 0.01 * np.arange(len(u)) if clocked else None
    for start, stop in ((1200, 1601), (1200, 1600), (1201, 1601)):
        rows = slice(start, stop)
        record = hj.Recording(t if t is None else t[rows], u[rows], w[rows])
        found = loops.summary(record, begin="zero")
        assert len(found.cycle) == 1
        wanted = {
            "amplitude": 1.0,
            "remanence": 0.6,
            "coercivity": 0.2,
            "energy": -2.4 * 0.7,
            "drift": 0.0,
        }
        wanted |= {"period": 4.0} if clocked else {}
        wanted |= {"pinching": 0.0} if start == 1200 else {}
        for name, value in wanted.items():
            assert float(found[name][0]) == pytest.approx(value, rel=5e-4, abs=1e-4)
    # Also where a step is far more than the threshold.
    u, w = protocol(samples=40)
    found = loops.summary(hj.Recording(None, u[120:160], w[120:160]), begin="zero")
    assert float(found.remanence[0]) == pytest.approx(0.6, rel=0.1)
    # What is before the first tip of a loop that does not close is another curve.
    u, w = protocol()
    virgin = loops.summary(hj.Recording(None, u[:401], w[:401]), begin="zero")
    assert np.isnan(virgin.coercivity[0]) and float(virgin.remanence[0]) > 0.3
    # Two steps before it comes round it is no cycle.
    with pytest.raises(hj.InputError, match="no cycle"):
        loops.summary(hj.Recording(None, u[1200:1599], w[1200:1599]), begin="zero")


def test_what_begins_away_from_zero_is_told_so():
    u, w = protocol(rest=20)
    both = (np.concatenate([np.full(50, x[0]), x]) for x in (u, w))
    at_rest = hj.Recording(None, *(x + 0.05 for x in both))
    with pytest.warns(UserWarning, match="neither at zero nor at a turning point"):
        loops.reversals(at_rest, begin="zero")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        centred = loops.centred(at_rest)
        assert len(loops.summary(centred, begin="zero").cycle) == 6
        loops.reversals(hj.Recording(None, u[100:], w[100:]), begin="zero")


def test_errors_of_cycles_from_zero_cover_the_truth():
    u, w = protocol()
    t = 0.01 * np.arange(len(u))
    names = ("amplitude", "saturation", "energy", "damping", "drift", "remanence")
    truth = loops.summary(hj.Recording(t, u, w), begin="zero")
    pulls = {name: [] for name in (*names, "lag")}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noisy = u + 2e-3 * rng.normal(size=len(u)), w + 0.01 * rng.normal(size=len(u))
        found = loops.summary(hj.Recording(t, *noisy), begin="zero")
        assert len(found["cycle"]) == 6
        np.testing.assert_allclose(found["period"], 4.0, atol=0.02)
        for name, of in pulls.items():
            of.extend(((found[name] - truth[name]) / found[f"{name}_error"]).values)
    for name, of in pulls.items():
        assert 0.7 < np.sqrt(np.mean(np.square(of))) < 1.4, name


def test_rests_at_zero_are_in_the_cycle_before_them():
    u, w = protocol(rest=100)
    record = hj.Recording(0.01 * np.arange(len(u)), u, w)
    found = loops.summary(record, begin="zero")
    np.testing.assert_array_equal(found["start"], 500 * np.arange(6))
    np.testing.assert_allclose(found["period"], [5.0] * 5 + [4.0], atol=1e-9)
    without = loops.summary(hj.Recording(None, *protocol()), begin="zero")
    np.testing.assert_allclose(found["energy"], without["energy"], rtol=1e-9)


def test_cycles_that_are_not_whole_are_in_no_cycle_from_zero():
    u, w = protocol()
    record = hj.Recording(None, u[100:-50], w[100:-50])
    found = loops.reversals(record, begin="zero")
    assert found.zeros[0] == found.zeros[-1] == -1
    np.testing.assert_array_equal(found.cycles[:, 0], 100 + 400 * np.arange(5))
    parts = loops.cycles(record, begin="zero")
    assert [len(part) for part in parts] == [401] * 5
    np.testing.assert_allclose([float(part.u[-1]) for part in parts], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("tips", "rows"),
    [
        ([0, 1, -1], []),
        ([0, 1, -1, 2, -2], [[0, 100, 200, 233]]),
        ([0, 1, -1, 1], [[0, 100, 200, 250]]),
        ([1, -1, 1, -1], [[50, 100, 200, 250]]),
        ([0, 1, -1, 0], [[0, 100, 200, 300]]),
    ],
)
def test_a_record_that_ends_at_a_tip_does_not_end_at_zero(tips, rows):
    """Straight lines of 100 samples: from -1 to 2 they pass zero at a third."""
    u = np.interp(np.arange(100 * len(tips) - 99), 100 * np.arange(len(tips)), tips)
    found = loops.reversals(hj.Recording(None, u, u), begin="zero")
    assert found.cycles.tolist() == rows


def test_losses_split_and_steinmetz():
    f = np.array([5.0, 20, 50, 100, 400])
    fit = loops.separate(f, 3 + 0.02 * f + 0.4 * np.sqrt(f))
    np.testing.assert_allclose(list(fit.value.values()), [3, 0.02, 0.4], rtol=1e-9)
    b = np.array([0.5, 1.0, 1.5, 1.0, 0.5])
    fit = loops.steinmetz(f, b, 2.5 * f**1.3 * b**1.9)
    np.testing.assert_allclose(list(fit.value.values()), [2.5, 1.3, 1.9], rtol=1e-9)


def test_errors_of_few_rows_are_those_of_scipy():
    """Of a straight line, and of the logarithms of powers."""
    f, b = np.array([5.0, 20, 50, 100]), np.array([0.5, 1.0, 1.5, 1.0])
    energy = np.array([3.1, 3.3, 4.1, 4.9])
    line = scipy.stats.linregress(f, energy)
    fit = loops.separate(f, energy, excess=False)
    errors = [line.intercept_stderr, line.stderr]
    np.testing.assert_allclose(list(fit.error.values()), errors, rtol=1e-9)
    powers = 2.5 * f**1.3 * b**1.9 * np.array([1.02, 0.99, 1.0, 1.01])

    def logarithm(_, k, alpha, beta):
        return np.log(k) + alpha * np.log(f) + beta * np.log(b)

    start = 2.5, 1.3, 1.9
    _, spread = scipy.optimize.curve_fit(logarithm, f, np.log(powers), start)
    errors = list(loops.steinmetz(f, b, powers).error.values())
    np.testing.assert_allclose(errors, np.sqrt(np.diag(spread)), rtol=1e-3)


def test_creep_is_told_with_its_error():
    t = np.linspace(0, 100, 2001)
    rng, truth, hits = np.random.default_rng(6), {"start": 5.0, "rate": 0.25}, []
    for _ in range(200):
        w = 5 + 0.25 * np.log10(np.maximum(t, 1) / 1) + 0.1 * rng.standard_normal(2001)
        fit = loops.creep(hj.Recording(t, np.ones_like(t), w), settle=1.0)
        hits.append(
            [abs(fit.value[k] - v) < 1.96 * fit.error[k] for k, v in truth.items()]
        )
    assert np.all(np.abs(np.mean(hits, axis=0) - 0.95) < 0.05)
    # By default from the sample after the first, which has no logarithm.
    w = 5 + 0.25 * np.log10(np.maximum(t, t[1]) / t[1])
    fit = loops.creep(hj.Recording(t, np.ones_like(t), w))
    np.testing.assert_allclose([*fit.value.values()], [5, 0.25], rtol=1e-12)


@pytest.mark.parametrize("level", [0.0, 5.0])
def test_creep_at_any_level_of_a_noisy_input(level):
    t, rng = np.linspace(0, 100, 2001), np.random.default_rng(7)
    u = level + np.where(t < 10, 5.0, 0.0) + 2e-3 * rng.standard_normal(2001)
    w = np.where(t < 10, 1.0, 0.25 * np.log10(np.maximum(t - t[200], 1)))
    record = hj.Recording(t, u, w)
    fit = loops.creep(record.window(200, 2001), settle=1.0)
    found = fit.value["start"], fit.value["rate"]
    np.testing.assert_allclose(found, [0, 0.25], atol=1e-12)
    with pytest.raises(InputError, match="the input moves"):
        loops.creep(record.window(100, 2001))
    if level == 0:  # of noise alone nobody knows how small it is
        alone = hj.Recording(t[200:], u[200:], w[200:])
        with pytest.raises(InputError, match="what came before too"):
            loops.creep(alone)


@pytest.mark.parametrize(("move", "rests"), [(0.009, True), (0.011, False)])
def test_creep_is_of_an_input_that_moves_by_one_per_cent_at_most(move, rests):
    t = np.linspace(0, 100, 201)
    w = 2 + 0.5 * np.log10(np.maximum(t, t[1]) / t[1])
    record = hj.Recording(t, 1 - move * (t > 50), w)
    if rests:
        fit = loops.creep(record)
        np.testing.assert_allclose(list(fit.value.values()), [2, 0.5], rtol=1e-12)
    else:
        with pytest.raises(InputError, match=r"moves by 0\.011 .* more than 1 % of 1;"):
            loops.creep(record)


def test_errors_of_a_split_cover_the_truth():
    rng, f = np.random.default_rng(5), np.linspace(5, 400, 30)
    truth, hits = np.array([3, 0.02, 0.4]), []
    for _ in range(400):
        y = 3 + 0.02 * f + 0.4 * np.sqrt(f) + 0.1 * rng.standard_normal(len(f))
        fit = loops.separate(f, y)
        apart = np.abs(np.array(list(fit.value.values())) - truth)
        hits.append(apart < 2.052 * np.array(list(fit.error.values())))  # t, 27 free
    assert np.all(np.abs(np.mean(hits, axis=0) - 0.95) < 0.03)


@pytest.mark.parametrize("units", [("A/m", "T"), ("T", "A/m"), ("Oe", "kG")])
def test_core_loss_is_positive_and_in_si(units):
    s = np.arange(2001) / 1000
    field, flux, _ = ellipse(s)
    columns = (flux, field) if units[0] == "T" else (field, flux)
    at_50_hz = hj.Recording(s / 50, *columns, units=units)
    loss = loops.core_loss(at_50_hz, density=7650.0)
    factor = {"Oe": 1e3 / (4 * np.pi) * 0.1}.get(units[0], 1.0)
    energy = factor * 6 * np.pi * np.sin(0.3)
    np.testing.assert_allclose(loss.energy, energy, rtol=1e-6)
    np.testing.assert_allclose(loss.power, 50 * energy, rtol=1e-6)
    np.testing.assert_allclose(loss.specific_energy, energy / 7650, rtol=1e-6)
    np.testing.assert_allclose(loss.specific_power, 50 * energy / 7650, rtol=1e-6)
    asked = loops.core_loss(at_50_hz, frequency=20.0)
    np.testing.assert_allclose(asked.power, 20 * energy, rtol=1e-6)
    bare = loops.core_loss(hj.Recording(None, *columns, units=units))
    assert not {"power", "specific_energy", "specific_power"} & {*bare.data_vars}
    to_si = {"Oe": 1e3 / (4 * np.pi)}.get(units[0], 1.0)
    np.testing.assert_allclose(loss.coercivity, to_si * 2 * np.sin(0.3), rtol=1e-9)
    np.testing.assert_allclose(loss.field, to_si * 2, rtol=1e-9)
    to_si = {"Oe": 0.1}.get(units[0], 1.0)
    np.testing.assert_allclose(loss.remanence, to_si * 3 * np.sin(0.3), rtol=1e-9)
    np.testing.assert_allclose(loss.flux, to_si * 3, rtol=1e-9)
    # Where the flux drives, its axis is passed where the field remains.
    known = loops.summary(loops.in_si(at_50_hz))
    names = ["coercivity_error", "remanence_error"]
    for name, other in zip(names, names[:: -1 if units[0] == "T" else 1], strict=True):
        np.testing.assert_array_equal(loss[name], known[other])
        assert np.all(loss[name] > 0)


def test_a_period_that_begins_between_its_tips_is_told_how_to_be_a_cycle():
    """And rolled so, its area is that of the ellipse, which has no first sample."""
    s = np.arange(1001) / 1000
    field, flux, _ = ellipse(s + 0.1)
    with pytest.raises(InputError, match=r"makes no cycle.*numpy\.roll") as told:
        loops.core_loss(hj.Recording(s, field, flux, units=("A/m", "T")))
    shift = int(re.search(r"numpy\.roll\(u, (-\d+)\)", str(told.value))[1])
    rolled = [np.roll(x, shift) for x in (field, flux)]
    loss = loops.core_loss(hj.Recording(s, *rolled, units=("A/m", "T")))
    np.testing.assert_allclose(loss.energy, 6 * np.pi * np.sin(0.3), rtol=1e-6)


def test_a_period_from_zero_to_zero_is_told_to_begin_there():
    s = np.arange(1001) / 1000
    u, w, known = ellipse(s + 0.25)
    with pytest.raises(InputError, match=r'summary\(\.\.\., begin="zero"\)'):
        loops.summary(hj.Recording(s, u, w))
    found = loops.summary(hj.Recording(s, u, w), begin="zero")
    for name in ("energy", "amplitude", "lag"):
        np.testing.assert_allclose(found[name], known[name], rtol=1e-6)


def test_an_input_that_goes_one_way_is_no_period():
    x = np.arange(50.0)
    with pytest.raises(InputError, match="makes no cycle") as told:
        loops.summary(hj.Recording(x, x, x))
    assert "period" not in str(told.value)


def test_corrections():
    s = np.arange(801) / 200
    u, w, truth = ellipse(s)
    moved = hj.Recording(s, u + 5, w - 7 + 0.02 * s)
    mended = loops.centred(loops.without_drift(moved))
    found = loops.summary(mended)
    np.testing.assert_allclose(found.coercivity, truth["coercivity"], rtol=1e-6)
    assert np.max(np.abs(found.drift)) < 1e-9
    for tips in (9, 8):  # of which the first and the last are alike, or are not
        straight = loops.without_drift(moved.window(0, 100 * tips - 99)).w
        np.testing.assert_allclose(straight, w[: 100 * tips - 99] - 7, atol=1e-9)
    x = np.linspace(-1, 1, 401)
    steep = hj.Recording(None, x, np.tanh(40 * x) + 0.3 * x)
    flat = loops.without_slope(steep)
    np.testing.assert_allclose(flat.w, np.tanh(40 * x), atol=1e-9)
    # What has just saturated where the input is at 80 % of its largest.
    knee = np.clip(x, -0.79, 0.79)
    flat = loops.without_slope(hj.Recording(None, x, knee + 0.3 * x))
    np.testing.assert_allclose(flat.w, knee, atol=1e-12)
    # Of two slopes the mean, for both sides are as long.
    uneven = np.where(x > 0, 0.3, 0.5) * x
    flat = loops.without_slope(hj.Recording(None, x, uneven))
    np.testing.assert_allclose(flat.w, uneven - 0.4 * x, atol=1e-12)
    body = hj.Recording(None, x, 2 * x, units=("A/m", "A/m"))
    np.testing.assert_allclose(loops.without_demagnetisation(body, 1 / 3).u, x / 3)


@pytest.mark.parametrize(
    ("unit", "in_si"),
    [  # by definition: an inch is 25.4 mm, a pound 0.45359237 kg, g 9.80665 m/s²
        ("ft", 12 * 0.0254),
        ("cm", 0.01),
        ("um", 1e-6),
        ("kgf", 9.80665),
        ("psi", 0.45359237 * 9.80665 / 0.0254**2),
        ("emu/cm3", 1e3),
    ],
)
def test_imperial_and_technical_units_are_converted(unit, in_si):
    x = np.arange(3.0)
    found = loops.in_si(hj.Recording(None, x, x, units=(unit, "m/ft")))
    np.testing.assert_allclose(found.u, in_si * x, rtol=1e-12)
    assert found.units[0] != unit and found.units[1] == "m/ft"


PREFIXES = {"k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "µ": 1e-6, "n": 1e-9}
POUND, INCH = 0.45359237 * 9.80665, 0.0254  # N and m
KNOWN = {
    **{unit: (unit[1:], PREFIXES[unit[0]]) for unit in (
        *("kA/m", "MA/m", "mT", "µT", "mA m²", "µA m²", "nA m²", "mm", "µm", "nm"),
        *("mN", "kN", "MN", "kPa", "MPa", "GPa", "kV", "mV"),
    )},
    # One emu is 1e-3 A m², an oersted 1000 / 4π A/m, a gauss 1e-4 T.
    **{"emu": ("A m²", 1e-3), "memu": ("A m²", 1e-6), "emu/g": ("A m²/kg", 1.0)},
    **{"Oe": ("A/m", 250 / np.pi), "kOe": ("A/m", 250e3 / np.pi), "A/cm": ("A/m", 100)},
    **{"G": ("T", 1e-4), "kG": ("T", 0.1), "bar": ("Pa", 1e5), "in": ("m", INCH)},
    **{"lbf": ("N", POUND), "kip": ("N", 1e3 * POUND)},
    "ksi": ("Pa", 1e3 * POUND / INCH**2),
    **{"A/mm": ("A/m", 1e3), "mA/m": ("A/m", 1e-3), "mOe": ("A/m", 0.25 / np.pi)},
    **{"Oersted": ("A/m", 250 / np.pi), "oe": ("A/m", 250 / np.pi), "nT": ("T", 1e-9)},
    **{"Gauss": ("T", 1e-4), "gauss": ("T", 1e-4), "Tesla": ("T", 1), "T": ("T", 1)},
}  # fmt: skip


def test_units_are_what_their_prefixes_say():
    for unit, (name, factor) in KNOWN.items():
        assert to_si(unit) == (name, pytest.approx(factor)), unit
        assert is_unit(unit), unit


@pytest.mark.parametrize(
    ("u", "w", "energy", "slope"),
    [
        ("A/m", "T", "J/m³", "H/m"),
        ("m", "N", "J", "N/m"),
        ("1", "MPa", "MJ/m³", "MPa"),
        ("1", "N", "N", "N"),
        ("1", "1", "1", "1"),
        ("A/m", "µm", "µm·A/m", "µm/(A/m)"),
        ("V", "1", "V", "1/V"),
        ("", "N", "", ""),
    ],
)
def test_energies_and_slopes_have_the_units_of_products_and_ratios(u, w, energy, slope):
    assert (Units(u, w).energy, Units(u, w).slope) == (energy, slope)


def test_units_are_the_same_however_they_are_spelt():
    for one, other in (("A m²", "A·m^2"), ("N·m", "N*m"), ("um", "µm"), ("", "V")):
        assert not differ(one, other) and not differ(other, one)
    assert differ("mT", "T") and differ("A m²", "A/m²")


def test_other_units_keep_what_was_before_a_window():
    """A play remembers it, whatever the units."""
    t = np.linspace(0, 1, 60)
    u = np.concatenate([3 * np.sin(2 * np.pi * t[:40]), 0.5 * np.sin(9 * t[40:])])
    late = hj.Recording(t, u, u, units=("kOe", "kG")).window(40, 60)
    device = hj.models.PrandtlIshlinskii([0.4], [1.0])
    scale = float(loops.in_si(late).u[0] / late.u[0])
    other = hj.models.PrandtlIshlinskii([0.4 * scale], [1.0])
    expected = scale * hj.simulate(device, late.path).w
    assert np.max(np.abs(expected - scale * hj.simulate(device, late.afresh()).w)) > 0.1
    np.testing.assert_allclose(
        hj.simulate(other, loops.in_si(late).path).w, expected, rtol=1e-12
    )


@pytest.mark.parametrize("name", ["centred", "without_drift", "without_slope"])
def test_corrections_keep_what_was_before_a_window(name):
    """A play that is far out remembers it along a loop that is narrower than it."""
    s = np.arange(900) / 200
    u = 5 + np.where(s < 1, 3.0, 0.5) * np.sin(2 * np.pi * s)
    late = hj.Recording(s, u, u).window(250, 900)
    mended = getattr(loops, name)(late)
    moved = float(late.u[0] - mended.u[0])
    assert (abs(moved) > 4) == (name == "centred")
    played = play(u - moved, 0.8, u[0] - moved)
    device = hj.models.PrandtlIshlinskii([0.8], [1.0])
    w = hj.simulate(device, mended.path).w
    np.testing.assert_allclose(w, played[250:], atol=1e-9)


@pytest.mark.parametrize("between", ["exact", "band-limited", "window"])
def test_corrections_hold_between_samples_too(between):
    t = 0.01 * np.arange(600)
    wave = hj.excitation.Sine(2.0, 0.5, offset=5.0)
    u = np.asarray(jax.vmap(wave)(t))
    way = hj.interpolation.BandLimited()
    if between == "exact":
        way = hj.interpolation.Exact(wave)
    w = 3 + np.cos(np.pi * t - 0.4)
    rec = hj.Recording(t, u, w, interpolation=way, units=("Oe", "G"))
    rec = rec.window(0, 450) if between == "window" else rec
    middle = 0.005 + t[:400]
    moved = loops.centred(rec).path.at(middle)[0]
    np.testing.assert_allclose(moved, 2 * np.sin(np.pi * middle), atol=1e-3)
    in_si = 1e3 / (4 * np.pi) * 1e-4
    energy = in_si * 2 * np.pi * np.cos(0.4)
    found = np.abs(loops.core_loss(rec).energy)
    np.testing.assert_allclose(found, energy, rtol=1e-3)
    body = hj.Recording(t, u, w, interpolation=way, units=("A/m", "A/m"))
    inside = loops.without_demagnetisation(body, 0.5)
    np.testing.assert_allclose(inside.path.samples()[0], u - w / 2, atol=1e-12)


@pytest.mark.parametrize(("samples", "noisy"), [(1000, 0.01), (200, 0.01)])
def test_the_window_of_a_flat_branch_does_not_reach_over_its_knee(samples, noisy):
    """Of w = tanh((u -+ 0.4) / 0.05) the remanence is 1, and no square is squarer."""
    t = np.linspace(0, 3.2, 3 * samples + samples // 5 + 1)
    u = np.sin(2 * np.pi * t)
    w = np.tanh((u - np.where(np.cos(2 * np.pi * t) > 0, 0.4, -0.4)) / 0.05)
    rng = np.random.default_rng(0)
    misses = {"remanence": [], "squareness": [], "coercivity": []}
    for _ in range(8):
        record = hj.Recording(t, u, w + noisy * rng.standard_normal(len(t)))
        found = loops.summary(record)
        for name, each in misses.items():
            true = 0.4 if name == "coercivity" else 1.0
            # Where lines between samples of a knee are of this size.
            least = 1e-3 if name == "coercivity" else 0.0
            error = np.hypot(found[f"{name}_error"].values, least)
            each += ((found[name].values - true) / error).tolist()
    for each in misses.values():
        assert np.sqrt(np.mean(np.square(each))) < 1.6


@pytest.mark.parametrize("noisy", [0.0, 0.003])
def test_an_end_that_is_on_its_way_to_a_tip_is_none(noisy):
    """A hundredth of the swing of a sine is three of its period."""

    def turns(until, shape):
        t = np.linspace(0, until, int(200 * until) + 1)
        noise = noisy * np.random.default_rng(1).standard_normal(len(t))
        u = 2 * shape(t + 0.17) + noise
        return loops.reversals(hj.Recording(t, u, u)).rows

    def sine(s):
        return np.cos(2 * np.pi * s)

    def held(s):
        return np.where(s > 3.25, 0.995, 1) * sine(np.minimum(s, 3.5))

    assert len(turns(3.3, sine)) == 6
    assert len(turns(3.325, sine)) == len(turns(3.335, sine)) == 7
    assert len(turns(3.45, held)) == 7  # where a machine holds it
    assert len(turns(3.33, triangle)) == 7


def test_means_beside_each_other_are_over_the_same_cycles():
    """A law off by a constant has no coercivity where its loop does not reach zero."""
    t = np.linspace(0, 5, 2001)
    size = np.where(t < 2, 0.3, np.where(t < 3, 1.0, np.where(t < 4, 2.0, 3.0)))
    u = size * np.sin(2 * np.pi * t)
    device = hj.models.PrandtlIshlinskii([0.0, 0.25], [1.0, 2.0])
    record = hj.Recording(t, u, hj.simulate(device, hj.Recording(t, u, u)).w)
    run = hj.simulate(device, record)
    moved = dataclasses.replace(run, w=run.w + 2.0)
    both = loops.side_by_side(record, {"law": moved})
    values = both["coercivity"].values
    common = np.isfinite(values).all(axis=0)
    assert 0 < common.sum() < np.isfinite(values[0]).sum()
    cells = loops.table(both, ["amplitude", "coercivity"])
    assert cells == [
        cells[0],
        cells[1],
        *(row for row in compared(record, {"law": moved}) if "coerc" in row[0]),
    ]
    name, recorded, law = cells[2]
    assert name.endswith(f", {common.sum()} of {len(common)} cycles")
    means = np.mean(values[:, common], axis=1)
    assert float(recorded) == pytest.approx(means[0], rel=1e-4)
    mean, off = law.removesuffix(" %)").split(" (")
    assert float(mean) == pytest.approx(means[1], rel=1e-4)
    assert float(off) == pytest.approx(100 * (means[1] / means[0] - 1), rel=0.06)
    assert cells[1][0] == "amplitude" and "+0 %" in cells[1][2]


@pytest.mark.parametrize("drift", [0.0, 0.03])
def test_an_amplitude_that_falls_a_little_is_no_drift(drift):
    """Upper and lower tips of a shrinking loop move against each other."""
    t = np.linspace(0, 5.6, 2801)
    u = np.exp(-0.05 * t) * np.sin(2 * np.pi * t)
    w = 2 * u - np.exp(-0.05 * t) * np.cos(2 * np.pi * t)
    record = hj.Recording(t, u, w + drift * t)
    moved = np.asarray(record.w - loops.without_drift(record).w)
    # A loop that shrinks evenly tells it but for how the shrinking slows down.
    np.testing.assert_allclose(moved, drift * t, atol=0.003 * t[-1])


@pytest.mark.parametrize(("samples", "off"), [(8, 0.03), (10, 0.02), (12, 1e-3)])
def test_tips_of_coarse_sines_are_no_corners(samples, off):
    """Whose slope is far from linear in the way from the tip there."""
    t = np.arange(0, int(4.3 * samples)) / samples
    for phase in np.linspace(0, 2 * np.pi / samples, 9):
        u = np.cos(2 * np.pi * t + 0.3 + phase)
        found = loops.summary(hj.Recording(t, u, 0.5 * u))
        np.testing.assert_allclose(found.amplitude, 1, atol=off)


def test_noise_moves_outputs_at_short_rests_to_neither_side():
    """They are averages of the rest alone, beyond which there is a corner."""
    up = np.append(np.linspace(-2, 2, 400, endpoint=False), np.full(40, 2.0))
    clean = driven(np.tile(np.append(up, -up), 8), t=np.arange(8 * 880.0))
    off = []
    for seed in range(5):
        noise_ = 0.05 * np.random.default_rng(seed).normal(size=len(clean))
        found = loops.summary(hj.Recording(clean.t, clean.u, clean.w + noise_))
        off.append((found.w_max - 1.24) / found.w_max_error)
    assert abs(np.mean(off)) < 0.5 and 0.7 < np.std(off) < 1.4


def test_an_output_that_moves_while_the_input_is_held_has_the_error_of_the_place():
    t = np.arange(8 * 1000 + 1.0)
    u = np.clip(1.5 * triangle(t / 1000), -1, 1)
    pulls = []
    for seed in range(6):
        noise_ = 0.01 * np.random.default_rng(seed).normal(size=len(t))
        found = loops.summary(hj.Recording(None, u + noise_, 3 * t))
        # Of the rests in the middle, of which each is held for a third of a half cycle.
        middles = 3 * (500.0 + 1000 * np.arange(len(found.cycle)))
        pulls += ((found.w_min - middles) / found.w_min_error).values.tolist()
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_noise_of_the_input_is_in_outputs_at_zero():
    u, _ = protocol()
    pulls = []
    for seed in range(20):
        noise_ = 0.01 * np.random.default_rng(seed).normal(size=len(u))
        found = loops.summary(hj.Recording(None, u + noise_, 3 * u), begin="zero")
        pulls.append(found.drift / found.drift_error)
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_the_way_back_goes_on_to_the_tip_of_the_next_cycle_and_no_farther():
    wave = np.sin(2 * np.pi * np.arange(400) / 400)
    u = np.append(np.concatenate([2 * wave, 2 * wave, 0.5 * wave]), 0.0)
    found = loops.summary(hj.Recording(None, u, u + 2 * play(u, 0.3)), begin="zero")
    np.testing.assert_array_equal(np.isnan(found.width[1]), [False, False, True])


def test_what_a_summary_may_have_is_left_out_of_a_table():
    u, w, _ = ellipse(np.linspace(0, 3, 301))
    found = loops.summary(hj.Recording(None, u, w))
    head, *_ = loops.table(found, ["period", "lag", "amplitude"])
    assert head == ["cycle", "amplitude"]


def test_turning_points_that_were_found_have_a_threshold():
    u, w, _ = ellipse(np.linspace(0, 3, 301))
    record = hj.Recording(None, u, w)
    found = loops.reversals(record)
    for verb in (loops.summary, loops.rainflow, loops.cycles):
        with pytest.raises(InputError, match="`found` has a threshold of its own"):
            verb(record, found=found, threshold=1.0)


@pytest.mark.parametrize("fit", [loops.eeep, loops.bilinear])
def test_a_fit_is_of_one_side_of_a_backbone(fit):
    u = np.arange(-3.0, 4.0)
    with pytest.raises(InputError, match=r"both sides of zero.*`found\.u_negative`"):
        fit(u, np.tanh(u))


def test_recorded_and_simulated_side_by_side():
    s = np.arange(601) / 200
    u = triangle(s)
    truth = hj.models.PrandtlIshlinskii([0.0, 0.3], [0.5, 1.0])
    record = hj.Recording(s, u, hj.simulate(truth, hj.Recording(s, u, u)).w)
    both = loops.side_by_side(record, {"law": hj.simulate(truth, record)})
    assert both.source.values.tolist() == ["recorded", "law"]
    np.testing.assert_array_equal(both.energy[0], both.energy[1])
    cells = loops.table(both.sel(source="law"))
    assert cells[0][:3] == ["cycle", "amplitude", "saturation"]  # of no known unit
    pure = hj.Recording(s, u, record.w, units=("1", "kN"))
    heads = loops.table(loops.summary(pure))[0]
    assert {"amplitude (1)", "energy (kN)", "secant_stiffness (kN)"} <= set(heads)
    half = hj.Recording(s, u, record.w, units=("mm", ""))
    heads = loops.table(loops.summary(half))[0]
    assert {"amplitude (mm)", "energy", "secant_stiffness"} <= set(heads)
    assert len(cells) == 4
    with pytest.raises(InputError, match="'recorded' is that of the record"):
        loops.side_by_side(record, {"recorded": hj.simulate(truth, record)})
    softer = hj.models.PrandtlIshlinskii([0.0, 0.3], [0.25, 0.6])
    runs = {"softer": hj.simulate(softer, record)}
    # Of a loop beside all axes too, which has no coercivity, and that loses it.
    raised = record.w + 9 * (s > 2)
    for each in (
        *(record, hj.Recording(None, u + 9, record.w)),
        hj.Recording(None, u, raised),
    ):
        told = loops.table(loops.side_by_side(each, runs))
        assert compared(each, runs) == told


POWERS = np.array([50.0, 100, 200, 400])


def tables(record):
    return loops.table(loops.summary(record), ["nothing"])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda r: loops.reversals(r, threshold=-1.0), "`threshold` must be a pos.*-1"),
        (lambda r: loops.reversals(r, threshold="1"), "threshold.*'1'"),
        (lambda r: loops.summary(r, begin="top"), "`begin` must be .*'top'"),
        (
            lambda r: loops.summary(r, begin="zero", found=loops.reversals(r)),
            "`found` has cycles that begin at a tip",
        ),
        (
            lambda r: loops.cycles(r.with_input(r.u + 9), begin="zero"),
            r"turning points at rows \d+ and \d+ the input does not pass zero",
        ),
        (lambda r: loops.summary(r.window(0, 40)), "the input makes no cycle"),
        (
            lambda r: loops.summary(hj.Recording(r.t, r.u, 0 * r.w + 3)),
            r"`w` is constant \(3\.0\); there is no loop",
        ),
        (lambda r: loops.backbone(r, kind="outer"), "`kind` must be.*'outer'"),
        (lambda r: loops.backbone(r, threshold=0.1), "`threshold` .* of all samples"),
        (lambda r: loops.table(loops.summary(r), ["width"]), "'width'.*each level"),
        (lambda r: loops.core_loss(r), r"the record's units are \('', ''\)"),
        (lambda r: loops.without_demagnetisation(r, 2.0), "`factor` .*0 to 1; got.*2"),
        (lambda r: loops.without_demagnetisation(r, "half"), "`factor`.*half"),
        (lambda r: loops.without_slope(r, np.nan), "`slope`.*finite"),
        (
            lambda r: loops.without_slope(r.with_input(np.sign(r.u - 0.01))),
            "all at one input; give the `slope`",
        ),
        (lambda r: loops.eeep([0, 0, 1], [0, 0.5, 1]), "before its input moves"),
        (
            lambda r: loops.rainflow(3, found=loops.reversals(r)),
            r"The order is `rainflow\(recording\)`|got 3",
        ),
        (lambda r: loops.without_slope(r, "steep"), "`slope`.*'steep'"),
        (
            lambda r: jax.grad(lambda x: loops.without_slope(r, x).u.sum())(0.5),
            "looks at the values of its arguments",
        ),
        (
            lambda r: jax.jit(lambda x: loops.without_demagnetisation(r, x).u)(0.5),
            "looks at the values of its arguments",
        ),
        (lambda r: loops.separate([1, 2, np.inf], np.ones(3)), "`frequency` holds NaN"),
        (
            lambda r: loops.steinmetz(POWERS, POWERS, POWERS * np.inf),
            "`power` holds NaN",
        ),
        (lambda r: loops.core_loss(r, density=np.inf), "`density` must be finite"),
        (lambda r: loops.core_loss(r, frequency=np.inf), "`frequency` must be finite"),
        (lambda r: loops.creep(r, settle=[1, 2]), "`settle` must be one number, got a"),
        (
            lambda r: loops.table(loops.summary(r).isel(cycle=0)),
            r"must be over `cycle`.*isel\(cycle=\[0\]\)",
        ),
        (lambda r: loops.separate("abc", [1.0, 2.0, 3.0]), "`frequency`.*'abc'"),
        (lambda r: loops.creep(r, settle="1"), "`settle`.*'1'"),
        (lambda r: loops.table(r), "what `hystjax.loops.summary`.*a Recording"),
        (lambda r: loops.separate([1.0, 2.0], [1.0, 2.0]), "3 or more; got 2, 2"),
        (
            lambda r: loops.separate([50, 50, 400, 400.0], np.ones(4)),
            "`frequency` has 2 different",
        ),
        (lambda r: loops.steinmetz(POWERS, POWERS / 9, POWERS), "`alpha`, `beta` ap"),
        (lambda r: loops.creep(r), "the input moves"),
        (
            lambda r: loops.creep(hj.Recording(None, r.u, r.w)),
            "the record has no clock",
        ),
        (
            lambda r: loops.steinmetz([1.0] * 4, [1, 2, 3, 4.0], [1.0] * 4),
            "`frequency` are 1: no exp",
        ),
        (lambda r: loops.eeep(np.arange(5.0), -np.arange(5.0)), "output has no peak"),
        (lambda r: loops.eeep(np.arange(5.0), np.ones(5)), "begins above 40 %"),
        (lambda r: loops.bilinear(np.ones(4), np.ones(4)), "3 different inputs.*of 1"),
        (lambda r: loops.bilinear(np.arange(5), np.ones(4)), "one length.*5.*4"),
        (lambda r: loops.eeep(np.arange(5), np.ones(4)), "one length.*5.*4"),
        (lambda r: loops.eeep([], []), "one point or more"),
        (tables, "has no number 'nothing'"),
    ],
)
def test_bad_input_is_named(call, says, unchecked):
    s = np.arange(401) / 100
    u, w, _ = ellipse(s)
    with pytest.raises(InputError, match=says):
        call(hj.Recording(s, u, w))


def area(u, w):
    """Under straight lines, closed by one."""
    return np.sum((w + np.roll(w, -1)) / 2 * (np.roll(u, -1) - u))


def opening(along, across):
    """Half of how far apart one column is where the other passes zero, by splines."""
    s = np.arange(len(along))
    roots = scipy.interpolate.CubicSpline(s, across).roots(extrapolate=False)
    return np.ptp(scipy.interpolate.CubicSpline(s, along)(roots)) / 2


def envelope(u, w):
    """Samples beyond all before them, on the positive side, by a loop from where the
    input last passes zero before it is a hundredth out, or from the first one."""
    out = np.argmax(u > 0.01 * np.max(np.abs(u)))
    below = np.flatnonzero(u[:out] <= 0)
    points, row = [(u[0], w[0])], 1
    if len(below):
        row = below[-1] + 1
        points = [(0.0, np.interp(0.0, u[row - 1 : row + 1], w[row - 1 : row + 1]))]
    for x, y in zip(u[row:], w[row:], strict=True):
        if x > points[-1][0]:
            points.append((x, y))
    return np.array(points).T


def measured(record):
    """Numbers of a measured record by name: ours, and by hand."""
    u, w = (np.asarray(x, float) for x in (record.u, record.w))
    found = loops.summary(record)
    if sorted(record.units) == ["A/m", "T"]:
        loss = loops.core_loss(record)
        h, b = (u, w) if record.units[0] == "A/m" else (w, u)
        return {
            "loss, J/m³": (loss.energy[0], abs(area(h, b))),
            "Hc, A/m": (loss.coercivity[0], opening(h, b)),
            "Br, T": (loss.remanence[0], opening(b, h)),
        }
    middle = len(found.cycle) // 2
    rows = slice(int(found.start[middle]), int(found.stop[middle]) + 1)
    last = int(found.stop[-1]) + 1
    work = np.sum((w[1:last] + w[: last - 1]) / 2 * np.diff(u[:last]))
    side = loops.backbone(record)
    by_hand = envelope(u, w)
    energy, force = found.energy.attrs["units"], record.units[1]
    return {
        f"energy of cycle {middle + 1}, {energy}": (
            found.energy[middle],
            area(u[rows], w[rows]),
        ),
        f"work of all cycles, {energy}": (found.cumulative_energy[-1], work),
        f"backbone's peak, {force}": (side.w.max(), by_hand[1].max()),
        f"work along the backbone, {energy}": (
            np.trapezoid(side.w, side.u),
            np.trapezoid(by_hand[1], by_hand[0]),
        ),
    }


@pytest.mark.recordings
def test_measured_numbers_in_the_guide_are_those_by_hand():
    guide = Path(__file__).parents[1] / "docs" / "loops.md"
    rows = re.findall(
        r"^\| `(\w+)` (\S+) \| (.+?) \| ([-\d.]+) \| ([-\d.]+) \|$",
        guide.read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    shown = {}
    for name, record, what, ours, by_hand in rows:
        shown.setdefault((name, record), {})[what] = (ours, by_hand)
    assert {name for name, _ in shown} == {
        "steel_m130_27s",
        "no27_steel",
        "steel_coupon",
        "friction_damper",
    }
    for (name, record), table in shown.items():
        found = measured(hj.datasets.load(name, record))
        assert table.keys() == found.keys()
        for what, (ours, by_hand) in found.items():
            assert abs(ours - by_hand) <= 1e-3 * abs(by_hand), (name, record, what)
            assert table[what] == (f"{float(ours):.5g}", f"{by_hand:.5g}")


def first_cycles(record, found=None):
    return loops.backbone(record, kind="first", found=found)


READERS = (
    *(loops.cycles, loops.rainflow, loops.summary, first_cycles),
    *(loops.centred, loops.without_drift),
)


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_turning_points_are_those_of_the_record(unchecked, read):
    """Those of a longer one would have its cycles cut short."""
    s = np.linspace(0, 3, 601)
    whole = hj.Recording(s, triangle(s), np.cos(2 * np.pi * s - 0.3))
    found = loops.reversals(whole)
    read(whole, found=found)
    with pytest.raises(InputError, match="up to row 600, and this one has 250 rows"):
        read(whole.window(0, 250), found=found)
    with pytest.raises(InputError, match=r"`found` must be what .* the number 0\.1"):
        read(whole, found=0.1)
    run = hj.simulate(hj.models.Duhem(0.5, 0.5, 0.2), whole)
    with pytest.raises(
        InputError, match=r"got a Trajectory\. `hystjax\.Recording\(x\.t"
    ):
        read(run)


def driven(inputs, model=None, t=None):
    """A device along an input, its output without noise: by default elastic up to an
    input of 0.3 from where it turned, then of the slope 0.2."""
    if model is None:
        model = hj.models.PrandtlIshlinskii([0.0, 0.3], [3.0, -2.8])
    record = hj.Recording(t, inputs, inputs)
    return hj.Recording(t, inputs, hj.simulate(model, record).w)


def polyline(*corners, steps=100):
    """Straight lines from one input to the next."""
    at = steps * np.arange(len(corners))
    return np.interp(np.arange(at[-1] + 1.0), at, corners)


@pytest.mark.parametrize("t", [None, 0.01 * np.arange(801)])
def test_an_inner_loop_that_is_left_out_is_no_rest_of_its_tip(t):
    u = polyline(-2, 2, 1, 2, -2, 2, 1, 2, -2.0)
    found = loops.summary(hj.Recording(t, u, 3 * u), threshold=2.0)
    np.testing.assert_allclose(found.u_max, 2, rtol=1e-9)
    np.testing.assert_allclose(found.w_max, 6, rtol=1e-9)


@pytest.mark.slow
def test_noise_on_samples_at_random_times_makes_no_energy():
    truth = -6 * np.pi * np.sin(0.6)
    off = []
    for seed in range(110, 130):
        rng = np.random.default_rng(seed)
        t = np.sort(rng.uniform(0, 4, 1500))
        u = 2 * np.sin(2 * np.pi * t) + 0.1 * rng.normal(size=1500)
        w = 3 * np.sin(2 * np.pi * t - 0.6) + 0.15 * rng.normal(size=1500)
        found = loops.summary(hj.Recording(t, u, w))
        off.append((found.energy - truth) / found.energy_error)
    off = np.concatenate(off)
    assert np.max(np.abs(off)) < 5 and np.sqrt(np.mean(off**2)) < 1.5


@pytest.mark.parametrize("held", [3, 4, 5, 6, 20])
@pytest.mark.parametrize("steps", [0.05, 0.2])
def test_outputs_at_held_tips_are_those_while_it_is_held(held, steps):
    up = np.append(np.arange(-2 + steps, 2 - steps / 2, steps), np.full(held, 2.0))
    u = np.tile(np.append(up, -up), 4)
    record = driven(u, t=np.arange(float(len(u))))
    found = loops.summary(record)
    # 3 u up to 0.6 from the other tip, then 0.2 u: 1.8 - 0.56 at the tip.
    np.testing.assert_allclose(found.w_max, 1.24, rtol=1e-9)
    np.testing.assert_allclose(found.w_min, -1.24, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-3, 1e-6])
def test_the_error_of_a_lag_is_that_of_many_records(size):
    """Of tips at samples too, which noise moves to the one side or the other."""
    t = np.arange(1001) / 200
    u = -triangle(t + 0.25)
    w = u + play(u, 0.4)
    lags, errors = [], []
    for seed in range(60):
        noise = size * np.random.default_rng(seed).normal(size=(2, len(t)))
        found = loops.summary(hj.Recording(t, u + noise[0], w + noise[1]))
        lags.append(found.lag)
        errors.append(found.lag_error)
    scatter, told = np.std(lags, axis=0), np.mean(errors, axis=0)
    assert np.all((told > 0.7 * scatter) & (told < 1.5 * scatter))


@pytest.mark.parametrize("clock", [True, False])
def test_two_samples_a_cycle_have_an_error(clock):
    """Of such noise in both is more than in one."""
    u = np.array([0.0, 1, -1, 1, -1, 1, -1, 1, -1])
    w = np.random.default_rng(0).normal(size=9)
    record = hj.Recording(np.arange(9.0) if clock else None, u, w)
    found = loops.summary(record, threshold=0.5)
    assert np.all(np.isfinite(found.energy_error)) and np.all(found.energy_error >= 0)


def test_a_threshold_of_core_losses_is_in_the_unit_of_the_record():
    s = np.arange(2001) / 200
    field = np.sin(2 * np.pi * s) + 0.15 * np.sin(40 * np.pi * s)
    record = hj.Recording(s, field, 1e3 * field, units=("Oe", "G"))
    cycles = loops.summary(record, threshold=0.5).sizes["cycle"]
    assert loops.core_loss(record, threshold=0.5).sizes["cycle"] == cycles == 9
    assert loops.core_loss(record).sizes["cycle"] > 20


def test_noise_at_held_tips_moves_neither_output_nor_lag():
    """A tenth of each cycle is held."""
    t = np.arange(20 * 2000 + 1) / 2000
    u = 2 * np.clip(triangle(t) / 0.9, -1, 1)
    record = driven(u, t=t)
    clean, rng = loops.summary(record), np.random.default_rng(0)
    noisy = (np.asarray(x) + 0.004 * rng.normal(size=len(t)) for x in (u, record.w))
    found = loops.summary(hj.Recording(t, *noisy))
    for name in ("w_max", "w_min", "saturation"):
        off = (found[name] - clean[name])[1:] / found[f"{name}_error"][1:]
        assert np.max(np.abs(off)) < 5, name
    scatter = np.std((found.lag - clean.lag)[1:])
    assert scatter < 1e-3
    np.testing.assert_allclose(np.mean((found.lag - clean.lag)[1:]), 0, atol=5e-4)


@pytest.mark.parametrize("samples", [1000, 5000])
def test_tips_of_a_smooth_input_are_not_cut_off(samples):
    t = np.linspace(0, 10, 10 * samples + 1)
    off = []
    for seed in range(5):
        noise_ = 0.01 * np.random.default_rng(seed).normal(size=len(t))
        u = np.cos(2 * np.pi * t) + noise_
        found = loops.summary(hj.Recording(t, u, u))
        off.append((found.amplitude - 1) / found.amplitude_error)
    off = np.concatenate(off)
    assert abs(np.mean(off)) < 1 and np.max(np.abs(off)) < 5


def test_a_test_that_ends_with_a_push_farther_out_does_not_drift():
    record = driven(polyline(0, 1, -1, 1, -1, 4.0), t=0.01 * np.arange(501))
    kept = loops.without_drift(record)
    np.testing.assert_allclose(kept.w, record.w, rtol=0, atol=1e-12)
    moved = hj.Recording(record.t, record.u, record.w + 0.3 * record.t)
    np.testing.assert_allclose(loops.without_drift(moved).w, record.w, atol=1e-9)
    # Of both kinds of tips, what amplitudes do is nothing in the mean.
    fades = hj.Recording(None, polyline(0, 5, -4, 3, -2, 1.0), np.zeros(501))
    elastic = hj.Recording(0.01 * np.arange(501), fades.u, 2 * fades.u)
    np.testing.assert_allclose(loops.without_drift(elastic).w, elastic.w, atol=1e-12)
    odd = polyline(0, 5, -4, 3, -2, 1, 0)  # three differences, of which two count
    elastic = hj.Recording(0.01 * np.arange(601), odd, 2 * odd)
    np.testing.assert_allclose(loops.without_drift(elastic).w, elastic.w, atol=1e-12)
    grows = driven(polyline(0, 1, -2, 3.0), t=0.01 * np.arange(301))
    with pytest.raises(InputError, match="comes back to a tip, and it never does"):
        loops.without_drift(grows)


def test_what_a_material_leaves_behind_where_it_goes_first_is_no_drift():
    """Plays under strokes to one side, which remain where the input comes back to 0,
    the more the farther it went; later cycles close."""
    u = polyline(0, 0.4, 0, 0.4, 0, 0.7, 0, 0.7, 0, 1.0, 0, 1.0, 0.0)
    t = 0.01 * np.arange(len(u))
    w = play(u, 0.1) + play(u, 0.2)
    record = hj.Recording(t, u, w)
    np.testing.assert_allclose(loops.without_drift(record).w, w, atol=1e-12)
    moved = hj.Recording(t, u, w + 0.3 * t)
    np.testing.assert_allclose(loops.without_drift(moved).w, w, atol=1e-9)


def test_losses_of_loops_that_do_not_close_are_warned_of():
    field = polyline(0, 5, -5, 0.5, -5, 5, -5.0)
    core = hj.Recording(None, field, 0.1 * play(field, 1.0), units=("kA/m", "T"))
    with pytest.warns(UserWarning, match=r"of 2 of 2 cycles \(the first is cycle 1\)"):
        loops.core_loss(core)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        minor = loops.core_loss(core.window(200, 401))  # from a tip to the next such
    # A play's loop is twice its radius high, and as long as the rest of the way.
    np.testing.assert_allclose(minor.energy, 0.1 * 2 * 1e3 * (5.5 - 2), rtol=1e-9)


def test_the_first_curve_is_no_branch_of_a_narrow_loop():
    """It begins in the middle of what the loop opens at zero, however little."""
    narrow = hj.models.PrandtlIshlinskii([0.0, 0.1], [1.0, 1.0])
    record = driven(polyline(0, 2, -2, 0, steps=200), narrow)
    found = loops.summary(record, begin="zero")
    np.testing.assert_allclose(found.remanence, 0.1, rtol=1e-9)
    assert np.all(np.isnan(found.coercivity)) and np.all(np.isnan(found.u_bias))
    # In the second cycle the branch that goes on is one.
    again = driven(polyline(0, 2, -2, 0, 2, -2, 0, 2, steps=200), narrow)
    second = loops.summary(again, begin="zero").isel(cycle=1)
    np.testing.assert_allclose(second.coercivity, 0.05, rtol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_two_lines_are_the_best_two(seed):
    """No knot on a fine grid leaves less."""
    rng = np.random.default_rng(seed)
    u = np.append(0.0, np.sort(rng.uniform(0, 1, 11)))
    w = np.append(0.0, np.cumsum(rng.uniform(0, 1, 11)))
    found = loops.bilinear(u, w)
    assert found.rmse == pytest.approx(
        np.sqrt(np.mean((w - np.interp(u, *_lines(found, u))) ** 2)), rel=1e-9
    )
    for knot in np.linspace(u[1], u[-2], 2000):
        columns = np.stack([np.minimum(u, knot), np.maximum(u - knot, 0)], axis=1)
        left = w - columns @ np.linalg.lstsq(columns, w)[0]
        assert found.rmse <= np.sqrt(np.mean(left**2)) * (1 + 1e-9)


def _lines(found, u):
    knot = found.u_yield
    far = found.w_yield + found.hardening * (u[-1] - knot)
    return [0, knot, u[-1]], [0, found.w_yield, far]


def test_what_is_nothing_is_off_by_no_per_cent():
    u = np.sin(np.linspace(0, 20, 2001))
    record = hj.Recording(None, u, 2 * u)
    run = hj.simulate(hj.models.PrandtlIshlinskii([0.0, 0.1], [1.0, 0.9]), record)
    cells = loops.table(loops.side_by_side(record, {"law": run}))
    shares = re.findall(r"\(([-+][\d.e]+) %\)", str(cells))
    assert shares and all(abs(float(share)) < 1e4 for share in shares)
