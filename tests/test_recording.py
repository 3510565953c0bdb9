import re
import warnings
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import hystjax as hj
from hystjax import InputError, Recording
from hystjax._core import checks
from hystjax.recording._as_measured import as_group

T = np.linspace(0.5, 4.0, 36)
U = np.sin(T)
W = np.cos(T) + 0.2 * T


@pytest.fixture
def recording():
    return Recording(T, U, W, names=("voltage", "stroke"), units=("V", "µm"))


@pytest.fixture
def clockless():
    return Recording(None, U, W, names=("voltage", "stroke"), units=("V", "µm"))


def changed(array, row, value):
    copy = np.array(array)
    copy[row] = value
    return copy


def quantity(**fields):
    """What NumPy makes an array of without its unit."""
    return SimpleNamespace(__array__=lambda *dtype, **copy: T, **fields)


DATE = np.datetime64("2026-01-01T00:00:00.650")
DURATIONS = (1000 * T).astype("timedelta64[ms]")
BAD_COLUMNS = {
    "NaN": ((T, U, changed(W, 7, np.nan)), r"`w` has 1 value\(s\).*first at row 7"),
    "inf": ((T, changed(U, 3, -np.inf), W), r"`u` has 1 value\(s\).*first at row 3"),
    "masked": (
        (T, U, np.ma.masked_equal(changed(W, 7, -9999), -9999)),
        r"`w` has 1 value\(s\).*first at row 7",
    ),
    "masked durations": (
        (np.ma.masked_equal(DURATIONS, DURATIONS[5]), U, W),
        r"`t` has 1 value\(s\).*first at row 5",
    ),
    "masked dates": (
        (np.ma.masked_less(DURATIONS + np.datetime64("2026"), DATE), U, W),
        r"`t` has 2 value\(s\).*first at row 0",
    ),
    "only missing dates": (
        (np.full(36, "NaT", "M8[s]"), U, W),
        r"`t` has 36 value\(s\).*first at row 0",
    ),
    "durations of no unit": (
        (np.arange(36).astype("m8"), U, W),
        r"`t` holds durations without a unit; name it",
    ),
    "a quantity of pint": (
        (quantity(magnitude=T, units="ms"), U, W),
        r"`t` must be .*\(in ms, which would be lost: `x.to\(unit\).magnitude`",
    ),
    "a quantity of Astropy": (
        (T, quantity(to_value=None, unit="kV"), W),
        r"`u` must be .*\(in kV, which would be lost: `x.to_value\(unit\)`",
    ),
    "NaN time": ((changed(T, 0, np.nan), U, W), r"`t` has 1 value\(s\).*row 0"),
    "lengths": ((T, U[:-2], W), r"Lengths differ: `t` 36, `u` 34, `w` 36"),
    "two columns": ((T, np.stack([U, U], axis=1), W), r"`u` must be 1-D.*\(36, 2\)"),
    "scalar": ((T, U, 1.0), r"`w` must be 1-D.*shape \(\)"),
    "complex": ((T, U, W + 0j), r"`w` must be real, got complex"),
    "strings": ((T, U, ["1.0"] * 36), r"`w` must be a 1-D array of numbers, got list"),
    "numbers as text": (
        (T, np.array(["1.0"] * 36), W),
        r"`u` must be .* got ndarray \(of type <U3; .*`numpy.asarray\(x, float\)`",
    ),
    "numbers as objects": (
        (T, U, np.array([1.0] * 36, object)),
        r"`w` must be .* got ndarray \(of type object; .*`numpy.asarray\(x, float\)`",
    ),
    "nothing": ((T, None, W), r"`u` must be a 1-D array of numbers, got NoneType"),
    "no clock, lengths": ((None, U, W[:-2]), r"Lengths differ.*`u` 36, `w` 34"),
    "no clock, two rows": ((None, U[:2], W[:2]), r"at least 3 samples, got 2"),
    "no clock, scalar": ((None, 1.0, W), r"`u` must be 1-D.*shape \(\)"),
    "objects": ((T, U, changed(W.astype(object), 4, None)), r"`w` must be a 1-D array"),
    "time repeated": ((changed(T, 9, T[8]), U, W), r"`t` must.*repeats at row 9"),
    "time back": ((changed(T, 9, 0.0), U, W), r"`t` must.*goes back at row 9.*Sort"),
    "time begins anew": (
        (np.tile(T, 2), np.tile(U, 2), np.tile(W, 2)),
        r"goes back at row 36 .*several runs .* the first of them up to row 36",
    ),
    "two rows": ((T[:2], U[:2], W[:2]), r"at least 3 samples, got 2"),
    "no rows": (([], [], []), r"at least 3 samples, got 0"),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("columns, message", BAD_COLUMNS.values(), ids=BAD_COLUMNS)
def test_bad_columns_are_named(columns, message):
    with pytest.raises(InputError, match=message):
        Recording(*columns)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"clocked": "no"}, "`clocked` must be True or False.*got the text 'no'"),
        ({"clocked": 0}, "`clocked` must be True or False.*got the number 0"),
        ({"past": Recording(None, U, W)}, r"`past` must be .*\.past`; got a Recording"),
        ({"past": (T, U)}, r"`past` must be .*; got a tuple"),
    ],
)
def test_fields_that_are_none_of_their_kind_are_named(field, message):
    with pytest.raises(InputError, match=message):
        Recording(T, U, W, **field)


