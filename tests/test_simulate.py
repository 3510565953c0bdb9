import functools
import itertools
import re

import diffrax
import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play
from hypothesis import given
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import hystjax as hj
from hystjax import RESULTS, ComputationError, InputError
from hystjax.models import BoucWen, Duhem, SparseModel
from hystjax.signals import Cubic, Exact, Linear
from hystjax.simulation import Adaptive, FixedStep

METHODS = pytest.mark.parametrize(
    "method", [Adaptive(), FixedStep(8)], ids=["adaptive", "fixed step"]
)

# ------------------------------------------------------------------------------ laws


def duhem(w, u, du):
    return 0.4 * abs(du) * u - 0.5 * abs(du) * w + 0.25 * du


def bouc_wen(n):
    def rate(w, u, du):
        drag = 0.25 * abs(du) * w * abs(w) ** (n - 1) + 0.5 * du * abs(w) ** n
        return 5 * du - drag

    return rate


def rate_dependent(w, u, du):
    return -0.2 - 2.4 * w + 0.6 * u + 0.1 * du - 0.08 * w * abs(w)


LAWS = {
    "Duhem": (Duhem(0.4, 0.5, 0.25), duhem),
    "Bouc-Wen": (BoucWen(5.0, 0.25, 0.5), bouc_wen(1)),
    "Bouc-Wen, n = 1.5": (BoucWen(5.0, 0.25, 0.5, 1.5), bouc_wen(1.5)),
    "Bouc-Wen, n = 2": (BoucWen(5.0, 0.25, 0.5, 2.0), bouc_wen(2)),
    "rate-dependent": (
        SparseModel.from_terms(
            {"1": -0.2, "w": -2.4, "u": 0.6, "du": 0.1, "w*|w|": -0.08}
        ),
        rate_dependent,
    ),
}

# ---------------------------------------------- inputs, with NumPy's and SciPy's word

T = np.linspace(0.0, 20.0, 101)
TRIANGLE = 2 * np.abs((T / 3) % 2 - 1) - 1
SAMPLED = np.sin(1.1 * T + 0.4)


def pieces_of_lines(u):
    """The input and its slope on every sample interval: one piece each."""
    slope = np.diff(u) / np.diff(T)
    for i, s in enumerate(slope):
        yield (
            T[i],
            T[i + 1],
            lambda t, i=i: u[i] + slope[i] * (t - T[i]),
            lambda t, s=s: s,
        )


def pieces_of(value, slope, turns):
    stops = np.sort(np.r_[T, [t for t in turns if T[0] < t < T[-1]]])
    for start, stop in itertools.pairwise(stops):
        if stop - start > 1e-12:
            yield start, stop, value, slope


def growing_slope(t):
    return np.sin(t) + t * np.cos(t)


SPLINE = CubicSpline(T, SAMPLED)
INPUTS = {
    "triangle": (Linear(), TRIANGLE, lambda: pieces_of_lines(TRIANGLE)),
    "sampled sine": (Linear(), SAMPLED, lambda: pieces_of_lines(SAMPLED)),
    "cubic": (
        Cubic(),
        SAMPLED,
        lambda: pieces_of(SPLINE, SPLINE.derivative(), SPLINE.derivative().roots()),
    ),
    "exact": (
        Exact(lambda t: t * jnp.sin(t) / 5),
        T * np.sin(T) / 5,
        lambda: pieces_of(
            lambda t: t * np.sin(t) / 5,
            lambda t: growing_slope(t) / 5,
            [brentq(growing_slope, b - np.pi / 2, b) for b in np.pi * np.arange(1, 8)],
        ),
    ),
}


@functools.cache
def reference(law, kind, w0):
    """SciPy's DOP853, started anew wherever the slope of the input is not smooth."""
    rate, (_, _, pieces) = LAWS[law][1], INPUTS[kind]
    w, times, values = w0, [T[0]], [w0]
    for start, stop, u, du in pieces():
        solved = solve_ivp(
            lambda t, w, u=u, du=du: rate(w, u(t), du(t)),
            (start, stop),
            [w],
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
        )
        w = solved.y[0, -1]
        times.append(stop)
        values.append(w)
    return np.array(values)[np.searchsorted(times, T - 1e-9)]


