"""The command line and reports use their own words; and what `dir` shows."""

import re
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of

import hystjax as hj
from hystjax._core.solution import in_words
from hystjax.cli import _laws, _main, main
from hystjax.cli._arguments import as_options
from hystjax.refinement._certainty import _fading

T = np.linspace(0.0, 6.0, 200)
U = np.sin(2 * T) * (1 - T / 12)
W = 0.3 * np.sin(2 * T - 0.4) * (1 - T / 12)
FILE = ("record.csv", "--time", "t", "--input", "u", "--output", "w")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    lines = [f"{t!r},{u!r},{w!r}" for t, u, w in np.stack([T, U, W], 1).tolist()]
    (tmp_path / "record.csv").write_text("\n".join(["t,u,w", *lines]))
    (tmp_path / "twice.csv").write_text("\n".join(["t,u,w", *lines, *lines]))
    (tmp_path / "x.bin").write_bytes(bytes(9))
    hj.save(tmp_path / "law.json", hj.models.Duhem(0.4, 0.5, 0.2))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_values_may_begin_with_a_minus():
    parse = _main._parser().parse_args
    files = ["law.json", *FILE]
    invert = parse(["invert", *files, "--limits", "-30:-.5e-1"])
    assert invert.limits == (-30.0, -0.05)
    for text in ("-1e-3", "-.5", "-inf"):
        assert parse(["simulate", *files, "--w0", text]).w0 == float(text)
    with pytest.raises(hj.InputError, match="unrecognized arguments: -x"):
        parse(["simulate", *files, "-x"])


