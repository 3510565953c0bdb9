import dataclasses
import json
import re
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of

import hystjax as hj
from hystjax import report
from hystjax._core.solution import RESULTS
from hystjax.models import Duhem, SparseModel
from hystjax.recording._as_measured import led_in
from hystjax.simulation import FixedStep, Judgement, Trajectory

T = np.linspace(0, 6, 61)
UNITS = ("V", "µm")
LAW = SparseModel.from_terms({"u": 1.0, "w*|w|": -2.5e-17}, units=UNITS)
ALIAS = hj.Alias("du*|w|", 0.003, {"w*u": 0.5, "w*du": -2.0})


def judged(offset=0.0, law=LAW):
    """A free run of w' = u under u = sin t, which is wrong by `offset` after 3 s."""
    w = 1 - np.cos(T) + offset * (T > 3)
    record = hj.Recording(T, np.sin(T), w, units=UNITS).with_input(jnp.sin)
    return hj.judge(law, record)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report with everything: its folder, and the judgements in it."""
    folder = tmp_path_factory.mktemp("report") / "not" / "there" / "yet"
    exploding = SparseModel.from_terms({"1": 1.0, "w^2": 9.0}, units=UNITS)
    judgements = {
        "fitted": judged(),
        "unseen": judged(0.1),
        "wild": judged(law=exploding),
    }
    settings = {"file": "a_b.csv", "threshold": "0.01"}
    path = report.write(folder, LAW, judgements, aliases=[ALIAS], settings=settings)
    assert path == folder / "report.md"
    return folder, judgements


def markdown_tables(text):
    """Rows of cells of each table, as GitHub reads them: a \\| does not end a cell."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in block.splitlines()]
        head, rule, *body = [
            [cell.strip().replace(r"\|", "|") for cell in row] for row in rows
        ]
        assert rule == ["---"] * len(head)
        assert {len(row) for row in body} == {len(head)}
        yield [dict(zip(head, row, strict=True)) for row in body]


def test_what_refine_returned_tells_how_certain_it_is(tmp_path):
    t = 0.1 * np.arange(200)
    noise = 0.01 * np.random.default_rng(0).normal(size=len(t))
    record = hj.Recording(t, np.sin(t), 1 - np.cos(t) + noise)
    fit = hj.refine(SparseModel.from_terms({"u": 1.1, "w": -0.01}), record)
    judgements = {"fitted": hj.judge(fit, record)}
    page = report.write(tmp_path, fit, judgements).read_text()
    assert "## Certainty" in page
    error = float(fit.stats["standard_errors"]["u"])
    assert f"| `u` | {float(fit.value.parameters()['u']):.6g} | {error:.2g} |" in page


def test_folder_holds_what_it_says_and_nothing_else(written):
    folder, judgements = written
    names = {path.name for path in folder.iterdir()}
    pictures = {f"{name}.png" for name in ("overview", *judgements)}
    assert names == {"report.md", "metrics.json", "law.json", *pictures}
    text = (folder / "report.md").read_text()
    shown = re.findall(r"!\[(.*)\]\((.*)\)", text)
    assert [name for _, name in shown] == ["overview.png"] + [
        f"{name}.png" for name in judgements
    ]
    for picture in pictures:
        assert (folder / picture).read_bytes().startswith(b"\x89PNG")


def test_law_file_and_coefficients_are_the_law(written):
    folder, _ = written
    assert hj.load(folder / "law.json").terms() == LAW.terms()
    coefficients, _ = markdown_tables((folder / "report.md").read_text())
    found = {row["term"].strip("`"): float(row["value"]) for row in coefficients}
    assert found == LAW.terms()
    assert [row["unit"] for row in coefficients] == ["µm V^-1 s^-1", "µm^-1 s^-1"]