BAD_CALLS = {
    "window past the end": (lambda r: r.window(30, 37), r"window\(30, 37\).*0 to 36"),
    "window before the start": (lambda r: r.window(-3, 9), r"window\(-3, 9\).*0 to 36"),
    "window by fractions": (lambda r: r.window(0.5, 9), r"whole numbers.*got 0\.5"),
    "window reversed": (lambda r: r.window(9, 4), r"`start` must be less than `stop`"),
    "window of one row": (lambda r: r.window(4, 5), r"at least 3 samples, got 1"),
    "between beyond": (lambda r: r.between(9, 12), r"holds 0.*from 0.5 s to 4 s"),
    "between reversed": (lambda r: r.between(3, 1), r"between\(3, 1\)` holds 0"),
    "between NaN": (lambda r: r.between(1, np.nan), r"between\(1, nan\)` holds 0"),
    "between without a clock": (
        lambda r: Recording(None, r.u, r.w).between(1, 9),
        r"between\(1, 9\)` takes times.*no clock.*with `window`",
    ),
    "resample beyond the last sample": (
        lambda r: Recording(None, r.u, r.w).resample([1.5, 20, 36]),
        r"from 1.5 to 36, beyond the recording's 0 to 35;",
    ),
    "a clock without times": (
        lambda r: Recording(None, r.u, r.w, clocked=True),
        r"`clocked=True` needs times.*give `t`",
    ),
    "split at 0": (lambda r: r.split(0.0), r"split\(0.0\)` of 36 rows"),
    "split in rows": (
        lambda r: r.split(20),
        r"must be a share from 0 to 1; got the number 20",
    ),
    "split off one row": (lambda r: r.split(0.97), r"fewer than 3 rows"),
    "resample beyond": (
        lambda r: r.resample([1.0, 2.0, 4.5]),
        r"from 1 s to 4.5 s, beyond the recording.*0.5 s to 4 s",
    ),
    "resample before": (lambda r: r.resample([0.0, 1.0, 2.0]), r"from 0 s to 2 s"),
    "resample out of order": (lambda r: r.resample([1.0, 3.0, 2.0]), r"goes back"),
    "resample at nothing": (lambda r: r.resample([]), r"at least 3 samples, got 0"),
    "input too short": (lambda r: r.with_input(U[:5]), r"Lengths differ.*`u` 5"),
    "name missing": (
        lambda r: Recording(r.t, r.u, r.w, names=("voltage",)),
        r"`names` must be a pair.*\('voltage',\)",
    ),
    "units in one": (
        lambda r: Recording(r.t, r.u, r.w, units="Vm"),
        r"`units` must be a pair.*'Vm'",
    ),
    "interpolation by name": (
        lambda r: Recording(r.t, r.u, r.w, interpolation="cubic"),
        r"`interpolation` must be one of.*got 'cubic'",
    ),
    "means of none": (lambda r: r.averaged(0), r"`count` must be at least 1, got 0"),
    "means of a part": (lambda r: r.averaged(2.5), r"`count` must be a whole number"),
    "two means": (lambda r: r.averaged(13), r"averaged\(13\)` of 36 samples makes 2 m"),
    "exact input of another record": (
        lambda r: Recording(
            r.t, r.u, r.w, interpolation=hj.interpolation.Exact(jnp.cos)
        ),
        r"`u` and the function of `interpolation.Exact` differ",
    ),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("call, message", BAD_CALLS.values(), ids=BAD_CALLS)
def test_bad_calls_are_named(recording, call, message):
    with pytest.raises(InputError, match=message):
        call(recording)


@pytest.mark.parametrize(
    "select, rows",
    [
        (lambda r: r.window(4, 30), slice(4, 30)),
        (lambda r: r.window(0, 36), slice(0, 36)),
        (lambda r: r.between(1.0 - 1e-9, 2.0 - 1e-9), slice(5, 15)),
        (lambda r: r.between(-1, 99), slice(0, 36)),
        (lambda r: r.split(0.7)[0], slice(0, 25)),
        (lambda r: r.split(0.7)[1], slice(25, 36)),
    ],
)
def test_selections_keep_rows_names_and_units(recording, select, rows):
    part = select(recording)
    for name, column in (("t", T), ("u", U), ("w", W)):
        np.testing.assert_array_equal(getattr(part, name), column[rows])
    assert part.names == ("voltage", "stroke")
    assert part.units == ("V", "µm")
    np.testing.assert_array_equal(recording.w, W)


def test_seconds_since_1970_are_told_apart():
    """To six digits all of a record would be at 1.7e+09 s."""
    t = 1.7e9 + 0.25 * np.arange(20)
    late = hj.Recording(t, np.sin(t), np.cos(t))
    assert "1700000000 to 1700000004.75 s" in repr(late)
    with pytest.raises(InputError, match=r"from 1700000000 s to 1700000004\.75 s"):
        late.between(0.0, 5.0)
    with pytest.raises(InputError, match=r"from 1700000001\.5 s to 1700000009 s"):
        late.resample(1.7e9 + np.array([1.5, 2.0, 9.0]))


@pytest.mark.parametrize("earlier", [0, 60])
def test_resample_keeps_what_was_before_under_jit_and_vmap(earlier):
    t = np.linspace(0, 10, 201)
    u = np.where(t < 5, 3.0, 1.0) * np.sin(np.pi * t / 2.5)
    stack = hj.models.PrandtlIshlinskii([0.5, 1.5, 2.5], [1.0, 1.0, 1.0])
    grid = np.linspace(6, 10, 41)

    def run(size):
        record = hj.Recording(t, size * u, u).window(earlier, 201)
        return hj.simulate(stack, record.resample(grid)).w

    sizes = jnp.array([0.5, 1.0, 2.0])
    expected = [run(size) for size in sizes]
    for found in ([jax.jit(run)(size) for size in sizes], jax.vmap(run)(sizes)):
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    "interpolation, oracle",
    [
        (hj.interpolation.Linear(), lambda times: np.interp(times, T, U)),
        (hj.interpolation.Cubic(), CubicSpline(T, U)),
        (hj.interpolation.Exact(jnp.sin), np.sin),
    ],
    ids=["linear", "cubic", "exact"],
)
def test_resample_takes_the_input_from_its_path(interpolation, oracle):
    times = np.sort(np.random.default_rng(0).uniform(0.5, 4.0, 50))
    part = Recording(T, U, W, interpolation=interpolation).resample(times)
    np.testing.assert_allclose(part.u, oracle(times), rtol=0, atol=1e-13)
    np.testing.assert_allclose(part.w, np.interp(times, T, W), rtol=0, atol=1e-13)


