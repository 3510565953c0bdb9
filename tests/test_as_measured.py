"""Laws are judged and fitted as the device was measured: settled under a periodic
input, after a lead-in, and across dropouts."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.models import BoucWenOscillator, SparseModel
from hystjax.recording._as_measured import led_in, noise_on_all
from hystjax.regression.formulation import Direct, Pointwise, WeakForm
from hystjax.simulation import FixedStep, metrics

N = 120
T = 0.1 * np.arange(N)
PHASE = 2 * np.pi * np.arange(N) / N
U = np.sin(PHASE) + 0.3 * np.sin(3 * PHASE + 1)
W = np.cos(PHASE) + 0.1 * np.sin(5 * PHASE)
REC = hj.Recording(T, U, W)
METHOD = FixedStep(2)
RANDOM = np.random.default_rng(0)


def tiled(times):
    t = 0.1 * np.arange(times * N)
    return hj.Recording(t, np.tile(U, times), np.tile(W, times))


def duhem(*coefficients):
    return SparseModel.from_terms(
        dict(zip(("du", "u*|du|", "w*|du|"), coefficients, strict=True))
    )


# ------------------------------------------------------------------------- the steady


BOTH = np.ones(2, bool)
PLAYS = hj.library.Play([0.2, 0.6])
MODELS = {
    "law": duhem(0.4, 0.5, -0.6),
    "plays": SparseModel(PLAYS, jnp.array([1.0, 0.5]), BOTH, target="value"),
    "oscillator": BoucWenOscillator(1.0, 0.8, 2.0, 3.0, 2.0, -1.5),
}


@pytest.mark.parametrize(
    "name", ["law", "oscillator", pytest.param("plays", marks=pytest.mark.slow)]
)
def test_a_periodic_record_is_judged_as_the_last_of_ten_periods(name):
    model = MODELS[name]
    judged = hj.judge(model, REC, periodic=True, method=METHOD)
    by_hand = hj.simulate(model, tiled(10), method=METHOD).w[-N:]
    np.testing.assert_allclose(judged.trajectory.w, by_hand, atol=1e-12)
    for error in ("nrmse", "r2", "max_error"):
        expected = float(getattr(metrics, error)(W, np.asarray(by_hand)))
        assert float(judged.errors[error]) == pytest.approx(expected, rel=1e-10)
    np.testing.assert_array_equal(judged.trajectory.t, T)
    assert judged.succeeded and float(judged.trajectory.stats["unsettled"]) < 1e-3


def lag(tau):
    return SparseModel.from_terms({"u": 1 / tau, "w": -1 / tau})


def steady_lag(tau):
    """Of sin t, at which w' = (u - w) / tau comes round."""
    return (np.sin(PHASE) - tau * np.cos(PHASE)) / (1 + tau**2)


def of_sine(w):
    return hj.Recording(PHASE, 0 * PHASE, w).with_input(jnp.sin)


def test_the_steady_state_of_a_lag_is_its_closed_form():
    w = steady_lag(1.0)
    judged = hj.judge(lag(1.0), of_sine(w), w0=5.0, periodic=True, method=METHOD)
    assert float(judged.errors["max_error"]) < 1e-6


@pytest.mark.parametrize("share", [5e-4, 2e-3, 10.0])  # of the output's range
def test_what_has_not_settled_is_told(share, recwarn):
    tau, period = 40.0, 2 * np.pi
    w = steady_lag(tau)
    # From w0 each period leaves a share of what there was to forget.
    left = np.exp(-8 * period / tau) * (1 - np.exp(-period / tau))
    apart = share * np.ptp(w)
    start = w[0] + apart / left
    run = hj.judge(lag(tau), of_sine(w), w0=start, periodic=True, method=METHOD)
    assert float(run.trajectory.stats["unsettled"]) == pytest.approx(apart, rel=1e-3)
    said = [str(each.message) for each in recwarn]
    assert any("not settled" in each and "`lead_in`" in each for each in said) == (
        share > 1e-3
    )


