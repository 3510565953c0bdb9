import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from hystjax import InputError, Recording
from hystjax.recording._formats import json_matrix, micromag_segments, read_mat
from hystjax.recording._text import read_text

NUMBERS = np.array([[0.0, -1.5, 3e-3], [0.1, 2.0, -7.25], [0.25, 0.0, 1e6]])


@pytest.fixture
def write(tmp_path):
    def write(content, name="data.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def lines(separator, ending="\n"):
    return "".join(separator.join(map(repr, row)) + ending for row in NUMBERS.tolist())


@pytest.mark.parametrize("header", ["", "t,u,w"])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   ", ", ", " \t "])
def test_any_separator_and_line_ending(write, separator, ending, header):
    names = separator.join(header.split(",")) + ending if header else ""
    table = read_text(write(names + lines(separator, ending)))
    assert table.names == tuple(header.split(",") if header else ())
    for number, name in enumerate(header.split(",") if header else (0, "1", 2)):
        np.testing.assert_array_equal(table.column("input", number), NUMBERS[:, number])
        np.testing.assert_array_equal(table.column("input", name), NUMBERS[:, number])


@pytest.mark.parametrize(
    "content",
    [
        "# made by hand\n% 3 rows\n\n" + lines(",") + "\n  \n# end\n",
        "\ufeff" + lines(","),
        lines(",").rstrip("\n"),
        lines(",").replace("e", "E").replace("-", " -"),
        ("# Größe in µm\n" + lines(",")).encode("latin-1"),
    ],
    ids=["comments", "byte-order mark", "no last newline", "spelling", "latin-1"],
)
def test_what_may_stand_around_the_numbers(write, content):
    table = read_text(write(content))
    columns = [table.column("input", number) for number in range(3)]
    np.testing.assert_array_equal(np.transpose(columns), NUMBERS)


@pytest.mark.parametrize("header", ["", '"t","u","w"'])
@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
@pytest.mark.parametrize("comma", [False, True])
def test_cells_in_quotes_are_those_that_pythons_csv_writes(
    write, separator, comma, header
):
    rows = [[repr(x) for x in row] for row in NUMBERS.tolist()]
    if comma:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    text = io.StringIO()
    csv.writer(text, delimiter=separator[0], quoting=csv.QUOTE_ALL).writerows(rows)
    quoted = text.getvalue().replace('"' + separator[0], '"' + separator)
    names = header.replace(",", separator) + "\n" if header else ""
    table = read_text(write(names + quoted))
    assert table.names == (("t", "u", "w") if header else ())
    columns = [table.column("input", number) for number in range(3)]
    np.testing.assert_array_equal(np.transpose(columns), NUMBERS)


def test_thousands_in_quotes_are_named(write):
    table = read_text(write('t,w\n0.5,"1,234.5"\n1.0,"2,345.5"\n'))
    with pytest.raises(
        InputError, match=r"'1,234\.5', which is not.*in line 2.* between thousands"
    ):
        table.column("output", "w")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t;w\n0.02;1,000\n0.04;91,727\n", r"'1,000', in line 2 .*beside '0\.02': whe"),
        ("t;w\n0,02;1.000\n0,04;91.727\n", r"'1\.000', in .*'0,02': whether points"),
        ("t;w\n1;999\n2;1,000\n", r"'1,000', in line 3 of .*, beside '999'"),
    ],
)
def test_thousands_are_not_taken_for_decimals(write, content, message):
    with pytest.raises(InputError, match=message):
        read_text(write(content)).column("output", "w")


def test_decimals_that_may_be_thousands_are_warned_of(write):
    table = read_text(write("t;w\n0;1,000\n1;2,500\n"))
    with pytest.warns(UserWarning, match=r"column 1\) has '1,000'.*read as decimal"):
        assert table.column("output", "w").tolist() == [1.0, 2.5]
    # Another column tells that commas are decimal, or one number does.
    for content in ("t;w\n0,5;1,000\n1;2,500\n", "t;w\n0;0,000\n1;2,500\n"):
        table = read_text(write(content))
        assert table.column("output", "w")[1] == 2.5
    points = read_text(write("t;w\n0;1.000\n1;2.500\n"))
    assert points.column("output", "w").tolist() == [1.0, 2.5]


