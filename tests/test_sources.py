"""Files and frames as they come: units of time, dates, units below the header, decimal
commas, compressed files, arrays, frames; and columns that are not there."""

import bz2
import datetime
import gzip
import io
import json
import lzma
import re
import sys
import warnings

import numpy as np
import pytest
import scipy.io
from matplotlib.figure import Figure

from hystjax import InputError, LongRecording, Recording, bridged, load, loops, plot

T = np.array([0.0, 0.02, 0.05, 0.07])
U = np.array([1.0, 2.5, -1.25, 0.5])
W = np.array([0.125, 7.0, -3.5, 1.5])
COLUMNS = {"input": "u", "output": "w"}
DATES = np.datetime64("2026-01-31T23:59:59.990") + (1e9 * T).astype("timedelta64[ns]")


def table(times, header="t,u,w\n", separator=","):
    rows = (separator.join(map(str, row)) for row in zip(times, U, W, strict=True))
    return header + "\n".join(rows) + "\n"


def read(folder, content, name="record.csv", **options):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return Recording.from_csv(path, **{**COLUMNS, **options})


def check(recording, t=T):
    np.testing.assert_allclose(recording.t, t - t[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(recording.u, U)
    np.testing.assert_array_equal(recording.w, W)


@pytest.mark.parametrize(
    ("unit", "size"),
    [("s", 1), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60), ("h", 3600)],
)
def test_times_and_periods_in_every_unit(tmp_path, unit, size):
    check(read(tmp_path, table(T / size), time="t", time_unit=unit))
    even = read(tmp_path, table(T), period=0.25, time_unit=unit)
    np.testing.assert_allclose(even.t, 0.25 * size * np.arange(4), rtol=1e-12)


def test_a_unit_in_a_name_is_warned_of_and_in_a_header_believed(tmp_path):
    named = table(1000 * T, "time_ms,u,w\n")
    with pytest.warns(UserWarning, match="'time_ms'.*seconds.*time_unit='ms'"):
        check(read(tmp_path, named, time="time_ms"), 1000 * T)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(read(tmp_path, named, time="time_ms", time_unit="ms"))
        check(read(tmp_path, named, time="time_ms", time_unit="s"), 1000 * T)
        check(read(tmp_path, table(1000 * T, "Time (ms),u,w\n"), time="time"))
        check(read(tmp_path, table(T, "Time [s],u,w\n"), time="time"))
        check(read(tmp_path, table(T, "my_time,u,w\n"), time=0))
        check(read(tmp_path, table(1000 * T, "t/ms,u,w\n"), time=0))
    for name in ("/'Group'/'Time (ms)'", "Time (ms) raw", "TIME:ms", "ms"):
        with pytest.warns(UserWarning, match="seconds.*time_unit='ms'"):
            check(read(tmp_path, table(1000 * T, f"{name},u,w\n"), time=0), 1000 * T)
    with pytest.warns(UserWarning, match="time_unit='h'"):  # not the ratio to hours
        check(read(tmp_path, table(T, "Run/h,u,w\n"), time=0))


def test_a_unit_of_time_that_is_none(tmp_path):
    with pytest.raises(InputError, match=r"'msek'.*Did you mean 'msec'.*s, ms, us"):
        read(tmp_path, table(T), time="t", time_unit="msek")
    with pytest.raises(InputError, match=r"time_unit='ms'.*neither `time` nor `peri"):
        read(tmp_path, table(T, "x,u,w\n"), time_unit="ms")


def test_rows_of_objects_have_the_columns_of_all(tmp_path):
    rows = [dict(zip("tuw", row, strict=True)) for row in zip(T, U, W, strict=True)]
    text = json.dumps([dict(reversed(rows[0].items())), *rows[1:]])
    check(read(tmp_path, text, "record.json", time="t"))
    del rows[0]["t"]
    with pytest.raises(InputError, match=r"`t` has 1 value.*at row 0"):
        read(tmp_path, json.dumps(rows), "record.json", time="t")


@pytest.mark.parametrize(
    ("header", "size"),
    [
        *(("Time (hrs)", 3600), ("t [hr]", 3600), ("t (mins)", 60), ("t (min.)", 60)),
        *(("t (ms.)", 1e-3), ("t (msecs)", 1e-3), ("t (days)", 86400), ("t(d)", 86400)),
        *(("t/ms", 1e-3), ("t / min", 60), ("t,u,w\nhrs", 3600)),
    ],
)
def test_units_of_time_in_every_spelling(tmp_path, header, size):
    *names, first = header.split("\n")
    rest = ",V,mm\n" if names else ",u,w\n"
    text = table(T / size, "\n".join([*names, first]) + rest)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(read(tmp_path, text, time=0))


def test_a_unit_of_time_in_the_header_that_is_not_known(tmp_path):
    text = table(T, "Time (fortnights),u,w\n")
    with pytest.warns(UserWarning, match="as seconds.*'fortnights' is not known"):
        check(read(tmp_path, text, time=0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(read(tmp_path, table(T, "group/run,u,w\n"), time=0))
        check(read(tmp_path, text, time=0, time_unit="s"))


@pytest.mark.parametrize("join", ["T", " "])
def test_dates_are_read_and_count_from_the_first(tmp_path, join):
    text = [str(date).replace("T", join) for date in DATES]
    check(read(tmp_path, table(text), time="t"))
    check(read(tmp_path, table([f"{date}Z" for date in text]), time=0))
    with pytest.raises(
        InputError, match=r"a date or time that cannot be read.*2026-01-31T"
    ):
        read(tmp_path, table(["2026-01-31", "2026-13-01", "x", "y"]), time="t")


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("named", [True, False])
def test_times_of_day_are_read_and_pass_midnight(tmp_path, separator, named):
    text = [str(date)[len("2026-01-31T") :] for date in DATES]
    assert text[0] == "23:59:59.990000000" and text[-1] == "00:00:00.060000000"
    lines = table(text, "t,u,w\n" if named else "").replace(",", separator)
    columns = {"time": 0, "input": 1, "output": 2}
    check(read(tmp_path, lines, **columns))
    if separator != ",":  # with decimal commas
        check(read(tmp_path, lines.replace(".", ","), **columns))


@pytest.mark.parametrize("hour", [0, 11, 12, 23])
def test_times_of_day_by_halves(tmp_path, hour):
    start = datetime.datetime(2026, 1, 31, hour, 59, 59, 990000)
    clock = [start + datetime.timedelta(0, t) for t in T]
    for form in ("%I:%M:%S.%f %p", "%I:%M:%S.%fpm"):
        text = [each.strftime(form.replace("pm", "%p")).lower() for each in clock]
        check(read(tmp_path, table(text), time="t"))


def test_a_clock_that_is_set_back_has_not_passed_midnight(tmp_path):
    back = ["12:00:00", "12:00:02", "12:00:01", "12:00:03"]
    with pytest.raises(InputError, match="`t` must increase"):
        read(tmp_path, table(back), time="t")


@pytest.mark.parametrize("hour", [0, 13])
def test_halves_of_a_day_have_hours_from_1_to_12(tmp_path, hour):
    text = [f"{hour}:00:0{second} PM" for second in range(4)]
    with pytest.raises(InputError, match=f"'{hour}:00:00 PM' is no time of day"):
        read(tmp_path, table(text), time="t")


LATE = [datetime.date(2026, 1, 31), datetime.date(2026, 2, 13)]
WRITTEN = ("%d.%m.%Y %H", "%d/%m/%Y %H", "%m/%d/%Y %H", "%d-%b-%Y %H", "%Y/%m/%d %H")
SHORT = ("%d.%m.%y %H", "%m/%d/%y %H", "%d-%b-%y %H")


@pytest.mark.parametrize("form", WRITTEN + SHORT)
@pytest.mark.parametrize("day", LATE)
def test_dates_as_loggers_write_them(tmp_path, form, day):
    pandas = pytest.importorskip("pandas")
    start = datetime.datetime.combine(day, datetime.time(23, 59, 59, 990000))
    clock = [start + datetime.timedelta(0, t) for t in T]
    text = [each.strftime(form + ":%M:%S.%f") for each in clock]
    assert text[0][:10] != text[-1][:10]
    check(read(tmp_path, table(text), time="t"))
    halves = [each.strftime(form[:-2] + "%I:%M:%S.%f %p") for each in clock]
    if form != WRITTEN[-1]:
        check(read(tmp_path, table(halves), time="t"))
    commas = table(text, "t;u;w\n").replace(",", ";").replace(".0", ",0")
    if form not in (WRITTEN[0], SHORT[0]):  # whose points are no decimal ones
        check(read(tmp_path, commas.replace(".", ","), time="t"))
    frame = pandas.DataFrame({"t": text, "u": U, "w": W})
    check(Recording.from_pandas(frame, time="t", **COLUMNS))


def test_dates_of_which_day_and_month_cannot_be_told_apart(tmp_path):
    one_day = [f"01/02/2026 12:00:{t:09.6f}" for t in T]
    check(read(tmp_path, table(one_day), time="t"))
    to_minutes = [f"1/2/2026 7:{minute}" for minute in (30, 31, 33, 34)]
    found = read(tmp_path, table(to_minutes), time="t")
    np.testing.assert_allclose(found.t, [0, 60, 180, 240], rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="NaN or inf, the first at row 2"):
        read(tmp_path, table([*one_day[:2], "", one_day[3]]), time="t")
    two_days = [*one_day[:3], "02/02/2026 12:00:00"]
    with pytest.raises(
        InputError, match=r"01 in 01/02/2026 may be the day or the month.*-31T"
    ):
        read(tmp_path, table(two_days), time="t")
    with pytest.raises(InputError, match="31/31 and others are not all days of a year"):
        read(tmp_path, table(["31/31/2026 12:00:00"] * 4), time="t")
    with pytest.raises(InputError, match="'12:00:01' is no date"):
        read(tmp_path, table([*one_day[:3], "12:00:01"]), time="t")


HOURS = 0, 6, 12, 18


def test_dates_with_years_of_two_digits(tmp_path):
    def at(days):
        text = [f"{day} {hour}:00:00" for day, hour in zip(days, HOURS, strict=True)]
        return read(tmp_path, table(text), time="t").t / 3600

    np.testing.assert_allclose(at(["26/01/31"] * 4), [0, 6, 12, 18], atol=1e-9)
    for old, new in (("99", "00"), ("69", "70")):  # POSIX: 69 is of the last century
        onwards = [f"31/12/{old}"] * 2 + [f"01/01/{new}"] * 2
        np.testing.assert_allclose(at(onwards), [0, 6, 36, 42], atol=1e-9)
    # Else 1 February would come before 2 January.
    again = ["02/01/2026", "02/01/2026", "02/01/2026", "01/02/2026"]
    np.testing.assert_allclose(at(again), [0, 6, 12, 738], atol=1e-9)
    by_year = ["26-01-31", "26-02-01", "26-02-02", "26-02-03"]
    np.testing.assert_allclose(at(by_year), [0, 30, 60, 90], atol=1e-9)
    between = ["30/01/26", "31/01/26", "31/01/26", "31/01/26"]
    with pytest.raises(InputError, match="30 in 30/01/26 may be the day or the year"):
        at(between)


SCOPE = "X,CH1,CH2,Start,Increment{0}\nSequence,Volt,Volt,{1!r},{2!r}\n"


@pytest.mark.parametrize("behind", ["", ",", ",,"])
def test_samples_of_an_oscilloscope_are_numbered_from_a_start(tmp_path, behind):
    rows = np.stack([np.arange(4), U, W], axis=1).tolist()
    lines = "".join(f"{i:g},{u!r},{w!r}{behind}\n" for i, u, w in rows)
    text = SCOPE.format(behind[:1], -0.06, 2e-5) + lines
    columns = {"input": "CH1", "output": "CH2"}
    record = read(tmp_path, text, time="X", **columns)
    np.testing.assert_allclose(record.t, -0.06 + 2e-5 * np.arange(4), atol=1e-15)
    np.testing.assert_array_equal([record.u, record.w], [U, W])
    assert record.names == ("CH1", "CH2") and record.units == ("Volt", "Volt")
    some = read(tmp_path, text, time=0, rows=(1, None), **columns)
    np.testing.assert_array_equal(some.t, record.t[1:])
    broken = text.replace(f"2,{rows[2][1]!r}", "2")
    with pytest.raises(InputError, match="line 5 of "):
        read(tmp_path, broken, time="X", **columns)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("numbered", [False, True])
def test_names_stand_behind_the_mark_of_a_comment(tmp_path, separator, numbered):
    text = table(T, "#,t,u,w\n")
    if numbered:  # rows have numbers, whose column is called #
        head, *rows = text.splitlines()
        text = "\n".join([head, *(f"{i},{row}" for i, row in enumerate(rows))])
    check(read(tmp_path, text.replace(",", separator), time="t"))


def test_channels_of_an_oscilloscope_are_called_by_numbers(tmp_path):
    text = table(T, "x-axis,1,2\nsecond,Volt,Volt\n")
    record = read(tmp_path, text, time="x-axis", input="1", output="2")
    check(record)
    assert record.names == ("1", "2") and record.units == ("Volt", "Volt")
    for slip in ("second,Volt,2", "second,Volt,", "second,Volt,n/a"):  # a row of data
        with pytest.raises(InputError, match=r"line [12]"):
            read(tmp_path, text.replace("second,Volt,Volt", slip), input=1, output=2)


def test_channels_of_modules_are_names_and_no_numbers(tmp_path):
    columns = {"time": 0, "input": "1_2", "output": "1_3"}
    found = read(tmp_path, table(T, "1_1,1_2,1_3\n"), **columns)
    check(found)
    assert found.names == ("1_2", "1_3")


@pytest.mark.parametrize("separator", [";", ","])
def test_thousands_that_may_be_decimals_are_refused(tmp_path, separator):
    def lines(cells):
        rows = (f'"{cell}"{separator}{w}' for cell, w in zip(cells, W, strict=True))
        return "\n".join([f"u{separator}w", *rows])

    with pytest.raises(
        InputError, match=r"`input`.*'1,000', in line 4 .* beside '998'"
    ):
        read(tmp_path, lines(["998", "999", "1,000", "-12,001"]))
    for cells in (
        ["0,998", "0,999", "1,000", "1,001"],
        ["1", "1,125", "1,25", "1,375"],
    ):
        found = read(tmp_path, lines(cells))
        expected = [float(cell.replace(",", ".")) for cell in cells]
        np.testing.assert_array_equal(found.u, expected)
    with pytest.raises(InputError, match=r"`u` has 1 value\(s\) that are NaN"):
        read(tmp_path, lines(["0,998", "nan", "2,000", "2,001"]))


def test_points_between_thousands_are_no_decimals(tmp_path):
    def lines(cells):
        rows = (
            f"{cell};{w}".replace(",", ".") for cell, w in zip(cells, W, strict=True)
        )
        return "\n".join(["u;w", *rows])

    with pytest.raises(InputError, match=r"'1\.000', in line 4 .* beside '998'"):
        read(tmp_path, lines(["998", "999", "1.000", "1.001"]))
    # Who leaves out zeros writes 2 for 2.000.
    found = read(tmp_path, lines(["1", "1.125", "1.375", "2"]))
    np.testing.assert_array_equal(found.u, [1.0, 1.125, 1.375, 2.0])


@pytest.mark.parametrize(
    "first",
    [
        *("2026-01-31 11:59:59,,", "11:59:59,,", "OVER,OVER,OVER"),
        *("t,u,w\n****,****,****", "t,u,w\nN.A.,N.A.,N.A.", "t,u,w\n########,2,4"),
    ],
)
def test_a_first_row_without_numbers_is_not_lost(tmp_path, first):
    time = "2026-01-31 12:00:0" if first.startswith("2026") else "12:00:0"
    times = [f"{time}{i}" for i in range(4)] if "59" in first else T
    with pytest.raises(InputError, match=r"not a number|empty cell|cannot be read"):
        read(tmp_path, table(times, f"{first}\n"), time=0, input=1, output=2)


def test_a_cell_that_a_spreadsheet_could_not_fill_is_no_comment(tmp_path):
    lines = table(T, separator=" ", header="t u w\n") + "#N/A 4 4\n"
    with pytest.raises(InputError, match="'#N/A', which is not a number, in line 6"):
        read(tmp_path, lines, time="t")
    ruled = "#########\n# of a test; 3\n" + table(T)
    check(read(tmp_path, ruled, time="t"))


PREAMBLES = {
    "a title": ("Loop of stack 3, operator XY; 2026\nDate: 26.11.2026\n", ",", ""),
    "of an oscilloscope": (
        "Model,MDO3024\nPoint Format,Y,\nSample Interval,0.01,\nRecord Length,4,\n\n",
        ",",
        "",
    ),
    "of LabVIEW": (
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n",
        "\t",
        "\tComment",
    ),
    "of a testing machine": (
        "MTS793|MPT|ENU|1|0|A\n\nData Acquisition: cyclic\tTime: 0.01\tSec\n",
        "\t",
        "\ns\t[V]\tµm",
    ),
    "of so many cells": ("Test 7\nSpecimen\tA3\tcyclic\n\n", "\t", ""),
    "of an oscilloscope's channels": (
        "Model,MSO54\nVertical Scale,0.2,0.5\n\nLabel,,\n",
        ",",
        "",
    ),
    "of LabVIEW's channels": (
        "LabVIEW Measurement\nSamples\t4\t4\n***End_of_Header***\t\t\t\n",
        "\t",
        "\tComment",
    ),
    "in merged cells": ("Test 7,,\n", ",", ""),
    "in merged cells above units": ("Test 7,,\n", ",", "\ns,[V],µm"),
    "of so many cells, all filled": (
        "Sample,A3,cyclic\nRate,100,Hz\n",
        ",",
        "\ns,V,µm",
    ),
    "with a date right above the names": (
        "Sample,A3,cyclic\nRate,100,Hz\nDate,2026-01-31,12:30:05\n",
        ",",
        "",
    ),
    "filled up to so many cells": ("Test 7,,\nOperator,XY,\n,,\n", ",", ""),
}


@pytest.mark.parametrize("kind", PREAMBLES)
@pytest.mark.parametrize("gap", [False, True])
def test_text_above_the_names_is_left_out(tmp_path, kind, gap):
    above, separator, below = PREAMBLES[kind]
    lines = table(T, f"t,u,w{below}\n").replace(",", separator)
    found = read(tmp_path, above + lines, time="t")
    check(found)
    assert found.names == ("u", "w")
    assert found.units == (("V", "µm") if "µm" in below else ("", ""))
    if gap:  # numbers are never taken for text above them
        missing = (above + lines).replace(f"{U[0]}", "over", 1)
        assert missing.count("over") == 1
        with pytest.raises(InputError, match=r"has 'over', which is not a number"):
            read(tmp_path, missing, time="t")
        bare = above + lines[lines.index(f"{T[0]}") :]
        with pytest.raises(InputError, match=r"line \d|header|not a column"):
            read(tmp_path, bare, time="t")


@pytest.mark.parametrize("clock", [False, True])
def test_comments_of_labview_are_in_some_rows(tmp_path, clock):
    above = "LabVIEW Measurement\t\nX_Columns\tNo\n***End_of_Header***\t\n"
    times = [str(t) if clock else "" for t in T]  # of which the column stays, empty
    rows = table(times, "X_Value,u,w,Comment\n").replace(",", "\t").splitlines()
    columns = {"time": "X_Value"} if clock else {"period": 1.0}
    for place in (1, 2, 4):
        lines = [*rows[:place], f"{rows[place]}\tthe pump is on", *rows[place + 1 :]]
        found = read(tmp_path, above + "\n".join(lines), **columns)
        check(found, T if clock else np.arange(4.0))
    empty = "\n".join([rows[0], *(f"{row}\t" for row in rows[1:])])
    check(read(tmp_path, above + empty, **columns), T if clock else np.arange(4.0))
    other = "\n".join([*rows[:2], f"{rows[2]}\t7.5", *rows[3:]]).replace("Comment", "x")
    with pytest.raises(InputError, match=r"cells where most have 3"):
        read(tmp_path, above + other, **columns)


@pytest.mark.parametrize("place", [0, 1, 3])
def test_a_column_of_text_is_part_of_the_table_below_a_title(tmp_path, place):
    rows = [["t", "u", "w"], *np.stack([T, U, W], axis=1).tolist()]
    marks = ["run", *"abba"]
    lines = [
        ",".join(map(str, [*row[:place], mark, *row[place:]]))
        for mark, row in zip(marks, rows, strict=True)
    ]
    found = read(tmp_path, "\n".join(["Loop of stack 3", *lines]), time="t")
    check(found)


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
@pytest.mark.parametrize(
    "above", ["Loop of stack 3\n", "Loop 3, by XY; 2026\nDate: 26.11.2026\n"]
)
def test_text_above_numbers_without_names_is_left_out(tmp_path, above, separator):
    lines = table(T, "").replace(",", separator)
    columns = {"time": 0, "input": 1, "output": 2}
    for apart in ("\n", "# by hand\n", ""):
        if apart or separator != "  ":
            found = read(tmp_path, above + apart + lines, **columns)
            check(found)
            assert found.names == ("input", "output")
    short = above + f"{T[0]}{separator}{U[0]}\n" + lines
    with pytest.raises(InputError, match=r"line|header"):  # a row that lacks a number
        read(tmp_path, short, **columns)


@pytest.mark.parametrize("names", [",u,w", "t,w,"])
def test_names_of_some_columns_stand_above_units(tmp_path, names):
    record = read(tmp_path, table(T, f"{names}\ns,V,mm\n"), time=0, input=1, output=2)
    check(record)
    assert record.units == ("V", "mm")


def test_units_between_blanks(tmp_path):
    lines = table(T, "t u w\n[s] [V] [µm]\n").replace(",", "  ")
    found = read(tmp_path, lines, time="t")
    check(found)
    assert found.units == ("V", "µm")


@pytest.mark.parametrize("order", ["le", "be"])
def test_unicode_text_of_excel_is_read(tmp_path, order):
    mark = "\ufeff".encode(f"utf-16-{order}")
    lines = table(T, "t,µm,w\n").replace(",", "\t").replace("\n", "\r\n")
    whole = mark + lines.encode(f"utf-16-{order}")
    check(read(tmp_path, whole, time="t", input="µm"))
    with pytest.raises(InputError, match=r"begins as UTF-16 does.*cut short"):
        read(tmp_path, whole[:-1], time="t")
    with pytest.raises(InputError, match="binary"):
        read(tmp_path, whole[2:], time="t")


def test_hours_that_have_passed_are_read(tmp_path):
    hours = ["99:59:58", "99:59:59.5", "100:00:00", "100:00:01.25"]
    record = read(tmp_path, table(hours), time="t")
    np.testing.assert_allclose(record.t, [0, 1.5, 2, 3.25], rtol=0, atol=1e-9)
    with pytest.raises(InputError, match=r"'12:00:02 h' is no time of day.*12:00:00"):
        read(tmp_path, table([*hours[:3], "12:00:02 h"]), time="t")
    with pytest.raises(InputError, match="some say AM or PM, and others do not"):
        read(tmp_path, table([*hours[:3], "12:00:02 PM"]), time="t")
    with pytest.raises(InputError, match="'13:00:02 pm' is no time of day"):
        read(tmp_path, table(["1:00:02 pm"] * 3 + ["13:00:02 pm"]), time="t")
    with pytest.raises(InputError, match=r"`t` has 1 value.*row 2"):
        read(tmp_path, table([*hours[:2], "", hours[3]]), time="t")


def test_times_of_day_of_a_frame(tmp_path):
    pandas = pytest.importorskip("pandas")
    start = datetime.datetime(2026, 1, 31, 23, 59, 59, 990000)
    clock = [(start + datetime.timedelta(0, t)).time() for t in T]
    for t in (clock, [str(time) for time in clock]):
        frame = pandas.DataFrame({"t": t, "u": U, "w": W})
        check(Recording.from_pandas(frame, time="t", **COLUMNS))


def test_dates_make_times_of_a_recording():
    python = [datetime.datetime(2026, 1, 31) + datetime.timedelta(0, t) for t in T]
    for t in (DATES, list(DATES), DATES - DATES[0], python):
        check(Recording(t, U, W))
    missing = np.where(np.arange(4) == 2, np.datetime64("NaT", "s"), DATES)
    with pytest.raises(InputError, match=r"`t` has 1 value.*row 2"):
        Recording(missing, U, W)
    with pytest.raises(InputError, match=r"`t` holds dates.*0\.07 is among them"):
        Recording([*python[:3], 0.07], U, W)


def test_months_and_years_are_as_long_as_their_days():
    for dates, days in (
        (["2026-01", "2026-02", "2026-03", "2026-04"], [0, 31, 59, 90]),
        (["2023", "2024", "2025", "2026"], [0, 365, 731, 1096]),
    ):
        of_days = 86400.0 * np.array(days)
        check(Recording(np.array(dates, "datetime64"), U, W), of_days)
        check(Recording([np.datetime64(date) for date in dates], U, W), of_days)


def test_durations_may_be_shorter_than_nanoseconds_and_longer_than_these_count():
    count = np.array([0, 150_000, 150_001, 300_000])
    for unit, size in (("ps", 1e-12), ("D", 86400.0)):
        durations = count.astype(f"m8[{unit}]")
        for t in (durations, list(durations)):
            seconds = Recording(t, U, W).t
            np.testing.assert_allclose(seconds, size * count, rtol=1e-15)
    centuries = [datetime.timedelta(days=int(days)) for days in count]
    check(Recording(centuries, U, W), 86400.0 * count)
    # A nanosecond is told apart though it is 1e-18 of the time since 1970.
    late = np.datetime64("2026-01-31T12:00", "ns") + np.arange(4)
    assert Recording(late, U, W).t.tolist() == [0.0, 1e-9, 2e-9, 3e-9]


ZONES = [datetime.timezone(datetime.timedelta(hours=h)) for h in (-3.5, 0, 5.5)]


def test_dates_of_several_time_zones_count_alike(tmp_path):
    start = datetime.datetime(2026, 1, 31, 23, 59, tzinfo=ZONES[1])
    python = [
        (start + datetime.timedelta(0, t)).astimezone(zone)
        for t, zone in zip(T, [*ZONES, ZONES[0]], strict=True)
    ]
    pandas = pytest.importorskip("pandas")
    berlin = pandas.DatetimeIndex(DATES, tz="Europe/Berlin")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for t in (python, np.array(python), list(berlin)):
            check(Recording(t, U, W))
        for t in (pandas.Series(python, dtype=object), berlin):
            frame = pandas.DataFrame({"t": t, "u": U, "w": W})
            check(Recording.from_pandas(frame, time="t", **COLUMNS))
        check(Recording.from_pandas(frame.set_index("t"), **COLUMNS))
        text = [date.isoformat(" ") for date in python]
        check(read(tmp_path, table(text), time="t"))
    naive = [python[0].replace(tzinfo=None), *python[1:]]
    for read_again in (
        lambda: Recording(naive, U, W),
        lambda: read(tmp_path, table([date.isoformat() for date in naive]), time="t"),
    ):
        with pytest.raises(InputError, match="some have a time zone, and others none"):
            read_again()
    for missing in (None, pandas.NaT):
        with pytest.raises(InputError, match="NaN or inf, the first at row 3"):
            Recording([*python[:3], missing], U, W)


def test_dates_of_a_recording_across_dropouts():
    w = np.where(np.arange(4) == 1, np.nan, W)
    found, known = bridged(list(DATES), U, w)
    np.testing.assert_allclose(found.t, T, atol=1e-12)
    np.testing.assert_allclose(found.w[1], np.interp(0.02, [0, 0.05], W[[0, 2]]))
    np.testing.assert_array_equal(known, [1, 0, 1, 1])


def test_a_row_of_units_below_the_header(tmp_path):
    found = read(tmp_path, table(1000 * T, "t,u,w\nms,[V],µm\n"), time="t")
    check(found)
    assert found.names == ("u", "w") and found.units == ("V", "µm")
    both = read(tmp_path, table(1000 * T, "t [s],u [V],w\nms,mV,µm\n"), time="t")
    check(both)
    assert both.names == ("u [V]", "w") and both.units == ("mV", "µm")
    given = read(tmp_path, table(T, "t,u,w\ns,V,µm\n"), time="t", units=("kV", "m"))
    assert given.units == ("kV", "m")
    for word in ("n/a", "N/A", "OVER", "Overload"):
        with pytest.raises(InputError, match=f"'{word}', which is not a number.*ne 2"):
            read(tmp_path, table(T, f"t,u,w\n{word},{word},{word}\n"), time="t")


@pytest.mark.parametrize(
    ("row", "units"),
    [
        ("s,-,MPa", ("", "MPa")),
        ("s,1,MPa", ("", "MPa")),
        ("[s],[-],(MPa)", ("", "MPa")),
        ("s,[W/(m·K)],(m/(V·s))", ("W/(m·K)", "m/(V·s)")),
        ("s,nA,", ("nA", "")),
    ],
)
def test_units_of_all_kinds_and_none(tmp_path, row, units):
    found = read(tmp_path, table(T, f"t,u,w\n{row}\n"), time="t")
    check(found)
    assert found.units == units


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
@pytest.mark.parametrize("title", ["", "Test 7\n"])
def test_names_that_stand_there_twice_are_no_units(tmp_path, title, separator):
    names = separator.join(("t", "V", "A")) + "\n"
    columns = {"time": "t", "input": "V", "output": "A"}
    line = 2 + len(title.splitlines())
    with pytest.raises(InputError, match=f"'V', which is not a number, in line {line}"):
        read(tmp_path, table(T, title + 2 * names, separator), **columns)
    # Nor are they names where the row below tells units.
    units = separator.join(("s", "V", "A")) + "\n"
    found = read(tmp_path, table(T, title + names + units, separator), **columns)
    assert found.units == ("V", "A")


def test_text_and_a_gap_are_no_units(tmp_path):
    text = "run,u,w\na,1,-\nb,2,3\nb,3,4\nb,4,5\n"
    found = read(tmp_path, text, output="u")
    np.testing.assert_array_equal(found.u, [1, 2, 3, 4])


@pytest.mark.parametrize("time", ["2026-01-31", "12:00:00"])
def test_a_time_beside_gaps_is_no_row_of_units(tmp_path, time):
    text = f"t,u,w\n{time},,\n" + "".join(f"{time},{i},{i}\n" for i in range(3))
    with pytest.raises(InputError, match="an empty cell, in line 2"):
        read(tmp_path, text)


@pytest.mark.parametrize("separator", [";", "\t", "  "])
def test_decimal_commas(tmp_path, separator):
    header = separator.join("tuw") + "\n"
    text = table(T, header, separator).replace(".", ",")
    check(read(tmp_path, text, time="t"))
    mixed = text.replace("7,0", "7.0")
    with pytest.raises(InputError, match="has decimal points too"):
        read(tmp_path, mixed, time="t")


def test_an_empty_cell_among_decimal_commas_is_named(tmp_path):
    text = "t;u;w\n0;1,5;2,5\n1;;3\n2;1,0;3,25\n"
    with pytest.raises(InputError, match="an empty cell, in line 3"):
        read(tmp_path, text, time="t")


@pytest.mark.parametrize("header", ["", "w\n"])
def test_one_column_with_decimal_commas(tmp_path, header):
    column = [1.5, 0.05, 0.25, -0.125]
    text = header + "".join(f"{x}\n" for x in column).replace(".", ",")
    found = read(tmp_path, text, input=0, output=0)
    np.testing.assert_array_equal(found.u, column)
    pairs = read(tmp_path, "1,5\n2,25\n3,125\n", input=0, output=1)
    np.testing.assert_array_equal(pairs.w, [5, 25, 125])


@pytest.mark.parametrize("index", [False, True])
def test_a_header_of_numbers_is_no_row(tmp_path, index):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(np.stack([T, U, W], axis=1))
    numbers = {"time": index, "input": 1 + index, "output": 2 + index}
    path = tmp_path / "record.csv"
    frame.to_csv(path, index=index)
    check(Recording.from_csv(path, **numbers))
    frame.to_csv(path, index=index, float_format="%.6e", sep="\t")
    check(Recording.from_csv(path, **numbers))


def test_a_number_that_is_the_name_of_another_column_of_a_frame_is_told():
    """As without a header, and with the first column for the index."""
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({1: U, 2: W, 3: T})
    with pytest.raises(InputError, match=r"number of column '2' .* '2' or '1'"):
        Recording.from_pandas(frame, time=2, input=1, output=2)
    check(Recording.from_pandas(frame, time="3", input="1", output="2"))
    check(Recording.from_pandas(frame[[3, 1, 2]], time=0, input="1", output="2"))


def test_a_first_row_of_data_that_looks_like_a_header_of_numbers(tmp_path):
    numbers = {"time": 0, "input": 1, "output": 2}
    for text in ("0,1,2\n1,3,2\n2,5,1\n", "0,1,2\n0.5,3,2\n1,5.25,1\n"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(read(tmp_path, text, **numbers)) == 3
    gaps = read(tmp_path, ",0,1\n,2,3\n7,5,1\n", input=1, output=2)
    np.testing.assert_array_equal(gaps.u, [0, 2, 5])
    text = "0,1,2\n0.5,1.5,2.5\n0.7,1.2,2.1\n0.9,1.1,2.2\n"
    german = text.replace(",", ";").replace(".", ",")
    for each in (text, german):
        with pytest.warns(UserWarning, match=r"first line.*0,1,2, was read as data.*#"):
            read(tmp_path, each, **numbers)
    # Whole numbers in a column of others are written by pandas with a zero.
    for each in (german.replace("0,5;", "0,0;"), german.replace("2,5\n", "2,0\n")):
        assert len(read(tmp_path, each, **numbers)) == 3


def test_digits_with_an_underscore_are_no_number(tmp_path):
    for cell in ("2_5", "2_5,5"):
        text = table(T).replace(",", ";").replace(".", ",")
        first = text.splitlines()[3].split(";")[1]
        with pytest.raises(InputError, match=f"'{cell}', which is not a number"):
            read(tmp_path, text.replace(first, cell, 1), time="t")


@pytest.mark.parametrize(("by", "ending"), [(gzip, "gz"), (bz2, "bz2"), (lzma, "xz")])
def test_compressed_files(tmp_path, by, ending):
    packed = by.compress(table(T).encode())
    check(read(tmp_path, packed, f"record.csv.{ending}", time="t"))
    with pytest.raises(InputError, match=f"compressed by {by.__name__}, and damaged"):
        read(tmp_path, packed[:-20], f"record.csv.{ending}", time="t")
    with pytest.raises(InputError, match=f"compressed by {by.__name__}, and damaged"):
        read(tmp_path, packed[:12] + b"?????" + packed[17:], time="t")
    whole = io.BytesIO()
    np.save(whole, np.stack([T, U, W], axis=1))
    by_number = {"time": 0, "input": 1, "output": 2}
    check(read(tmp_path, by.compress(whole.getvalue()), f"a.NPY.{ending}", **by_number))


def test_text_that_begins_as_a_compressed_file_does(tmp_path):
    check(read(tmp_path, table(T, "BZh,u,w\n"), time="BZh"))
    check(read(tmp_path, table(T, "BZh1,u,w\n"), time="BZh1"))
    with pytest.raises(InputError, match=r"has no rows"):  # of a file, unpacked
        read(tmp_path, bz2.compress(b""))


def test_compressed_files_where_python_has_no_such_module(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lzma", None)  # as where it was built without
    with pytest.raises(InputError, match="built without its `lzma`: unpack it first"):
        read(tmp_path, lzma.compress(table(T).encode()), time="t")


def test_arrays_in_files(tmp_path):
    by_number = {"time": 0, "input": 1, "output": 2}
    path = tmp_path / "record.npy"
    np.save(path, np.stack([T, U, W], axis=1))
    check(Recording.from_csv(path, **by_number))
    check(Recording.from_csv(path, **by_number, rows=(0, 4)))
    np.save(path, np.vstack([np.arange(5.0), np.ones(5), np.ones(5)]) + T[:3, None])
    with pytest.warns(
        UserWarning, match=r"shape \(3, 5\), which was read as 5 columns"
    ):
        assert len(Recording.from_csv(path, **by_number)) == 3
    kinds = [("t_ms", float), ("u", float), ("w", float)]
    rows = list(zip(1000 * T, U, W, strict=True))
    np.save(path, np.array(rows, kinds))
    with pytest.warns(UserWarning, match="time_unit='ms'"):
        check(Recording.from_csv(path, time="t_ms", **COLUMNS), 1000 * T)
    np.savez(tmp_path / "record.npz", t=T, u=U, w=W)
    check(Recording.from_csv(tmp_path / "record.npz", time="t", **COLUMNS))
    np.savez(tmp_path / "record.npz", t=T, u=U[:2], w=W)
    with pytest.raises(InputError, match="Lengths differ: `t` 4, `u` 2, `w` 4"):
        Recording.from_csv(tmp_path / "record.npz", time="t", **COLUMNS)
    path.write_bytes(path.read_bytes()[:90])
    with pytest.raises(InputError, match=r"record.npy cannot be read"):
        Recording.from_csv(path, **by_number)


def test_arrays_that_are_not_asked_for_may_be_of_any_shape(tmp_path):
    path = tmp_path / "record.npz"
    others = {"fs": 50.0, "notes": np.array([{"by": "hand"}], dtype=object)}
    np.savez(path, t=T, u=U, w=W, short=U[:2], **others)
    check(Recording.from_csv(path, time="t", **COLUMNS))
    part = Recording.from_csv(path, time="t", rows=(1, 4), **COLUMNS)
    np.testing.assert_array_equal(part.w, W[1:])
    with pytest.raises(InputError, match=r"`time`='fs' of .* shape \(\)"):
        Recording.from_csv(path, time="fs", **COLUMNS)
    with pytest.raises(InputError, match=r"record.npz cannot be read: Object arrays"):
        Recording.from_csv(path, time="notes", **COLUMNS)


def test_broken_archives_of_arrays(tmp_path):
    path = tmp_path / "record.npz"
    np.savez(path, t=T, u=U, w=W)
    content = path.read_bytes()
    for broken in (
        content[: len(content) // 2],
        content.replace(U.tobytes(), b"!" * 32),
    ):
        path.write_bytes(broken)
        with pytest.raises(InputError, match=r"record.npz cannot be read"):
            Recording.from_csv(path, time="t", **COLUMNS)
    np.savez(path)
    with pytest.raises(InputError, match=r"record.npz holds no arrays"):
        Recording.from_csv(path, time="t", **COLUMNS)


class Columns(dict):
    """What has columns by name, as a table of Astropy does."""

    columns = property(dict.keys)


def test_frames_of_pandas_and_their_files(tmp_path):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"t": T, "u": U, "w": W})
    check(Recording.from_pandas(frame, time="t", **COLUMNS))
    dated = frame.set_index(pandas.DatetimeIndex(DATES))
    check(Recording.from_pandas(dated, **COLUMNS))
    part = Recording.from_pandas(dated, **COLUMNS, rows=(1, 4), units=("V", "µm"))
    np.testing.assert_allclose(part.t, T[1:] - T[1], rtol=1e-12)
    np.testing.assert_array_equal(part.u, U[1:])
    other = frame.set_index(pandas.to_timedelta(2 * T, "s"))
    check(Recording.from_pandas(other, time="t", **COLUMNS))
    check(Recording.from_pandas(other, **COLUMNS), 2 * T)
    for indexed in (frame.set_index("t"), dated.drop(columns="t").rename_axis("t")):
        check(Recording.from_pandas(indexed, time="t", **COLUMNS))
    in_ms = frame.assign(t=1000 * T).set_index("t").rename_axis("T [ms]")
    check(Recording.from_pandas(in_ms, time="t", **COLUMNS))
    with pytest.raises(InputError, match=r"is not a column .*2 'T \[ms\]'"):
        Recording.from_pandas(in_ms, time="seconds", **COLUMNS)
    both = frame.rename_axis("t")  # numbers of rows, of the name of a column
    check(Recording.from_pandas(both, time="t", **COLUMNS))
    # A column that is called index stays what it is, as do two of one name.
    named = other.rename(columns={"u": "index"})
    found = Recording.from_pandas(named, input="index", output="w")
    check(found, 2 * T)
    assert found.names == ("index", "w")
    twice = other[["t", "t", "u", "w"]]
    found = Recording.from_pandas(twice, input=2, output=3)
    check(found, 2 * T)
    assert found.names == ("u", "w")
    rows = np.ma.masked_equal(U, U[2])
    with pytest.raises(InputError, match=r"`u` has 1 value.* first at row 2"):
        Recording.from_pandas(Columns({"t": T, "u": rows, "w": W}), time="t", **COLUMNS)
    with pytest.warns(UserWarning, match="no clock"):
        assert not Recording.from_pandas(frame, **COLUMNS).clocked
    frame.to_parquet(tmp_path / "record.parquet")
    check(Recording.from_csv(tmp_path / "record.parquet", time="t", **COLUMNS))
    for indexed in (frame.set_index("t"), dated.drop(columns="t").rename_axis("t")):
        indexed.to_parquet(tmp_path / "indexed.parquet")
        check(Recording.from_csv(tmp_path / "indexed.parquet", time="t", **COLUMNS))
    check(Recording.from_csv(tmp_path / "indexed.parquet", **COLUMNS))
    with pytest.raises(InputError, match=r"there is no file .*none.parquet"):
        Recording.from_csv(tmp_path / "none.parquet", time="t", **COLUMNS)
    words = frame.assign(u=["a", "b", "c", "d"])
    with pytest.raises(InputError, match="`input`='u' of the frame is no column of n"):
        Recording.from_pandas(words, time="t", **COLUMNS)


def test_a_clock_that_is_not_asked_for_is_told_of(tmp_path):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"u": U, "w": W}, index=pandas.Index(T, name="Time [s]"))
    path = tmp_path / "record.mat"
    scipy.io.savemat(path, {"t": T, "u": U, "w": W})
    for name, unasked in (
        (r"Time \[s\]", lambda **how: Recording.from_pandas(frame, **COLUMNS, **how)),
        ("t", lambda **how: Recording.from_mat(path, **COLUMNS, **how)),
    ):
        with pytest.warns(UserWarning, match=f"no clock.*`time='{name}'`"):
            assert not unasked().clocked
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert unasked(period=1.0).clocked
            check(unasked(time=name.replace("\\", "")))


@pytest.mark.parametrize(
    "name", ["X_Value", "second", "t/ms", "Zeit [ms]", "TIME", "Elapsed Time (s)"]
)
def test_a_clock_is_known_by_what_instruments_call_it(tmp_path, name):
    path = tmp_path / "record.csv"
    rows = "\n".join(f"{t},{u},{w}" for t, u, w in zip(T, U, W, strict=True))
    path.write_text(f"{name},u,w\n{rows}\n", encoding="utf-8")
    with pytest.warns(UserWarning, match=re.escape(f"`time={name!r}` would be")):
        assert not Recording.from_csv(path, **COLUMNS).clocked


def test_columns_of_matlab_structures_have_the_names_of_matlab(tmp_path):
    path = tmp_path / "struct.mat"
    inner = {"V": U, "x": {"stroke": W}}
    scipy.io.savemat(path, {"meas": {"time": T, **inner}, "note": "hello"})
    record = Recording.from_mat(
        path, time="meas.time", input="meas.V", output="meas.x.stroke"
    )
    for ours, given in ((record.t, T), (record.u, U), (record.w, W)):
        np.testing.assert_array_equal(ours, given)
    assert record.names == ("meas.V", "meas.x.stroke")
    with pytest.raises(InputError, match=r"meas\.x\.stroke"):
        Recording.from_mat(path, time="meas.time", input="meas.V", output="stroke")


def test_periods_of_pandas_are_dates(unchecked):
    pandas = pytest.importorskip("pandas")
    periods = pandas.PeriodIndex(DATES, freq="ms")
    assert periods.dtype == "period[ms]"
    frame = pandas.DataFrame({"t": periods, "u": U, "w": W})
    check(Recording.from_pandas(frame, time="t", **COLUMNS))
    indexed = frame.drop(columns="t").set_index(periods)
    check(Recording.from_pandas(indexed, **COLUMNS))
    assert Recording.from_pandas(indexed, **COLUMNS).clocked
    check(Recording.from_pandas(indexed.rename_axis("t"), time="t", **COLUMNS))
    for t in (periods, list(periods), frame["t"]):
        check(Recording(t, U, W))
    missing = frame.assign(t=periods.where(W > -3))
    with pytest.raises(InputError, match=r"`t` has 1 value.*row 2"):
        Recording.from_pandas(missing, time="t", **COLUMNS)


def test_tables_of_pyarrow():
    arrow = pytest.importorskip("pyarrow")
    for t in (T, DATES, DATES - DATES[0]):
        flat = arrow.table({"t": t, "u": U, "w": W})
        chunked = arrow.concat_tables([flat[:1], flat[1:]])
        for each in (flat, chunked, flat.to_batches()[0]):
            check(Recording.from_pandas(each, time="t", **COLUMNS))


@pytest.mark.parametrize("path", [3, None, b"record.csv", ["record.csv"], ""])
def test_a_path_that_is_none_is_told_of(unchecked, path):
    columns = {"t": "t", "u": "u", "w": "w"}
    for call in (
        lambda: Recording.from_csv(path, **COLUMNS),
        lambda: Recording.from_mat(path, **COLUMNS),
        lambda: LongRecording.from_parquet(path, **columns),
        lambda: LongRecording.from_npy(**dict.fromkeys("tuw", path)),
        lambda: load(path),
        lambda: loops.read_forc(path),
        lambda: plot.save(Figure(), path),
    ):
        with pytest.raises(InputError, match="`path` must name a file, got"):
            call()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (5, r"`rows` must be a pair.*such as \(0, 500\).*the number 5"),
        (None, r"`rows` must be a pair.*got None"),
        ("0:5", r"`rows` must be a pair.*the text '0:5'"),
        (slice(0, 3), r"`rows` must be a pair"),
        ((0, 4, 2), r"`rows` must be a pair"),
        ((0.0, 4.0), r"`rows\[0\]` must be a whole number.*0\.0"),
        ((0, "4"), r"`rows\[1\]` must be a whole number.*'4'"),
    ],
)
def test_rows_are_a_pair_of_whole_numbers(tmp_path, unchecked, rows, message):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"u": U, "w": W})
    with pytest.raises(InputError, match=message):
        read(tmp_path, table(T), time="t", rows=rows)
    with pytest.raises(InputError, match=message):
        Recording.from_pandas(frame, rows=rows, **COLUMNS)
    with pytest.raises(InputError, match="the frame has no rows"):
        Recording.from_pandas(frame[:0], **COLUMNS)