@pytest.mark.slow
def test_batches_of_laws_are_judged_in_their_steady_state():
    rec = of_sine(steady_lag(1.0))

    def error(tau):
        judged = hj.judge(lag(tau), rec, w0=0.0, periodic=True, method=METHOD)
        return judged.errors["rmse"]

    def lag(tau):
        ones = jnp.stack([-1 / tau, 1 / tau])
        library = hj.library.Polynomial(1, ("w", "u"), constant=False)
        return SparseModel(library, ones, np.ones(2, bool))

    taus = np.array([0.5, 1.0])
    apart = np.sqrt(np.mean((steady_lag(0.5) - steady_lag(1.0)) ** 2))
    found = jax.vmap(error)(jnp.asarray(taus))
    np.testing.assert_allclose(found, [apart, 0.0], atol=1e-6)


# ------------------------------------------------------------------------- a lead-in


@pytest.mark.parametrize("how", [{"lead_in": 80}, {"periodic": True}])
def test_a_first_output_without_weight_may_be_anything_behind_a_lead_in(how):
    """It begins the run all the same, and is then like one that has weight."""
    model, weight = MODELS["law"], np.ones(N)
    weight[0] = 0.0
    w = np.asarray(hj.judge(model, REC, periodic=True, method=METHOD).trajectory.w)
    w = w + 0.01 * np.random.default_rng(0).normal(size=N)
    fits = []
    for first in (w[0], 99.0):
        record = hj.Recording(T, U, np.append(first, w[1:]))
        found = hj.refine(model, record, weights=[weight], substeps=2, **how)
        fits.append((found.value.coefficients, found.stats["standard_errors"]))
    (one, errors), (other, _) = fits
    np.testing.assert_array_less(np.abs(one - other), np.array([*errors.values()]))


@pytest.mark.slow
def test_a_mass_that_starts_from_rest_has_settled_in_the_period_that_is_fitted():
    """Though that differs from the one before."""
    model, t = BoucWenOscillator(1.0, 0.2, 2.0, 3.0, 2.0, -1.5), 0.1 * np.arange(2048)
    u = 2 * np.sin(np.pi * t / 6.4) + np.cos(np.pi * t / 2.56)
    whole = hj.simulate(model, hj.Recording(t, u, 0 * u), method=METHOD)
    record = hj.Recording(t[:512], u[:512], whole.w[-512:])
    rest = np.max(np.abs(whole.w[512:1024] - whole.w[:512]))
    assert rest > 0.1 * np.ptp(record.w)
    fixed = [name for name in model.parameters() if name != "mass"]
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "the law has not settled")
        found = hj.refine(model, record, periodic=True, fixed=fixed, substeps=2)
    assert float(found.value.mass) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.slow
def test_a_fit_says_that_one_period_is_too_few_to_settle_in():
    """Of a lag of three periods, which starts at the first input, under straight lines
    by hand for as long as it takes."""
    tau, step, z = 3 * N * 0.1, 0.1, U[0]
    fades, settled = np.exp(-step / tau), []
    for before, after in zip(
        U.tolist() * 60, [*U[1:].tolist(), U[0]] * 60, strict=True
    ):
        settled.append(z)
        behind = (after - before) * tau / step
        z = after - behind + (z - before + behind) * fades
    w = 1.3 * np.array(settled[-N:]) + 0.2 * U
    library = hj.library.Lag([tau]) + hj.library.Polynomial(1, ("u",), constant=False)
    model = SparseModel(library, jnp.array([1.0, 0.1]), BOTH, target="value")
    record, lag = hj.Recording(T, U, w), f"lag(u,{tau!r})"
    fixed = {
        "periodic": True,
        "fixed": [name for name in model.parameters() if "time" in name],
    }
    with pytest.warns(UserWarning, match="not settled.*Give a longer `lead_in`"):
        short = hj.refine(model, record, **fixed).value.terms()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        long = hj.refine(model, record, lead_in=30 * N, **fixed).value.terms()
    assert not any("not settled" in str(each.message) for each in said)
    assert abs(short[lag] - 1.3) > 0.05
    assert long[lag] == pytest.approx(1.3, rel=1e-3)