LABVIEW = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nX_Columns\tOne\n"
    "***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t3\t3\t\n"
    "Y_Unit_Label\tVolts\tVolts\t\nX0\t0.0E+0\t0.0E+0\t\nDelta_X\t0.1\t0.1\t\n"
    "***End_of_Header***\t\t\t\nX_Value\tVoltage\tForce\tComment\n"
)


def test_a_header_may_be_longer_than_its_table(write):
    table = read_text(write(LABVIEW + lines("\t"), "short.lvm"))
    assert table.names == ("X_Value", "Voltage", "Force")
    columns = [table.column("input", number) for number in range(3)]
    np.testing.assert_array_equal(np.transpose(columns), NUMBERS)
    # Nor is a table with words in its rows taken for such a header.
    words = "t,state,w\n0,ok,1\n1,ok,2\n2,ok,3\nthe largest of all\n1,2\n3,4\n"
    with pytest.raises(InputError, match=r"line 5 of .* has 1 cells where most have 3"):
        read_text(write(words))


def test_a_name_that_stands_below_the_first_line_is_told_of(write):
    table = read_text(write("Operator,Sample\nSmith,steel\nt,w\n0,1\n1,2\n2,3\n"))
    with pytest.raises(InputError, match=r"'w' .*0 'Operator'.* in line 3: if that is"):
        table.column("output", "w")
    with pytest.raises(InputError, match=r"'3' is not a column of [^\n]*'Sample'\.$"):
        table.column("output", "3")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_rows_may_end_with_a_separator_and_names_without(write, separator):
    names = separator.join("tuw") + "\n"
    table = read_text(write(names + lines(separator, f"{separator}\n")))
    assert table.names == ("t", "u", "w")
    np.testing.assert_array_equal(table.column("output", "w"), NUMBERS[:, 2])
    with pytest.raises(InputError, match=r"3 names .* for 4 columns"):
        read_text(write(names + lines(separator, f"{separator}1\n")))
    mixed = lines(separator, f"{separator}1\n").replace(
        f"{separator}1\n", f"{separator}\n", 1
    )
    with pytest.raises(InputError, match=r"3 names .* for 4 columns"):
        read_text(write(names + mixed))


@pytest.mark.parametrize("above", ["Test 7\n", "Rate;1000\n", "Test 7\n\n"])
@pytest.mark.parametrize("units", [(), ("s", "V", "mm")])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_title_may_stand_above_rows_that_end_with_a_separator(
    write, separator, units, above
):
    names = above.replace(";", separator) + separator.join("tuw") + "\n"
    names += separator.join(units) + "\n" if units else ""
    table = read_text(write(names + lines(separator, f"{separator}\n")))
    assert (table.names, table.units) == (("t", "u", "w"), units)
    np.testing.assert_array_equal(table.column("output", "w"), NUMBERS[:, 2])


def test_names_with_units_below_a_title_of_as_many_cells_are_no_units(write):
    """Which line holds the names, the file does not say; the message does."""
    table = read_text(write("Sample;S-17\nH [kA/m];B [T]\n0;1\n1;2\n2;3\n"))
    assert table.units == ()
    with pytest.raises(InputError, match=r"It stands in line 2: if that is the head"):
        table.column("input", "H")


def test_empty_columns_count(write):
    table = read_text(write(",0.5,1,\n,0.75,2,\n"))
    np.testing.assert_array_equal(table.column("input", 1), [0.5, 0.75])
    np.testing.assert_array_equal(table.column("input", 2), [1, 2])


def test_columns_of_text_are_no_header_and_no_obstacle(write):
    table = read_text(write("12:00:01,0.5,ok\n12:00:02,0.75,ok\n"))
    assert table.names == ()
    np.testing.assert_array_equal(table.column("input", 1), [0.5, 0.75])


@pytest.mark.parametrize(
    ("header", "key", "title"),
    [
        ("Time [s]\tPosition [mm]\t", "Position [mm]", "Position [mm]"),
        ("Time [s]\tPosition [mm]", "position", "Position [mm]"),
        ("Time [s]\tPosition (mm)", "POSITION (MM)", "Position (mm)"),
        ("pos\tPOS", "POS", "POS"),
        ('"Time, s"\t"Position, mm"', "Position, mm", "Position, mm"),
        ("t\tx", "1", "x"),
        ("t\tx", 1, "x"),
        ("t\t", 1, "default"),
    ],
)
def test_columns_by_header_name(write, header, key, title):
    table = read_text(write(header + "\n0.0\t1.5\n0.5\t2.5\n"))
    np.testing.assert_array_equal(table.column("input", key), [1.5, 2.5])
    assert table.title(key, "default") == title