@pytest.mark.parametrize("units", [None, 1, ("V", None), "Vm", ("V",), ("V", "m", "s")])
def test_units_are_a_pair_of_texts(tmp_path, unchecked, units):
    for name in ("units", "names"):
        with pytest.raises(InputError, match=f"`{name}` must be a pair of texts"):
            read(tmp_path, table(T), time="t", **{name: units})
        with pytest.raises(InputError, match=f"`{name}` must be a pair of texts"):
            Recording(T, U, W, **{name: units})


def test_columns_of_one_name_are_had_by_number():
    pandas, arrow = map(pytest.importorskip, ("pandas", "pyarrow"))
    names, numbers = ("t", "x", "x"), {"input": 1, "output": 2}
    for frame in (
        pandas.DataFrame(np.stack([T, U, W], axis=1), columns=names),
        arrow.Table.from_arrays([*map(arrow.array, (T, U, W))], names=names),
    ):
        check(Recording.from_pandas(frame, time="t", **numbers))
        with pytest.raises(InputError, match=r"`input`='x' fits 2 columns .*1 'x', 2"):
            Recording.from_pandas(frame, time="t", input="x", output=2)


SHEETS = {
    "names": ("t,u,w\n", ("u", "w"), ("", "")),
    "no names": ("", ("input", "output"), ("", "")),
    "units": ("t,u,w\ns,V,µm\n", ("u", "w"), ("V", "µm")),
    "a title": ("Test 7; by XY,,\n,,\nt,u,w\ns,V,µm\n", ("u", "w"), ("V", "µm")),
}