@pytest.mark.parametrize(
    "command",
    ["identify", "discover", "compare", "simulate", "invert", "loops", "forc", "demo"],
)
def test_help_says_where_results_go(capsys, command):
    with pytest.raises(SystemExit):
        main((command, "--help"))
    told = " ".join(capsys.readouterr().out.split())
    required = {"simulate": ["law.json", *FILE], "invert": ["law.json", *FILE]}
    required |= {"forc": ["curves.frc"], "demo": []}
    given = required.get(command, FILE)
    options = _main._parser().parse_args([command, *given])
    assert f"(default: {options.out})" in told


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("identify", *FILE, "--rows", "0:99999"), "--rows 0:99999 is not in the file"),
        (("identify", *FILE, "--rows", "9:3"), "--rows 9:3 .*0 to 200"),
        (("identify", *FILE, "--average", "0"), "--average must be at least 1, got 0"),
        (("compare", *FILE, "--average", "99"), "--average 99 of 200 samples makes 2"),
        (
            ("discover", *FILE, "--oscillator", "--average", "2"),
            "--average is of laws whose output was measured",
        ),
        (("discover", *FILE, "--test", "0:999"), "--test 0:999 is not in the file"),
        (("discover", *FILE, "--seed", "1e22"), "--seed.*'1e22' is not a whole number"),
        (("discover", *FILE, "--seed", "9" * 30), "--seed.*at most 18 digits"),
        (("discover", *FILE, "--seconds", "0"), "--seconds.*'0' is not a positive"),
        (("identify", *FILE, "--thresold", "1"), "--thresold.*Did you mean '--thresh"),
        (("identify", *FILE[:-2], "--outptu", "w"), "--outptu.*mean '--output'"),
        (("idenify", *FILE), "'idenify'.*Did you mean 'identify'"),
        (("identify", *FILE, "--variables", "w,u,dw"), "Did you mean"),
        (("identify", "record.csv", "--input", "uu", "--output", "w"), "mean 'u'"),
        (
            ("identify", *FILE, "--time-unit", "msek"),
            "unit msek .*mean 'msec'",
        ),
        (("identify", *FILE, "x"), r"unrecognized arguments: x; see `hystjax"),
        (
            ("discover", *FILE, "--variables", "u", "--rate-independent"),
            "no candidate is left with --rate-independent or --odd",
        ),
        (("dance",), r"'demo'\); see `hystjax --help`"),
        (("--verson",), r"--verson \(Did you mean '--version'\?\); see"),
        (("identify", *FILE, "--variables", ""), r"--variables must .* got \('',\)"),
        (
            ("identify", *FILE, "--period", "0.1"),
            "give either --time, a column, or --period, .* --time 't' and --period 0.1",
        ),
        (("identify", "x.bin", *FILE[1:]), "MATLAB file the ending .mat; unpack"),
        (
            ("invert", "law.json", *FILE, "--limits", "5:1"),
            "--limits: '5:1' is no range of inputs such as -10:150; see",
        ),
        (("identify", "record.csv", "--input", "", "--output", "w"), "`input`='' is"),
        (("identify", "x.mat", "--input", "u:²", "--output", "w"), "no file x.mat"),
        (("identify", "x.mat", *FILE[3:6], "w:" + "9" * 5000), "no file x.mat"),
        (("identify", *FILE[:-1], "9" * 5000), "`output`='9+' is not a column"),
        (("identify", *FILE, "--rows", "0:" + "9" * 5000), "is not a range of rows"),
        (("identify", "a" * 300, *FILE[1:]), "a' cannot be read: File name too long"),
        (("identify", "record.csv", "--period", "1e-320", *FILE[3:]), "not a positive"),
        (("identify", "record.csv", "--period", "1_0", *FILE[3:]), "not a positive"),
        (("identify", *FILE, "--degree", "0"), "error: --degree must be at least 1"),
        (("identify", *FILE, "--threshold", "-1"), "error: --threshold must be zero"),
        (("discover", *FILE, "--largest", "0"), "error: --largest must be at least 1"),
        (("discover", *FILE, "--width", "0"), "error: --width must be at least 1"),
        (("compare", *FILE, "--families", "law,law"), "--families names 'law' more"),
        (("loops", *FILE, "--threshold", "-1"), "error: --threshold must be a pos"),
        (("simulate", "law.json", *FILE, "--w0", "nan"), "error: --w0 must be finite"),
        (
            ("invert", "law.json", *FILE[:3], *FILE[5:], "--limits", "0.3:1"),
            r"--limits \(0\.3, 1\.0\) do not hold 0, .*without --u0",
        ),
        (
            ("discover", *FILE, "--oscillator", "--cycle", "20"),
            "Check --cycle, and leave out rows before the first whole one by --rows",
        ),
        (
            ("identify", "twice.csv", *FILE[1:]),
            "several runs .*, put each into a file .*, the first .* row 200. Else",
        ),
        (("discover", *FILE, "--known", "w=1_0"), "'w=1_0' is not a coefficient"),
        (
            ("simulate", "law.json", *FILE, "--out", "/dev/null"),
            "null is (not an ordinary file|a device)",
        ),
        (
            ("export", "law.json", "--to", "c", "--out", ""),
            r"\. is a folder; give the path of a file",
        ),
    ],
)
def test_one_line_in_its_own_words(folder, capsys, arguments, said):
    assert main(arguments) == 2
    written = capsys.readouterr().err
    assert written.count("\n") == 1 and "window(" not in written
    assert re.search(said, written)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("(`guard=False` admits them)", "(--any-reach admits them)"),
        ("allowed, `largest=6`: more", "allowed, --largest 6: more"),
        (
            "`discover` says: as many as were allowed, `largest=6`: more",
            "`hystjax discover` says: as many as were allowed, --largest 6: more",
        ),
        (
            "try terms of `library.Lag(times)`, or the family `plays and creep` of "
            "`compare`.",
            "try the family `plays and creep` of `hystjax compare`.",
        ),
        ("recording or a smaller `window`.", "recording or a smaller --smooth."),
        ("search ended, `seconds=60`: with", "search ended, --seconds 60: with"),
        ("pass `time_unit='ms'`, or `time_unit='s'`", "pass --time-unit ms, or --tim"),
        ("`time='Time (s)'` would be", "--time 'Time (s)' would be"),
        ("column too, such as input=('M', 0).", "column too, such as --input M:0."),
        (
            "make the recording with `interpolation=hystjax.interpolation.Cubic()`, "
            "or `BandLimited()` for whole periods",
            "give --interpolation cubic, or band-limited for whole periods",
        ),
        (
            in_words(hj.RESULTS.max_steps_reached),
            "From Python, `hystjax.simulate` takes `method=hystjax.simulation.Adaptive",
        ),
        (
            in_words(hj.RESULTS.nonlinear_max_steps_reached),
            "or refine from Python, with `shooting=hystjax.refinement.Nudging()`, with",
        ),
        (
            "it leaves: give more `substeps`, or judge the law by `simulation.A()`",
            "it leaves: from Python, give more `substeps`, or judge the law by `sim",
        ),
        (
            "`interpolation.BandLimited` takes whole, or use `interpolation.Cubic()`.",
            "--interpolation band-limited takes whole, or use --interpolation cubic.",
        ),
        (
            "smaller swings; `rainflow` counts half cycles too",
            "smaller swings; from Python, `hystjax.loops.rainflow` counts half",
        ),
        (
            in_words(hj.RESULTS.not_finite),
            "guard it with `jnp.where`. Otherwise squares of the values overflow",
        ),
        ("as much: `recording.averaged(30)`.", "as much: --average 30."),
        ("`w` is no option", "`w` is no option"),
        ("its `addends()`; `to_text` prints it.", "`addends()`; --to text prints it."),
        (
            "cannot write; use `to_c`, or an FMU.",
            "cannot write; use --to c, or an FMU.",
        ),
        ("`name` is 'end', which means", "--name is 'end', which means"),
        (
            "`known` says -1 for 'w*|du|', and `signs` 1: leave it out",
            "--known says -1 for 'w*|du|', and --sign 1: leave it out",
        ),
        ("`known` holds ['w'], which depend", "--known holds ['w'], which depend"),
        (in_words(hj.RESULTS.no_law), "more time, where --seconds ended the search"),
        (
            '`begin` is "zero", and ... (`hystjax.loops.centred`), take a larger '
            '`threshold`, or let cycles `begin` at a "tip".',
            "--begin is zero, and ... (--centre), take a larger --threshold, or leave "
            "out --begin.",
        ),
    ],
)
def test_options_of_verbs_are_those_of_the_command_line(said, expected):
    assert expected in as_options(said)


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("", "empty cell, in line 52 of record.csv. From Python, .* `hystjax.bridged`"),
        ("ovld", "'ovld', .* in line 52 of record.csv. From Python, .*bridged`"),
        ("o.1", "'o.1', .* in line 52 of record.csv. Correct or remove that line.\n"),
        ("0.1,0.2", "most have 3. .*; correct or remove that line.\n"),
        ("nan", "the first at row 50. .* From Python, dropouts .* `hystjax.bridged`"),
    ],
)
def test_no_option_leaves_out_lines_that_cannot_be_read(folder, capsys, cell, said):
    lines = (folder / "record.csv").read_text().split("\n")
    lines[51] = lines[51].rpartition(",")[0] + f",{cell}"
    (folder / "record.csv").write_text("\n".join(lines))
    assert main(("loops", *FILE, "--rows", "60:200")) == 2
    assert re.search(said, capsys.readouterr().err)