def test_names_with_units_between_blanks(write):
    table = read_text(write("Time [s]  Force (N)\n0.0  1.5\n"))
    assert table.names == ("Time [s]", "Force (N)")
    assert read_text(write("0.0 1.5\n")).title(1, "default") == "default"


def test_cells_in_quotes_between_blanks_are_those_that_r_writes(write):
    rows = '"0.0" 1.5  "at rest"\n"0.1"\t" 2.5" "on its way"\n'
    table = read_text(write(f'"Time (s)" "Force" "is moving"\n{rows}'))
    assert table.names == ("Time (s)", "Force", "is moving")
    np.testing.assert_array_equal(table.column("input", "time"), [0.0, 0.1])
    np.testing.assert_array_equal(table.column("output", "force"), [1.5, 2.5])
    dated = '"when" "F" [kN]\n"2026-01-31 12:00:00" 1\n"2026-01-31 12:00:02" 2\n'
    table = read_text(write(dated))
    assert table.names == ("when", "F [kN]")
    assert np.diff(table.moments("time", "when")) == np.timedelta64(2, "s")


def test_rows_count_from_the_line_after_the_header(write):
    path = write("t,u\n# note\n0,10\n1,11\n2,12\n3,13\n")
    for rows, expected in {
        (None, None): [10, 11, 12, 13],
        (1, 3): [11, 12],
        (None, 1): [10],
        (3, None): [13],
    }.items():
        column = read_text(path, rows=rows).column("input", "u")
        np.testing.assert_array_equal(column, expected)


@pytest.mark.parametrize("rows", [(2, 2), (3, 1), (0, 5), (-1, 2), (4, None)])
def test_rows_outside_the_file(write, rows):
    with pytest.raises(InputError, match=r"`rows`=.* it has 4 rows"):
        read_text(write("t,u\n0,1\n1,1\n2,1\n3,1\n"), rows=rows)


@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
@pytest.mark.parametrize("title", ["", "bench 3, range 2\n"])
def test_names_in_the_comment_that_numpy_writes_above_the_numbers(
    tmp_path, separator, title
):
    names = "t (ms)", "V", "x"
    header = title + separator.join(names)
    path = tmp_path / "saved.csv"
    np.savetxt(path, NUMBERS, fmt="%.17g", delimiter=separator, header=header)
    table = read_text(path)
    assert table.names == names
    for number, name in enumerate(("t", "V", "x")):
        np.testing.assert_array_equal(table.column("input", name), NUMBERS[:, number])


@pytest.mark.parametrize(
    "above",
    [
        "# piezo, 150 V\n",  # other words than columns
        "# sensor no 3\n",  # prose of as many words
        "# t,u,w\n\n",  # not right above
        "# 1,2,3\n",
        "# t,,w\n",
    ],
)
def test_other_comments_name_nothing(write, above):
    assert read_text(write(above + lines(","))).names == ()


def test_units_below_names_in_comments(write):
    table = read_text(write("# Time\tVolt\tPath\n# ms\t[V]\tmm\n" + lines("\t")))
    assert table.names == ("Time", "Volt", "Path")
    assert table.units == ("ms", "V", "mm")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_row_of_units_may_begin_with_per_cent(write, separator):
    head = "\n".join(map(separator.join, (["e", "F", "t"], ["%", "kN", "ms"])))
    table = read_text(write(f"{head}\n{lines(separator)}"))
    assert table.names == ("e", "F", "t") and table.units == ("%", "kN", "ms")
    commented = read_text(
        write(f"e{separator}F{separator}t\n% of 3 mm\n" + lines(separator))
    )
    assert commented.units == ()


def test_a_campbell_logger_has_three_lines_below_its_own(write):
    head = (
        '"TOA5","CR1000","CR1000","1234","CR1000.Std.31","CPU:p.CR1","55","Table1"',
        '"TIMESTAMP","RECORD","Volt_Avg","Disp_Avg"',
        '"TS","RN","V","mm"',
        '"","","Avg","Avg"',
    )
    rows = (f'"2026-01-31 12:00:0{i}",{i},{i / 10},{i / 5}' for i in range(5))
    path = write("\n".join([*head, *rows]))
    record = Recording.from_csv(
        path, time="TIMESTAMP", input="Volt_Avg", output="Disp_Avg"
    )
    assert record.names == ("Volt_Avg", "Disp_Avg") and record.units == ("V", "mm")
    np.testing.assert_allclose(record.t, np.arange(5.0))
    np.testing.assert_allclose(record.u, np.arange(5) / 10)