@pytest.mark.parametrize("kind", SHEETS)
def test_spreadsheets_are_read_as_text_is(monkeypatch, kind):
    pandas = pytest.importorskip("pandas")
    above, names, units = SHEETS[kind]
    text = table(T, above)

    # The engine of a spreadsheet is not among what hystjax installs.
    def read_excel(path, **how):
        assert how.pop("sheet_name") is None
        cells = pandas.read_csv(io.StringIO(text), skip_blank_lines=False, **how)
        return {"Data": cells, "Sheet2": pandas.DataFrame()}

    monkeypatch.setattr(pandas, "read_excel", read_excel)
    record = Recording.from_csv("record.xlsx", time=0, input=1, output=2)
    check(record)
    assert (record.names, record.units) == (names, units)


def test_sheets_that_are_not_read_are_named(monkeypatch):
    pandas = pytest.importorskip("pandas")
    cells = pandas.DataFrame(np.stack([T, U, W], axis=1), dtype=object)
    sheets = {"up": cells, "empty": pandas.DataFrame(), "down": cells[::-1]}
    monkeypatch.setattr(pandas, "read_excel", lambda path, **how: sheets)
    with pytest.warns(UserWarning, match="the first, 'up', was read; 'down' was not"):
        check(Recording.from_csv("record.xlsx", time=0, input=1, output=2))