def test_a_speed_asks_for_times(folder, capsys):
    columns = (*FILE[:1], *FILE[5:])
    assert main(("invert", "law.json", *columns, "--speed", "1")) == 2
    *_, error = capsys.readouterr().err.splitlines()
    assert "--speed is the change of the input in a second, and" in error


def test_a_law_of_the_rate_asks_for_times(folder, capsys):
    hj.save("law.json", hj.models.SparseModel.from_terms({"du": 0.3, "w": -1.0}))
    columns = ("--input", "u", "--output", "w")
    assert main(("simulate", "law.json", "record.csv", *columns)) == 2
    warning, error = capsys.readouterr().err.splitlines()
    assert "neither --time nor --period" in warning
    assert "Give the recording its times, or use rate-independent terms" in error


def test_warnings_name_options(tmp_path, monkeypatch, capsys):
    rows = "\n".join(f"{1000 * t},{u},{w}" for t, u, w in zip(T, U, W, strict=True))
    (tmp_path / "record.csv").write_text("t_ms,u,w\n" + rows)
    monkeypatch.chdir(tmp_path)
    columns = ("--time", "t_ms", "--input", "u", "--output", "w")
    assert main(("loops", "record.csv", *columns)) == 0
    assert "pass --time-unit ms, or --time-unit s where" in capsys.readouterr().err