def means(x, rows):
    return [np.mean(x[row]) for row in rows]


@pytest.mark.parametrize("clocked", [True, False])
@pytest.mark.parametrize("run", [lambda f, r: f(r), lambda f, r: jax.jit(f)(r)])
def test_means_are_those_of_samples_in_turn(recording, clockless, clocked, run):
    whole = recording if clocked else clockless
    part = run(lambda r: r.averaged(3), whole)
    rows = [slice(3 * i, 3 * i + 3) for i in range(12)]
    for name in ("t", "u", "w"):
        expected = means(np.asarray(getattr(whole, name)), rows)
        np.testing.assert_allclose(getattr(part, name), expected, rtol=0, atol=1e-14)
    assert (part.names, part.units) == (whole.names, whole.units)
    assert part.clocked == clocked and part.past is None


def test_what_makes_no_whole_mean_is_told_of_and_what_came_before_is_kept(recording):
    window = recording.window(10, 36)
    with pytest.warns(UserWarning, match=r"last 2 of 26 samples make no group of 4"):
        part = window.averaged(4)
    rows = [slice(10 + 4 * i, 14 + 4 * i) for i in range(6)]
    np.testing.assert_allclose(part.w, means(W, rows), rtol=0, atol=1e-14)
    before = [slice(0, 2), slice(2, 6), slice(6, 10)]
    np.testing.assert_allclose(part.past.t, means(T, before), rtol=0, atol=1e-14)
    np.testing.assert_allclose(part.past.u, means(U, before), rtol=0, atol=1e-14)
    assert window.averaged(1) is window


