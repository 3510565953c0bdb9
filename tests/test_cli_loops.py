"""`hystjax loops` and `hystjax forc` on files of a stranger, good and bad."""

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from test_cli import hystjax
from test_forc import bump, simulated

import hystjax as hj
from hystjax import InputError
from hystjax.cli import main
from hystjax.cli._loops import _backbone, _notes

COLUMNS = ("--input", "stroke", "--output", "force")
LOOPS = ("loops", "loop.csv", *COLUMNS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops")
    t = np.linspace(0, 3, 3001)
    u, w = np.sin(2 * np.pi * t), 2 * np.sin(2 * np.pi * t + 0.3)
    columns = {"delimiter": ",", "header": "instant,stroke,force", "comments": ""}
    np.savetxt(folder / "loop.csv", np.stack([t, u, w], axis=1), **columns)
    curves = simulated(bump, n=24, seed=0, noise=1e-3)
    parts = [
        "".join(f"{h:.9e},{m:.9e}\n" for h, m in zip(field, moment, strict=True))
        for field, moment in (
            (curves.field[a:b], curves.moment[a:b])
            for a, b in zip(curves.starts[:-1], curves.starts[1:], strict=True)
        )
    ]
    (folder / "curves.csv").write_text("Field [T],Moment [A m2]\n" + "\n".join(parts))
    (folder / "two.csv").write_text("\n".join(parts[:2]))
    (folder / "bare.csv").write_text("\n".join(parts))
    hj.save(folder / "law.json", hj.models.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5]))
    wild = hj.models.PrandtlIshlinskii([0.0, 0.2], [1e308, 1.7e308])
    hj.save(folder / "wild.json", wild)
    return folder


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def table(path):
    with Path(path).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_one_period_from_zero_is_told_to_begin_there(folder):
    rows = (folder / "loop.csv").read_text().splitlines(keepends=True)[:1002]
    Path("period.csv").write_text("".join(rows))
    ran = hystjax("loops", "period.csv", *COLUMNS, "--time", "instant")
    assert ran.code != 0 and "--begin zero reads one" in ran.err


def test_loops_of_a_test_may_begin_at_zero():
    ran = hystjax(*LOOPS, "--time", "instant", "--begin", "zero", "--out", "from_zero")
    assert (ran.code, ran.err) == (0, "")
    rows = table("from_zero/loops.csv")
    marks = [
        [int(row[name]) for name in ("start", "turn", "back", "stop")] for row in rows
    ]
    wanted = [[0, 250, 750, 1000], [1000, 1250, 1750, 2000], [2000, 2250, 2750, 3000]]
    assert marks == wanted
    assert float(rows[0]["remanence"]) == pytest.approx(-2 * np.sin(0.3), rel=1e-6)


def test_an_output_that_drifts_is_told_and_put_right():
    """What it adds to an area is its drift over a cycle times the input at the tip."""
    t = np.linspace(0, 5, 2501)
    u, w = 2 * np.sin(2 * np.pi * t), 0.5 * np.sin(2 * np.pi * t - 0.3) + 0.02 * t
    columns = {"delimiter": ",", "header": "t,stroke,force", "comments": ""}
    np.savetxt("drifts.csv", np.stack([t, 1 + u, w], axis=1), **columns)
    area = -np.pi * 2 * 0.5 * np.sin(0.3)
    given = ("loops", "drifts.csv", "--time", "t", *COLUMNS)
    for more, wanted in (((), area + 0.04), (("--without-drift", "--centre"), area)):
        ran = hystjax(*given, *more, "--out", "drifts")
        share = abs(0.04 / (area + 0.04))
        said = f"by 0.02 a cycle on average.*off by about {100 * share:.2g} %"
        told = re.search(said, ran.out)
        assert ran.code == 0 and bool(told) == (not more)
        rows = table("drifts/loops.csv")
        energies = [float(row["energy"]) for row in rows]
        np.testing.assert_allclose(energies, wanted, rtol=1e-4)
        middle = float(rows[0]["u_max"]) + float(rows[0]["u_min"])
        assert middle == pytest.approx(0 if more else 2, abs=1e-6)
    # Where cycles begin at zero it adds nothing.
    ran = hystjax(*given, "--centre", "--begin", "zero", "--out", "drifts")
    assert ran.code == 0 and "do not close" not in ran.out