@pytest.mark.parametrize("failed", ["#N/A", "#NV", "#DIV/0!", "#WERT!", "#NAME?"])
@pytest.mark.parametrize("rest", [",3", ";3", "\t3", ""])
def test_what_a_spreadsheet_could_not_calculate_is_no_comment(write, failed, rest):
    other = rest.replace("3", "2")
    table = read_text(
        write(f"V{rest and rest[0] + 'x'}\n1{other}\n{failed}{rest}\n2{other}\n")
    )
    assert len(table.cells) == 3
    with pytest.raises(InputError, match=f"'{re.escape(failed)}', which is not a"):
        table.column("input", "V")


def test_digits_are_a_name_where_a_column_has_it(write):
    """As oscilloscopes call their channels."""
    units = "second,Volt,Volt,Volt"
    path = write(f"x-axis,2,3,4\n{units}\n0,1,2,3\n1,2,3,4\n2,3,4,5\n")
    table = read_text(path)
    np.testing.assert_array_equal(table.column("input", "2"), [1, 2, 3])
    np.testing.assert_array_equal(table.column("input", "4"), [3, 4, 5])
    np.testing.assert_array_equal(table.column("input", "0"), [0, 1, 2])
    np.testing.assert_array_equal(table.column("input", 1), [1, 2, 3])


def test_prose_above_one_column_names_nothing(write):
    assert read_text(write("# piezo at rest\n0.5\n1.5\n2.5\n")).names == ()


@pytest.mark.parametrize(
    "unit", ["µC/cm²", "Nm", "kNm", "Am²", "Wb", "emu/cc", "µstrain", "mil", "Volt"]
)
def test_units_of_many_trades_are_taken_from_brackets(write, unit):
    path = write(f"u (V),w ({unit})\n0,1\n1,2\n0,1\n")
    record = Recording.from_csv(path, period=0.1, input="u", output="w")
    assert record.names == ("u", "w") and record.units == ("V", unit)


def test_a_header_goes_before_a_comment(write):
    assert read_text(write("# a,b,c\nt,u,w\n" + lines(","))).names == ("t", "u", "w")


def test_bad_lines_can_be_left_out_by_rows(write):
    path = write("0,1\n1,1\n2,1\nstopped by operator\n")
    np.testing.assert_array_equal(
        read_text(path, rows=(0, 3)).column("time", 0), [0, 1, 2]
    )
    with pytest.raises(InputError, match=r"line 4 of .* has 1 cells where most have 2"):
        read_text(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", r"is empty \(0 bytes\)"),
        ("# nothing\n\n", "has no rows: all its lines are blank or comments"),
        ("t,u\n", "has no rows below its header"),
        (b"PK\x03\x04\x00\x00", "is binary, not text.*from_mat.*archive.*spreadsheet"),
        ("0,1\n1,2\n2,3,4\n", "line 3 of .* has 3 cells where most have 2"),
        ("0,1\n1,2\n2\n", "line 3 of .* has 1 cells where most have 2"),
        ("t,u,w\n0,1\n1,2\n", r"has 3 names \(t, u, w\) for 2 columns"),
        ("t u w\n0 1\n1 2\n", r"has 3 names \(t, u, w\) for 2 columns"),
        ("t\n0,1\n1,2\n", r"has 1 names \(t\) for 2 columns"),
        ("0,1.O\n1,2\n2,3\n", "line 1 of .* neither a header nor data: '1.O'"),
        ("t,u\n0,1\n1,x2\n", r"`input` \(column 1\) has 'x2'.*in line 3"),
        ("# note\n0,1\n1,\n", r"`input` \(column 1\) has an empty cell, in line 3"),
        ("0\n1\n", "`input`=1 is not a column of .*from 0 to 0; .*no header"),
    ],
)
def test_files_that_cannot_be_used(write, content, message):
    with pytest.raises(InputError, match=message):
        read_text(write(content)).column("input", 1)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("force", "`input`='force' is not a column .*0 't', 1 'u', 2 'U'"),
        (3, "`input`=3 is not a column .*from 0 to 2"),
        (-1, "`input`=-1 is not a column"),
        ("7", "`input`='7' is not a column"),
    ],
)
def test_missing_columns_are_named_beside_those_there_are(write, key, message):
    with pytest.raises(InputError, match=message):
        read_text(write("t,u,U\n0,1,2\n")).column("input", key)