def test_means_of_an_input_that_is_known_are_where_it_goes(recording):
    part = recording.with_input(jnp.cos).averaged(4)
    np.testing.assert_allclose(part.u, np.cos(part.t), rtol=0, atol=1e-14)
    measured = Recording(T, np.cos(T), W).averaged(4)
    assert np.abs(part.u - measured.u).max() > 1e-3
    np.testing.assert_allclose(part.path.at(1.23)[0], np.cos(1.23), rtol=1e-14)


def test_with_input_by_array_function_and_excitation(recording):
    sine = hj.excitation.Sine(2.0, 0.5)
    for new, oracle in (
        (2 * U, 2 * U),
        (lambda s: jnp.exp(-s), np.exp(-T)),
        (sine, 2 * np.sin(np.pi * T)),
    ):
        other = recording.with_input(new)
        np.testing.assert_allclose(other.u, oracle, rtol=1e-13, atol=1e-13)
        np.testing.assert_array_equal(other.w, W)
        assert other.names == recording.names
    # A function serves between samples too, and an array after it no longer does.
    exact = recording.with_input(lambda s: jnp.exp(-s))
    np.testing.assert_allclose(exact.path.at(1.23)[0], np.exp(-1.23), rtol=1e-14)
    sampled = exact.with_input(U)
    np.testing.assert_allclose(sampled.path.at(1.23)[0], np.interp(1.23, T, U))


def test_without_a_clock_samples_are_numbered(recording, clockless):
    np.testing.assert_array_equal(clockless.t, np.arange(36))
    assert clockless.t.dtype == recording.t.dtype
    assert recording.clocked and not clockless.clocked
    assert not Recording(T, U, W, clocked=False).clocked


@pytest.mark.parametrize(
    "change, t",
    [
        (lambda r: r.window(4, 30), np.arange(4, 30)),
        (lambda r: r.split(0.7)[1], np.arange(25, 36)),
        (lambda r: r.resample([0.5, 1, 7.25]), [0.5, 1, 7.25]),
        (lambda r: r.with_input(2 * U), np.arange(36)),
        (lambda r: r.with_input(jnp.cos), np.arange(36)),
        (lambda r: jax.tree.map(lambda x: x, r), np.arange(36)),
        (lambda r: jax.jit(lambda q: q.window(4, 30))(r), np.arange(4, 30)),
    ],
)
def test_parts_of_a_recording_without_a_clock_have_none(clockless, change, t):
    part = change(clockless)
    assert not part.clocked
    np.testing.assert_array_equal(part.t, t)
    assert part.names == ("voltage", "stroke")


def test_samples_without_a_clock_are_evenly_spaced():
    turn = 2 * np.pi * np.arange(16) / 16
    band = hj.interpolation.BandLimited()
    record = Recording(None, np.sin(turn), np.cos(turn), interpolation=band)
    np.testing.assert_allclose(record.path.at(2.5)[0], np.sin(2.5 * turn[1]))


def test_a_rate_independent_law_runs_alike_with_and_without_a_clock(clockless):
    law = hj.models.Duhem(0.8, 0.5, 0.9)
    clocked = Recording(T, U, W)
    runs = [hj.simulate(law, record, w0=0.1).w for record in (clocked, clockless)]
    np.testing.assert_allclose(*runs, rtol=1e-5)


def test_columns_share_the_default_type():
    columns = T.astype(np.float32), (100 * U).astype(int), list(W)
    recording = Recording(*columns)
    assert {recording.t.dtype, recording.u.dtype, recording.w.dtype} == {
        np.dtype("float64")
    }
    np.testing.assert_array_equal(recording.u, columns[1])


def test_recording_is_a_pytree(recording):
    leaves, structure = jax.tree.flatten(recording)
    again = jax.tree.unflatten(structure, leaves)
    assert eqx.tree_equal(again, recording)
    assert again.units == ("V", "µm")


def test_recordings_under_jit_and_vmap(recording):
    def energy(r):
        head, _ = r.split(0.5)
        part = head.window(2, 12)
        again = r.resample(r.t[::3]).with_input(jnp.cos)
        return jnp.sum(part.w**2) + jnp.sum(again.u)

    expected = np.sum(W[2:12] ** 2) + np.sum(np.cos(T[::3]))
    np.testing.assert_allclose(jax.jit(energy)(recording), expected, rtol=1e-13)

    factors = jnp.array([1.0, -2.0, 3.0])
    batch = jax.vmap(lambda f: Recording(T, U, f * W))(factors)
    assert batch.w.shape == (3, 36)
    np.testing.assert_allclose(
        jax.vmap(energy)(batch),
        factors**2 * np.sum(W[2:12] ** 2) + np.sum(np.cos(T[::3])),
        rtol=1e-13,
    )


