import argparse
import contextlib
import inspect
import io
import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.io
from jax.experimental.compilation_cache import compilation_cache
from test_report import markdown_tables

import hystjax as hj
from hystjax import refinement
from hystjax._core.show import Progress, say
from hystjax.cli import main
from hystjax.cli._arguments import _chosen_rows
from hystjax.cli._main import _is_of_cache, _parser
from hystjax.comparison import Compared
from hystjax.reproduce import Comparison, Row

COLUMNS = ("--time", "time", "--input", "voltage", "--output", "displacement")
TRUTH = {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25}


class Ran(NamedTuple):
    code: int
    out: str
    err: str


def hystjax(*arguments):
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return Ran(code, out.getvalue(), err.getvalue())


def growing(t):
    """t sin t and its derivative."""
    return t * np.sin(t), np.sin(t) + t * np.cos(t)


def duhem(signal=growing, end=7 * np.pi):
    """A Duhem law under an input that is given with its derivative, by SciPy."""

    def rate(t, w):
        u, du = signal(t)
        return (0.4 * u - 0.5 * w) * abs(du) + 0.25 * du

    t = np.linspace(0, end, 1000)
    law = scipy.integrate.solve_ivp(
        rate, (0, t[-1]), [0.0], t_eval=t, rtol=1e-9, atol=1e-9, max_step=t[1]
    )
    return np.column_stack([t, signal(t)[0], law.y[0]])


def write_csv(path, table, header="time,voltage,displacement"):
    rows = [",".join(map(repr, row)) for row in table.tolist()]
    path.write_text("\n".join([header, *rows]) + "\n")


def changed(table, row, column, value):
    table = table.copy()
    table[row, column] = value
    return table