@pytest.mark.usefixtures("unchecked")
def test_keys_of_other_kinds(write, mat):
    path = write("t,u,w\n" + lines(","))
    columns = {"time": np.int64(0), "input": np.int32(1), "output": 2}
    np.testing.assert_array_equal(Recording.from_csv(path, **columns).u, NUMBERS[:, 1])
    for key in (None, 1.0, ("u", 1)):
        with pytest.raises(InputError, match="`input` must be a column, by name or by"):
            Recording.from_csv(path, **columns | {"input": key})
    with pytest.raises(InputError, match="`input`='' is not a column"):
        Recording.from_csv(path, **columns | {"input": ""})
    with pytest.raises(InputError, match=r"`period` must be one number.*'s', 0"):
        Recording.from_csv(path, period=("s", 0), input=1, output=2)
    found = Recording.from_mat(mat, period="Ts", input="u", output=("x_F", np.int64(1)))
    np.testing.assert_array_equal(found.w, NUMBERS[:, 1])
    for key in (0, None, ("x_F",), ("x_F", "1"), ("x_F", 1.5)):
        with pytest.raises(InputError, match=r"`input` must be the name of a vector"):
            Recording.from_mat(mat, period="Ts", input=key, output="u")


def test_ambiguous_name(write):
    table = read_text(write("t,Force [N],force [kN]\n0,1,2\n"))
    with pytest.raises(InputError, match="'force' fits 2 columns"):
        table.column("output", "force")


@pytest.mark.parametrize("read", [read_text, read_mat])
def test_paths_without_a_file(tmp_path, read):
    with pytest.raises(InputError, match=r"no file .*missing\.csv"):
        read(tmp_path / "missing.csv")
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path)


@pytest.fixture
def mat(tmp_path):
    path = tmp_path / "data.mat"
    variables = {"x_F": NUMBERS, "u": NUMBERS[:, 0], "Ts": 0.01, "note": "a note"}
    scipy.io.savemat(path, {**variables, "z": 1j * NUMBERS[:, 0], "n": np.arange(3)})
    return path


def test_mat_vectors_and_columns(mat):
    table = read_mat(mat)
    np.testing.assert_array_equal(table.column("input", "u"), NUMBERS[:, 0])
    np.testing.assert_array_equal(table.column("input", ("x_F", 2)), NUMBERS[:, 2])
    np.testing.assert_array_equal(table.column("period", "Ts"), [0.01])
    assert table.column("input", "n").dtype == np.float64


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("v", "`input`='v' is not in .*Its variables: x_F, u, Ts, note, z, n"),
        ("x_F", r"matrix of shape \(3, 3\); give its column too, .*\('x_F', 0\)"),
        (("x_F", 3), r"shape \(3, 3\), so its columns are numbered from 0 to 2"),
        (("x_F", -1), "numbered from 0 to 2"),
        ("note", "not a vector or matrix of real numbers"),
        ("z", "not a vector or matrix of real numbers: it is of type complex128"),
    ],
)
def test_mat_variables_that_cannot_be_used(mat, key, message):
    with pytest.raises(InputError, match=message):
        read_mat(mat).column("input", key)