def test_a_lead_in_is_fitted_as_weights_of_zero_and_as_a_period_before():
    two = tiled(2)
    by_hand = [np.repeat([0.0, 1.0], N)]
    start = duhem(0.3, 0.4, -0.5)
    fits = []
    for recording, settings in (
        (two, {"weights": by_hand, "free_start": False}),
        (two, {"lead_in": N}),
        (REC, {"periodic": True}),
        (REC, {"periodic": True, "weights": [np.full(N, 4.0)]}),
    ):
        fits.append(hj.refine(start, recording, substeps=1, **settings))
    values = [list(map(float, fit.value.parameters().values())) for fit in fits]
    np.testing.assert_allclose(values[1], values[0], rtol=1e-12)
    # Times before the first sample are the same but for their rounding.
    np.testing.assert_allclose(values[2:], 2 * [values[0]], rtol=1e-9)
    left = [float(fit.stats["rmse"][0]) for fit in fits]
    np.testing.assert_allclose(left, left[0], rtol=1e-12)
    # What it left is what `judge` finds behind the same lead-in.
    judged = hj.judge(
        *(fits[0], two), w0=fits[0].stats["w0"], lead_in=N, method=FixedStep(1)
    )
    assert float(judged.errors["rmse"]) == pytest.approx(left[0], rel=1e-9)


