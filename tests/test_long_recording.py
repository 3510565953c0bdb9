import re
import sys

import jax
import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

import hystjax as hj
from hystjax import InputError, LongRecording
from hystjax.regression.differentiation import (
    FiniteDifference,
    SavitzkyGolay,
    SmoothingSpline,
)

N = 5003
LIBRARY = hj.library.Polynomial(2)
EXACT = hj.regression.STLSQ(0.05)


@pytest.fixture(scope="module")
def columns():
    random = np.random.default_rng(1)
    t = np.cumsum(random.uniform(0.005, 0.015, N))
    u = np.sin(t) + 0.4 * np.sin(2.3 * t + 1)
    path = hj.interpolation.Linear().path(jax.numpy.asarray(t), jax.numpy.asarray(u))
    law, step = hj.models.Duhem(0.4, 0.5, 0.25), hj.simulation.FixedStep()
    w = np.asarray(hj.simulate(law, path, w0=0.1, method=step).w)
    return {"t": t, "u": u, "w": w + 1e-3 * random.normal(size=N)}


@pytest.fixture(scope="module")
def files(columns, tmp_path_factory):
    folder = tmp_path_factory.mktemp("columns")
    for name, column in columns.items():
        np.save(folder / name, column)
    return {name: folder / f"{name}.npy" for name in columns}


@pytest.mark.parametrize("chunk", [64, 1000, N - 1, N, 2**20])
@pytest.mark.parametrize("how", [FiniteDifference(), SavitzkyGolay(21, 3)])
def test_chunks_of_files_give_the_law_of_the_record_in_memory(
    columns, files, chunk, how
):
    settings = {"regression": EXACT, "differentiation": how}
    whole = hj.identify(hj.Recording(**columns), LIBRARY, **settings)
    record = LongRecording.from_npy(**files, chunk=chunk, units=("V", "µm"))
    found = hj.identify(record, LIBRARY, **settings)
    np.testing.assert_array_equal(found.value.support, whole.value.support)
    expected = np.asarray(whole.value.coefficients)
    np.testing.assert_allclose(found.value.coefficients, expected, rtol=1e-10)
    residual = whole.stats["residual"]
    np.testing.assert_allclose(found.stats["residual"], residual, rtol=1e-10)
    norms, same = (s.stats["problem"].norms() for s in (found, whole))
    np.testing.assert_allclose(norms[0], same[0], rtol=1e-10)
    assert found.value.units == ("V", "µm")
    assert repr(record).split("\n") == [
        f"LongRecording of {N} samples",
        "  u, w   input (V), output (µm)",
        f"  chunk  {chunk} samples",
    ]
    ranges = [jax.tree.leaves(s.value.fitted_range) for s in (found, whole)]
    np.testing.assert_allclose(*ranges, rtol=1e-12)


def test_anything_that_can_be_sliced_is_a_column(columns, files):
    mapped = {name: np.load(file, mmap_mode="r") for name, file in files.items()}
    record = LongRecording(**mapped, chunk=700)
    window = record.window(100, 400)
    assert isinstance(window, hj.Recording)
    for name, column in columns.items():
        np.testing.assert_array_equal(getattr(window, name), column[100:400])
    law = hj.identify(record, hj.library.Duhem(), EXACT).value
    same = hj.identify(hj.Recording(**columns), hj.library.Duhem(), EXACT).value
    np.testing.assert_allclose(law.coefficients, same.coefficients, rtol=1e-10)


@pytest.mark.parametrize("rows", [700, 2**20])
def test_columns_of_parquet_files(columns, tmp_path, rows):
    path = tmp_path / "record.parquet"
    named = dict(zip(("time", "field", "flux"), columns.values(), strict=True))
    parquet.write_table(pyarrow.table(named), path, row_group_size=rows)
    where = {"t": "time", "u": "field", "w": "flux"}
    record = LongRecording.from_parquet(path, **where, chunk=1000)
    assert record.names == ("field", "flux")
    for start, stop in [(0, N), (699, 700), (700, 1400), (650, 2150), (N - 1, N)]:
        for found, column in zip(
            record.read(start, stop), columns.values(), strict=True
        ):
            np.testing.assert_array_equal(found, column[start:stop])
    law = hj.identify(record, LIBRARY, EXACT).value
    same = hj.identify(LongRecording(**columns, chunk=1000), LIBRARY, EXACT).value
    np.testing.assert_array_equal(law.coefficients, same.coefficients)