def test_mat_files_that_cannot_be_read(mat, write):
    content = mat.read_bytes()
    with pytest.raises(InputError, match="cannot be read as a MATLAB file"):
        read_mat(write(content[: len(content) // 2], "half.mat"))
    with pytest.raises(InputError, match=r"cannot be read as a MATLAB file.*from_csv"):
        read_mat(write("0.0,1.0\n" * 100, "text.mat"))
    hdf5 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n"
    with pytest.raises(InputError, match=r"7\.3 \(HDF5\).*'-v7'"):
        read_mat(write(hdf5, "new.mat"))
    with pytest.raises(InputError, match=r"is binary, not text.*from_mat"):
        read_text(mat)


def test_recording_from_files(write, mat):
    path = write("Time [s];Voltage [V];Stroke [um]\n" + lines(";"))
    recording = Recording.from_csv(path, time="time", input="voltage", output=2)
    for column, values in zip("tuw", NUMBERS.T, strict=True):
        np.testing.assert_array_equal(getattr(recording, column), values)
    assert recording.names == ("Voltage", "Stroke")
    assert recording.units == ("V", "um")
    given = Recording.from_csv(
        path, time=0, input=1, output=2, names=("u", "w"), units=("kV", "mm")
    )
    assert (given.names, given.units) == (("u", "w"), ("kV", "mm"))
    recording = Recording.from_mat(mat, period="Ts", input="u", output=("x_F", 1))
    assert recording.names == ("u", "output")  # a matrix says nothing of its columns
    np.testing.assert_allclose(recording.t, [0, 0.01, 0.02])
    np.testing.assert_array_equal(recording.w, NUMBERS[:, 1])


@pytest.mark.parametrize(
    ("head", "name", "unit"),
    [
        ("Force (kN)", "Force", "kN"),
        ("H [A/m]", "H", "A/m"),
        ("Moment (N·m)", "Moment", "N·m"),
        ("speed [mm/s]", "speed", "mm/s"),
        ("a (m/s^2)", "a", "m/s^2"),
        ("a (m s⁻²)", "a", "m s⁻²"),
        ("strain (%)", "strain", "%"),
        ("T [°C]", "T", "°C"),
        ("Position (left)", "Position (left)", ""),
        ("Sensor (1)", "Sensor (1)", ""),
        ("Force (mean)", "Force (mean)", ""),  # not metres
        ("Force (N), raw", "Force (N), raw", ""),
        ("(mm)", "(mm)", ""),
    ],
)
def test_units_behind_names(write, head, name, unit):
    path = write(f"t;u;{head}\n" + lines(";"))
    recording = Recording.from_csv(path, time="t", input="u", output=2)
    assert (recording.names[1], recording.units[1]) == (name, unit)


def test_recording_from_files_without_a_clock(write, mat):
    path = write("Time [s];Voltage [V];Stroke [um]\n" + lines(";"))
    with pytest.warns(UserWarning, match=r"no clock.*time='Time \[s\]'"):
        read = Recording.from_csv(path, input="voltage", output=2)
    for recording in (read, Recording.from_mat(mat, input="u", output=("x_F", 1))):
        assert not recording.clocked
        np.testing.assert_array_equal(recording.t, [0, 1, 2])
    with pytest.raises(InputError, match=r"either `time`.*or `period`"):
        Recording.from_csv(path, input=1, output=2, time=0, period=1.0)


def test_json_matrix(write):
    path = write(json.dumps({"dt": 0.1, "data": NUMBERS.tolist()}))
    np.testing.assert_array_equal(json_matrix(path, "data"), NUMBERS)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ('{"data": [[1, 2], [3,', r"cannot be read as JSON \(.*cut short"),
        (b'{"data": "\xff"}', "cannot be read as JSON"),
        ('{"dt": 1, "rows": [[1]]}', "'data' is not in .*; its names: dt, rows"),
        ("[[1, 2]]", r"'data' is not in .*; its names: \(none\)"),
        ('{"data": [[1, 2], [3]]}', r"not a matrix of numbers.*differ in length"),
        ('{"data": [[1, "x"]]}', "not a matrix of numbers"),
        ('{"data": [1, 2]}', r"list of rows of numbers, got shape \(2,\)"),
    ],
)
def test_json_without_a_matrix(write, content, message):
    with pytest.raises(InputError, match=message):
        json_matrix(write(content), "data")


MICROMAG = """MicroMag 2900/3900 Data File
Number of data                  4

    Field         Moment
     (T)          (Am\xb2)
+132.9481E-03,+9.967639E-06

-19.08159E-03,-5.248264E-06
+0.000000E+00,+5.195985E-06
+19.05010E-03,+5.235395E-06

MicroMag 2900/3900 Data File ends
"""


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_micromag_segments_are_parted_by_blank_lines(write, ending):
    path = write(MICROMAG.replace("\n", ending).encode("latin-1"))
    first, second = micromag_segments(path)
    np.testing.assert_array_equal(first, [[0.1329481, 9.967639e-6]])
    np.testing.assert_array_equal(second[:, 0], [-0.01908159, 0, 0.0190501])
    np.testing.assert_array_equal(second[0], [-0.01908159, -5.248264e-6])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (MICROMAG[: MICROMAG.index("+19.05")], "holds 3 rows.*4 promised.*cut short"),
        ("nothing here", "holds 0 rows of field and moment, with none promised"),
    ],
)
def test_micromag_file_that_is_broken(write, content, message):
    with pytest.raises(InputError, match=message):
        micromag_segments(write(content))