def test_a_refinement_that_fails_keeps_the_law_of_the_regression(
    folder, capsys, monkeypatch
):
    def failing(model, recordings, **options):
        assert not options["throw"]
        return hj.Solution(model, hj.RESULTS.nonlinear_max_steps_reached, {})

    monkeypatch.setattr(_laws, "refine", failing)
    code = main(("identify", *FILE, "--degree", "1", "--refine", "--out", "report"))
    out, err = capsys.readouterr()
    assert code == 3
    law = hj.load("report/law.json")
    assert law.terms() and str(law) in out
    assert "the refinement ended without a law" in err and "--smooth" in err
    assert "max_steps`" not in err
    text = (folder / "report" / "report.md").read_text()
    assert "refinement: failed (nonlinear_max_steps_reached)" in text


def test_a_refinement_that_leads_away_is_one_that_failed(folder, capsys, monkeypatch):
    """Though it says that it ended well: its steps may have been too long."""

    def astray(model, recordings, **_):
        far = {name: 3 * x for name, x in model.parameters().items()}
        return hj.Solution(model.with_parameters(far), hj.RESULTS.successful, {})

    monkeypatch.setattr(_laws, "refine", astray)
    code = main(("identify", *FILE, "--degree", "1", "--refine", "--out", "astray"))
    out, err = capsys.readouterr()
    assert code == 3 and "its free run misses the fitted rows by more" in err
    assert main(("identify", *FILE, "--degree", "1", "--out", "plain")) == 0
    law, plain = hj.load("astray/law.json"), hj.load("plain/law.json")
    assert law.terms() == plain.terms() and str(law) in out


@pytest.mark.usefixtures("unchecked")
def test_of_terms_that_are_hardly_told_apart_a_law_has_one_too_many():
    alias = hj.Alias("du", 1e-4, {"u": 2.0})
    law = hj.models.SparseModel.from_terms({"du": 1.0, "u": 2.0})
    judged: dict[str, Any] = {"fitted": SimpleNamespace(errors={"nrmse": 0.01})}
    (said,) = _laws._hints(law, judged, [alias])
    assert said.startswith("du cannot be told from u (0.01 % of it is new)")
    assert [*_laws._hints(law, judged, [hj.Alias("w", 1e-4, {"u": 2.0})])] == []


@pytest.mark.usefixtures("unchecked")
def test_a_law_that_does_not_rest_is_told_where_it_is_found():
    law = hj.models.SparseModel.from_terms({"1": 0.4, "u": 0.1})
    law = law.fitted_on(hj.models.FittedRange(-1.0, 1.0, 2.0))
    zero = jnp.zeros(())
    fading = hj.refinement.Fading(zero - 1, zero, zero, zero, zero)
    found = fit_of(law, fading=fading, spread=jnp.array(1.0)).solution()
    for error, hints in ((0.01, 0), (0.2, 1)):
        judged: dict[str, Any] = {"fitted": SimpleNamespace(errors={"nrmse": error})}
        first, *more = _laws._cautions(found, judged)
        assert first == "while the input is held at 0 it rises by 0.4, and never rests"
        assert len(more) == hints and all("hystjax compare" in each for each in more)


def test_remedies_that_exist():
    law = hj.models.SparseModel.from_terms({"du": 1.0})
    for name, words in (
        ("nonlinear_max_steps_reached", "Nudging"),
        ("max_steps_reached", "Kvaerno5"),
    ):
        computed = hj.Solution(law, getattr(hj.RESULTS, name), {})
        with pytest.raises(hj.ComputationError, match=words):
            hj._core.solution.raise_unless_successful(computed)
    assert hj.refinement.Nudging and hj.simulation.Adaptive.stiff().rtol
    assert isinstance(hj.simulation.Adaptive.stiff().solver, diffrax.Kvaerno5)


