import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import hystjax as hj
from hystjax import InputError
from hystjax.signals import BandLimited, Cubic, Exact, Linear

RNG = np.random.default_rng(1)
EVEN = np.linspace(-1.0, 2.0, 25)
UNEVEN = np.sort(RNG.uniform(-1.0, 2.0, 25))


at = eqx.filter_jit(lambda path, times: path.at(times))
variation = eqx.filter_jit(lambda path: path.variation())


def path_of(interpolation, t, u):
    return interpolation.path(jnp.asarray(t, float), jnp.asarray(u, float))


# A multisine over one period of 2 s: amplitudes, harmonics and phases.
LINES = ((1.0, 1, 0.3), (0.5, 3, 1.0), (0.2, 7, -0.4))


def multisine(t, order=0):
    return sum(
        a * (np.pi * k) ** order * np.sin(np.pi * k * t + phase + order * np.pi / 2)
        for a, k, phase in LINES
    )


def growing(t):
    return t * jnp.sin(t)


# Where an even clock finds what `Reclocked` gives at 60 even times.
DENSE_CLOCK = np.linspace(0, 12, 60) + 0.5 * np.sin(np.linspace(0, 12, 60))


# ---------------------------------------------------------------- between samples


def test_times_in_lists():
    path = path_of(Linear(), [0.0, 1.0, 3.0], [0.0, 2.0, 1.0])
    u, du = path.at([0.5, 2.0])
    np.testing.assert_allclose([u, du], [[1.0, 1.5], [2.0, -0.5]])


@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("kind", ["linear", "cubic", "exact"])
def test_values_and_slopes_against_scipy(kind, t):
    u = np.sin(3 * t) + t**2
    spline = CubicSpline(t, u, bc_type="not-a-knot")
    interpolation, value, slope = {
        "linear": (Linear(), lambda s: np.interp(s, t, u), None),
        "cubic": (Cubic(), spline, spline.derivative()),
        "exact": (
            Exact(lambda s: jnp.sin(3 * s) + s**2),
            lambda s: np.sin(3 * s) + s**2,
            lambda s: 3 * np.cos(3 * s) + 2 * s,
        ),
    }[kind]
    path = path_of(interpolation, t, u)
    times = np.concatenate([RNG.uniform(t[0], t[-1], 40), t])
    ours, slopes = at(path, times)
    np.testing.assert_allclose(ours, value(times), rtol=0, atol=1e-12)
    if slope is not None:
        np.testing.assert_allclose(slopes, slope(times), rtol=0, atol=1e-9)
    np.testing.assert_allclose(path.samples()[0], u, rtol=0, atol=1e-13)


@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_linear_slopes_at_knots_are_right_limits(t):
    u = RNG.normal(size=len(t))
    slope = np.diff(u) / np.diff(t)
    expected = np.append(slope, slope[-1])
    path = path_of(Linear(), t, u)
    np.testing.assert_allclose(path.at(t)[1], expected, rtol=1e-12)
    np.testing.assert_allclose(path.samples()[1], expected, rtol=1e-12)
    # From inside an interval its own slope holds at both ends.
    for fraction in (0.0, 1.0):
        inside = jax.vmap(path.evaluate, in_axes=(0, None))
        got = inside(path.segments(), jnp.array(fraction))[1]
        np.testing.assert_allclose(got, slope, rtol=1e-12)


@pytest.mark.parametrize("substeps", [1, 3, 4])
def test_straight_lines_meet_their_samples_to_the_last_bit(substeps):
    """A relay may turn just there; and a rest moves nothing."""
    t = np.cumsum(RNG.uniform(0.01, 1, 300))
    u = np.round(RNG.normal(size=300), 1)
    u[100:200] = u[100]
    path = path_of(Linear(), t, u)
    np.testing.assert_array_equal(path.samples()[0], u)
    np.testing.assert_array_equal(at(path, t)[0], u)
    grid = path.grid(substeps)
    np.testing.assert_array_equal(grid.start.u[::substeps], u[:-1])
    np.testing.assert_array_equal(grid.end.u[substeps - 1 :: substeps], u[1:])
    np.testing.assert_array_equal(grid.end.u[:-1], grid.start.u[1:])
    for stage in (grid.start, grid.middle, grid.end):
        resting = stage.u[100 * substeps : 199 * substeps]
        np.testing.assert_array_equal(resting, u[100])