def test_of_columns_with_one_name_the_one_of_the_number_is_read(columns, tmp_path):
    path = tmp_path / "record.parquet"
    t, u, w = columns.values()
    named = pyarrow.table([t, 0 * u, u, w], names=["t", "x", "x", "w"])
    parquet.write_table(named, path, row_group_size=700)
    record = LongRecording.from_parquet(path, t="t", u="2", w="w")
    np.testing.assert_array_equal(record.read(650, 750)[1], u[650:750])


def test_columns_of_parquet_files_go_by_name_and_unit(columns, tmp_path):
    path = tmp_path / "record.parquet"
    milli = 1000 * columns["t"]
    named = {"Time (ms)": milli, "Field (A/m)": columns["u"], "B [T]": columns["w"]}
    parquet.write_table(pyarrow.table(named), path)
    record = LongRecording.from_parquet(path, t="time", u="field", w="b")
    assert record.names == ("Field", "B") and record.units == ("A/m", "T")
    np.testing.assert_allclose(record.window(5, 99).t, columns["t"][5:99], rtol=1e-12)
    again = LongRecording.from_parquet(path, t="time", u="field", w="b", time_unit="s")
    np.testing.assert_allclose(again.window(5, 99).t, milli[5:99], rtol=1e-12)
    parquet.write_table(pyarrow.table({**columns, "time_ms": milli}), path)
    with pytest.warns(UserWarning, match="time_unit='ms'"):
        LongRecording.from_parquet(path, t="time_ms", u="u", w="w")


@pytest.mark.parametrize(
    "file, named, message",
    [
        ("no.parquet", {}, "no.parquet cannot be read"),
        ("broken.parquet", {}, "broken.parquet cannot be read"),
        (
            "good.parquet",
            {"u": "H"},
            "`u`='H' is not a column of .*: 0 't', 1 'u', 2 'w'",
        ),
        ("good.parquet", {"w": "note"}, "holds string, not numbers"),
    ],
)
def test_parquet_that_cannot_be_read_is_refused(tmp_path, file, named, message):
    (tmp_path / "broken.parquet").write_bytes(b"t,u,w")
    table = {"t": [0.0, 1.0], "u": [1, 2], "w": [1.0, 2.0], "note": ["a", "b"]}
    parquet.write_table(pyarrow.table(table), tmp_path / "good.parquet")
    names = {"t": "t", "u": "u", "w": "w"} | named
    with pytest.raises(InputError, match=message):
        LongRecording.from_parquet(tmp_path / file, **names)


def test_names_and_units_are_pairs_as_those_of_a_recording(files, unchecked):
    for field in ("names", "units"):
        for given in (None, (None, None), "Vm", ("a", "b", "c")):
            with pytest.raises(InputError, match=f"`{field}` must be a pair of texts"):
                LongRecording.from_npy(**files, **{field: given})
        found = LongRecording.from_npy(**files, **{field: ["V", "m"]})
        assert getattr(found, field) == ("V", "m")


def test_parquet_without_pyarrow_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install hystjax\[parquet\]"):
        LongRecording.from_parquet("record.parquet", t="t", u="u", w="w")


def changed(columns, name, row, value):
    column = columns[name].copy()
    column[row] = value
    return LongRecording(**{**columns, name: column}, chunk=1000)


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("w", np.nan, r"`w` has 1 value\(s\) that are NaN.*from row 2994"),
        ("u", np.inf, r"`u` has 1 value"),
        ("t", 0.0, r"`t` must increase strictly; it goes back"),
        ("w", slice(None), "`w` is constant"),
    ],
)
def test_bad_rows_are_found_wherever_they_are(columns, name, value, message):
    row, value = (3500, value) if isinstance(value, float) else (value, 1.0)
    with pytest.raises(InputError, match=message):
        hj.identify(changed(columns, name, row, value), LIBRARY)


