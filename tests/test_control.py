"""Devices led along references: against the same loops written out in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import dlsim, lsim

import hystjax as hj
from hystjax import InputError
from hystjax.compensation import PID, Learning
from hystjax.simulation import FixedStep

H = 0.01
T = H * np.arange(201)
WANTED = np.sin(2 * T)
GAIN, TAU = 2.0, 0.3
PLANT = hj.models.SparseModel.from_terms({"w": -1 / TAU, "u": GAIN / TAU})
STATIC = hj.models.SparseModel.from_terms({"u": GAIN}, target="value")
STACK = hj.models.PrandtlIshlinskii([0.0, 0.1, 0.3], [0.5, 0.3, 0.2])
ROUGH = hj.models.PrandtlIshlinskii([0.0, 0.2], [0.6, 0.4])
LOOP = PID(kp=0.3, ki=4.0, kd=0.01, filter=0.02)
EXACT = FixedStep(8)
KEYS = jax.vmap(jax.random.key)(jnp.arange(3))


def relative(run):
    return np.asarray(run.value.error) / np.ptp(WANTED)


@pytest.fixture(scope="module")
def looped():
    return hj.control(PLANT, WANTED, T, feedback=LOOP, method=EXACT)


def test_a_loop_around_a_linear_plant_is_the_linear_system_that_it_is(looped):
    """The plant over straight inputs, the sampled loop and its delay as one matrix."""
    a = np.exp(-H / TAU)
    # u(t) = u + v t over an interval: what is reached by the constant, and by the ramp.
    ramp = GAIN * (1 - TAU / H * (1 - a))
    held = GAIN * (1 - a) - ramp
    kp, ki, kd, tau = 0.3, 4.0, 0.01, 0.02
    q = 1 / (tau + H)
    # The state: output, input, integral, error before, derivative.
    error = np.array([-1.0, 0, 0, 0, 0])
    slope = tau * q * np.eye(5)[4] + q * (error - np.eye(5)[3])
    integral = np.eye(5)[2] + ki * H * error
    u = kp * error + integral + kd * slope
    w = a * np.eye(5)[0] + held * np.eye(5)[1] + ramp * u
    matrix = np.stack([w, u, integral, error, slope])
    into = kp + ki * H + kd * q
    drive = np.array([ramp * into, into, ki * H, 1, q])[:, None]
    seen = np.eye(5)[:2]
    # Its first sample has no derivative.
    first = np.array([0, 0, 0, WANTED[0], 0])
    system = (matrix, drive, seen, np.zeros((2, 1)), H)
    _, found, _ = dlsim(system, WANTED[:, None], x0=first)
    np.testing.assert_allclose(looped.value.w, found[:, 0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(looped.value.u, found[:, 1], rtol=0, atol=1e-10)
    np.testing.assert_array_equal(looped.value.measured, looped.value.w)
    share = 100 * relative(looped)
    assert looped.stats["rms"] == pytest.approx(np.sqrt(np.mean(share**2)))
    assert looped.stats["largest"] == pytest.approx(np.max(np.abs(share)))


def test_a_loop_knows_uneven_times():
    """The derivative is over the interval that is past, the integral over the next."""
    t = np.linspace(0, 1.4, 201) ** 2
    wanted = np.sin(2 * t)
    loop = PID(kp=0.2, ki=4.0, kd=0.002, filter=0.02)
    run = hj.control(STATIC, wanted, t, feedback=loop).value
    inputs, z, before, slope = [0.0], 0.0, wanted[0], 0.0
    for k, ahead in enumerate(np.diff(t)):
        error = wanted[k] - GAIN * inputs[k]
        if k > 0:
            behind = t[k] - t[k - 1]
            slope = (0.02 * slope + error - before) / (0.02 + behind)
        z += 4.0 * ahead * error
        inputs.append(0.2 * error + z + 0.002 * slope)
        before = error
    np.testing.assert_allclose(run.u, inputs, rtol=0, atol=1e-12)


def test_what_is_learned_holds_the_noise_of_the_sensor():
    """From rest, the second input is the gain times what was measured the first."""
    scheme, size = Learning(0.2, repetitions=2), 0.1
    run = hj.control(STATIC, WANTED, T, learning=scheme, noise=size, key=KEYS[0]).value
    heard = np.asarray(run.u) / 0.2 - WANTED
    assert abs(np.std(heard) / size - 1) < 5 / np.sqrt(2 * len(T))
    again = np.asarray(run.measured - run.w)  # the second time it is another one
    assert abs(np.corrcoef(heard, again)[0, 1]) < 5 / np.sqrt(len(T))
    # Nor is an input learned that is beyond a limit.
    wanted, more = np.cos(2 * T), {"noise": 0.0, "key": KEYS[0], "limits": (-0.1, 0.1)}
    kept = hj.control(STATIC, wanted, T, learning=scheme, **more).value.u
    np.testing.assert_allclose(kept, np.clip(0.2 * wanted, -0.1, 0.1), atol=1e-12)


def test_an_exact_inverse_leaves_nothing():
    found = hj.invert(STACK, WANTED, T)
    for feedforward in (STACK, found, found.value, found.value.u):
        run = hj.control(STACK, WANTED, T, feedforward=feedforward)
        assert np.max(np.abs(relative(run))) < 1e-9
    # Of what flows the inverse is by roots.
    run = hj.control(PLANT, WANTED, T, feedforward=PLANT)
    assert np.max(np.abs(relative(run))) < 1e-9


def test_an_inverse_is_run_from_where_it_was_found():
    """Its first input is a leap back from the one at which the device rests."""
    found = hj.invert(STACK, WANTED, T, u0=1.0)
    assert abs(found.value.u[0] - 1.0) > 0.1
    run = hj.control(STACK, WANTED, T, feedforward=found)
    np.testing.assert_allclose(run.value.w, WANTED, rtol=0, atol=1e-12)


def test_what_flows_is_led_to_known_inputs_from_where_it_rests():
    """Its first sample keeps the input before; there is no leap to the known one."""
    known = 1.0 + 0.2 * T
    run = hj.control(PLANT, WANTED, T, feedforward=known, u0=0.25, method=EXACT).value
    inputs = np.concatenate([[0.25], known[1:]])
    straight = (np.array([[-1 / TAU]]), np.array([[GAIN / TAU]]), np.eye(1), [[0.0]])
    _, found, _ = lsim(straight, inputs, T, X0=WANTED[:1])
    np.testing.assert_array_equal(run.u, inputs)
    np.testing.assert_allclose(run.w, found, rtol=0, atol=1e-10)


def test_noise_is_the_sensors_alone():
    run = hj.control(STACK, WANTED, T, feedforward=STACK, noise=0.1, key=KEYS[0])
    assert np.max(np.abs(relative(run))) < 1e-9
    noise = np.asarray(run.value.measured - run.value.w)
    assert np.std(noise) == pytest.approx(0.1, rel=0.2)


def test_learning_contracts_by_what_the_gain_leaves():
    """On a slope: by 1 - gain * slope each time, for every error alike."""
    lessons = Learning(0.2, repetitions=6)
    run = hj.control(STATIC, WANTED, T, learning=lessons)
    expected = 0.6 ** np.arange(6)
    shares = np.asarray(run.stats["repetitions"] / run.stats["repetitions"][0])
    np.testing.assert_allclose(shares, expected, rtol=1e-12)
    np.testing.assert_allclose(
        run.value.error, -(0.6**5) * WANTED, rtol=1e-9, atol=1e-12
    )


def test_smoothing_shifts_nothing():
    """A low-pass run forwards and backwards: 1 / (1 + (w tau)^2) of a sine, as far as
    samples are dense and ends are far."""
    t = np.arange(0, 60, 0.005)
    some = Learning(1.0, smoothing=0.5)
    found = np.asarray(some.correction(jnp.asarray(t), jnp.asarray(np.sin(3 * t))))
    inside = (t > 10) & (t < 50)
    expected = np.sin(3 * t) / (1 + 1.5**2)
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-4)
    none = Learning(2.0).correction(jnp.asarray(t), jnp.asarray(t))
    np.testing.assert_array_equal(none, 2 * t)


def test_smoothing_knows_uneven_times():
    """Its low-pass in a loop, once each way: it forgets by the time between samples."""
    rng = np.random.default_rng(3)
    t, error = np.cumsum(rng.uniform(0.01, 0.3, 60)), rng.normal(size=60)

    def low_pass(times, x):
        out = [x[0]]
        for gap, now in zip(np.abs(np.diff(times)), x[1:], strict=True):
            kept = np.exp(-gap / 0.2)
            out.append(kept * out[-1] + (1 - kept) * now)
        return np.array(out)

    expected = 3 * low_pass(t[::-1], low_pass(t, error)[::-1])[::-1]
    lesson = Learning(3.0, smoothing=0.2)
    found = lesson.correction(jnp.asarray(t), jnp.asarray(error))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def noisy(key, loop=LOOP, scale=1.0):
    return hj.control(
        STACK, scale * WANTED, T, feedforward=ROUGH, feedback=loop, noise=0.01, key=key
    )


def test_many_are_run_side_by_side():
    seeds = jax.vmap(noisy)(KEYS)
    for i, key in enumerate(KEYS):
        alone = noisy(key)
        np.testing.assert_allclose(seeds.value.w[i], alone.value.w, atol=1e-12)
        assert seeds.stats["rms"][i] == pytest.approx(float(alone.stats["rms"]))
    assert len(np.unique(seeds.stats["rms"])) == len(KEYS)


@pytest.mark.slow
def test_gains_and_references_are_run_side_by_side():
    def cost(ki, scale):
        return noisy(KEYS[0], PID(ki=ki), scale).stats["rms"]

    gains, scales = jnp.array([1.0, 4.0]), jnp.array([1.0, 0.5])
    many = jax.vmap(cost)(gains, scales)
    each = [cost(*pair) for pair in zip(gains, scales, strict=True)]
    np.testing.assert_allclose(many, each, rtol=1e-9)


def test_the_cost_has_derivatives_in_the_gains():
    def cost(gains):
        loop = PID(gains[0], gains[1], gains[2], 0.02)
        return hj.control(PLANT, WANTED, T, feedback=loop).stats["rms"]

    here = jnp.array([0.3, 4.0, 0.01])
    slopes = jax.grad(cost)(here)
    for i, slope in enumerate(slopes):
        step = 1e-5 * jnp.eye(3)[i]
        expected = (cost(here + step) - cost(here - step)) / 2e-5
        assert slope == pytest.approx(float(expected), rel=1e-5)


def test_limits_are_kept_and_the_integral_waits():
    """An output that the plant can have with u = 0.4 at most, asked for 1: the integral
    stands still there, and the input leaves the limit as soon as the error turns."""
    wanted = np.where(T < 1, 1.0, 0.2)
    run = hj.control(STATIC, wanted, T, feedback=PID(ki=5.0), limits=(-0.4, 0.4))
    u, integral = np.asarray(run.value.u), np.asarray(run.stats["integral"])
    assert np.max(u) == 0.4 and np.max(integral) == 0.4
    full = np.flatnonzero(u == 0.4)
    assert run.stats["saturated"] == pytest.approx(len(full) / len(T))
    assert np.all(np.diff(integral[full]) == 0)
    asked_for_less = np.flatnonzero(T >= 1)[0]
    assert full[-1] <= asked_for_less + 1
    assert abs(run.value.error[-1]) < 0.01
    # Nor does the other limit, of the mirrored task, tell another tale.
    other = hj.control(STATIC, -wanted, T, feedback=PID(ki=5.0), limits=(-0.4, 0.4))
    np.testing.assert_allclose(other.value.u, -u, rtol=0, atol=1e-12)
    assert other.stats["saturated"] == run.stats["saturated"]
    # And a feedforward beyond them is not taken at its word, at the first sample too.
    beyond, more = 0.9 + 0 * T, {"feedback": PID(), "limits": (-0.4, 0.4)}
    held = hj.control(STATIC, wanted, T, feedforward=beyond, **more)
    np.testing.assert_array_equal(held.value.u, np.full(len(T), 0.4))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_integral_beyond_a_limit_keeps_what_it_holds(sign):
    """A feedforward leaps beyond the limit while the output is still short."""
    ahead = np.where(T < 1, 0.0, 0.6)
    run = hj.control(
        STATIC,
        sign * np.where(T < 1, 0.5, 1.0),
        T,
        feedforward=sign * ahead,
        feedback=PID(ki=5.0),
        limits=(-0.4, 0.4),
    )
    held = sign * np.asarray(run.stats["integral"])[T > 1.02]
    assert held[0] > 0.2
    np.testing.assert_array_equal(held, held[0])


def test_the_input_is_no_faster_than_it_may():
    run = hj.control(STATIC, WANTED, T, feedback=PID(ki=20.0), speed=0.5)
    assert np.max(np.abs(np.diff(run.value.u))) <= 0.5 * H * (1 + 1e-9)


def test_a_recording_is_a_reference_with_its_past():
    """Led through the second half of what it has done, by itself, a device errs not."""
    u = np.exp(-T) * np.sin(9 * T)
    still = hj.Recording(T, u, 0 * T)
    record = hj.Recording(T, u, hj.simulate(STACK, still, method=FixedStep(1)).w)
    later = record.window(100, 201)
    run = hj.control(STACK, later, feedforward=STACK)
    np.testing.assert_allclose(run.value.u, u[100:], atol=1e-9)
    assert np.max(np.abs(run.value.error)) < 1e-9
    blind = hj.control(STACK, later.afresh(), feedforward=later.u)
    assert np.max(np.abs(blind.value.error)) > 1e-3
    # By known inputs too, from where the recording says that the device is.
    known = hj.control(STACK, later, feedforward=later.u)
    assert np.max(np.abs(known.value.error)) < 1e-9


def test_a_loop_that_runs_away_says_so():
    run = hj.control(STATIC, WANTED, T, feedback=PID(kp=1e4))
    assert run.result == hj.RESULTS.diverged


def test_an_input_that_is_none_is_no_success():
    """A stack stays where it is where nothing pulls it."""
    run = hj.control(STACK, WANTED, T, feedback=PID(kp=np.inf))
    assert not np.all(np.isfinite(run.value.u)) and np.all(np.isfinite(run.value.w))
    assert run.result == hj.RESULTS.diverged


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"feedback": 3.0}, r"`feedback` must be a `.*PID` or None, got the number 3"),
        ({"learning": LOOP}, r"`learning` must be a `.*Learning` or None, got a PID"),
        ({"noise": 0.1}, "`noise` needs a `key`"),
        ({"noise": -0.1, "key": KEYS[0]}, "`noise` must be zero or more"),
        ({"noise": 0.1, "key": 3}, "`key` must be a key of `jax.random`"),
        ({"feedforward": WANTED[1:]}, "`reference` 201, `feedforward` 200"),
        ({"feedforward": []}, "`reference` 201, `feedforward` 0"),
        ({"feedforward": np.nan * T}, "`feedforward` has 201 value"),
        ({"limits": (1.0, 1.0)}, "`limits` must be two rising numbers"),
    ],
)
def test_arguments_that_are_none(options, message):
    with pytest.raises(InputError, match=message):
        hj.control(STATIC, WANTED, T, **options)


def test_a_reference_without_a_stroke_is_refused():
    with pytest.raises(InputError, match=r"`reference` is constant.*without a stroke"):
        hj.control(STATIC, np.full_like(WANTED, 0.2), T)


@pytest.mark.usefixtures("unchecked")
def test_devices_and_schemes_that_are_none():
    late = hj.models.Instrumented(STATIC, delay=0.1)
    with pytest.raises(InputError, match=r"comes late.*`device`"):
        hj.control(late, WANTED, T)
    with pytest.raises(InputError, match="`device` must be a model"):
        hj.control(WANTED, STATIC, T)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="`repetitions` counts the first run"):
        Learning(1.0, repetitions=0)
    with pytest.raises(InputError, match="`filter` must be zero or more"):
        PID(filter=-1.0)


def test_of_a_fit_the_model_leads_and_not_how_certain_it_is(monkeypatch):
    u = np.sin(3 * T)
    record = hj.Recording(T, u, 2 * u + 0.01 * np.cos(40 * T))
    fit = hj.refine(STATIC, record)
    assert "u_standard_errors" in hj.invert(fit, WANTED, T).stats

    def in_vain(*_):
        raise AssertionError

    monkeypatch.setattr("hystjax.inversion._invert._standard_errors", in_vain)
    runs = [hj.control(STATIC, WANTED, T, feedforward=x) for x in (fit, fit.value)]
    np.testing.assert_array_equal(runs[0].value.u, runs[1].value.u)
    gain = float(fit.value.parameters()["u"])
    np.testing.assert_allclose(runs[0].value.u, WANTED / gain, rtol=0, atol=1e-9)


def test_what_is_learned_beyond_a_limit_is_forgotten():
    """Two runs by a loop in NumPy: where the output falls short but comes closer, the
    derivative takes the input off its limit at once."""
    wanted, kd, high = np.cos(2 * T), 0.02, 0.1
    ahead = np.zeros_like(T)
    for _ in range(2):
        u, before = [ahead[0]], None
        for k in range(len(T) - 1):
            error = wanted[k] - GAIN * u[k]
            slope = 0.0 if before is None else (error - before) / H
            u.append(np.clip(ahead[k + 1] + kd * slope, -high, high))
            before = error
        ahead = np.clip(ahead + 3.0 * (wanted - GAIN * np.array(u)), -high, high)
    options = {"limits": (-high, high), "noise": 0.0, "key": KEYS[0]}
    schemes = {"learning": Learning(3.0, repetitions=2), "feedback": PID(kd=kd)}
    run = hj.control(STATIC, wanted, T, **schemes, **options)
    np.testing.assert_allclose(run.value.u, u, rtol=0, atol=1e-12)