def test_cubic_is_exact_on_cubics():
    u = UNEVEN**3 - 2 * UNEVEN
    times = np.linspace(UNEVEN[0], UNEVEN[-1], 99)
    value, slope = at(path_of(Cubic(), UNEVEN, u), times)
    np.testing.assert_allclose(value, times**3 - 2 * times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(slope, 3 * times**2 - 2, rtol=0, atol=1e-11)


@pytest.mark.parametrize("n, factor", [(16, 8), (17, 16), (40, 8)])
def test_band_limited_follows_a_multisine_above_its_samples(n, factor):
    """Just above two samples a cycle of the highest line, where `Cubic` is lost."""
    t = np.arange(n) * 2.0 / n
    times = np.linspace(t[0], t[-1], 301)
    value, slope = at(path_of(BandLimited(factor), t, multisine(t)), times)
    # Errors of cubic splines of step h: about h^4 u''''/64 at the not-a-knot ends for
    # the value (Beatson and Chacko, 1992) and, for the slope, h^3 u''''/4.
    step, fourth = 2.0 / n / factor, np.max(np.abs(multisine(times, order=4)))
    assert np.max(np.abs(value - multisine(times))) < step**4 * fourth / 64
    assert np.max(np.abs(slope - multisine(times, order=1))) < step**3 * fourth / 4
    at_samples = path_of(BandLimited(factor), t, multisine(t)).samples()[0]
    np.testing.assert_allclose(at_samples, multisine(t), rtol=0, atol=1e-13)


@pytest.mark.parametrize("late", [1e6, 1.7e9])
def test_band_limited_slopes_do_not_round_times(late):
    """Such as seconds since 1970, of which an eighth of a sample is 50 roundings."""
    n = 20000
    t = np.arange(n) * 2.0 / n
    slope = path_of(BandLimited(), late + t, multisine(t)).samples()[1]
    # The length of the period is known to a rounding of its last time, which is `late`.
    wanted, rounding = multisine(t, order=1), late * 2.0**-52
    np.testing.assert_allclose(
        slope, wanted, rtol=0, atol=2 * rounding * np.max(np.abs(wanted)) + 1e-9
    )


@pytest.mark.parametrize(("factor", "n"), [(1, 16), (2, 16), (8, 16), (2, 15)])
def test_band_limited_meets_samples_with_the_highest_line(factor, n):
    """Of an even number of samples that is the Nyquist line, of an odd one it is not
    and counts whole."""
    t = np.arange(n) * 2.0 / n
    u = multisine(t) + 0.5 * np.cos(2 * np.pi * (n // 2) / n * np.arange(n))
    at_samples = path_of(BandLimited(factor), t, u).samples()[0]
    np.testing.assert_allclose(at_samples, u, rtol=0, atol=1e-13)


def test_band_limited_shares_the_nyquist_line():
    """(-1)^i is cos(pi n t / 2) and not a sine of any amplitude beside it."""
    n = 16
    t = np.arange(n) * 2.0 / n
    times = np.linspace(t[0], t[-1], 101)
    value, _ = at(path_of(BandLimited(64), t, (-1.0) ** np.arange(n)), times)
    np.testing.assert_allclose(value, np.cos(np.pi * n * times / 2), atol=1e-6)


def multisine_record():
    t = np.arange(40) / 20
    columns = t, multisine(t), np.zeros(40)
    return hj.Recording(*columns, interpolation=BandLimited(64))


@pytest.mark.parametrize(
    "select",
    [
        lambda r: r.window(7, 29),
        lambda r: r.window(7, 29).window(3, 12),
        lambda r: r.between(0.4, 1.31),
        lambda r: r.split(0.3)[1],
        lambda r: r.resample(np.linspace(0.1, 1.9, 57)),
        lambda r: r.resample(r.t[3:30:2]),
    ],
    ids=["window", "window of it", "between", "split", "finer", "coarser"],
)
def test_parts_keep_the_band_limited_interpolant_of_the_whole(select):
    """Of a multisine: a part is no whole period, and its own interpolant is another."""
    part = select(multisine_record())
    times = np.random.default_rng(2).uniform(part.t[0], part.t[-1], 99)
    value, slope = at(part.path, times)
    # Cubic splines of step h: 5/384 h^4 u for the value and h^3 u/24 for the
    # slope (Hall and Meyer, 1976), the ends of a period being like the rest of it.
    step, fourth = 0.05 / 64, np.max(np.abs(multisine(times, order=4)))
    bound = 5 / 384 * step**4 * fourth + 1e-13
    np.testing.assert_allclose(value, multisine(times), rtol=0, atol=2 * bound)
    wanted = multisine(times, order=1)
    np.testing.assert_allclose(slope, wanted, rtol=0, atol=step**3 * fourth / 12)


def test_windows_of_a_band_limited_record_drive_simulations_alike():
    whole = multisine_record()
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    method = hj.simulation.FixedStep(4)  # the same steps for both
    run = hj.simulate(law, whole, method=method).w
    later = hj.simulate(law, whole.window(10, 40), w0=run[10], method=method).w
    np.testing.assert_allclose(later, run[10:], rtol=0, atol=1e-9 * np.ptp(run))


# ------------------------------------------------------------------ turning points


def alternating(amplitude, n):
    return amplitude * (-1.0) ** np.arange(n)


def parabola(t):
    return (t - 1) ** 2


RAMP, ACROSS, BESIDE = np.arange(9.0), np.linspace(0, 2, 11), np.linspace(0, 2.3, 11)
PEAKS = np.pi * np.array([0.5, 1.5, 2.5])

TURNING = {
    "triangle": (Linear(), RAMP, [0, 1, 2, 1, 0, -1, 0, 1, 2], [2.0, 5.0]),
    "zigzag": (Linear(), RAMP, alternating(1, 9), np.arange(1.0, 8.0)),
    "plateau": (Linear(), RAMP, [0, 1, 1, 1, 0, 0, -1, -1, -1], [3.0]),
    "rest at first": (Linear(), RAMP, [0, 0, 0, 1, 2, 1, 1, 1, 0], [4.0]),
    "uneven ramp": (Linear(), RAMP, [0, 1, 1, 3, 4, 4, 9, 9, 9], []),
    "constant": (Linear(), RAMP, np.ones(9), []),
    "exact sine": (Exact(jnp.sin), np.linspace(0, 10, 40), None, PEAKS),
    "exact, at a sample": (Exact(parabola), np.linspace(0, 2, 9), None, [1.0]),
    "exact, late clock": (
        Exact(lambda t: jnp.sin(2 * jnp.pi * t)),
        1000 + np.arange(17) / 16,
        None,
        [1000.25, 1000.75],
    ),
    "exact rest": (Exact(lambda t: (t - 1) ** 3), np.linspace(0, 2, 9), None, []),
    "cubic, at a sample": (Cubic(), ACROSS, parabola(ACROSS), [1.0]),
    "cubic, between": (Cubic(), BESIDE, parabola(BESIDE), [1.0]),
}


@pytest.mark.parametrize("interpolation, t, u, expected", TURNING.values(), ids=TURNING)
def test_turning_points(interpolation, t, u, expected):
    u = jax.vmap(interpolation.function)(t) if u is None else u
    path = path_of(interpolation, t, u)
    times, values = path.turning_points()
    np.testing.assert_allclose(times, expected, rtol=0, atol=1e-11)
    np.testing.assert_allclose(values, path.at(np.asarray(expected, float))[0])


@pytest.mark.parametrize("interpolation", [Linear(), Cubic()], ids=["linear", "cubic"])
def test_a_decaying_sine_turns_twice_a_cycle_by_any_clock(interpolation):
    """In seconds since 1970 a thousandth is a few thousand roundings long."""
    t = np.arange(20000) * 1e-3
    u = np.exp(-t / 4) * np.sin(np.pi * t)
    times, values = path_of(interpolation, 1.7e9 + t, u).turning_points()
    peaks = (np.arange(20) * np.pi + np.arctan(4 * np.pi)) / np.pi
    np.testing.assert_allclose(times - 1.7e9, peaks, rtol=0, atol=2e-3)
    height = np.exp(-peaks / 4) * np.abs(np.sin(np.pi * peaks))
    np.testing.assert_allclose(np.abs(values), height, rtol=1e-4)


@given(st.integers(0, 24), st.floats(-1e-9, 1e-9) | st.floats(-0.1, 0.1))
def test_a_sampled_sine_turns_twice_a_cycle(shift, beside):
    """Whatever the phase, with samples on the peaks or within rounding of them."""
    t = np.linspace(0, 6 * np.pi, 121)
    phase = np.pi * (shift / 20) + beside
    times, values = path_of(Cubic(), t, np.sin(t + phase)).turning_points()
    expected = np.pi * (np.arange(9) + 0.5) - phase
    # Peaks beside the ends of the record may be in it or not.
    inside = (expected > 1e-3) & (expected < t[-1] - 1e-3)
    times = times[(times > 1e-3) & (times < t[-1] - 1e-3)]
    np.testing.assert_allclose(times, expected[inside], rtol=0, atol=1e-3)
    np.testing.assert_allclose(np.abs(values), 1, rtol=0, atol=1e-4)


@pytest.mark.parametrize("start, height", [(0, 0), (1.7e9, 0), (0, 1e6), (1.7e9, 1e6)])
def test_a_rest_on_the_way_up_is_no_turn(start, height):
    """Though rounding of the clock, or of the input, makes its slope negative."""
    for step in (0.113, 0.139, 0.152, 0.23, 0.243):
        t = np.arange(12) * step
        times, _ = path_of(
            Cubic(), start + t, height + (t - t[5]) ** 3
        ).turning_points()
        assert not times.size


# ----------------------------------------------------------------- total variation


def growing_variation(t):
    """V of t sin t from 0, by its extremes: where tan t = -t."""
    edges = np.arange(1, int(t[-1] / np.pi) + 2) * np.pi
    extremes = [
        brentq(lambda s: np.sin(s) + s * np.cos(s), b - np.pi / 2, b) for b in edges
    ]
    stops = [np.r_[0, [e for e in extremes if e < s], s] for s in t]
    return np.array([np.sum(np.abs(np.diff(s * np.sin(s)))) for s in stops])


def test_variation_against_closed_forms():
    t = np.linspace(0, 7 * np.pi, 100)
    exact = path_of(Exact(growing), t, growing(t))
    np.testing.assert_allclose(variation(exact), growing_variation(t), rtol=1e-12)

    sine = path_of(Exact(jnp.sin), t, np.sin(t))
    quarter = np.floor(t / np.pi + 0.5)
    by_hand = 2 * quarter + (-1) ** quarter * np.sin(t)
    np.testing.assert_allclose(variation(sine), by_hand, rtol=1e-12, atol=1e-13)

    u = RNG.normal(size=100)
    by_sum = np.r_[0, np.cumsum(np.abs(np.diff(u)))]
    np.testing.assert_allclose(variation(path_of(Linear(), t, u)), by_sum, rtol=1e-12)


def test_variation_of_cubic_paths_between_samples():
    t, u = UNEVEN, np.sin(5 * UNEVEN)
    spline = CubicSpline(t, u)
    turns = spline.derivative().roots(extrapolate=False)
    stops = np.sort(np.r_[t, turns])
    by_roots = np.r_[0, np.cumsum(np.abs(np.diff(spline(stops))))]
    expected = by_roots[np.searchsorted(stops, t)]
    np.testing.assert_allclose(variation(path_of(Cubic(), t, u)), expected, rtol=1e-11)


samples = st.lists(st.floats(-10, 10), min_size=12, max_size=12)
gaps = st.lists(st.floats(0.1, 5), min_size=12, max_size=12)


@given(samples, gaps, gaps)
def test_variation_does_not_depend_on_time(u, gaps, other_gaps):
    runs = [variation(path_of(Linear(), np.cumsum(g), u)) for g in (gaps, other_gaps)]
    np.testing.assert_allclose(*runs, rtol=0, atol=1e-10)


class Reclocked(eqx.Module):
    """t sin t by a clock that runs at an uneven speed."""

    speed: jax.Array
    start: jax.Array

    def clock(self, s):
        return self.speed * (s - self.start) + 0.5 * jnp.sin(
            self.speed * (s - self.start)
        )

    def __call__(self, s):
        return growing(self.clock(s))


@given(st.floats(0.2, 5), st.floats(-3, 3))
def test_variation_of_a_function_does_not_depend_on_its_clock(speed, start):
    slow = variation(path_of(Exact(growing), DENSE_CLOCK, growing(DENSE_CLOCK)))
    s = np.linspace(0, 12, 60) / speed + start
    function = Reclocked(jnp.array(speed), jnp.array(start))
    fast = variation(path_of(Exact(function), s, s))
    np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", [Linear(), Cubic()], ids=["linear", "cubic"])
@given(samples, gaps)
def test_variation_is_at_least_every_displacement(kind, u, gaps):
    v = np.asarray(variation(path_of(kind, np.cumsum(gaps), u)))
    moved = np.abs(np.subtract.outer(u, u))
    assert np.all(np.abs(np.subtract.outer(v, v)) >= moved - 1e-9 * (1 + v[-1]))


# --------------------------------------------------------------------- step grids

LONG, PERIOD = np.linspace(0, 20, 60), np.arange(40) / 20
PATHS = {
    "exact": (Exact(growing), LONG, LONG * np.sin(LONG)),
    "cubic": (Cubic(), UNEVEN, np.sin(5 * UNEVEN)),
    "cubic, turns at samples": (Cubic(), LONG, np.cos(np.pi * LONG * 59 / 200)),
    "band-limited": (BandLimited(), PERIOD, multisine(PERIOD)),
    "linear": (Linear(), UNEVEN, RNG.normal(size=25)),
}


@pytest.fixture(params=PATHS)
def path(request):
    return path_of(*PATHS[request.param])


@pytest.mark.parametrize("substeps", [2, 5])
def test_grid_steps_end_at_turning_points(path, substeps):
    grid = eqx.filter_jit(lambda path: path.grid(substeps))(path)
    steps, *stages = jax.device_get(tuple(grid))
    t, u, du = (np.stack(each, axis=1) for each in zip(*stages, strict=True))
    assert np.all(steps > 0)
    boundaries = path.t[0] + np.r_[0, np.cumsum(steps)]
    np.testing.assert_allclose(boundaries[::substeps], path.t, rtol=0, atol=1e-12)
    for turn in path.turning_points()[0]:
        assert np.min(np.abs(boundaries - turn)) < 1e-11

    # Stages are starts, middles and ends of steps, at the path's own values.
    starts, middles = boundaries[:-1], boundaries[:-1] + steps / 2
    times = np.stack([starts, middles, boundaries[1:]], axis=1)
    value, slope = map(np.asarray, at(path, times))
    np.testing.assert_allclose(t, times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(u, value, rtol=0, atol=1e-10)
    np.testing.assert_allclose(du[:, 1], slope[:, 1], rtol=0, atol=1e-8)
    # No step goes through a change of sign of du/dt.
    assert np.all(du[:, 0] * du[:, 2] >= -1e-10 * np.max(du**2))


def test_turning_points_are_jumps_or_samples(path):
    jumps = np.asarray(path.jumps())
    np.testing.assert_array_equal(jumps, np.sort(jumps))  # what is infinite comes last
    assert np.all(np.diff(jumps[np.isfinite(jumps)]) > 0)
    for turn in path.turning_points()[0]:
        assert np.min(np.abs(np.r_[jumps, path.t] - turn)) < 1e-12


# ---------------------------------------------------------- transformations, errors


@pytest.mark.parametrize("interpolation", [Linear(), Cubic(), BandLimited()], ids=repr)
def test_paths_batch_over_inputs(interpolation):
    inputs = jnp.asarray(RNG.normal(size=(3, 25)))

    def summary(u):
        path = interpolation.path(jnp.asarray(EVEN), u)
        middle = path.at(jnp.array([0.11, 0.57]))
        return middle, path.variation(), path.grid(2), path.jumps()

    single = eqx.filter_jit(summary)
    batched = eqx.filter_jit(jax.vmap(summary))(inputs)
    for i, u in enumerate(inputs):
        lane = jax.tree.map(lambda leaf, i=i: leaf[i], batched)
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9),
            lane,
            single(u),
        )


def test_path_gradients():
    """du/du_i of a linear path is its hat function."""

    def value(u):
        return Linear().path(jnp.asarray(EVEN), u).at(0.3)[0]

    hats = [np.interp(0.3, EVEN, row) for row in np.eye(25)]
    gradient = jax.grad(value)(jnp.asarray(np.sin(EVEN)))
    np.testing.assert_allclose(gradient, hats, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "interpolation, t, message",
    [
        (Cubic(), [0.0, 1.0, 2.0], r"at least 4 samples, got 3.*Linear"),
        (BandLimited(), [0.0, 1.0, 2.0, 4.0, 5.0], r"evenly sampled.*vary by.*Cubic"),
        (BandLimited(), [0.0, 1.0, 2.0], r"at least 4 samples, got 3"),
    ],
    ids=["short", "uneven", "short band-limited"],
)
def test_errors(interpolation, t, message):
    with pytest.raises(InputError, match=message):
        path_of(interpolation, t, np.sin(t))


def test_uneven_times_are_refused_as_the_recording_is_made():
    """Before verbs see them compiled, where no step can be told from another."""
    t = np.delete(EVEN, 7)
    with pytest.raises(InputError, match=r"evenly sampled.*vary by.*Cubic"):
        hj.Recording(t, np.sin(t), np.sin(t), interpolation=BandLimited())


def test_a_turn_within_rounding_of_a_sample_belongs_to_the_sample():
    """By a clock since 1970 it is no time of its own, to which a solver could step."""
    start, since = 1.7e9, np.arange(12.0)
    for beside, inside in (
        (0.0, 0),
        (1e-9, 0),
        (1e-7, 0),
        (-1e-7, 0),
        (1e-3, 1),
        (-1e-3, 1),
    ):
        path = path_of(Cubic(), start + since, (since - 5 - beside) ** 2)
        fractions = np.asarray(path.turning_fractions())
        turned = fractions[~np.isnan(fractions)]
        np.testing.assert_allclose(turned, [beside % 1] * inside)
        jumps = np.asarray(path.jumps())
        assert not np.any(np.isin(jumps, start + since))


def test_the_way_of_a_sine_has_the_derivative_by_its_frequency():
    """The integral of |u'|, in steps that end where the sine turns."""
    law, t = hj.models.SparseModel.from_terms({"|du|": 1.0}), np.linspace(0, 4, 81)

    def way(frequency):
        path = hj.excitation.Sine(1.0, frequency).path(t)
        steps = hj.simulation.FixedStep(8)
        return hj.simulate(law, path, w0=0.0, method=steps).w

    # Half waves that are over move nothing; the one that goes on is at sin(phase).
    phase = 2 * np.pi * t
    expected = phase * np.abs(np.cos(0.7 * phase))
    np.testing.assert_allclose(jax.jacfwd(way)(0.7), expected, atol=1e-3)