def test_a_lead_in_is_no_place_to_fit_noise_from():
    """A settled device with noise, its period begun at either of two places: the law
    forgets within a period, and where it starts makes next to no difference."""
    run = hj.simulate(duhem(0.3, 0.4, -0.9), tiled(8), w0=0.0, method=METHOD)
    settled, noise = np.asarray(run.w[-N:]), np.random.default_rng(0).normal(size=N)
    noisy = settled + 0.02 * np.std(settled) * noise
    found = []
    for first in (0, N // 3):
        record = hj.Recording(REC.t, np.roll(U, first), np.roll(noisy, first))
        fit = hj.refine(
            duhem(0.4, 0.3, -0.7), record, periodic=True, lead_in=3 * N, substeps=1
        )
        assert float(fit.stats["w0"][0]) == pytest.approx(float(record.w[0]), abs=1e-12)
        judged = hj.judge(
            *(fit.value, record), periodic=True, lead_in=3 * N, method=FixedStep(1)
        )
        left = float(fit.stats["rmse"][0])
        assert float(judged.errors["rmse"]) == pytest.approx(left, rel=1e-6)
        found.append([float(x) for x in fit.value.parameters().values()])
    np.testing.assert_allclose(*found, rtol=1e-5)


def test_a_lead_in_goes_round_as_often_as_it_takes():
    whole, weights = led_in(REC, jnp.asarray(W), 250, periodic=True)
    rows = np.arange(-250, N) % N
    np.testing.assert_array_equal(whole.u, U[rows])
    np.testing.assert_array_equal(whole.w, W[rows])
    np.testing.assert_allclose(whole.t, 0.1 * np.arange(-250, N), atol=1e-12)
    np.testing.assert_array_equal(weights, np.where(np.arange(-250, N) < 0, 0, W[rows]))
    past = whole.past
    np.testing.assert_array_equal(past.u, U[np.arange(-250 - N, -250) % N])
    np.testing.assert_allclose(past.t, 0.1 * np.arange(-250 - N, -250), atol=1e-12)


# -------------------------------------------------------------------------- dropouts

GONE = slice(40, 55)
SPOILT = np.where((np.arange(N) >= 40) & (np.arange(N) < 55), np.nan, W)


def test_dropouts_are_bridged_by_straight_lines_of_no_weight():
    holes = SPOILT.copy()
    holes[[0, -1]] = np.nan
    with pytest.warns(UserWarning, match="first 1 values of `w` are NaN"):
        rec, weight = hj.bridged(T, U, holes, units=("V", "µm"))
    known = ~np.isnan(holes)
    np.testing.assert_array_equal(weight, known)
    np.testing.assert_allclose(rec.w, np.interp(T, T[known], holes[known]))
    assert rec.units == ("V", "µm")
    unclocked, _ = hj.bridged(None, U, SPOILT)
    np.testing.assert_allclose(unclocked.w[GONE], np.linspace(W[39], W[55], 17)[1:-1])
    with pytest.raises(hj.InputError, match=r"`hystjax\.bridged` makes a recording"):
        hj.Recording(T, U, SPOILT)
    with pytest.raises(hj.InputError, match="3 are needed"):
        hj.bridged(T, U, np.where(np.arange(N) < 2, W, np.nan))


def test_a_first_output_that_is_not_known_is_told():
    """From a value that stands in its place the very law would be judged to be off."""
    run = hj.simulate(MODELS["law"], hj.Recording(T, U, W), method=METHOD).w
    holes = np.where(np.arange(N) < 12, np.nan, run)
    with pytest.warns(UserWarning, match=r"window\(12, 120\).*weights\[12:\].*w0"):
        rec, weight = hj.bridged(T, U, holes)
    begun = hj.judge(MODELS["law"], rec, weights=weight, w0=run[0], method=METHOD)
    part, weight = rec.window(12, 120), weight[12:]
    later = hj.judge(MODELS["law"], part, weights=weight, method=METHOD)
    for judged in (begun, later):
        np.testing.assert_allclose(judged.errors["max_error"], 0, atol=1e-12)


def test_dropouts_are_simulated_through_and_not_judged():
    rec, weight = hj.bridged(T, U, SPOILT)
    judged = hj.judge(MODELS["law"], rec, weights=weight, lead_in=10, method=METHOD)
    rows = np.setdiff1d(np.arange(10, N), np.arange(40, 55))
    off = np.asarray(judged.trajectory.w)[rows - 10] - W[rows]
    whole = hj.simulate(MODELS["law"], rec, method=METHOD)
    np.testing.assert_array_equal(judged.trajectory.w, whole.w[10:])
    np.testing.assert_array_equal(judged.recording.t, T[10:])
    assert float(judged.errors["rmse"]) == pytest.approx(np.sqrt(np.mean(off**2)))
    assert float(judged.errors["max_error"]) == pytest.approx(np.max(np.abs(off)))
    assert float(judged.errors["nrmse"]) == pytest.approx(
        np.sqrt(np.mean(off**2)) / np.ptp(W[rows])
    )
    assert f"Judgement of {len(rows)} of {N - 10} samples" in repr(judged)


def test_weights_in_metrics_are_repeated_samples():
    counts = RANDOM.integers(0, 4, N)
    w_hat = W + RANDOM.normal(size=N)
    again = np.repeat(W, counts), np.repeat(w_hat, counts)
    spoilt = np.where(counts > 0, w_hat, np.nan)
    for name in ("rmse", "nrmse", "max_error", "relative_error", "r2"):
        measure = getattr(metrics, name)
        found, expected = measure(W, spoilt, counts), measure(*again)
        np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=name)


def test_regression_is_that_of_the_equations_without_dropouts():
    """By NumPy, whose `gradient` is the three-point difference."""
    w = W + 0.01 * RANDOM.normal(size=N)
    rec, weight = hj.bridged(T, U, np.where(np.isnan(SPOILT), np.nan, w))
    found = hj.identify(
        [rec, hj.Recording(T, U, 100 * W)],
        hj.library.Duhem(),
        hj.regression.LeastSquares(),
        weights=[weight, np.full(N, 1e-4)],
    )
    du = np.gradient(U, T, edge_order=2)

    def equations(w, weights):
        speed = np.abs(du)
        columns = {"du": du, "|du|": speed, "w*|du|": w * speed, "u*|du|": U * speed}
        left = np.stack([columns[name] for name in found.value.library.names], axis=1)
        root = np.sqrt(weights)
        return root[:, None] * left, root * np.gradient(w, T, edge_order=2)

    first = np.asarray(weight).copy()
    first[[39, 55]] = 0  # whose differences would look into the gap
    both = equations(np.asarray(rec.w), first), equations(100 * W, np.full(N, 1e-4))
    rows, targets = map(np.concatenate, zip(*both, strict=True))
    expected = np.linalg.lstsq(rows, targets, rcond=None)[0]
    np.testing.assert_allclose(found.value.coefficients, expected, rtol=1e-9)
    # Of mean 1 where they count, so that a ridge means the same whatever their scale.
    counted = np.concatenate([first, np.full(N, 1e-4)])
    triangle = found.stats["problem"].triangle
    mean = np.mean(counted[counted > 0])
    np.testing.assert_allclose(triangle.T @ triangle, rows.T @ rows / mean, rtol=1e-9)