def noisy(table, share):
    error = np.random.default_rng(4).normal(size=len(table)) * np.std(table[:, 2])
    return table + np.outer(share * error, [0, 0, 1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of a stranger, good and bad."""
    folder, good = tmp_path_factory.mktemp("cli"), duhem()
    t, u = good[:, 0], good[:, 1]
    tables = {
        "good": good,
        "nan": changed(good, 17, 2, np.nan),
        "inf": changed(good, 3, 1, np.inf),
        "back": changed(good, 10, 0, t[8]),
        "twice": changed(good, 10, 0, t[9]),
        "two": good[:2],
        "few": good[:20],
        "noisy": noisy(good, 0.05),
        "still": changed(good, slice(None), 1, 1.0),
        "stuck": changed(good, slice(None), 2, 1.0),
    }
    for name, table in tables.items():
        write_csv(folder / f"{name}.csv", table)
    text = (folder / "good.csv").read_text()
    (folder / "ragged.csv").write_text(text + "22.0,1.0\n")
    (folder / "words.csv").write_text(text.replace(repr(float(u[5])), "n/a"))
    (folder / "empty.csv").write_bytes(b"")
    (folder / "binary.csv").write_bytes(bytes(range(256)) * 20)
    (folder / "broken.mat").write_bytes(b"no MATLAB file" * 20)
    (folder / "broken.json").write_text("{nope")
    (folder / "other.json").write_text("{}")
    columns = {"t": t, "uw": good[:, 1:], "short": u[:-3]}
    scipy.io.savemat(folder / "good.mat", columns)
    hj.save(folder / "law.json", hj.models.Duhem(0.4, 0.5, 0.25))
    wild = hj.models.SparseModel.from_terms({"1": 1.0, "w": 1e4})
    hj.save(folder / "wild.json", wild)
    return folder


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)


BEYOND = r"hystjax: warning: .* the input leaves what this law was fitted on .*\n"


def identified(*arguments):
    """Law, metrics and output of an `identify` that must succeed without a murmur, but
    for rows that go beyond those fitted."""
    ran = hystjax("identify", *arguments, "--out", "report")
    assert (ran.code, re.sub(BEYOND, "", ran.err)) == (0, "")
    return hj.load("report/law.json"), json.loads(
        Path("report/metrics.json").read_text()
    )


PRECISE = ("--variables", "w,u,du,|du|", "--threshold", "0.1")


def test_identify_finds_the_law_of_a_simulated_device():
    law, metrics = identified("good.csv", *COLUMNS, "--units", "V, µm", *PRECISE)
    assert law.terms().keys() == TRUTH.keys()
    for name, value in law.terms().items():
        assert value == pytest.approx(TRUTH[name], abs=2e-3)
    assert (law.names, law.units) == (("voltage", "displacement"), ("V", "µm"))
    settings = metrics["settings"]
    assert (settings["fitted rows"], settings["unseen rows"]) == ("0:700", "700:1000")
    assert max(each["nrmse"] for each in metrics["errors"].values()) < 1e-4


@pytest.fixture
def no_figures(monkeypatch):
    """Leave the figures out, which take most of the time and are tested elsewhere."""
    monkeypatch.setattr(hj.report, "_figures", lambda *_: [])


@pytest.mark.parametrize(
    ("arguments", "fitted", "unseen"),
    [
        (("--rows", "300:1000"), "300:1000", "0:300"),
        (("--rows", "0:999"), "0:999", "none left"),
        (("--test", "700:1000"), "0:700", "700:1000"),
    ],
)
def test_which_rows_are_unseen(no_figures, arguments, fitted, unseen):
    _, metrics = identified("good.csv", *COLUMNS, *PRECISE, *arguments)
    settings = metrics["settings"]
    assert (settings["fitted rows"], settings["unseen rows"]) == (fitted, unseen)
    assert ("unseen" in metrics["errors"]) == (unseen != "none left")


def test_means_are_fitted_and_judged(no_figures):
    """As of a file of them, which NumPy made."""
    table = np.loadtxt("good.csv", delimiter=",", skiprows=1)
    means = table[:999].reshape(333, 3, 3).mean(axis=1)
    head = "time,voltage,displacement"
    np.savetxt("means.csv", means, delimiter=",", header=head, comments="")
    rows = ("--rows", "0:600", "--test", "600:999", "--average", "3")
    found, metrics = identified("good.csv", *COLUMNS, *PRECISE, *rows)
    rows = ("--rows", "0:200", "--test", "200:333")
    expected, of_means = identified("means.csv", *COLUMNS, *PRECISE, *rows)
    assert found.terms() == pytest.approx(expected.terms(), rel=1e-9)
    for name, errors in metrics["errors"].items():
        assert errors == pytest.approx(of_means["errors"][name], rel=1e-6)
    assert metrics["settings"]["fitted rows"] == "0:600, means of 3"
    assert metrics["settings"]["unseen rows"] == "600:999, means of 3"


def test_same_columns_by_other_names(no_figures):
    step = repr(7 * np.pi / 999)
    expected, _ = identified("good.csv", *COLUMNS, *PRECISE)
    for columns in (
        ("good.mat", "--time", "t", "--input", "uw:0", "--output", "uw:1"),
        ("good.csv", "--period", step, "--input", "1", "--output", "2"),
    ):
        law, _ = identified(*columns, *PRECISE)
        assert law.terms() == pytest.approx(expected.terms(), rel=1e-9)


@pytest.mark.slow
def test_refinement_reaches_the_truth(no_figures):
    law, _ = identified(
        "good.csv", *COLUMNS, *PRECISE, "--refine", "--interpolation", "cubic"
    )
    assert law.terms() == pytest.approx(TRUTH, abs=1e-5)
    assert "trajectory matching" in Path("report/report.md").read_text()
    assert Path("report/refinement.png").stat().st_size > 10_000


OVER = "criterion over the chosen law's"


def kept_by(results, function):
    """The function, whose results are kept in a list."""

    def keeping(*arguments, **options):
        results.append(function(*arguments, **options))
        return results[-1]

    return keeping


def check_criteria(table, candidates, chosen):
    """Rows of a report, against the laws that they are of."""
    for row, each in zip(table, candidates, strict=True):
        assert row["terms"].replace("`", "").split(", ") == list(each.terms)
        more = float(each.criterion) - float(chosen.criterion)
        assert float(row[OVER]) == pytest.approx(more, abs=0.06)


@pytest.mark.slow
def test_discover_finds_the_terms_under_noise(monkeypatch):
    """What regression of the derivative with the default threshold does not."""
    solutions = []
    monkeypatch.setattr(
        "hystjax.discovery._discover.discover", kept_by(solutions, hj.discover)
    )
    ran = hystjax(
        *("discover", "noisy.csv", *COLUMNS, "--units", "V,µm", "--out", "report"),
        *("--largest", "3"),
    )
    assert (ran.code, ran.err) == (0, "")
    law = hj.load("report/law.json")
    assert law.terms().keys() == TRUTH.keys()
    text = Path("report/report.md").read_text()
    for name, value in law.terms().items():
        row = f"| `{name}` | {value:.6g} | ".replace("|du|", r"\|du\|")
        error = float(text.split(row)[1].split()[0])
        assert abs(value - TRUTH[name]) < 4 * error < 0.2
    assert str(law) in ran.out and "unseen" in ran.out
    assert "\nthe law is rate independent: " in ran.out
    tried = text.split("## Laws that were tried")[1]
    assert "| `du`, `w*\\|du\\|`, `u*\\|du\\|` |" in tried and "| +0.0 |" in tried
    (stats,) = (solution.stats for solution in solutions)
    for_each_size, *hardly_told = markdown_tables(tried)
    check_criteria(for_each_size, stats["frontier"].values(), stats["candidates"][0])
    for table in hardly_told:
        check_criteria(table, stats["alike"], stats["candidates"][0])
    # A law of one term explains far less than the chosen one.
    assert float(for_each_size[0][OVER]) > 100
    assert "frontier.png" in text and Path("report/frontier.png").is_file()
    assert Path("report/inclusion.png").is_file()
    assert "up to 3 terms" in text and "standard error" in text
    assert stats["why"] in text and stats["why"] in ran.out


def test_options_reach_the_fit(no_figures):
    options = ("--degree", "1", "--variables", "du,u", "--threshold", "0.001")
    options += ("--ridge", "0.01", "--smooth", "9", "--no-normalise")
    law, _ = identified("good.csv", *COLUMNS, *options)
    record = hj.Recording.from_csv(
        "good.csv", time="time", input="voltage", output="displacement"
    )
    expected = hj.identify(
        record.window(0, 700),
        hj.library.Polynomial(1, ("u", "du")),
        hj.regression.STLSQ(0.001, 0.01, normalise=False),
        differentiation=hj.differentiation.SavitzkyGolay(9),
    )
    assert law.terms() == pytest.approx(expected.value.terms(), rel=1e-12)


def test_simulate_runs_a_saved_law():
    ran = hystjax(
        "simulate", "law.json", "good.csv", *COLUMNS, "--interpolation", "cubic"
    )
    assert (ran.code, ran.err) == (0, "")
    assert "w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|" in ran.out
    result, measured = (
        np.genfromtxt("simulated.csv", delimiter=",", names=True),
        duhem(),
    )
    assert result.dtype.names == ("t", "u", "w", "recorded")
    np.testing.assert_array_equal(result["t"], measured[:, 0])
    np.testing.assert_allclose(result["u"], measured[:, 1], atol=1e-14)
    np.testing.assert_allclose(result["w"], measured[:, 2], atol=2e-5)


def test_simulate_without_an_output_starts_where_it_is_told():
    bare = ("--time", "time", "--input", "voltage")
    rows = ("--rows", "100:300", "--w0", "0.5", "--out", "bare.csv")
    ran = hystjax("simulate", "law.json", "good.csv", *bare, *rows)
    assert (ran.code, ran.err) == (0, "") and "NRMSE" not in ran.out
    result = np.genfromtxt("bare.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(result["t"], duhem()[100:300, 0])
    assert result["w"][0] == 0.5


def test_simulate_of_an_operator_asks_for_no_start():
    device = hj.models.PrandtlIshlinskii([0.0, 0.1], [1.0, 2.0])
    hj.save("operator.json", device)
    bare = ("--time", "time", "--input", "voltage", "--out", "operator.csv")
    ran = hystjax("simulate", "operator.json", "good.csv", *bare)
    assert (ran.code, ran.err) == (0, "")
    result = np.genfromtxt("operator.csv", delimiter=",", names=True)
    t, u, w = duhem().T
    expected = hj.simulate(device, hj.Recording(t, u, w)).w
    np.testing.assert_allclose(result["w"], expected, rtol=0, atol=1e-12)


def test_simulate_judges_the_run_that_it_writes():
    """From another start than the recorded one, under which the errors differ."""
    arguments = ("simulate", "law.json", "noisy.csv", *COLUMNS, "--rows", "500:540")
    ran = hystjax(*arguments, "--w0", "20", "--out", "judged.csv")
    assert (ran.code, ran.err) == (0, "")
    w = np.genfromtxt("judged.csv", delimiter=",", names=True)["w"]
    assert w[0] == 20
    measured = np.genfromtxt("noisy.csv", delimiter=",", names=True)["displacement"]
    error = w - measured[500:540]
    nrmse = 100 * np.sqrt(np.mean(error**2)) / np.ptp(measured[500:540])
    (shown,) = re.findall(r"^simulated +(\S+) %", ran.out, re.MULTILINE)
    assert float(shown) == pytest.approx(nrmse, rel=1e-3)
    assert f"{np.max(np.abs(error)):.4g}" in ran.out


@pytest.mark.parametrize(
    ("read", "out"),
    [
        ("simulated.csv", ()),  # the default
        ("good.csv", ("--out", "./good.csv")),
        ("good.csv", ("--out", "law.json")),
        ("link.csv", ("--out", "good.csv")),
    ],
)
def test_simulate_does_not_overwrite_what_it_reads(
    folder, tmp_path, monkeypatch, read, out
):
    for source, name in (("good.csv", "good.csv"), ("good.csv", "simulated.csv")):
        (tmp_path / name).write_bytes((folder / source).read_bytes())
    (tmp_path / "law.json").write_bytes((folder / "law.json").read_bytes())
    (tmp_path / "link.csv").symlink_to("good.csv")
    monkeypatch.chdir(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    message = failed(("simulate", "law.json", read, *COLUMNS, *out), 2)
    assert "--out" in message and "that is read; name another" in message
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("command", "verb", "flags", "changed"),
    [
        ("identify", hj.identify, (), {}),
        (
            "identify",
            hj.identify,
            ("--threshold", "0.2", "--ridge", "0.7", "--no-normalise"),
            {"regression": hj.regression.STLSQ(0.2, 0.7, normalise=False)},
        ),
        ("discover", hj.discover, (), {}),
        ("discover", hj.discover, ("--any-memory",), {"fading": False}),
        (
            "discover",
            hj.discover,
            (
                *("--any-reach", "--rate-independent", "--known", "u=-2.5"),
                *("--sign", "du=+", "--sign", "w*|du|=-"),
                *("--largest", "4", "--width", "3", "--seconds", "9"),
            ),
            {
                **{"guard": False, "rate_independent": True, "largest": 4, "width": 3},
                **{"seconds": 9.0, "signs": {"du": 1, "w*|du|": -1}},
                "known": {"u": -2.5},
            },
        ),
        ("discover", hj.discover, ("--odd",), {"odd": True}),
    ],
)
def test_commands_have_the_defaults_of_python(
    monkeypatch, command, verb, flags, changed
):
    signature, found = inspect.signature(verb), {}

    def caught(*arguments, **options):
        bound = signature.bind(*arguments, **options)
        bound.apply_defaults()
        found.update(bound.arguments)
        raise hj.ComputationError("enough")

    folder = {"identify": "regression", "discover": "discovery"}[command]
    monkeypatch.setattr(f"hystjax.{folder}._{command}.{command}", caught)
    failed((command, "good.csv", *COLUMNS, *flags), 3)
    expected = {name: each.default for name, each in signature.parameters.items()}
    expected |= {"library": hj.library.Polynomial(2), **changed}
    for name in expected.keys() - {"recordings", "progress"}:
        assert repr(found[name]) == repr(expected[name])


@pytest.mark.parametrize(("flags", "seed"), [((), 0), (("--seed", "7"), 7)])
def test_residuals_are_drawn_again_by_the_seed(monkeypatch, flags, seed):
    stats, drawn = {"why": "", "candidates": ()}, []

    def caught(found, rows, *, key, largest):
        drawn.append(jax.random.key_data(key).tolist())
        raise hj.ComputationError("enough")

    law = hj.models.SparseModel.from_terms(TRUTH)
    found = hj.Solution(law, hj.RESULTS.successful, stats)
    monkeypatch.setattr("hystjax.discovery._discover.discover", lambda *_, **__: found)
    monkeypatch.setattr("hystjax.cli._laws.inclusion", caught)
    failed(("discover", "good.csv", *COLUMNS, *flags), 3)
    assert drawn == [jax.random.key_data(jax.random.key(seed)).tolist()]


GOOD = ("identify", "good.csv", *COLUMNS)
MAT = ("identify", "good.mat", "--time", "t")
BARE = ("--input", "voltage", "--output", "displacement")
RUN = ("simulate", "law.json", "good.csv")
BAD = [
    (("compare", "good.csv", *COLUMNS, "--test", "0:99"), "Give --rows too"),
    (("identify", "nan.csv", *COLUMNS), "`w` has 1 value.*NaN.*row 17.*Remove"),
    (("identify", "inf.csv", *COLUMNS), "`u` has 1 value.*inf.*row 3.*Remove"),
    (("identify", "back.csv", *COLUMNS), "`t` must increase.*goes back at row 10"),
    (("identify", "twice.csv", *COLUMNS), "`t` must increase.*repeats at row 10"),
    (("identify", "ragged.csv", *COLUMNS), "line 1002 .*2 cells where most have 3"),
    (("identify", "words.csv", *COLUMNS), "`input`.*'n/a'.*not a number, in line 7 "),
    (("identify", "two.csv", *COLUMNS), "at least 3 samples, got 2"),
    (("identify", "few.csv", *COLUMNS), "21 terms needs at least 22 samples, got 14"),
    (("identify", "still.csv", *COLUMNS), r"`u` is constant \(1.0\)"),
    (("identify", "stuck.csv", *COLUMNS), r"`w` is constant \(1.0\)"),
    (("identify", "empty.csv", *COLUMNS), "empty.csv is empty"),
    (("identify", "binary.csv", *COLUMNS), "binary.csv is binary"),
    (("identify", "missing.csv", *COLUMNS), "no file missing.csv"),
    (("identify", ".", *COLUMNS), "is a folder"),
    (("identify", "good.csv", "--time", "zeit", *BARE), "'zeit' is not a column.*0 't"),
    (("identify", "good.csv", "--time", "3", *BARE), "'3' is not a column.*0 to 2"),
    ((*GOOD, "--period", "1"), "give either --time.* or --period, "),
    (
        ("identify", "good.csv", "--period", "nan", *BARE),
        "--period: 'nan' is not a positive",
    ),
    (
        ("identify", "good.csv", "--period", "inf", *BARE),
        "--period: 'inf' is not a positive",
    ),
    (
        ("identify", "good.csv", "--period", "0", *BARE),
        "--period: '0' is not a positive",
    ),
    (("identify", "broken.mat", *COLUMNS), "broken.mat cannot be read as a MATLAB"),
    ((*MAT, "--input", "short", "--output", "uw:1"), "`t` 1000, `u` 997, `w` 1000"),
    ((*MAT, "--input", "uw", "--output", "uw:1"), "`input`='uw' is a matrix"),
    ((*MAT, "--input", "uw:0", "--output", "uw:2"), "`output`=.*numbered from 0 to 1"),
    ((*MAT, "--input", "x", "--output", "uw:1"), "`input`='x' is not in.*t, uw, short"),
    ((*GOOD, "--threshold", "nan"), "--threshold must be zero or more, got nan"),
    ((*GOOD, "--threshold", "much"), "--threshold: invalid float.*'much'.*--help"),
    ((*GOOD, "--threshold", "1_0"), "--threshold: invalid float.*'1_0'.*--help"),
    ((*GOOD, "--ridge", "-1"), "--ridge must be zero or more, got -1.0"),
    ((*GOOD, "--ridge", "nan"), "--ridge must be zero or more, got nan"),
    ((*GOOD, "--degree", "0"), "--degree must be at least 1, got 0"),
    ((*GOOD, "--degree", "1.5"), "--degree: invalid int.*'1.5'"),
    (
        (*GOOD, "--variables", "w,v"),
        "--variables must be different names out of w, u, du, .*'v'",
    ),
    ((*GOOD, "--variables", "w,w"), "different names out of w, u, du"),
    ((*GOOD, "--smooth", "0"), "--smooth must be odd.*got 0"),
    ((*GOOD, "--smooth", "8"), "--smooth must be odd.*got 8"),
    ((*GOOD, "--smooth", "3"), "--smooth .*larger than 3, got 3"),
    ((*GOOD, "--smooth", "1001"), "--smooth 1001 .* at least 1001 samples, got 700"),
    ((*GOOD, "--rows", "five"), "--rows: 'five' is not a range of rows such as 0:5000"),
    ((*GOOD, "--rows", "9:3"), "--rows 9:3 .*the first must be less"),
    ((*GOOD, "--rows", "0:1001"), "--rows 0:1001 .*rows run from 0 to 1000"),
    ((*GOOD, "--rows", "0:300", "--test", "200:400"), "200:400 shares rows .*0:300"),
    ((*GOOD, "--test", "998:1000"), "at least 3 samples, got 2"),
    ((*GOOD, "--units", "V"), "--units must be two units.*'V'"),
    ((*GOOD, "--interpolation", "step"), "invalid choice: 'step'.*'linear', 'cubic'"),
    ((*GOOD, "--tresh", "1"), "unrecognized arguments: --tresh"),
    (("identify", "m\udce4.csv", *COLUMNS), r"argument 'm\\udce4\.csv'.*Rename the"),
    ((*GOOD, "--out", "m\udce4"), r"argument 'm\\udce4' holds .* is not UTF-8"),
    ((*GOOD, "--out", "law.json"), "'law.json' cannot be made .*choose another"),
    ((*GOOD, "--out", "law.json/x"), "'law.json/x' cannot be made .*choose another"),
    ((), "arguments are required: COMMAND; see `hystjax --help`"),
    (("identify",), "arguments are required: FILE, --input.*`hystjax identify --help`"),
    (("discern",), "invalid choice: 'discern' .*'identify'"),
    (("simulate", "missing.json", "good.csv", *COLUMNS), "no file missing.json"),
    (("simulate", "broken.json", "good.csv", *COLUMNS), "broken.json is not JSON"),
    (("simulate", "other.json", "good.csv", *COLUMNS), "other.json: this is no model"),
    ((*RUN, "--time", "time", "--input", "voltage"), "give --w0, or --output"),
    ((*RUN, *COLUMNS, "--w0", "nan"), "--w0 .*nan"),
    ((*RUN, *COLUMNS, "--rows", "0:2000"), "--rows 0:2000 is not in the file"),
    ((*RUN, *COLUMNS, "--out", "nowhere/x.csv"), "no folder .*nowhere"),
    (("reproduce", "9"), "no experiment '9'.* 1, 2, .* all, tables, "),
    (("reproduce", "famlies"), r"no .*'famlies'.* Did you mean 'families'\?"),
    (("reproduce", "1", "--out", "good.csv"), "folder 'good.csv' cannot be made"),
    (("data",), "arguments are required: ACTION"),
    (("data", "path"), "arguments are required: NAME"),
    (("data", "path", "piezo"), "no dataset 'piezo'.*piezo_ayala"),
    (("data", "fetch", "piezo"), "no dataset 'piezo'.*piezo_ayala"),
    (("data", "list", "piezo_ayala"), "unrecognized arguments: piezo_ayala"),
]


def failed(arguments, code):
    """The one line that a command which must fail has printed."""
    before = sorted(Path().rglob("*"))
    ran = hystjax(*arguments)
    assert (ran.code, ran.out) == (code, "")
    assert ran.err.count("\n") == 1 and ran.err.startswith("hystjax: error: ")
    assert sorted(Path().rglob("*")) == before
    return ran.err


@pytest.mark.parametrize(
    ("arguments", "message"), BAD, ids=[" ".join(arguments) for arguments, _ in BAD]
)
def test_bad_input_is_one_line_and_leaves_nothing_behind(unchecked, arguments, message):
    assert re.search(message, failed(arguments, 2))


@pytest.mark.parametrize("command", ["identify", "discover", "compare"])
@pytest.mark.parametrize("out", ["law.json", "law.json/x", ""])
def test_where_no_folder_can_be_is_told_before_the_work(monkeypatch, command, out):
    def worked(*_, **__):
        raise AssertionError

    monkeypatch.setattr("hystjax.cli._laws._identify.identify", worked)
    monkeypatch.setattr("hystjax.cli._laws._discover.discover", worked)
    monkeypatch.setattr("hystjax.cli._laws.compare", worked)
    said = failed((command, "good.csv", *COLUMNS, "--out", out), 2)
    assert re.search("law.json is a file|a folder is given by its path", said)


def test_empty_law_is_no_result():
    said = failed((*GOOD, "--threshold", "1e9"), 3)
    assert "zero. Terms below --threshold are dropped: lower that" in said
    assert said.endswith("root mean square of what is explained.\n")


def test_diverging_simulation_is_no_result():
    message = failed(("simulate", "wild.json", "good.csv", *COLUMNS), 3)
    assert "did not stay finite" in message and "row" in message


@pytest.mark.slow
def test_a_best_family_that_diverges_is_no_result(monkeypatch, tmp_path):
    wild = hj.load("wild.json")
    row = Compared("wild", wild, (0.01,), 0.01, 1.0, 3, 1.0, "")
    found = hj.Comparison((row,), {}, 0.01)
    monkeypatch.setattr("hystjax.cli._laws.compare", lambda *_, **__: found)
    ran = hystjax("compare", "good.csv", *COLUMNS, "--out", str(tmp_path / "out"))
    assert ran.code == 3 and "diverges on the fitted rows" in ran.err
    assert (tmp_path / "out/report.md").is_file()


def test_rows_that_nobody_chose_are_not_too_few():
    options = argparse.Namespace(rows=(0, 1950), test=None, average=20)
    assert _chosen_rows(options, 2000) == ((0, 1950), None)
    assert _chosen_rows(options, 2010) == ((0, 1950), (1950, 2010))


@pytest.mark.slow
@pytest.mark.parametrize("start", [COLUMNS[-2:], ("--w0", "0")])
def test_where_a_law_is_lost_is_told_by_the_row_of_the_file(start):
    run = ("simulate", "wild.json", "good.csv", *COLUMNS[:4], *start)
    message = failed((*run, "--rows", "500:900"), 3)
    time, row = re.search(r"lost at t = ([\d.]+) s, row (\d+)\.", message).groups()
    assert duhem()[int(row), 0] == pytest.approx(float(time), rel=1e-5)


@pytest.mark.slow
def test_law_that_diverges_on_unseen_rows_still_gets_its_report(folder):
    # w = 1 / (2.5 - t) obeys w' = w^2, up to where the device turned out to be finite.
    t = np.linspace(0, 4, 1000)
    w = np.where(t < 2.4, 1 / np.maximum(2.5 - t, 0.1), 10.0)
    write_csv(folder / "pole.csv", np.column_stack([t, np.sin(t), w]))
    columns = (*COLUMNS, "--rows", "0:500", "--variables", "w", "--threshold", "0.1")
    ran = hystjax("identify", "pole.csv", *columns, "--out", "pole")
    assert ran.code == 3
    error = re.sub(BEYOND, "", ran.err)
    assert re.fullmatch(
        r"hystjax: warning: displacement stays at 10 to the last digit .*\n"
        r"hystjax: error: the law diverges on the unseen rows;.*\n",
        error,
    )
    assert re.search(r"fitted +0\.\d+ %.*\nunseen +diverged\n", ran.out)
    assert hj.load("pole/law.json").terms() == pytest.approx({"w^2": 1}, rel=1e-2)
    errors = json.loads(Path("pole/metrics.json").read_text())["errors"]
    assert errors["unseen"]["nrmse"] is None and errors["fitted"]["nrmse"] < 1e-2
    assert "| unseen | diverged |" in Path("pole/report.md").read_text()
    assert Path("pole/unseen.png").stat().st_size > 10_000


def test_a_law_too_fast_for_the_samples_is_judged_all_the_same():
    rate, t = 250.0, np.linspace(0, 4, 401)  # a time constant of 4 ms, steps of 10 ms
    slow = rate * (rate * np.sin(t) - np.cos(t)) / (1 + rate**2)
    w = slow + (0.5 - slow[0]) * np.exp(-rate * t)  # solves w' = rate (sin t - w)
    record = hj.Recording(t, np.sin(t), w).with_input(jnp.sin)
    law = hj.models.SparseModel.from_terms({"w": -rate, "u": rate})
    assert float(hj.judge(law, record).errors["nrmse"]) < 1e-7
    fixed = hj.judge(law, record, method=hj.simulation.FixedStep())
    assert fixed.succeeded and float(fixed.errors["nrmse"]) > 1e-4


@pytest.mark.parametrize(
    "settings, kept",
    [({}, True), ({"JAX_ENABLE_COMPILATION_CACHE": "false"}, False)],
)
def test_compiled_programs_are_kept_for_the_next_process(tmp_path, settings, kept):
    bare = ("--time", "time", "--input", "voltage", "--w0", "0", "--out", "kept.csv")
    code = "import sys; from hystjax.cli import main; sys.exit(main())"
    command = (sys.executable, "-c", code, "simulate", "law.json", "good.csv", *bare)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), **settings}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    subprocess.run(command, env=environment, check=True, capture_output=True)
    assert any((tmp_path / "hystjax" / "compiled").iterdir()) == kept


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The folder of compiled programs, where JAX keeps any, as it does not in tests."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    settings = {"jax_enable_compilation_cache": True, "jax_compilation_cache_dir": None}
    before = {name: jax.config.values[name] for name in settings}
    for name, value in settings.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
    yield tmp_path / "hystjax" / "compiled"
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


@pytest.mark.parametrize("cut", [0, 100], ids="{} bytes".format)
def test_a_program_that_was_half_written_is_kept_anew(kept, monkeypatch, cut):
    def listing():
        return str(jax.jit(lambda x: x + 1.5)(2.0))

    monkeypatch.setattr(hj.datasets, "listing", listing)
    assert hystjax("data", "list").code == 0
    (file,) = kept.iterdir()
    file.write_bytes(file.read_bytes()[:cut])
    ran = hystjax("data", "list")
    assert (ran.code, ran.err) == (0, "")
    assert list(kept.iterdir()) == [file] and file.stat().st_size > 1000


@pytest.mark.parametrize("ours", [True, False])
def test_only_the_program_that_is_cut_is_removed_and_from_our_cache_alone(kept, ours):
    kept.mkdir(parents=True)
    jax.config.update("jax_compilation_cache_dir", str(kept if ours else kept.parent))
    names = {"jit_f-ab-cache", "jit_f-ab-atime", "jit_f-abc-cache", "jit_g-ab-cache"}
    for name in names:
        (kept / name).touch()
    said = "Error reading persistent compilation cache entry for 'jit_f-ab': cut"
    assert _is_of_cache(said) == ours and not _is_of_cache("the rest")
    cut = {"jit_f-ab-cache", "jit_f-ab-atime"} if ours else set()
    assert {each.name for each in kept.iterdir()} == names - cut


def test_help_tells_where_compiled_programs_are_kept():
    said = " ".join(_parser().format_help().split())
    assert "in ~/.cache/hystjax/compiled, or in hystjax/compiled of XDG_CACHE_" in said


@pytest.mark.parametrize("asked, taken", [(None, "cpu"), ("", "cpu"), ("cuda", "cuda")])
def test_the_processor_computes_unless_another_device_is_asked_for(asked, taken):
    before = jax.config.values["jax_platforms"]
    jax.config.update("jax_platforms", asked)
    try:
        assert hystjax("data", "list").code == 0
        assert jax.config.values["jax_platforms"] == taken
    finally:
        jax.config.update("jax_platforms", before)


def test_interrupt_is_not_a_traceback(monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(hj.datasets, "listing", interrupted)
    assert failed(("data", "list"), 130) == "hystjax: error: interrupted\n"


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_reader_that_leaves_is_no_error(unbuffered):
    code = "import sys; from hystjax.cli import main; sys.exit(main(['data', 'list']))"
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    environment["PYTHONPATH"] = str(Path(hj.__file__).parents[1])
    reader, writer = os.pipe()
    os.close(reader)
    ran = subprocess.run(
        [sys.executable, "-c", code],
        stdout=writer,
        stderr=subprocess.PIPE,
        env=environment,
    )
    os.close(writer)
    assert (ran.returncode, ran.stderr) == (0, b"")


@pytest.mark.parametrize(("encoding", "micro"), [("ascii", r"\xb5"), ("utf-8", "µ")])
def test_output_takes_what_its_encoding_lacks(monkeypatch, encoding, micro):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding))
    monkeypatch.setattr(hj.datasets, "listing", lambda: "displacement (µm)")
    assert main(["data", "list"]) == 0
    assert written.getvalue().decode() == f"displacement ({micro}m)\n"


def test_without_a_console_all_else_is_done(monkeypatch):
    def full():
        raise OSError(28, "No space left on device")

    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    export = ("export", "law.json", "--to", "text", "--out")
    assert main([*export, "silent.txt"]) == 0 and Path("silent.txt").is_file()
    assert main([*export, "missing/silent.txt"]) == 2
    with monkeypatch.context() as patched:
        patched.setattr("hystjax.cli._main.keep", full)
        assert main([*export, "silent.txt"]) == 2
    with Progress("laws", 2) as shown:
        shown.show(1)
    say("nobody hears that")
    assert refinement.watched(hystjax) is hystjax  # nor is a solver watched


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ((), "exit codes: 0 done; 2 bad input"),
        (("identify",), "--rows 35001:45001"),
        (("discover",), "the one that goes least its own way under larger, faster"),
        (("simulate",), "hystjax simulate report/law.json"),
        (("data",), "hystjax data fetch piezo_ayala"),
        (("reproduce",), "doi 10.1063/5.0146134"),
        (("demo",), "rows it has not seen"),
        (("--version",), hj.__version__),
    ],
)
def test_help_teaches(command, said, capsys):
    flag = () if command == ("--version",) else ("--help",)
    with pytest.raises(SystemExit, match="0"):
        main([*command, *flag])
    assert said in " ".join(capsys.readouterr().out.split())


def helped(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([*command, "--help"])
    return capsys.readouterr().out


def test_help_names_every_study(capsys):
    said = helped(("reproduce",), capsys)
    named = re.findall(r"^  ([a-z_]+)  +\S", said.partition("Studies")[2], re.MULTILINE)
    assert named == list(hj.reproduce.STUDIES)


@pytest.mark.parametrize("command", [(), ("discover",), ("loops",), ("export",)])
def test_commands_in_help_fit_a_terminal_and_can_be_copied(command, capsys):
    said = helped(command, capsys)
    assert max(map(len, re.findall(r"^  hystjax .*", said, re.MULTILINE))) <= 88
    commands = re.findall(r"^  (hystjax .*)", re.sub(r"\\\n *", "", said), re.MULTILINE)
    for line in commands:
        _, *arguments = shlex.split(re.split(r"  +", line)[0])
        assert callable(_parser().parse_args(arguments).run)


@pytest.mark.parametrize("units", ["-,MPa", "-,-", "mm,-"])
def test_units_may_begin_with_a_dash_for_none(units):
    columns = ("--input", "a", "--output", "b")
    given = _parser().parse_args(["loops", "f.csv", *columns, "--units", units])
    assert given.units == units


def test_the_package_runs_as_a_module(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["hystjax", "--version"])
    with pytest.raises(SystemExit, match="0"):
        runpy.run_module("hystjax", run_name="__main__")
    assert capsys.readouterr().out == f"{hj.__version__}\n"


def test_data_list_shows_terms_and_whereabouts():
    ran = hystjax("data", "list")
    assert (ran.code, ran.err) == (0, "")
    names = hj.datasets.names()
    for name in names:
        assert f"{name}: " in ran.out
    assert ran.out.count("  licence ") == ran.out.count("  cite ") == len(names)


@pytest.mark.recordings
def test_data_fetch_and_path_agree():
    (path,) = hystjax("data", "path", "piezo_ayala").out.splitlines()
    (file,) = hystjax("data", "fetch", "piezo_ayala").out.splitlines()
    assert Path(file).parent == Path(path) and Path(file).is_file()


@pytest.mark.parametrize(
    ("arguments", "titles"),
    [((), ["first", "second"]), (("all",), ["first", "second"]), (("2",), ["second"])],
)
def test_reproduce_prints_three_figures_side_by_side(monkeypatch, arguments, titles):
    def experiment(title):
        return lambda: Comparison(title, (Row("error, %", 0.25, None, 0.1234567),))

    experiments = {"1": experiment("first"), "2": experiment("second")}
    monkeypatch.setattr(hj.reproduce, "EXPERIMENTS", experiments)
    monkeypatch.setattr(hj.reproduce, "TABLES", {"2": experiments["2"]})
    monkeypatch.setattr(hj.reproduce, "reproduce", lambda n: experiments[n]())
    ran = hystjax("reproduce", *arguments)
    assert (ran.code, ran.err) == (0, "")
    lines = [line.split() for line in ran.out.splitlines() if line]
    table = [["paper", "rerun", "hystjax"], ["error,", "%", "0.25", "-", "0.12346"]]
    assert lines == [line for title in titles for line in [[title], *table]]


PIEZO = {"1": -0.176, "w": -2.388, "u": 0.581, "du": 0.119, "w*|w|": -0.076}


@pytest.mark.recordings
def test_stranger_gets_the_published_law_from_the_piezo_file():
    file = hj.datasets.path("piezo_ayala") / "hysteresis_v_150_1hz.csv"
    ran = hystjax(
        *("identify", file, "--time", 1, "--input", 3, "--output", 2),
        *("--units", "V,µm", "--rows", "35001:45001", "--test", "17500:35000"),
        *("--threshold", "0.01", "--ridge", "0.05", "--no-normalise"),
        *("--out", "piezo"),
    )
    assert (ran.code, ran.err) == (0, "")
    metrics = json.loads(Path("piezo/metrics.json").read_text())
    law = hj.load("piezo/law.json")
    assert law.terms() == metrics["terms"]
    assert law.terms().keys() == PIEZO.keys()
    assert law.terms() == pytest.approx(PIEZO, abs=1e-3)
    errors = {rows: each["nrmse"] for rows, each in metrics["errors"].items()}
    assert 100 * errors["fitted"] == pytest.approx(0.2328, abs=0.005)
    assert 100 * errors["unseen"] == pytest.approx(0.248, abs=0.005)
    law_line, kind_line, _, *table, where = ran.out.splitlines()
    assert law_line == metrics["law"] == str(law)
    assert kind_line == str(hj.library.Kind.RATE_DEPENDENT)
    for line, (rows, nrmse) in zip(table, errors.items(), strict=True):
        assert re.match(rf"{rows} +{100 * nrmse:.4g} % ", line)
    assert where == f"report: {Path('piezo/report.md')}"
    for name in ("report.md", "overview.png", "fitted.png", "unseen.png"):
        assert Path("piezo", name).stat().st_size > 1000


@pytest.mark.slow
def test_what_a_newcomer_does_not_know_to_try_is_said(no_figures):
    """Of many terms, as where columns are exchanged, and of a large error."""

    def decaying(t):
        rate = 0.4j * np.pi - 0.05
        turned = np.exp(rate * t)
        return turned.imag, (rate * turned).imag

    write_csv(Path("newcomer.csv"), noisy(duhem(decaying, 30.0), 5e-3))
    given = ("identify", "newcomer.csv", "--time", "time", "--rows", "0:1000")
    right = (*given, *COLUMNS[2:], "--variables", "w,u,du,|du|")
    good = hystjax(*right, "--smooth", 21, "--threshold", 0.1).out
    assert "fitted" in good and "hystjax discover" not in good
    exchanged = ("--input", "displacement", "--output", "voltage")
    swapped = hystjax(*given, *exchanged, "--threshold", 0.001)
    assert re.search(r"\d+ terms are many: raise --threshold.* exchanged", swapped.out)
    coarse = hystjax(*right, "--threshold", 0.8).out
    assert "more than 3 % of their range: `hystjax discover`" in coarse