@pytest.mark.parametrize("name", ["rtol", "atol"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_tolerances_are_positive(name, value):
    with pytest.raises(hj.InputError, match=f"`{name}` must be positive"):
        hj.simulation.Adaptive(**{name: value})


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("u'", "Write 'du'"),
        ("w*|u'|", r"Write '\|du\|'"),
        ("play(u, .1)", r"Write 'play\(u,\.1\)'"),
        ("dw", "Did you mean"),
    ],
)
def test_a_term_as_laws_print_it_is_told_how_to_write(name, said):
    with pytest.raises(hj.InputError, match=said):
        hj.models.SparseModel.from_terms({name: 1.0})


def test_the_number_of_a_library_is_called_by_its_name(unchecked):
    with pytest.raises(hj.InputError, match=r"`n` must be a whole number"):
        hj.library.BoucWen(1.0)
    with pytest.raises(hj.InputError, match=r"`degree` must be a whole number"):
        hj.library.Polynomial(1.5)


def test_what_is_always_equal_is_no_news():
    def alias(term, *others):
        return hj.Alias(term, 0.0, dict.fromkeys(others, 1.0))

    always = [
        alias("|du|^2", "du^2"),
        alias("u*|w|^2", "u*w^2"),
        alias("du*|du|^2", "du^3"),
    ]
    record = [alias("|w|^2", "u^2"), alias("|w|", "w"), alias("|du|^3", "du^3")]
    mixed = alias("|w|^2", "w^2", "u^2")
    assert all(map(hj.report._always, always))
    assert not any(map(hj.report._always, [*record, mixed]))
    assert hj.report._ambiguities(always, ()) == ""


def _fading_of(exponent, largest, where, share):
    gain = 6 * exponent
    numbers = map(jnp.asarray, (exponent, gain, largest, where, share))
    return hj.refinement.Fading(*numbers)


def test_what_expands_nowhere_is_not_said_to():
    never = _fading_of(-2.0, -0.0, 0.0, 0.0)
    said = _fading(never, clocked=True)
    assert "2 per s on average, and at every sample" in said and "-0" not in said
    often = _fading_of(-2.0, 3.0, 0.5, 0.25)
    by_time = _fading(often, clocked=True)
    assert "25 % of the samples, at most 3 per s, at t = 0.5 s" in by_time
    assert "at most 3 per sample, at sample 0.5" in _fading(often, clocked=False)


def test_a_run_is_written_beside_what_was_recorded(folder, capsys):
    law = hj.models.SparseModel.from_terms({"du": 0.3}, units=("V", "µm"))
    hj.save("law.json", law)
    assert main(("simulate", "law.json", *FILE, "--out", "run.csv")) == 0
    assert "w: output (µm)" in capsys.readouterr().out
    table = np.genfromtxt("run.csv", delimiter=",", names=True)
    assert table.dtype.names == ("t", "u", "w", "recorded")
    np.testing.assert_array_equal(table["recorded"], W)


def test_public_surfaces_in_a_fresh_process():
    code = (
        "import hystjax as hj; print(*dir(hj)); print(*dir(hj.report)); "
        "print(*dir(hj.refinement)); hj.plot.loop, hj.reproduce"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    whole, report, refinement = (line.split() for line in run.stdout.splitlines())
    assert {"plot", "report", "reproduce", "judge", "discover"} <= set(whole)
    assert report == ["error_table", "markdown_table", "plain_table", "write"]
    assert "refine" in refinement and "Objective" not in refinement


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="has no /dev/full")
def test_a_full_disk_is_one_line():
    code = "import sys, hystjax.cli as c; sys.exit(c.main(['data', 'list']))"
    with open("/dev/full", "w") as full:
        run = subprocess.run(
            [sys.executable, "-c", code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1 and "No space left" in run.stderr
    with open("/dev/full", "w") as full:
        run = subprocess.run([sys.executable, "-c", code], stdout=full, stderr=full)
    assert run.returncode == 2