def test_numbers_agree_with_the_judgements(written):
    folder, judgements = written
    metrics = json.loads(
        (folder / "metrics.json").read_text(), parse_constant=pytest.fail
    )
    assert metrics["terms"] == LAW.terms()
    assert metrics["settings"] == {"file": "a_b.csv", "threshold": "0.01"}
    for name, judgement in judgements.items():
        for error, value in judgement.errors.items():
            expected = float(value) if np.isfinite(value) else None
            assert metrics["errors"][name][error] == expected
    fitted, unseen, wild = list(markdown_tables((folder / "report.md").read_text()))[1]
    assert fitted["largest error"].endswith(" µm")
    wrong = 0.1 * np.sqrt(np.mean(T > 3))  # root mean square of the offset
    w = 1 - np.cos(T) + 0.1 * (T > 3)
    expected = 100 * wrong / np.sqrt(np.mean(w**2))
    assert float(unseen["relative error"].removesuffix(" %")) == pytest.approx(
        expected, rel=1e-3
    )
    assert float(unseen["squared error"].removesuffix(" %")) == pytest.approx(
        expected**2 / 100, rel=1e-3
    )
    assert unseen["largest error"] == "0.1 µm"
    assert (wild["NRMSE"], wild["relative error"], wild["R²"]) == ("diverged", "", "")


def test_settings_are_written_as_text(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "_figures", lambda *_: [])
    path = report.write(tmp_path, LAW, {"fitted": judged()}, settings={"degree": 2})
    assert "- degree: 2\n" in path.read_text()
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["settings"] == {"degree": "2"}


def test_names_of_rows_are_shown_as_they_are(tmp_path, monkeypatch):
    monkeypatch.setattr(
        report, "_figures", lambda place, given, _: [*map(place.joinpath, given)]
    )
    t = np.linspace(0.0, 20.0, 200)
    record = hj.Recording(t, np.sin(t), np.sin(t - 0.3), units=("V", "N*m"))
    run = Trajectory(record.t, record.u, record.w, RESULTS.successful, {})
    judgements = {"<x>|*y*": Judgement(record, run, judged().errors)}
    text = report.write(tmp_path, LAW, judgements).read_text()
    assert "\n## Loops, &lt;x>|\\*y\\*\n" in text
    assert "![&lt;x>|\\*y\\*](%3Cx%3E%7C%2Ay%2A" in text
    assert "\n| &lt;x>\\|\\*y\\* |" in text  # in a table a bar would end the cell
    assert "\n| remanence (N\\*m) |" in text
    assert "<x>" not in text and "*y*" not in text


def test_text_for_people(written):
    text = (written[0] / "report.md").read_text()
    assert str(LAW) in text and f"$${hj.export.to_latex(LAW)}$$" in text
    assert "\n\nThe law is nonlinear and depends on the rate" in text
    assert r"- du\*|w| cannot be told from a mix of w\*u and w\*du (0.3 %" in text
    assert "- file: a_b.csv\n- threshold: 0.01\n" in text