def identified(columns, name, change):
    record = LongRecording(**{**columns, name: change(columns[name])}, chunk=1000)
    return hj.identify(record, LIBRARY)


def to_dates(t):
    return np.datetime64("2026-01-31", "ns") + (1e9 * t).astype("timedelta64[ns]")


def test_a_window_of_dates_is_a_recording(columns):
    least = 3  # samples that a chunk may have
    dates = LongRecording(**{**columns, "t": to_dates(columns["t"])}, chunk=least)
    expected = columns["t"][10:50] - columns["t"][10]
    np.testing.assert_allclose(dates.window(10, 50).t, expected, atol=2e-9)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda c: LongRecording(c["t"], c["u"], c["w"][1:]), "the same length"),
        (lambda c: LongRecording(**c, chunk=2), "at least 3"),
        (lambda c: identified(c, "t", to_dates), "datetime64[ns]: give times as"),
        (lambda c: identified(c, "w", lambda w: w + 1j), "got one of complex128"),
        (
            lambda c: identified(c, "w", lambda w: np.ma.masked_less(w, w[3500])),
            "`w` has",
        ),
        (lambda c: LongRecording(**c).window(5, N + 1), "not inside"),
        (lambda c: LongRecording.from_npy(t="no.npy", u="u", w="w"), "no.npy"),
        (
            lambda c: hj.identify(
                LongRecording(**c), LIBRARY, differentiation=SmoothingSpline()
            ),
            "needs all of it at once",
        ),
        (
            lambda c: hj.identify(
                LongRecording(**c), LIBRARY, formulation=hj.formulation.WeakForm()
            ),
            "needs all of it at once",
        ),
        (
            lambda c: hj.identify(
                LongRecording(**c), LIBRARY, weighting=hj.weighting.Bisquare()
            ),
            "`weighting`",
        ),
        (
            lambda c: hj.identify(
                LongRecording(**c, chunk=20),
                LIBRARY,
                differentiation=SavitzkyGolay(21, 3),
            ),
            "more than 20 samples",
        ),
    ],
)
def test_what_cannot_be_is_refused(columns, call, message):
    with pytest.raises(InputError, match=re.escape(message)):
        call(columns)


def test_an_output_far_from_zero_is_told_as_of_one_in_memory(columns):
    columns = columns | {"w": 1000 + columns["w"]}
    plays = hj.library.Play([0.1, 0.5])
    said = []
    for record in (hj.Recording(**columns), LongRecording(**columns, chunk=300)):
        with pytest.warns(UserWarning, match="the output is about") as caught:
            hj.identify(record, plays, formulation=hj.formulation.Direct())
        said.append(str(caught[0].message))
    assert said[0] == said[1]


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    "name, value, message",
    [
        ("chunk", 1e3, "`chunk` must be a whole number"),
        ("t", None, "`t` must be a column that"),
        ("u", [0.0] * N, "`u` must be a column that"),
    ],
)
def test_what_is_no_column_is_named(columns, name, value, message):
    with pytest.raises(InputError, match=message):
        LongRecording(**{**columns, name: value})


LAW = hj.models.PrandtlIshlinskii([0.0, 0.2], [0.5, 0.3])


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    "verb, name",
    [
        (lambda long: hj.refine(LAW, long), "recordings"),
        (lambda long: hj.refine(LAW, [long]), "recordings"),
        (lambda long: hj.judge(LAW, long), "recording"),
        (lambda long: hj.simulate(LAW, long), "inputs"),
        (lambda long: hj.compare(long), "recordings"),
        (lambda long: hj.invert(LAW, long), "reference"),
        (lambda long: hj.control(LAW, long), "reference"),
    ],
)
def test_verbs_that_need_all_at_once_say_how_to_get_a_window(columns, verb, name):
    long = LongRecording(**columns)
    with pytest.raises(InputError) as raised:
        verb(long)
    said = str(raised.value)
    assert f"`{name}` must be a `Recording`" in said and "The order" not in said
    told = re.search(r"`long\.(window\(\d+, \d+\))`", said)
    assert told and isinstance(eval(f"long.{told[1]}"), hj.Recording)