def recording_of(kind, w0):
    interpolation, u, _ = INPUTS[kind]
    return hj.Recording(T, u, np.full(len(T), w0), interpolation=interpolation)


def method_of(name, law):
    if name == "adaptive":
        return Adaptive(rtol=1e-9)
    # |w| has a kink at 0, inside steps: there the order is lost.
    return FixedStep(512 if "Bouc-Wen" in law else 8)


CASES = [
    (law, kind)
    for law in LAWS
    for kind in INPUTS
    if law != "rate-dependent" or kind in ("sampled sine", "exact")
]


@pytest.mark.parametrize("name", ["adaptive", "fixed step"])
@pytest.mark.parametrize("law, kind", CASES)
def test_trajectories_equal_scipy(law, kind, name):
    expected, method = reference(law, kind, 0.3), method_of(name, law)
    trajectory = hj.simulate(LAWS[law][0], recording_of(kind, 0.3), method=method)
    error = np.max(np.abs(trajectory.w - expected)) / np.max(np.abs(expected))
    assert error < 1e-7
    assert trajectory.result == RESULTS.successful
    np.testing.assert_array_equal(trajectory.t, T)
    np.testing.assert_allclose(trajectory.u, INPUTS[kind][1], rtol=0, atol=1e-12)


def test_kinks_in_sines_of_magnitudes_cost_no_accuracy():
    t = np.linspace(0, 5, 21)
    u, w = np.sin(3 * t), [0.2]
    for start, stop, slope in zip(t, t[1:], np.diff(u) / np.diff(t), strict=False):
        solved = solve_ivp(
            lambda _, x, slope=slope: slope - 0.8 * np.sin(3 * np.abs(x)),
            (start, stop),
            w[-1:],
            "DOP853",
            rtol=1e-12,
            atol=1e-13,
        )
        w.append(solved.y[0, -1])
    assert np.min(w) < 0 < np.max(w)
    law = SparseModel.from_terms({"du": 1.0, "sin(3.0*|w|)": -0.8})
    run = hj.simulate(law, hj.Recording(t, u, w))
    np.testing.assert_allclose(run.w, w, atol=5e-8)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_default_tolerance_knows_the_outputs_unit(unit):
    """w in another unit is the same run: its absolute tolerance is a share of w."""
    law = SparseModel.from_terms({"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25})
    other = {"u*|du|": 0.4 * unit, "w*|du|": -0.5, "du": 0.25 * unit}
    expected = reference("Duhem", "cubic", 0.3)
    record, size = recording_of("cubic", 0.3), np.max(np.abs(expected))
    scaled = eqx.tree_at(lambda r: r.w, record, unit * record.w)
    one = hj.simulate(law, record, method=Adaptive())
    two = hj.simulate(SparseModel.from_terms(other), scaled, method=Adaptive())
    np.testing.assert_allclose(two.w / unit, one.w, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(two.w / unit, expected, rtol=0, atol=1e-7 * size)
    few = abs(int(two.stats["num_steps"]) - int(one.stats["num_steps"]))
    assert few <= 0.01 * int(one.stats["num_steps"])


@pytest.mark.parametrize("kind", INPUTS)
def test_fixed_steps_keep_their_order_over_turning_points(kind):
    """Half the step, a sixteenth of the error, kinks or not."""
    expected = reference("Duhem", kind, 0.3)
    coarse, fine = (
        np.max(
            np.abs(
                hj.simulate(
                    LAWS["Duhem"][0],
                    recording_of(kind, 0.3),
                    method=FixedStep(substeps),
                ).w
                - expected
            )
        )
        for substeps in (2, 4)
    )
    assert 10 < coarse / fine < 25


# ----------------------------------------------------------------------- closed forms


def duhem_branch(u, start, w, alpha=0.4, beta=0.5, gamma=0.25):
    """Duhem's law along a monotone input from (start, w) to u: linear in w over u."""
    sign = np.where(u >= start, 1.0, -1.0)
    slope = alpha / beta
    offset = sign * (gamma - slope) / beta
    decay = np.exp(-sign * beta * (u - start))
    return slope * u + offset + (w - slope * start - offset) * decay


def duhem_along(u, extremes, counts, w0):
    """w at inputs u, of which `counts` have so many of the `extremes` before them."""
    corners = [(u[0], w0)]
    for extreme in extremes:
        corners.append((extreme, duhem_branch(extreme, *corners[-1])))
    return np.array([
        duhem_branch(x, *corners[count]) for x, count in zip(u, counts, strict=True)
    ])  # fmt: skip


@METHODS
def test_a_ramp_in_closed_form(method):
    t = np.linspace(0, 3, 50)
    for u in (2 * t - 1, 1 - t):
        recording = hj.Recording(t, u, np.full(50, -0.7))
        ours = hj.simulate(Duhem(0.4, 0.5, 0.25), recording, method=method).w
        np.testing.assert_allclose(ours, duhem_branch(u, u[0], -0.7), rtol=0, atol=1e-8)


QUARTER = 12  # samples a quarter of a period


@METHODS
@pytest.mark.parametrize("offset", [0.0, 1000.0])
@pytest.mark.parametrize("kind", ["cubic", "exact"])
@given(beside=st.floats(-1e-7, 1e-7) | st.sampled_from([0.0, 1e-16, -1e-15, 1e-13]))
def test_turning_points_at_samples(method, kind, offset, beside):
    """A sine sampled on its peaks, or within rounding of them, in closed form."""
    phases = np.pi / 2 * np.arange(8 * QUARTER + 1) / QUARTER + beside
    u = np.sin(phases)
    t = phases + offset
    if kind == "exact":
        shift = jnp.array(offset)
        interpolation, tolerance = Exact(Shifted(shift)), 1e-7
    else:
        interpolation, tolerance = Cubic(), 2e-4  # the spline is not the sine
    recording = hj.Recording(t, u, np.zeros(len(t)), interpolation=interpolation)
    ours = SIMULATE(Duhem(0.4, 0.5, 0.25), recording, method)
    extremes = [1.0, -1.0, 1.0, -1.0]
    counts = np.clip(np.floor(phases / np.pi + 0.5).astype(int), 0, 4)
    expected = duhem_along(u, extremes, counts, 0.0)
    assert ours.result == RESULTS.successful
    np.testing.assert_allclose(ours.w, expected, rtol=0, atol=tolerance)


def test_between_smooth_samples_outputs_are_not_interpolated():
    """Steps end at all of them, however little happens."""
    t = np.pi / 2 * np.arange(8 * QUARTER + 1) / QUARTER
    still = hj.Recording(t, 1e-3 * np.sin(t), 0 * t, interpolation=Cubic())
    ran = SIMULATE(Duhem(0.4, 0.5, 0.25), still, Adaptive())
    assert ran.stats["num_steps"] >= len(t) - 1


class Shifted(eqx.Module):
    """A sine by a clock that starts late."""

    offset: jax.Array

    def __call__(self, t):
        return jnp.sin(t - self.offset)


SIMULATE = eqx.filter_jit(
    lambda model, recording, method: hj.simulate(
        model, recording, method=method, throw=False
    )
)


@METHODS
@pytest.mark.parametrize("law", ["Duhem", "Bouc-Wen, n = 2"])
@given(st.floats(-3, 3))
def test_rate_independence(law, method, power):
    """Duhem's and Bouc and Wen's laws do not know how fast time runs."""
    runs = [
        SIMULATE(LAWS[law][0], hj.Recording(T * speed, TRIANGLE, TRIANGLE), method).w
        for speed in (1.0, 10.0**power)
    ]
    np.testing.assert_allclose(*runs, rtol=0, atol=1e-8 * np.max(np.abs(runs[0])))


@pytest.mark.parametrize(
    "solver",
    [
        diffrax.Kvaerno5(),
        pytest.param(diffrax.Kvaerno3(), marks=pytest.mark.slow),
    ],
    ids=repr,
)
def test_stiff_laws(solver):
    """w' = -5000 (w - u), u = sin t, in closed form."""
    t, speed = np.linspace(0, 6, 61), 5000.0
    law = SparseModel.from_terms({"w": -speed, "u": speed})
    recording = hj.Recording(t, np.sin(t), 0 * t, interpolation=Exact(jnp.sin))
    ours = hj.simulate(law, recording, method=Adaptive(solver, rtol=1e-9, atol=1e-11))
    settled = (speed**2 * np.sin(t) - speed * np.cos(t)) / (speed**2 + 1)
    expected = settled + speed / (speed**2 + 1) * np.exp(-speed * t)
    np.testing.assert_allclose(ours.w, expected, rtol=0, atol=1e-7)
    assert ours.stats["num_steps"] < 2000  # an explicit solver needs ten times more


# ------------------------------------------------------------------------- divergence

RUNAWAY = SparseModel.from_terms({"|du|": 1.0, "w^2*|du|": 1.0})  # w = tan V, V <= pi/2
RAMP = hj.Recording(np.linspace(0, 3, 31), np.linspace(0, 3, 31), np.zeros(31))


@METHODS
def test_an_input_that_is_none_is_no_success(method):
    """A stack stays where it is where nothing pulls it."""
    stack = hj.models.PrandtlIshlinskii([0.0, 0.2], [0.5, 0.3])
    path = hj.interpolation.Linear().path(RAMP.t, RAMP.u.at[7].set(jnp.nan))
    with pytest.raises(ComputationError, match=r"did not stay finite.* row [67]\."):
        hj.simulate(stack, path, method=method)


@pytest.mark.parametrize("make", [hj.interpolation.Linear, hj.interpolation.Cubic])
def test_a_path_of_whole_numbers_is_one_of_floats(make):
    whole = [0, 1, 3, 2, 0]
    stack = hj.models.PrandtlIshlinskii([0.0, 0.2], [0.5, 0.3])
    path = make().path(np.arange(5), whole)
    floats = hj.Recording(range(5), whole, whole, interpolation=make())
    np.testing.assert_array_equal(
        hj.simulate(stack, path).w, hj.simulate(stack, floats).w
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("error")  # of more steps, which would mend nothing
def test_a_number_that_is_none_is_named():
    nowhere = hj.models.Duhem(0.4, 0.5, 0.25).with_parameters({"beta": np.nan})
    for verb in (hj.simulate, hj.refine):
        with pytest.raises(ComputationError, match="given `beta` is nan"):
            verb(nowhere, hj.Recording(RAMP.t, RAMP.u, RAMP.u))


@METHODS
def test_divergence_is_reported_with_its_time(method):
    with pytest.raises(ComputationError) as caught:
        hj.simulate(RUNAWAY, RAMP, method=method)
    message = str(caught.value)
    time, row = re.search(r"lost at t = (.*) s, row (\d+)", message).groups()
    time, row = float(time), int(row)
    # Explicit steps of fixed length outrun the pole before they overflow.
    assert np.pi / 2 < time < np.pi / 2 + (0.1 if isinstance(method, Adaptive) else 1.5)
    np.testing.assert_allclose(RAMP.t[row], time, rtol=1e-5)
    assert "fewer terms" in message

    assert "model that was given" not in message

    quiet = hj.simulate(RUNAWAY, RAMP, method=method, throw=False)
    assert quiet.result == RESULTS.diverged
    assert quiet.w.shape == (31,)
    np.testing.assert_allclose(quiet.w[:13], np.tan(RAMP.t[:13]), rtol=1e-6)
    assert not np.any(np.isfinite(quiet.w[row:]))


@METHODS
def test_only_the_lane_that_diverges_is_lost(method):
    def lane(strength):
        law = eqx.tree_at(
            lambda m: m.coefficients, RUNAWAY, jnp.stack([jnp.array(1.0), strength])
        )
        return hj.simulate(law, RAMP, method=method, throw=False)

    batch = jax.vmap(lane)(jnp.array([-1.0, 1.0, -4.0]))
    lost = np.asarray(jax.vmap(lambda result: result == RESULTS.diverged)(batch.result))
    np.testing.assert_array_equal(lost, [False, True, False])
    np.testing.assert_allclose(batch.w[0], np.tanh(RAMP.t), rtol=0, atol=1e-6)
    np.testing.assert_allclose(batch.w[2], np.tanh(2 * RAMP.t) / 2, rtol=0, atol=1e-5)


def test_growth_without_end_is_no_want_of_steps():
    """It is lost on the way to inf, before ever shorter steps are tried."""
    law, record = Duhem(0.0, -300.0, 0.25), hj.Recording(T, TRIANGLE, TRIANGLE)
    assert SIMULATE(law, record, Adaptive()).result == RESULTS.diverged


def test_divergence_inside_jit():
    run = eqx.filter_jit(lambda law: hj.simulate(law, RAMP, method=FixedStep()).w)
    with pytest.raises(Exception, match="did not stay finite"):
        run(RUNAWAY).block_until_ready()


# ------------------------------------------------------------------- starts and errors


def test_the_start_is_the_recordings_unless_given():
    law, recording = Duhem(0.4, 0.5, 0.25), recording_of("triangle", 0.3)
    method = FixedStep()
    default = hj.simulate(law, recording, method=method).w
    np.testing.assert_array_equal(default[0], 0.3)
    given_start = hj.simulate(law, recording, w0=-1.0, method=method).w
    np.testing.assert_allclose(given_start[0], -1.0)
    bare = hj.simulate(law, recording.path, w0=-1.0, method=method).w
    np.testing.assert_allclose(bare, given_start, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "call, message",
    [
        (
            lambda: hj.simulate(Duhem(0.4, 0.5, 0.25), RAMP.path),
            "`w0`, the output at the first sample, is needed",
        ),
        (lambda: FixedStep(0), "`substeps` must be at least 1, got 0"),
        (
            lambda: hj.simulate(
                Duhem(0.4, 0.5, 0.25), recording_of("cubic", 0.0), method=FixedStep(1)
            ),
            "use `substeps=2` or more",
        ),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize("method", [FixedStep(1), hj.simulation.Automatic()])
def test_what_memory_makes_alone_needs_no_first_output(method):
    device = hj.models.PrandtlIshlinskii([0.0, 0.4], [1.0, 2.0])
    expected = np.asarray(RAMP.u) + 2 * play(np.asarray(RAMP.u), 0.4)
    for w0 in (None, 7.0):
        w = hj.simulate(device, RAMP.path, w0=w0, method=method).w
        np.testing.assert_allclose(w, expected, rtol=0, atol=1e-12)


# --------------------------------------------------------------- gradients and batches


@pytest.mark.parametrize(
    "law, kind, method",
    [
        pytest.param("Duhem", "cubic", Adaptive(rtol=1e-11), marks=pytest.mark.slow),
        ("Duhem", "cubic", FixedStep(8)),
        ("Bouc-Wen, n = 1.5", "triangle", FixedStep(8)),
    ],
)
def test_gradients_equal_differences(law, kind, method):
    """In the law's parameters, the start and the size of the input."""
    interpolation, u, _ = INPUTS[kind]
    numbers, structure = jax.tree.flatten(LAWS[law][0])
    weights = jnp.cos(np.arange(len(T)))

    @jax.jit
    def score(numbers, w0, size):
        path = interpolation.path(jnp.asarray(T), size * jnp.asarray(u))
        law = jax.tree.unflatten(structure, numbers)
        return weights @ hj.simulate(law, path, w0=w0, method=method, throw=False).w

    at = (tuple(numbers), jnp.array(0.3), jnp.array(1.2))
    flat, unravel = jax.flatten_util.ravel_pytree(at)
    ours, _ = jax.flatten_util.ravel_pytree(jax.grad(score, argnums=(0, 1, 2))(*at))
    step = 1e-4
    differences = [
        (score(*unravel(flat + step * e)) - score(*unravel(flat - step * e)))
        / (2 * step)
        for e in np.eye(len(flat))
    ]
    np.testing.assert_allclose(ours, differences, rtol=2e-5, atol=2e-5)


def test_gradients_at_rest_are_finite():
    """From w = 0, where |w|^n and its roots have their corner, written either way."""
    recording = recording_of("triangle", 0.0)
    laws = [BoucWen(5.0, 0.25, 0.5, 1.5)]
    laws.append(SparseModel.from_terms(laws[0].terms()))
    for law in laws:

        def score(law):
            return jnp.sum(hj.simulate(law, recording, method=FixedStep(4)).w)

        for leaf in jax.tree.leaves(eqx.filter_grad(score)(law)):
            assert np.all(np.isfinite(leaf)) and np.any(leaf != 0)


@pytest.mark.parametrize("law", [name for name in LAWS if name != "rate-dependent"])
def test_classical_laws_equal_their_sums_of_terms(law):
    classical, recording = LAWS[law][0], recording_of("cubic", 0.3)
    terms, method = SparseModel.from_terms(classical.terms()), FixedStep(8)
    np.testing.assert_allclose(
        hj.simulate(terms, recording, method=method).w,
        hj.simulate(classical, recording, method=method).w,
        rtol=0,
        atol=1e-12,
    )


@METHODS
def test_batches_of_laws_and_of_recordings(method):
    recording = recording_of("sampled sine", 0.3)
    betas, sizes = jnp.array([0.2, 0.5, 2.0]), jnp.array([0.5, 1.0, 3.0])

    def lane(beta, size):
        scaled = hj.Recording(T, size * SAMPLED, np.full(len(T), 0.3))
        return hj.simulate(Duhem(0.4, beta, 0.25), scaled, method=method, throw=False).w

    batch = jax.jit(jax.vmap(lane))(betas, sizes)
    for beta, size, w in zip(betas, sizes, batch, strict=True):
        alone = hj.simulate(
            Duhem(0.4, beta, 0.25), recording.with_input(size * SAMPLED), method=method
        )
        np.testing.assert_allclose(w, alone.w, rtol=0, atol=1e-8)


@METHODS
def test_single_precision(method):
    expected = reference("Duhem", "triangle", 0.3)
    with jax.enable_x64(False):
        recording = recording_of("triangle", 0.3)
        ours = hj.simulate(Duhem(0.4, 0.5, 0.25), recording, method=method)
        assert ours.w.dtype == jnp.float32
    np.testing.assert_allclose(ours.w, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("lagging", [{}, {"lag(u,1.5e-3)": 200.0, "w": -40.0}])
def test_short_steps_of_a_late_clock(lagging):
    """Seconds since 1970 are rounded by a part of each step, and less what lags."""
    late = 1.7e9 + np.arange(60) * 1e-4
    u = np.cumsum(np.random.default_rng(3).normal(size=60))
    law = SparseModel.from_terms({"du": 0.3, "w*|du|": -0.5} | lagging)
    found, expected = (
        hj.simulate(law, hj.Recording(t, u, 0 * u), method=Adaptive()).w
        for t in (late, late - late[0])
    )
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, atol=(1e-4 if lagging else 1e-9) * size)


def test_a_mask_does_not_change_the_law():
    """Terms off the support, with whatever coefficients, take no part."""
    library = hj.library.Polynomial(2)
    support = np.isin(library.names, ["du", "w*|du|", "u*|du|"])
    full = dict(zip(library.names, np.arange(1.0, 22.0), strict=True))
    full.update({"du": 0.25, "w*|du|": -0.5, "u*|du|": 0.4})
    masked = SparseModel(library, jnp.array(list(full.values())), jnp.asarray(support))
    recording = recording_of("triangle", 0.3)
    for method in (Adaptive(), FixedStep(8)):
        ours = SIMULATE(masked, recording, method).w
        np.testing.assert_allclose(
            ours, reference("Duhem", "triangle", 0.3), rtol=0, atol=1e-7
        )


def test_the_first_output_is_one_number():
    law = Duhem(0.4, 0.5, 0.25)
    path = hj.Recording(T, SAMPLED, SAMPLED)
    expected = hj.simulate(law, path, w0=0.3).w
    found = hj.refine(law, hj.Recording(T, SAMPLED, expected))
    # What `refine` knows of one recording can be given as it is.
    ran = hj.simulate(law, path, w0=found.stats["w0"])
    assert ran.w.shape == expected.shape
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-6)
    for w0 in ([0.1, 0.2], [], np.zeros((2, 1))):
        for verb in (hj.simulate, hj.judge):
            with pytest.raises(InputError, match=r"`w0` must be one number.*shape \("):
                verb(law, path, w0=jnp.asarray(w0))