@pytest.mark.parametrize("half_width", [3, 40])
def test_an_equation_counts_as_the_least_sample_it_looks_at(half_width):
    x = RANDOM.uniform(size=N)
    weak = WeakForm(half_width)
    library = hj.library.Duhem()
    rows, _ = jax.eval_shape(lambda w: weak.equations(library, REC.path, w), REC.w)
    stride = max(1, half_width // 16)
    starts = range(0, N - 2 * half_width, stride)
    brute = [x[i : i + 2 * half_width + 1].min() for i in starts]
    assert rows.shape[0] == len(brute)
    np.testing.assert_array_equal(weak.weights(jnp.asarray(x)), brute)
    np.testing.assert_array_equal(Direct().weights(jnp.asarray(x)), x)


@pytest.mark.parametrize(
    "how",
    [hj.differentiation.FiniteDifference(), hj.differentiation.SavitzkyGolay(7, 2)],
)
def test_an_estimate_counts_as_the_least_sample_that_changes_it(how):
    """At the ends too, where windows are off their centre: by its derivative in every
    sample."""
    x = RANDOM.uniform(size=N)
    t = np.cumsum(RANDOM.uniform(0.5, 1.5, size=N))
    value, slope = jax.jacfwd(lambda y: how.estimate(t, y))(REC.w)
    looks = (np.abs(value) > 1e-9) | (np.abs(slope) > 1e-9)
    looks |= np.eye(N, dtype=bool)  # the middle one has no part in even differences
    least = np.min(np.where(looks, x, np.inf), axis=1)
    counted = np.asarray(Pointwise(how).weights(jnp.asarray(x)))
    assert np.all(counted <= least)
    inside = np.arange(N)[how.reach : N - how.reach]
    np.testing.assert_array_equal(counted[inside], least[inside])


@pytest.mark.parametrize("row", [2, N - 3])
def test_dropouts_near_the_ends_do_not_count(row):
    """A sample far off of no weight, and one that is right."""
    spoilt = W.copy()
    spoilt[row] += 5
    weight = np.ones(N)
    weight[row] = 0
    laws = [
        hj.identify(
            hj.Recording(T, U, w),
            hj.library.Duhem(),
            hj.regression.LeastSquares(),
            weights=[weight],
        ).value
        for w in (W, spoilt)
    ]
    np.testing.assert_array_equal(laws[0].coefficients, laws[1].coefficients)


# --------------------------------------------------------------------------- refusals


UNEVEN = hj.Recording(np.sqrt(1 + np.arange(N)), U, W)
CLOSED = {
    # As `linspace` with its end makes it of a device whose output is noisy, and as a
    # loop is that was closed by its first row, here from a tip on.
    "passing": (np.sin, RANDOM.normal(size=N + 1)),
    "tip": (np.cos, np.cos(2 * np.pi * np.arange(N + 1) / N - 0.3)),
}


@pytest.mark.parametrize("name", CLOSED)
def test_a_last_row_that_is_the_first_again_is_told(name):
    wave, w = CLOSED[name]
    rec = hj.Recording(
        np.linspace(0, 2, N + 1), wave(np.linspace(0, 2 * np.pi, N + 1)), w
    )
    with pytest.warns(UserWarning, match="its first again.*without that row"):
        led_in(rec, None, 0, periodic=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        led_in(rec.window(0, N), None, 0, periodic=True)


def test_band_limited_inputs_are_of_whole_periods():
    """Of a sine that is cut, or a row too long, they would ring between the samples."""
    way = hj.interpolation.BandLimited()
    exact = hj.Recording(T, U, W, interpolation=way).path.at(T[:-1] + 0.02)[0]
    phase = 2 * np.pi * (T[:-1] + 0.02) / (0.1 * N)
    expected = np.sin(phase) + 0.3 * np.sin(3 * phase + 1)
    np.testing.assert_allclose(exact, expected, atol=1e-5)
    part = slice(0, 100)
    with pytest.raises(hj.InputError, match=r"BandLimited` takes whole.*or use.*Cubic"):
        hj.Recording(T[part], U[part], W[part], interpolation=way)
    with pytest.warns(UserWarning, match="BandLimited` goes on.*one sample too long"):
        hj.Recording(
            np.append(T, 0.1 * N),
            *(np.append(x, x[0]) for x in (U, W)),
            interpolation=way,
        )


@pytest.mark.parametrize(
    "u",
    [
        np.cos(PHASE + np.pi / N),  # two samples beside the tip
        np.round(5 * np.sin(PHASE)),  # of few levels
        np.clip(2 * np.cos(PHASE), -1, 1),  # held
        # Hardly moving at first, and fast at the end.
        np.append(np.linspace(0, 1, N - 1) ** 4, -1e-7) - 2 * (np.arange(N) == N - 2),
    ],
)
def test_inputs_that_are_alike_at_both_ends_may_be_two_samples(u):
    rec = hj.Recording(T, u, u + 0.1 * np.sin(PHASE))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        led_in(rec, None, 0, periodic=True)


HALF = hj.Recording(T, np.linspace(0, 1, N), W)
LONG = hj.LongRecording(T, U, W)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda m: hj.judge(m, REC, lead_in=-1), "`lead_in` counts samples"),
        (lambda m: hj.judge(m, REC, lead_in=N), f"less than the {N}"),
        (lambda m: hj.judge(m, REC, lead_in=N - 2), "after its lead-in"),
        (lambda m: hj.judge(m, REC, lead_in=0.5), "must be a whole number"),
        (lambda m: hj.judge(m, UNEVEN, periodic=True), "evenly sampled"),
        (lambda m: hj.judge(m, HALF, periodic=True), "it would leap by 1"),
        (lambda m: hj.judge(m, REC, weights=np.ones(3)), "Lengths differ"),
        (lambda m: hj.judge(m, REC, weights=np.zeros(N)), "nothing to judge"),
        (lambda m: hj.refine(m, REC, lead_in=N), "`lead_in` counts samples"),
        (lambda m: hj.refine(m, HALF, periodic=True), "it would leap by 1"),
        (
            lambda m: hj.identify(REC, hj.library.Duhem(), weights=[-W]),
            "zero or more",
        ),
        (lambda m: hj.identify(LONG, hj.library.Duhem(), weights=[W]), "in chunks"),
    ],
)
def test_what_cannot_be_measured_so_is_refused(unchecked, call, message):
    with pytest.raises(hj.InputError, match=message):
        call(MODELS["law"])


def test_noise_on_recordings_counts_by_their_samples():
    rng, records = np.random.default_rng(0), []
    for n, sigma in ((4000, 0.1), (2000, 1.0)):
        t = np.linspace(0, 10, n)
        w = np.sin(t) + sigma * rng.normal(size=n)
        records.append(hj.Recording(t, np.sin(t), w))
    used = jnp.array([np.ones(4000), np.arange(4000) < 2000])
    wanted = ((4000 * 0.1**2 + 2000 * 1.0**2) / 6000) ** 0.5
    assert noise_on_all(records, used) == pytest.approx(wanted, rel=0.1)
    wanted = ((4000 * 0.05**2 + 2000 * 0.25**2) / 6000) ** 0.5
    shares = noise_on_all(records, used, sizes=[2.0, 4.0])
    assert shares == pytest.approx(wanted, rel=0.1)