def test_moments_and_gaps_of_a_spreadsheet(monkeypatch):
    pandas = pytest.importorskip("pandas")
    start = datetime.datetime(2026, 1, 31, 23, 59, 59, 990000)
    after = [datetime.timedelta(hours=30, seconds=t) for t in T]
    clock = [start + datetime.timedelta(seconds=t) for t in T]

    def read(t, w):
        rows = [("t", "no;te\n", "u", "w"), *zip(t, 4 * ["a;b\tc"], U, w, strict=True)]
        cells = {"Data": pandas.DataFrame(rows, dtype=object)}
        monkeypatch.setattr(pandas, "read_excel", lambda path, **how: cells)
        return Recording.from_csv("record.xlsx", time="t", **COLUMNS)

    for t in (clock, after, [time.time() for time in clock]):
        check(read(t, W))
    with pytest.raises(InputError, match=r"an empty cell, in line 4 of record.xlsx"):
        read(T, [W[0], W[1], "", W[3]])
    with pytest.raises(InputError, match=r"`w` has 1 value.*row 2"):  # such as #DIV/0!
        read(T, [W[0], W[1], np.nan, W[3]])


def test_numbers_in_columns_of_text_and_objects_are_no_dates(tmp_path):
    pandas = pytest.importorskip("pandas")
    for t in (pandas.Series([0, 20, 50, 70], dtype=object), ["0", "20", "50", "70"]):
        frame = pandas.DataFrame({"t": t, "u": U, "w": W})
        check(Recording.from_pandas(frame, time="t", time_unit="ms", **COLUMNS))
    path = tmp_path / "record.npz"
    np.savez(path, t=np.array(["1000", "1000.02", "1000.05", "1000.07"]), u=U, w=W)
    read_back = Recording.from_csv(path, time="t", **COLUMNS)
    np.testing.assert_array_equal(read_back.t, 1000 + T)
    durations = [datetime.timedelta(0, t) for t in T]
    for t in (DATES.astype(str), list(DATES), durations):
        frame = pandas.DataFrame({"t": pandas.Series(t, dtype=object), "u": U, "w": W})
        check(Recording.from_pandas(frame, time="t", **COLUMNS))
    words = pandas.DataFrame({"t": ["2026-01-31", "x", "y", "z"], "u": U, "w": W})
    with pytest.raises(
        InputError, match="`time`='t' of the frame holds dates or times"
    ):
        Recording.from_pandas(words, time="t", **COLUMNS)