def test_a_long_file_is_read_whole_and_once(write, monkeypatch):
    values = np.random.default_rng(0).normal(size=(50_000, 3))
    path = write("\n".join(",".join(map(repr, row)) for row in values.tolist()))
    reads, read = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda p: reads.append(p) or read(p))
    table = read_text(path)
    columns = [table.column("input", number) for number in range(3)]
    np.testing.assert_array_equal(np.transpose(columns), values)
    assert reads == [path]


BY_NAME = dict(zip("tuw", NUMBERS.T.tolist(), strict=True))


@pytest.mark.parametrize(
    ("held", "keys"),
    [
        (NUMBERS.tolist(), (0, 1, 2)),
        ({"rate": 4, "data": NUMBERS.tolist()}, (0, 1, 2)),
        ({"columns": None, "data": NUMBERS.tolist()}, (0, 1, 2)),
        (BY_NAME, "tuw"),
        ({"calibration": [[1, 2], [3, 4]], **BY_NAME}, "tuw"),
        ({**BY_NAME, "spot": [[1, 2]] * 3}, (0, 1, 2)),
        ({"channels": [{"name": "t"}, {"name": "u"}], **BY_NAME}, "tuw"),
        ({"gain": [1, 2], "offset": [0, 0], "data": NUMBERS.tolist()}, (0, 1, 2)),
        ([dict(zip("tuw", row, strict=True)) for row in NUMBERS.tolist()], "tuw"),
        (
            {"columns": ["t", "u", "w"], "index": [0, 1, 2], "data": NUMBERS.tolist()},
            "tuw",
        ),
    ],
    ids=[
        "rows",
        "rows under a name",
        "rows without names",
        "lists",
        "lists beside rows that are fewer",
        "lists beside as many rows",
        "lists beside objects",
        "rows beside lists that are shorter",
        "objects",
        "split as by pandas",
    ],
)
def test_tables_of_json(write, held, keys):
    # Lines without an end, of which Python's csv reads 131 072 characters.
    path = write(json.dumps(held).replace(" ", " " * 20_000), "data.json")
    t, u, w = keys
    record = Recording.from_csv(path, time=t, input=u, output=w)
    np.testing.assert_array_equal(np.transpose([record.t, record.u, record.w]), NUMBERS)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"t": [0, 1, 2], "u": [1, 2, 3], "u": [9, 8, 7]}', "the same key twice: u"),
        ('{"t": [0, 1, 2], "u": ["1_0", "2", "3"]}', "digits with _"),
        (f'{{"t": [0, 1, 2], "u": [1, 2, 1{400 * "0"}]}}', "too large"),
    ],
)
def test_numbers_of_json_that_are_none(write, content, said):
    with pytest.raises(InputError, match=said):
        Recording.from_csv(write(content, "data.json"), time="t", input="u", output="t")


def test_a_first_row_with_a_word_that_is_no_unit_is_data(write):
    path = write("t,u,w,flags\n1,1,1,0x80\n2,2,3,0\n3,4,5,0\n4,5,6,0\n")
    assert len(Recording.from_csv(path, time="t", input="u", output="w")) == 4
    path = write("n,u,w\n1,1,Err:502\n2,2,3\n3,4,5\n4,5,6\n")
    with pytest.raises(InputError, match="'Err:502', which is not a number, in line 2"):
        Recording.from_csv(path, time="n", input="u", output="w")
    path = write("t,u,w\ns,A/m2,1\n2,2,3\n3,4,5\n4,5,6\n")
    record = Recording.from_csv(path, time="t", input="u", output="w")
    assert (len(record), record.units) == (3, ("A/m2", ""))


@pytest.mark.parametrize(
    "content", ["3", "{}", "[]", '{"a": "b"}', "[[1, 2], [3]]", "[1, 2]", "[[], []]"]
)
def test_json_without_a_table(write, content):
    with pytest.raises(InputError, match="holds no table"):
        Recording.from_csv(write(content, "data.json"), input=0, output=1)
    with pytest.raises(InputError, match="cannot be read as JSON"):
        Recording.from_csv(write("t,u\n1,2\n", "data.json"), input=0, output=1)


def test_a_line_of_text_that_is_too_long(write):
    with pytest.raises(InputError, match="a line for each sample"):
        read_text(write('{"data": "' + "1, 2, " * 30_000))