@pytest.mark.parametrize("drift", [0.015, 0.0])
def test_a_drift_is_told_of_by_what_all_cycles_together_tell(drift):
    """Each of 50 cycles alone cannot tell 0.015 in noise of 0.02."""
    t = np.arange(5001) / 100
    noise = 0.02 * np.random.default_rng(0).normal(size=len(t))
    u, w = np.sin(2 * np.pi * t), np.sin(2 * np.pi * t - 0.3) + drift * t
    columns = {"delimiter": ",", "header": "t,stroke,force", "comments": ""}
    np.savetxt("noisy.csv", np.stack([t, u, w + noise], axis=1), **columns)
    ran = hystjax("loops", "noisy.csv", "--time", "t", *COLUMNS, "--out", "noisy")
    told = re.search(r"the output moves by (\S+) a cycle on average", ran.out)
    assert ran.code == 0 and bool(told) == bool(drift)
    if told:
        assert float(told[1]) == pytest.approx(drift, abs=0.003)


def test_loops_writes_numbers_and_figures_beside_a_law():
    ran = hystjax(
        *(*LOOPS, "--time", "instant", "--units", "mm,kN"),
        *("--model", "law.json", "--out", "report"),
    )
    assert (ran.code, ran.err) == (0, "")
    assert "6 reversals of more than 0.02" in ran.out
    assert "energy (kN·mm)" in ran.out
    rows = table("report/loops.csv")
    assert len(rows) == 2
    for row in rows:
        energy = float(row["energy [kN·mm]"])
        assert energy == pytest.approx(2 * np.pi * np.sin(0.3), rel=1e-6)
        assert float(row["lag [rad]"]) == pytest.approx(-0.3, rel=1e-6)
    report = Path("report/report.md").read_text(encoding="utf-8")
    # A play of radius 0.2 behind an amplitude of 1 is behind it: 0.5 · 4 · 0.2 · 0.8.
    ((own, law, off),) = re.findall(
        r"^\| energy \(kN·mm\) \| (.+) \| (.+) \((.+) %\) \|$", report, re.MULTILINE
    )
    assert float(law) == pytest.approx(-0.32, rel=1e-3)
    assert float(off) == pytest.approx(100 * (float(law) / float(own) - 1), rel=0.1)
    for name in ("loop", "energy", "backbone"):
        assert f"({name}.png)" in report
        assert Path(f"report/{name}.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_law_is_moved_as_the_record_is():
    """A record that a law made has its numbers, whatever is taken for zero."""
    t = np.linspace(0, 8, 1601)
    u = 75 - 75 * np.cos(np.pi * t)
    law = hj.models.SparseModel.from_terms({"du": 0.02, "u*du": 2e-4, "w*|du|": -0.01})
    w = hj.simulate(law, hj.Recording(t, u, 0 * u), w0=0.0).w
    np.savetxt("made.csv", np.stack([t, u, w], 1), "%.15g", ",", header="t,u,w")
    hj.save("made.json", law)
    columns = ("--time", "t", "--input", "u", "--output", "w", "--model", "made.json")
    for more in (
        (),
        ("--centre",),
        ("--without-drift",),
        ("--centre", "--without-drift"),
    ):
        assert hystjax("loops", "made.csv", *columns, *more).code == 0
        report = Path("hystjax-loops/report.md").read_text()
        beside = report.split("## The law beside it")[1]
        off = [float(each) for each in re.findall(r"\((\S+) %\)", beside)]
        assert len(off) >= 7 and np.max(np.abs(off)) < 1e-9


@pytest.mark.parametrize("name", ["loops.csv", "forc.csv"])
def test_a_measurement_is_not_written_over(name, tmp_path, monkeypatch):
    source = {"loops.csv": "loop.csv", "forc.csv": "curves.csv"}[name]
    text = Path(source).read_text()
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    columns = COLUMNS if name == "loops.csv" else ()
    ran = hystjax(name.removesuffix(".csv"), name, *columns, "--out", ".")
    assert ran.code == 2 and "is the file" in ran.err
    assert [*tmp_path.iterdir()] == [tmp_path / name] and Path(name).read_text() == text


def test_loops_need_no_clock_and_take_rows():
    arguments = (*LOOPS, "--rows", "100:2101", "--threshold", "0.5")
    ran = hystjax(*arguments, "--out", "bare")
    assert (ran.code, ran.err) == (0, "")
    assert "lag" not in ran.out
    (cycle,) = table("bare/loops.csv")
    # Of the file's rows: its sine turns every half second, 500 rows.
    assert [int(cycle[name]) for name in ("start", "turn", "stop")] == [250, 750, 1250]


def test_each_side_of_a_backbone_has_its_own_curve(monkeypatch):
    """Springs that yield at other forces on the way in and out."""
    monkeypatch.setattr(hj.plot, "backbone", lambda record, outer, fits: fits)
    u = np.concatenate([np.linspace(0, 2, 51), np.linspace(2, -3, 101)[1:]])
    u = np.append(u, np.linspace(-3, 0, 51)[1:])
    w = np.clip(10 * u, -5.0, 8.0)
    record = hj.Recording(None, u, w)
    fits = _backbone(record, hj.loops.backbone(record))
    assert fits["EEEP"].w_yield == pytest.approx(8.0, rel=0.05)
    assert fits["EEEP, negative side"].w_yield == pytest.approx(-5.0, rel=0.05)


def test_an_input_that_is_never_zero_has_numbers_and_no_backbone():
    arguments = ("--threshold", "0.5", "--out", "never")
    assert hystjax(*LOOPS, *arguments).code == 0
    assert Path("never/backbone.png").exists()
    table_of = np.loadtxt("loop.csv", delimiter=",", skiprows=1) + np.array([0, 5, 0])
    columns = {"delimiter": ",", "header": "instant,stroke,force", "comments": ""}
    np.savetxt("never.csv", table_of, **columns)
    ran = hystjax("loops", "never.csv", *COLUMNS, *arguments)
    assert ran.code == 0 and "a backbone count from there, and --centre" in ran.out
    for row in table("never/loops.csv"):
        assert float(row["energy"]) == pytest.approx(2 * np.pi * np.sin(0.3), rel=1e-6)
    report = Path("never/report.md").read_text(encoding="utf-8")
    assert re.findall(r"!\[(\w+)\]", report) == ["loop", "energy"]
    assert sorted(Path("never").glob("*.png")) == [
        Path("never/energy.png"),
        Path("never/loop.png"),
    ]


def test_of_many_cycles_the_first_and_last_are_printed(tmp_path):
    u = np.tile([0.0, 1.0, 0.0, -1.0], 46)
    many, out = tmp_path / "many.csv", tmp_path / "out"
    np.savetxt(many, np.stack([u, np.roll(u, 1)], axis=1), delimiter=",")
    columns = ("--input", "0", "--output", "1", "--out", str(out))
    tips = tmp_path / "tips.csv"  # which may all be noise
    np.savetxt(tips, np.tile([[1.0, 0.0], [-1.0, 0.0]], (46, 1)), delimiter=",")
    told = hystjax("loops", str(tips), *columns).err
    assert "A smaller --threshold counts" in told
    ran = hystjax("loops", str(many), *columns, "--threshold", "0.5")
    assert (ran.code, ran.err) == (0, "")
    printed = re.findall(r"^(\d+|\.\.\.) {2}", ran.out, re.MULTILINE)
    whole = [row["cycle"] for row in table(out / "loops.csv")]
    assert len(whole) > 41 and printed == [*whole[:20], "...", *whole[-20:]]
    assert f"{len(whole) - 40} more cycles are in {out / 'loops.csv'}" in ran.out


@pytest.mark.slow
def test_forc_writes_the_diagram_and_a_model(monkeypatch):
    monkeypatch.setattr(hj.loops, "left_out", lambda curves: 12e-4 * len(curves))
    ran = hystjax("forc", "curves.csv", "--preisach", "--out", "diagram")
    assert (ran.code, ran.err) == (0, "")
    assert "24 curves" in ran.out
    assert "NRMSE 2.88 % on every tenth curve left out" in ran.out
    known = [row for row in table("diagram/forc.csv") if row["density [A m²/T²]"]]
    best = max(
        (row for row in known if float(row["Hc [T]"]) > 0.01),
        key=lambda row: float(row["density [A m²/T²]"].replace("nan", "-inf")),
    )
    assert float(best["Hc [T]"]) == pytest.approx(0.04, abs=0.006)
    assert isinstance(hj.load("diagram/preisach.json"), hj.models.Preisach)
    report = Path("diagram/report.md").read_text(encoding="utf-8")
    assert "| smoothing | error at points left out (A m²) |" in report
    assert Path("diagram/forc.png").stat().st_size > 1000
    again = hystjax("forc", "curves.csv", "--out", "diagram")
    assert again.code == 0 and "preisach.json beside this is of something" in again.out
    assert Path("diagram/preisach.json").exists()


@pytest.mark.parametrize(
    ("options", "drift", "smoothing"),
    [
        ((), True, None),
        (("--no-drift", "--smoothing", "3"), False, 3.0),
        (("--varying",), True, hj.loops.Varying()),
    ],
)
def test_options_reach_the_diagram(monkeypatch, options, drift, smoothing):
    given, read = {}, hj.loops.read_forc

    def reading(file, **how):
        given.update(how)
        return read(file)

    def drawing(curves, **how):
        given.update(how)
        raise hj.ComputationError("enough")

    monkeypatch.setattr(hj.loops, "read_forc", reading)
    monkeypatch.setattr(hj.loops, "forc", drawing)
    assert hystjax("forc", "curves.csv", *options).code == 3
    assert repr(given) == repr({"drift": drift, "smoothing": smoothing})


def test_curves_without_units_have_no_empty_brackets():
    ran = hystjax("forc", "bare.csv", "--smoothing", "4", "--out", "unknown")
    assert (ran.code, ran.err) == (0, "")
    (head, *_) = Path("unknown/forc.csv").read_text(encoding="utf-8").splitlines()
    assert head == "Hc,Hu,density,standard error"
    report = Path("unknown/report.md").read_text(encoding="utf-8")
    for text in (ran.out, report):
        assert not re.search(r"\(\)|\[\]|\w  \w|\w ,", text)
    found = hj.loops.forc(hj.loops.read_forc("bare.csv"), smoothing=4)
    rows = iter(table("unknown/forc.csv"))
    for i, hu in enumerate(found.hu):
        for j, hc in enumerate(found.hc):
            expected = hc, hu, found.density[i, j], found.error[i, j]
            np.testing.assert_array_equal([*map(float, next(rows).values())], expected)
    ax, *_ = hj.plot.forc(found).axes
    assert ax.get_xlabel() == "coercivity Hc"
    # A thousand times as much where it is mT of T.
    other, *_ = hj.plot.forc(dataclasses.replace(found, units=("T", "A m²"))).axes
    assert other.get_ylabel().endswith("(mT)")
    places, larger = (each.collections[0].get_coordinates() for each in (ax, other))
    np.testing.assert_allclose(larger, 1e3 * places)


BAD = [
    ((*LOOPS, "--threshold", "-1"), 2, "--threshold must be a positive number, got -1"),
    ((*LOOPS, "--threshold", "9"), 2, "the input makes no cycle.*smaller --threshold"),
    ((*LOOPS, "--rows", "0:300"), 2, "the input makes no cycle"),
    ((*LOOPS, "--model", "missing.json"), 2, "no file missing.json"),
    ((*LOOPS, "--model", "wild.json"), 3, "did not stay finite"),
    ((*LOOPS, "--interpolation", "cubic"), 2, "that a --model is run along"),
    ((*LOOPS, "--units", "mm"), 2, "--units must be two units"),
    (("loops", "loop.csv", "--input", "stroke"), 2, "arguments are required: --output"),
    (("forc", "missing.frc"), 2, "no file missing.frc"),
    (("forc", "loop.csv"), 2, "loop.csv has no column with 'field' in its name"),
    (("forc", "two.csv"), 2, "3 reversal curves or more, got 2"),
    (("forc", "curves.csv", "--smoothing", "0.5"), 2, "--smoothing must be 1 or more"),
    (("forc", "curves.csv", "--smoothing", "nan"), 2, "must be 1 or more, and finite"),
    (("forc", "curves.csv", "--smoothing", "3", "--varying"), 2, "not both"),
]


@pytest.mark.parametrize(("arguments", "code", "message"), BAD)
def test_bad_input_is_one_line_and_leaves_nothing_behind(
    unchecked, arguments, code, message
):
    before = sorted(Path().rglob("*"))
    ran = hystjax(*arguments, "--out", "nothing")
    assert (ran.code, ran.out) == (code, "")
    assert ran.err.count("\n") == 1 and ran.err.startswith("hystjax: error: ")
    assert re.search(message, ran.err)
    assert sorted(Path().rglob("*")) == before


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("loops", "cycle by cycle"),
        ("loops", "it is the loss with a minus sign"),
        ("forc", "every tenth is left"),
    ],
)
def test_help_teaches(command, said, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert said in " ".join(capsys.readouterr().out.split())


def test_a_loop_is_drawn_whose_columns_have_one_name():
    t = np.linspace(0, 2, 401)
    u, w = np.sin(2 * np.pi * t), np.sin(2 * np.pi * t - 0.3)
    (ax,) = hj.plot.cycles(hj.Recording(t, u, w, names=("travel",) * 2)).axes
    marks = [line for line in ax.lines if line.get_label() == "at travel 0"]
    remanent, coercive = [np.array(line.get_xydata()) for line in marks]
    for found, axis in ((remanent, 1), (coercive, 0)):
        wanted = np.zeros((2, 2))
        wanted[:, axis] = np.array([-1, 1]) * np.sin(0.3)
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_figures_of_loops_say_what_they_cannot_show():
    curves, far = simulated(bump, n=5), np.array([1.0, 1.1])
    with pytest.raises(InputError, match="no density is known"):
        hj.plot.forc(hj.loops.forc(curves, smoothing=2, hc=far, hu=far))
    with pytest.raises(InputError, match="two or more of `hc`"):
        hj.plot.forc(hj.loops.forc(curves, smoothing=2, hc=far[:1]))


def written(name, u, model):
    """A file of a device along an input."""
    record = hj.Recording(None, u, u)
    w = np.asarray(hj.simulate(model, record).w)
    t = 0.01 * np.arange(len(u))
    columns = {"delimiter": ",", "header": "t,stroke,force", "comments": ""}
    np.savetxt(name, np.stack([t, u, w], axis=1), **columns)
    return hj.Recording(None, u, w)


def test_amplitudes_that_grow_are_no_drift():
    s = np.arange(200) / 200
    wave = [size * np.sin(2 * np.pi * s) for size in (0.5, 1, 2)]
    device = hj.models.PrandtlIshlinskii([0.0, 0.3], [3.0, -2.8])
    written("grows.csv", np.concatenate(wave), device)
    ran = hystjax("loops", "grows.csv", *COLUMNS, "--time", "t", "--out", "grows")
    assert ran.code == 0 and "do not close" not in ran.out


def test_what_is_put_right_is_read_by_the_turns_that_count():
    corners = [2, -2, *[2, 1.5, 2, 1.5, 2, -2] * 3, 2]
    u = np.interp(np.arange(4001.0), 200 * np.arange(21), corners)
    device = hj.models.PrandtlIshlinskii([0.0, 0.4, 1.0], [1.0, 2.0, -0.5])
    record = written("inner.csv", u, device)
    told = ("--threshold", "3", "--centre", "--without-drift", "--out", "inner")
    ran = hystjax("loops", "inner.csv", *COLUMNS, *told)
    assert ran.code == 0, ran.err
    assert "do not close" not in ran.out
    found = hj.loops.reversals(record, threshold=3)
    mended = hj.loops.without_drift(record, found=found)
    expected = hj.loops.summary(hj.loops.centred(mended, found=found), found=found)
    rows = table("inner/loops.csv")
    for name in ("remanence", "coercivity"):
        got = [float(row[name]) for row in rows]
        np.testing.assert_allclose(got, expected[name], rtol=1e-6)


@pytest.mark.parametrize(("drift", "told"), [(0.09, True), (0.06, False)])
def test_a_drift_is_told_from_three_standard_errors_of_its_mean_on(drift, told):
    """Four cycles in a row drift by what the last tip is from the first one: 3 times
    0.1 / 4. Before them the input goes where it never was."""
    u = np.interp(np.arange(501), 50 * np.arange(11), [1.0, -1.0] * 5 + [1.0])
    record = hj.Recording(None, u, np.sin(3 * u) + drift * np.arange(501) / 100)
    found, numbers = hj.loops.reversals(record), hj.loops.summary(record)
    none = 0 * numbers.drift
    numbers = numbers.assign({"energy": none + 1, "drift_error": none + 0.1})
    said = _notes(numbers, found, record, False)
    assert any("do not close" in each for each in said) == told