def test_small_report_of_a_classical_model_replaces_the_old_one(tmp_path):
    law = Duhem(0.4, 0.5, 0.25)
    (tmp_path / "report.md").write_text("old")
    (tmp_path / "mine.txt").write_text("kept")
    path = report.write(tmp_path, law, {"all rows": judged(law=law)})
    coefficients, errors = markdown_tables(path.read_text())
    found = {row["term"].strip("`"): float(row["value"]) for row in coefficients}
    assert found == {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
    assert [row["rows"] for row in errors] == ["all rows"]
    assert "cannot tell apart" not in path.read_text()
    assert path.read_text().startswith("# A law of hysteresis\n")
    assert "\n\nThe law is rate independent: " in path.read_text()
    assert (tmp_path / "mine.txt").read_text() == "kept"
    assert "![all rows](all%20rows.png)" in path.read_text()  # a link ends at a blank
    assert "## Settings" not in path.read_text()


def test_a_fitted_classical_model_has_its_parameters_with_their_errors():
    stats = {"standard_errors": {"alpha": 0.125, "beta": 0.25, "gamma": 0.5}}
    law = Duhem(0.4, 0.5, 0.25)
    solution = hj.Solution(law, hj.RESULTS.successful, stats)
    (rows,) = markdown_tables(report._coefficients(law, solution) + "\n")
    found = {row["term"].strip("`"): list(row.values())[1:3] for row in rows}
    assert found == {
        "alpha": ["0.4", "0.12"],
        "beta": ["0.5", "0.25"],
        "gamma": ["0.25", "0.5"],
    }


def test_terms_that_are_equal_on_every_record_are_no_ambiguity():
    """At u = -2 and du = -3 the odd ones differ, and the even ones do not."""
    pairs = [("|du|^2", "du^2"), ("u^3", "u*|u|^2"), ("|du|", "du"), ("u*|u|", "u^2")]
    at = {"u": -2.0, "du": -3.0, "abs": abs}
    for term, other in pairs:
        values = [
            eval(re.sub(r"\|(\w+)\|", r"abs(\1)", name).replace("^", "**"), at)
            for name in (term, other)
        ]
        text = report._ambiguities([hj.Alias(term, 0.0, {other: 1.0})], ())
        assert bool(text) == (values[0] != values[1])


def test_laws_are_listed_by_what_decided():
    """Criteria over that of the chosen law, or errors on blocks, where some were not
    worth the blocks."""
    laws = [
        hj.search.Trial({"u": 1.0}, rmse=0.5, criterion=-10.0),
        hj.search.Trial({"u": 1.0, "w": 2.0}, rmse=0.25, criterion=-7.5),
    ]
    head, *rows = report._trial_table(laws, laws[0])
    assert head[2] == "criterion over the chosen law's"
    assert rows == [["`u`", "0.5", "+0.0"], ["`u`, `w`", "0.25", "+2.5"]]
    blocks = dataclasses.replace(laws[0], blocks=(1.0, 3.0))
    head, *rows = report._trial_table([blocks, laws[1]], blocks)
    assert head[2] == "on blocks left out"
    assert [row[2] for row in rows] == ["2", "far off"]


@pytest.mark.slow
def test_figures_of_an_earlier_report_go(tmp_path):
    (tmp_path / "inclusion.png").write_text("somebody's")
    first = {"fitted": judged(), "unseen": judged(0.1)}
    report.write(tmp_path, LAW, {"fitted": judged()})
    assert (tmp_path / "inclusion.png").read_text() == "somebody's"
    report.write(tmp_path, LAW, first, inclusion={"u": 1.0})
    assert (tmp_path / "inclusion.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "frontier.png").write_text("of an earlier one")
    (tmp_path / "holiday.png").write_text("mine")
    text = report.write(tmp_path, LAW, {"fitted": judged()}).read_text()
    shown = {name for _, name in re.findall(r"!\[(.*)\]\((.*)\)", text)}
    assert shown == {"overview.png", "fitted.png"}
    pictures = {path.name for path in tmp_path.glob("*.png")}
    assert pictures == {*shown, "holiday.png"}


@pytest.mark.parametrize(
    "judgements, settings",
    [({"m\udce4": None}, {}), ({}, {"file": "m\udce4"}), ({}, {"m\udce4": "file"})],
)
def test_text_that_is_not_utf8_is_refused_before_a_file_is_written(
    tmp_path, judgements, settings
):
    judgements = {name: judged() for name in judgements} or {"fitted": judged()}
    with pytest.raises(hj.InputError, match=r"'m\\udce4' of .* is not UTF-8"):
        report.write(tmp_path / "new", LAW, judgements, settings=settings)
    assert not (tmp_path / "new").exists()


def test_figures_whose_names_differ_in_capitals_alone_are_refused(tmp_path):
    """Of two files where capitals count, only one is left where they do not."""
    judgements = dict.fromkeys(("A", "b", "a"), judged())
    with pytest.raises(hj.InputError, match="the rows 'A' and 'a', whose figures"):
        report.write(tmp_path / "new", LAW, judgements)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ({"w": -1.0, "u": 1.0}, "The law is linear: its lag depends on the rate"),
        ({"du": 1.0}, "The law has no memory: "),
    ],
)
def test_a_law_without_hysteresis_is_called_so(tmp_path, terms, said):
    law = SparseModel.from_terms(terms)
    text = report.write(tmp_path, law, {"all rows": judged(law=law)}).read_text()
    assert text.startswith("# A law without hysteresis\n") and f"\n\n{said}" in text


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_folder_that_cannot_be_made(tmp_path, place):
    (tmp_path / "file").write_text("")
    with pytest.raises(hj.InputError, match=r"file.* cannot be made .*choose another"):
        report.write(tmp_path / place, LAW, {"fitted": judged()})
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_search_that_found_no_law_is_not_reported(tmp_path):
    stats = {"why": "No law does."}
    nothing = hj.Solution(LAW, hj.RESULTS.no_law, stats)
    place = tmp_path / "new"
    with pytest.raises(hj.InputError, match=r"No law does\. Leave it out"):
        report.write(place, LAW, {"fitted": judged()}, discovered=nothing)
    assert not place.exists()