def test_complex_columns_are_refused(tmp_path):
    pandas = pytest.importorskip("pandas")
    np.savez(tmp_path / "record.npz", t=T, u=U + 1j, w=W)
    np.save(tmp_path / "record.npy", np.stack([T, U + 1j, W], axis=1))
    frame = pandas.DataFrame({"t": T, "u": U + 1j, "w": W})
    for call in (
        lambda: Recording.from_csv(tmp_path / "record.npz", time="t", **COLUMNS),
        lambda: Recording.from_csv(tmp_path / "record.npy", input=1, output=2, time=0),
        lambda: Recording.from_pandas(frame, time="t", **COLUMNS),
    ):
        with pytest.raises(InputError, match=r"no column of real numbers.*complex128"):
            call()


def test_frames_of_other_makes_and_what_is_none(unchecked):
    class Frame(dict):
        columns = ("t", "u", "w")

        def __len__(self):
            return 4

    check(Recording.from_pandas(Frame(t=T, u=U, w=W), time="t", **COLUMNS))
    with pytest.raises(InputError, match=r"`frame` must be a data frame.*ndarray"):
        Recording.from_pandas(U, **COLUMNS)


@pytest.mark.parametrize(
    ("name", "near"),
    [("Voltag", "Voltage [V]"), ("strok", "Stroke"), ("voltage_v", "Voltage [V]")],
)
def test_a_column_that_is_not_there_is_answered_with_the_nearest(tmp_path, name, near):
    text = table(T, "t,Voltage [V],Stroke\n")
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, time="t", input=name, output=2)
    assert f"Did you mean {near!r}? " in str(caught.value)


def test_a_column_without_a_name_is_not_looked_for_in_empty_cells(tmp_path):
    file = tmp_path / "gaps.csv"
    file.write_text("t,u,w,remark\n" + "".join(f"{i},{i % 3},{i},\n" for i in range(9)))
    with pytest.raises(InputError, match="`time`='' is not a column") as error:
        Recording.from_csv(file, time="", input="u", output="w")
    assert "stands in line" not in str(error.value)