def in_single_precision(offset, step):
    t = offset + step * np.arange(400)
    return Recording(t, np.sin(t), np.cos(t))


@pytest.mark.parametrize(
    "offset, step, warns",
    [(0.0, 0.05, False), (0.0, 1e-4, True), (1000.0, 0.05, True)],
    ids=["coarse", "fine steps", "late start"],
)
def test_single_precision_warns_where_derivatives_are_lost(offset, step, warns):
    with jax.enable_x64(False), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        hj.identify(
            in_single_precision(offset, step),
            hj.library.Duhem(),
            hj.regression.LeastSquares(),
        )
    messages = [str(w.message) for w in caught if "float32" in str(w.message)]
    assert bool(messages) == warns
    assert all("64-bit numbers" in message for message in messages)


@pytest.mark.parametrize(
    "wide, t, told",
    [
        (
            False,
            1e5 + 0.05 * np.arange(40),
            r"float32 rounds times .* 2\d\.\d% of a step.*64-bit",
        ),
        (False, 0.05 * np.arange(40), None),
        (False, np.arange(20_000.0), None),  # whole numbers are what they are
        (False, None, None),
        (True, 1.7e9 + 5e-5 * np.arange(40), r"float64 rounds .*subtract the first"),
        (True, 1.7e9 + 0.05 * np.arange(40), None),
    ],
)
def test_times_far_from_zero_are_told_where_their_steps_are_rounded(wide, t, told):
    u = np.sin(np.arange(40.0 if t is None else len(t)))
    with jax.enable_x64(wide), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Recording(t, u, u)
    found = [str(each.message) for each in caught]
    assert len(found) == (told is not None)
    assert all(re.search(told or "", each) for each in found)


@pytest.mark.parametrize("offset, told", [(0.0, 0), (1e2, 0), (1e4, 1)])
def test_guesses_say_where_single_precision_rounds_an_input(offset, told):
    """By its range over a thousand plays of one have no shape any more."""
    t = np.linspace(0, 12, 241)
    u = np.sin(np.pi * t / 2) * (1 - t / 24)
    with jax.enable_x64(False), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        record = Recording(t, u + offset, 0.5 * u)
        hj.models.PrandtlIshlinskii.guess(record)
    found = [str(x.message) for x in caught if "rounds an input" in str(x.message)]
    assert len(found) == told


def test_single_precision_times_that_round_together_are_explained():
    t = 1e5 + 1e-4 * np.arange(10)
    with (
        jax.enable_x64(False),
        pytest.raises(InputError, match="too small for float32"),
    ):
        Recording(t, np.sin(t), t)
    with jax.enable_x64(True):
        assert len(Recording(t, np.sin(t), t)) == 10


@pytest.mark.parametrize(
    "kind", ["?", "u1", "i4", "f4", "c8", "S3", "U3", "O", "M8[s]", "m8[ms]"]
)
def test_what_is_masked_is_missing_in_columns_of_any_type(kind):
    column = np.ma.array([1, 0, 1], mask=[False, True, False]).astype(kind)
    found = checks.unmasked(column)
    assert (found[[0, 2]] == np.asarray(column.data)[[0, 2]]).all()
    missing = found[1]
    assert missing is None or missing in ("", b"") or missing != missing
    assert found is checks.unmasked(found)  # what has no mask stays as it is


def test_dates_are_no_positive_numbers():
    for moment in (np.timedelta64(3, "s"), np.array([1, 2], "m8[ms]")):
        with pytest.raises(InputError, match="`rate` must be a number"):
            checks.positive("rate", moment)


def test_units_that_are_spelt_otherwise_are_the_same():
    t = np.arange(9.0)
    for one, other in (("µm", "\u03bcm"), ("µm", "um"), ("A·m²", "A m^2")):
        pair = [Recording(t, t % 3, t, units=("V", unit)) for unit in (one, other)]
        assert len(as_group(pair, "identify(recordings)")) == 2
    none = [Recording(t, t % 3, t, units=("V", unit)) for unit in ("µm", "")]
    with pytest.raises(InputError, match="the units of recording 1"):
        as_group(none, "identify(recordings)")


def test_a_mean_of_periods_is_of_even_ones():
    step = np.repeat([0.01, 0.02], 40)
    t = np.concatenate([[0.0], np.cumsum(step)[:-1]])
    u = np.sin(2 * np.pi * np.arange(80) / 40)
    with pytest.raises(InputError, match="`steady` needs evenly sampled times"):
        hj.steady(Recording(t, u, u), 40)