def test_dollars_of_names_and_units_set_no_mathematics(tmp_path):
    units = ("US$", "k$")
    record = hj.Recording(T, np.sin(T), 1 - np.cos(T), units=units)
    law = SparseModel.from_terms({"u": 1.0}, units=units)
    judgements = {"in $": hj.judge(law, record)}
    page = report.write(tmp_path, law, judgements, settings={"input": "a $x$"})
    text = page.read_text(encoding="utf-8")
    assert r"| k\$ US\$^-1 s^-1 |" in text and r"- input: a \$x\$" in text
    (shown,) = re.findall(r"^\$\$.*\$\$$", text, flags=re.MULTILINE)
    assert not re.search(r"(?<!\\)\$", text.replace(shown, ""))


def test_plain_table_lines_up():
    table = [["rows", "NRMSE"], ["fitted", "0.2 %"], ["x", ""]]
    assert report.plain_table(table) == "rows    NRMSE\nfitted  0.2 %\nx"


def test_report_says_where_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = report.write("here", LAW, {"fitted": judged()})
    assert path == Path("here/report.md") and path.is_file()


def test_numbers_of_loops_are_set_beside_the_laws(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "_figures", lambda *_: [])
    u = np.sin(np.linspace(0, 6 * np.pi, 601))
    truth, law = (
        hj.models.PrandtlIshlinskii([0.0, 0.5], [1.0, weight]) for weight in (0.5, 0.6)
    )
    record = hj.Recording(None, u, hj.simulate(truth, hj.Recording(None, u, u)).w)
    report.write(tmp_path, law, {"fitted": hj.judge(law, record)})
    text = (tmp_path / "report.md").read_text()
    assert "## Loops, fitted" in text
    rows = next(
        {row["mean over cycles"]: row["law"] for row in table}
        for table in markdown_tables(text)
        if "mean over cycles" in table[0]
    )
    assert "made of all" not in text
    judged = hj.judge(law, record, weights=np.arange(601) > 100)
    report.write(tmp_path, law, {"fitted": judged})
    text = (tmp_path / "report.md").read_text()
    assert "samples have no weight" in text and "mean over cycles" not in text
    # A play of 0.6 in place of 0.5 loses a fifth more.
    assert re.search(r"\(\+20 %\)$", rows["energy"])
    assert rows["amplitude"].endswith("(+0 %)")


def test_what_has_no_weight_is_in_no_figure(tmp_path, monkeypatch):
    """Where a sensor failed, straight lines stand in for what nobody measured."""
    drawn = {}
    monkeypatch.setattr(
        report.plot, "save", lambda figure, path: drawn.update({path.stem: figure})
    )
    u = np.sin(np.linspace(0, 6 * np.pi, 601))
    law = hj.models.PrandtlIshlinskii([0.0, 0.5], [1.0, 0.5])
    w = np.array(hj.simulate(law, hj.Recording(None, u, u)).w)
    w[300:400] = 0.0
    weights = np.ones(601)
    weights[300:400] = 0.0
    judged = hj.judge(law, hj.Recording(None, u, w), weights=weights)
    assert judged.errors["nrmse"] < 1e-12
    report.write(tmp_path, law, {"fitted": judged})
    top, bottom = drawn["fitted"].axes
    assert re.fullmatch(r"NRMSE [\d.e-]+ %", top.get_title(loc="right"))
    assert float(top.get_title(loc="right").split()[1]) < 1e-10
    assert np.all(np.isnan(top.lines[0].get_ydata()) == (weights == 0))
    assert np.nanmax(np.abs(bottom.lines[0].get_ydata())) < 1e-12
    loop, *panels = drawn["overview"].axes
    assert np.isnan(loop.lines[0].get_ydata()).sum() == 100
    assert panels[0].get_title() == f"fitted: {top.get_title(loc='right')}"


@pytest.mark.parametrize("how", ["as it is", "periodic", "after a lead-in"])
def test_the_law_before_is_judged_as_the_one_after(how, tmp_path, monkeypatch):
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    record = hj.Recording(t, np.sin(t), np.cos(t))
    before, after = (
        SparseModel.from_terms({"w": -rate, "u": 1.0}) for rate in (1.0, 1.3)
    )
    options = {"periodic": {"periodic": True}, "after a lead-in": {"lead_in": 50}}
    options = options.get(how, {})
    if how == "after a lead-in":
        options["weights"] = np.linspace(0, 1, 200)
    runs = []
    monkeypatch.setattr(report, "_figures", lambda *_: [])
    monkeypatch.setattr(report, "_saved", lambda path, figure: path)
    monkeypatch.setattr(
        report.plot, "refinement", lambda _, *given, **__: runs.extend(given[:2])
    )
    judged = hj.judge(after, record, method=FixedStep(1), **options)
    left = judged.trajectory.w - judged.recording.w
    left = jnp.pad(left, (200 - len(left), 0))[None]
    begun = {"periodic": judged.trajectory.w[0]}.get(how, record.w[0])[None]
    lengths = np.array([200])
    fit = fit_of(after, residuals=left, lengths=lengths, w0=begun).solution()
    report.write(tmp_path, after, {"fitted": judged}, refined=(before, fit))
    alike = hj.judge(before, record, **options)
    np.testing.assert_array_equal(runs[0].w, alike.trajectory.w)
    assert runs[1] is judged.trajectory
    again = judged.alike(before)
    np.testing.assert_allclose(again.errors["rmse"], alike.errors["rmse"], rtol=1e-12)
    said = {
        "as it is": "From the first sample's output alone; ratios",
        "periodic": "In the steady state that the law comes to; ratios",
        "after a lead-in": "From the first sample's output alone, after 50 samples",
    }
    assert said[how] in (tmp_path / "report.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("lead_in", [None, 200])
def test_a_hidden_force_is_drawn_along_the_run_that_was_judged(
    tmp_path, monkeypatch, lead_in
):
    drawn = []

    def hidden(recording, *found, **options):
        drawn.append(plot_hidden(recording, *found, **options))
        return drawn[-1]

    plot_hidden = report.plot.hidden
    monkeypatch.setattr(report.plot, "hidden", hidden)
    monkeypatch.setattr(report, "_figures", lambda *_: [])
    monkeypatch.setattr(report, "_refinement_figures", lambda *_: [])
    spring = SparseModel.from_terms({"du": 3.0, "w*|du|": -4.0})
    model = hj.models.Oscillator(1.0, 2.0, 2.0, spring)
    t = 0.1 * np.arange(300)
    path = hj.excitation.Sine(2.0, 0.2).path(jnp.asarray(t))
    clean = hj.simulate(model, path, w0=0.0).w
    noisy = clean + 0.01 * np.random.default_rng(0).normal(size=len(t))
    noisy = noisy.at[0].add(0.1)  # from where a mass would ring
    record = hj.Recording(
        t, path.samples()[0], noisy, interpolation=hj.interpolation.Cubic()
    )
    fixed = ["mass", "damping", "w*|du|"]
    fit = hj.refine(model, record, fixed=fixed, lead_in=lead_in)
    first = fit.stats["w0"] if lead_in is None else None
    judgement = hj.judge(fit, record, w0=first, lead_in=lead_in)
    path = report.write(tmp_path, fit, {"fitted": judgement}, refined=(model, fit))
    assert "![hidden](hidden.png)" in path.read_text()
    assert (tmp_path / "hidden.png").read_bytes().startswith(b"\x89PNG")
    ((time, loop, _),) = (figure.axes for figure in drawn)
    position = loop.lines[0].get_xdata()
    # By fixed steps, and by as many as it takes.
    np.testing.assert_allclose(position, judgement.trajectory.w, atol=1e-3)
    assert len(time.lines[0].get_xdata()) == 300 - (lead_in or 0)
    # Whoever takes away what was before the rows has no picture of them.
    rows = judgement.recording.afresh()
    bare = eqx.tree_at(lambda each: each.recording, judgement, rows)
    path = report.write(tmp_path, fit, {"fitted": bare}, refined=(model, fit))
    assert ("hidden.png" in path.read_text()) == (lead_in is None)
    assert (tmp_path / "hidden.png").is_file() == (lead_in is None)


def test_figures_are_of_the_rows_that_they_name(tmp_path, monkeypatch):
    """Whichever comes first, and whatever their lengths."""
    figures = {}
    monkeypatch.setattr(report.plot, "save", lambda f, path: figures.update({path: f}))
    law = SparseModel.from_terms({"w*|du|": -0.5, "du": 0.8, "u*|du|": 0.3})

    def record(n, speed, seed):
        t = np.linspace(0, 12, n)
        clean = hj.Recording(t, np.sin(speed * t) * (1 - t / 24), 0 * t)
        noise = 0.01 * np.random.default_rng(seed).normal(size=n)
        return hj.Recording(t, clean.u, hj.simulate(law, clean, w0=0.0).w + noise)

    one, other, alike = record(401, 2.0, 0), record(151, 3.0, 1), record(401, 2.0, 2)
    fit = hj.refine(law, one, substeps=1)
    runs = {
        "unseen": hj.judge(fit, other),
        "fitted": hj.judge(fit, one),
        "repeated": hj.judge(fit, alike),
    }
    report.write(tmp_path, fit, runs, refined=(law, fit))
    titles = [ax.get_title() for ax in figures[tmp_path / "overview.png"].axes]
    assert titles[0] == "loop, fitted"
    assert [title.split(":")[0] for title in titles[1:3]] == ["unseen", "fitted"]
    panels = figures[tmp_path / "refinement.png"].axes
    (band,) = (ax for ax in panels if ax.get_label() == "band")
    np.testing.assert_array_equal(band.lines[0].get_ydata(), fit.stats["residuals"][0])
    errors = next(ax for ax in panels if ax.get_label() == "errors").lines[1]
    missed = runs["fitted"].trajectory.w - one.w
    np.testing.assert_allclose(errors.get_ydata(), missed, atol=1e-12)
    # Records that were not refined on have none, though one is the same run again.
    figures.clear()
    others = {name: runs[name] for name in ("unseen", "repeated")}
    text = report.write(tmp_path, fit, others, refined=(law, fit)).read_text()
    assert "refinement.png" not in text
    assert tmp_path / "refinement.png" not in figures


@pytest.mark.slow
def test_a_hidden_law_is_shown_in_its_steady_state(tmp_path):
    """The period that was fitted is the past, which nobody had to give."""
    model = hj.models.BoucWenOscillator(1.0, 0.8, 2.0, 3.0, 2.0, -1.5)
    t = 0.1 * np.arange(640)
    u = 2 * np.sin(2 * np.pi * t / 6.4) + np.cos(2 * np.pi * t / 12.8)
    w = hj.simulate(model, hj.Recording(t, u, 0 * u)).w
    record = hj.Recording(t[:128], u[-128:], w[-128:])
    fixed = [name for name in model.parameters() if name != "mass"]
    fit = hj.refine(model, record, periodic=True, fixed=fixed, substeps=1)
    run = hj.judge(fit, record, periodic=True)
    report.write(tmp_path, fit, {"fitted": run})
    assert (tmp_path / "hidden.png").is_file()


@pytest.mark.parametrize("how", [{}, {"lead_in": 20}, {"periodic": True}])
def test_a_fit_knows_its_recording_from_another_along_the_same_drive(how):
    """Though the law lacks much, and the first output is a bad one to begin with."""
    t, rng = np.linspace(0, 2 * np.pi, 60, endpoint=False), np.random.default_rng(0)
    law = SparseModel.from_terms({"w": -1.0, "u": 1.0})
    once = FixedStep(1)

    def record():
        w = 1 - np.cos(t) + 0.5 * np.sin(5 * t) + 0.05 * rng.normal(size=60)
        return hj.Recording(t, np.sin(t), w + 2.0 * (t == 0))

    own, other = record(), record()
    rows, weights = led_in(own, None, **({"lead_in": 0, "periodic": False} | how))
    if how.get("periodic"):
        rows, weights = led_in(own, None, 45, periodic=True)
    run = hj.simulate(law, rows, w0=0.1, method=once).w
    fit = fit_of(
        law,
        residuals=jnp.where(weights > 0, run - rows.w, 0.0)[None],
        lengths=np.array([len(rows)]),
        w0=jnp.array([0.1]),
    ).solution()
    for options in ({}, {"lead_in": 30}, {"periodic": True}):
        runs = [hj.judge(law, each, method=once, **options) for each in (other, own)]
        judgements = dict(zip(("other", "own"), runs, strict=True))
        assert report._refined_on(judgements, fit) is runs[1]
        assert report._refined_on({"other": runs[0]}, fit) is None
