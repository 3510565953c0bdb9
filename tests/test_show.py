"""Results show themselves: in terminals, in notebooks, and as LaTeX."""

import pickle
import re
import traceback
from dataclasses import replace
from xml.etree import ElementTree

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy

import hystjax as hj
from hystjax._core.show import Card, Curve, Number
from hystjax._core.solution import AbstractFindings
from hystjax.recording._as_measured import Outliers
from hystjax.refinement import Bootstrap
from hystjax.regression import Stability

T = np.linspace(0.0, 6.0, 60)
U = np.sin(2 * T)
TERMS = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
NAMED = {"names": ("voltage", "displacement"), "units": ("V", "µm")}
ONCE = hj.simulation.FixedStep(1)


@pytest.fixture(scope="module")
def law():
    return hj.models.SparseModel.from_terms(TERMS, **NAMED)


@pytest.fixture(scope="module")
def record():
    w = 0.3 * np.sin(2 * T - 0.4) + 0.01 * np.cos(37 * T)
    return hj.Recording(T, U, w, **NAMED)


@pytest.fixture(scope="module")
def judgement(law, record):
    return hj.judge(law, record, method=ONCE)


def test_a_judgement_holds_its_errors_as_numbers_with_units(judgement, record):
    error = np.asarray(judgement.trajectory.w) - np.asarray(record.w)
    nrmse = 100 * np.sqrt(np.mean(error**2)) / np.ptp(record.w)
    text = str(judgement)
    assert text == repr(judgement)
    said = re.search(r"NRMSE (\S+) %", text)[1]
    assert float(said) == pytest.approx(nrmse, rel=1e-3)
    largest = re.search(r"largest error +(\S+) µm", text)[1]
    assert float(largest) == pytest.approx(np.max(np.abs(error)), rel=1e-3)


def test_a_law_shows_its_equation_and_the_units_of_its_numbers(law):
    assert str(law) == "w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|"
    lines = repr(law).split("\n")
    assert lines[0] == str(law)
    rows = [line.split() for line in lines]
    assert ["w", "displacement", "(µm)"] in rows
    assert ["u*|du|", "0.4", "µm", "V^-2"] in rows
    assert law._repr_latex_() == f"${hj.export.to_latex(law)}$"


def test_units_that_are_made_of_several_are_kept_together():
    """Read as SymPy does, which knows that powers come before products."""
    terms = dict.fromkeys(("1", "du", "u*|du|", "w*|du|", "w^2"), 1.0)
    magnetic = hj.models.SparseModel.from_terms(terms, units=("A/m", "T"))
    turned = hj.models.SparseModel.from_terms(terms, units=("T", "A/m"))
    stack = hj.models.PrandtlIshlinskii([0.1], [0.2], units=("A/m", "T"))
    (ax,) = hj.plot.densities(stack).axes
    weight = re.fullmatch(r"weight \((.*)\)", ax.get_ylabel())[1]
    flat = np.zeros((1, 1))
    curves = hj.loops.Forc(
        *(2 * [flat[0]]), flat, flat, np.stack([flat, flat]), 1.0, 0.0, {}, ("A/m", "T")
    )
    t, a, m, s = sympy.symbols("T A m s")
    of_a_field = (t / s, t * m / a, t * m**2 / a**2, m / a, 1 / (t * s))
    of_a_density = (a / m / s, a / m / t, a / m / t**2, 1 / t, m / a / s)
    for units, expected in (
        (magnetic.number_units().values(), of_a_field),
        (turned.number_units().values(), of_a_density),
        ([weight, curves.density_unit], [t * m / a, t * m**2 / a**2]),
    ):
        for unit, meant in zip(units, expected, strict=True):
            typed = unit.replace(" ", "*").replace("^", "**").replace("²", "**2")
            read = sympy.sympify(typed)
            assert sympy.simplify(read - meant) == 0
    single = hj.models.SparseModel.from_terms(
        {"1": 1.0}, target="value", units=("T", "A/m")
    )
    assert single.number_units() == {"1": "A/m"}


def test_a_success_says_so_and_how_certain_its_numbers_are(law):
    errors = {"du": jnp.array(0.0123), "w*|du|": np.float64(0.5)}
    stats = {"standard_errors": errors, "num_steps": 3, "rmse": jnp.array([0.25])}
    good = hj.Solution(law, hj.RESULTS.successful, stats)
    assert repr(good).startswith("Solution: successful\nw' = 0.25 u'")
    rows = [line.split() for line in repr(good).split("\n")]
    assert ["du", "0.25", "±", "0.012", "µm", "V^-1"] in rows
    assert ["rmse", "0.25", "µm"] in rows and ["num_steps", "3"] in rows
    assert good._repr_latex_() == law._repr_latex_()
    assert "successful" in good._repr_html_() and "± 0.012" in good._repr_html_()
    bad = hj.Solution(law, hj.RESULTS.empty_support, {})
    assert repr(bad).startswith("Solution: empty_support")


def test_errors_and_results_say_the_names_that_users_have_for_them():
    for kind in (hj.InputError, hj.ComputationError):
        assert getattr(hj, kind.__name__) is kind
        (said,) = traceback.format_exception_only(kind("too short"))
        assert said == f"hystjax.{kind.__name__}: too short\n"
        assert str(pickle.loads(pickle.dumps(kind("too short")))) == "too short"
    assert repr(hj.RESULTS.no_law).startswith("hystjax.RESULTS<No law was found")


def test_standard_errors_of_what_is_no_term_are_shown_with_the_parameters():
    duhem = hj.models.Duhem(0.4, 0.5, 0.25)
    play = hj.models.SparseModel.from_terms({"play(u,0.3)": 2.0}, target="value")
    for model, errors, expected in (
        (duhem, {"alpha": 0.1, "gamma": 0.2}, "alpha 0.4 ± 0.1|beta 0.5|gamma 0.25 ±"),
        (play, {"play(u,0.3)": 0.1, "play(u,0.3).radius": 0.2}, ".3) 2 ± 0.1|.3 ± 0.2"),
    ):
        stats = {"standard_errors": {k: jnp.array(x) for k, x in errors.items()}}
        lines = repr(hj.Solution(model, hj.RESULTS.successful, stats)).split("\n")
        shown = "|".join(" ".join(line.split()) for line in lines)
        assert all(part in shown for part in expected.split("|"))
        assert "u*|du|" not in shown and shown.count("±") == len(errors)


def test_a_batch_says_how_many_succeeded(law):
    coefficients = jnp.stack([law.coefficients, law.coefficients, law.coefficients])
    batch = eqx.tree_at(lambda tree: tree.coefficients, law, coefficients)
    good = jnp.array([True, False, True])
    result = jax.vmap(
        lambda x: hj.RESULTS.where(x, hj.RESULTS.successful, hj.RESULTS.diverged)
    )(good)
    text = repr(hj.Solution(batch, result, {}))
    assert "2 successful, 1 diverged" in text
    assert "coefficients=f64[3,3]" in repr(batch)
    assert batch._repr_html_() is None and batch._repr_latex_() is None


@pytest.mark.parametrize("what", ["law", "record"])
def test_what_is_traced_is_shown_without_numbers(what, request):
    shown = []

    @jax.jit
    def call(arrays):
        each = eqx.combine(arrays, rest)
        shown.extend([repr(each), str(each), each._repr_html_()])
        return 0

    arrays, rest = eqx.partition(request.getfixturevalue(what), eqx.is_array)
    call(arrays)
    assert "f64[" in shown[0] and "f64[" in shown[1] and shown[2] is None


def test_a_gradient_says_that_it_is_none_of_the_laws(law):
    def total(model):
        return jnp.sum(model.coefficients * jnp.array([3.0, 5.0, -7.0]))

    floats, ints = eqx.filter_grad(total)(law), jax.grad(total, allow_int=True)(law)
    for gradient in (floats, ints):
        assert "gradient" in str(gradient)
        assert "du 3, u*|du| 5, w*|du| -7" in str(gradient)
        assert repr(gradient) == str(gradient) and gradient._repr_latex_() is None


def test_models_of_every_kind_show_themselves():
    device = hj.models.Butterfly(hj.models.Duhem(0.4, 0.5, 0.25), 1.0, 0.3)
    assert repr(device).startswith(f"{device}\n")
    assert ["offset", "1", "[w]"] in [line.split() for line in repr(device).split("\n")]
    assert device._repr_latex_() is None and "y0" in device._repr_html_()


def test_thousands_of_relays_are_counted_and_not_taken_out(monkeypatch):
    levels = np.linspace(-1, 1, 201)
    relays = hj.models.Preisach(levels, np.ones(200 * 201 // 2), units=("A/m", "T"))
    relays = relays.fitted_on(hj.models.FittedRange(-1.0, 1.0))
    few = hj.models.Preisach(levels[:3], np.ones(3))

    def one_by_one(*_):
        raise AssertionError

    assert str(few).startswith("Preisach(levels[0] = -1, ")
    monkeypatch.setattr("hystjax.models._numbers._entries", one_by_one)
    said = f"Preisach({201 + 200 * 201 // 2 + 1} numbers)"
    assert str(relays) == said
    assert repr(relays) == f"{said}\n  u  input (A/m)\n  w  output (T)"
    assert said in relays._repr_html_()


def test_a_recording_tells_its_clock_and_its_ranges(record):
    text = str(record)
    assert "60 samples" in text and f"every {T[1]:.4g} s" in text
    assert f"{np.min(record.w):.4g} to {np.max(record.w):.4g} µm" in text
    far = repr(hj.Recording(T, 1000 + 0.001 * U, 2e5 + U))
    u = 1000 + 0.001 * np.array([np.min(U), np.max(U)])
    assert f"{u[0]:.7f}".rstrip("0")[:8] in far and f"{u[1]:.7f}"[:8] in far
    bare = hj.Recording(None, U, U)
    assert "no clock" in repr(bare) and "()" not in bare._repr_html_()
    for jitter, said in ((0.02, "unevenly"), (0.001, "every")):
        assert said in repr(hj.Recording(T + jitter * T[1] * (np.arange(60) % 2), U, U))


def test_a_picture_shows_the_loops_where_they_are(judgement):
    page = ElementTree.fromstring(judgement._repr_html_())
    tag = "{http://www.w3.org/2000/svg}"
    box = next(page.iter(f"{tag}rect")).attrib
    left, top, wide, high = (float(box[k]) for k in ("x", "y", "width", "height"))
    recorded, run = page.iter(f"{tag}polyline")
    seen = [tuple(map(float, p.split(","))) for p in recorded.attrib["points"].split()]
    w = np.asarray(judgement.recording.w)
    x = left + wide * (U - np.min(U)) / np.ptp(U)
    y = top + high * (np.max(w) - w) / np.ptp(w)
    np.testing.assert_allclose(seen, np.stack([x, y], 1), atol=0.051)
    assert run.attrib["stroke"] != recorded.attrib["stroke"]
    texts = [text.text for text in page.iter(f"{tag}text")]
    assert "voltage (V)" in texts and any("displacement (µm)" in t for t in texts)


def test_labels_of_a_picture_leave_its_numbers_room():
    names = 3 * "displacement of the stage ", 5 * "voltage "
    loop = hj.Recording(T, -1.23e-5 * U, 4.56e-7 * U, names=names, units=("mm", "kV"))
    page = ElementTree.fromstring(loop._repr_html_())
    box = page.find(".//{*}svg").attrib
    ends = []
    for text in page.iter("{http://www.w3.org/2000/svg}text"):
        start, wide = float(text.attrib["x"]), 5.5 * len(text.text)
        share = {"start": 0.0, "middle": 0.5, "end": 1.0}[text.attrib["text-anchor"]]
        ends.append(
            (start - share * wide, start + (1 - share) * wide, text.attrib["y"])
        )
    assert all(left >= 0 and right <= float(box["width"]) for left, right, _ in ends)
    for i, (left, right, line) in enumerate(ends):
        others = [each for each in ends[:i] if each[2] == line]
        assert all(right <= each[0] or left >= each[1] for each in others)
    assert all(name.strip() in "".join(page.itertext()) for name in names)


def test_long_wild_and_empty_loops_are_small_pictures():
    n = 200_000
    u, w = np.cos(np.arange(n) / 99), np.sin(np.arange(n) / 99)
    run = w.copy()
    run[100:200], run[200:] = 1e300, np.nan
    html = Card("x", curves=(Curve(u, w, True), Curve(u, run))).html()
    assert len(html) < 80_000 and "nan" not in html and "e+" not in html
    flat = Card("x", curves=(Curve(u[:5], 0 * u[:5], True),)).html()
    assert "nan" not in flat and flat.split('points="')[1].split('"')[0].count(",") == 5
    for lost in ((u[:5], np.nan * u[:5]), (np.nan * u[:5], u[:5])):
        assert "svg" not in Card("x", curves=(Curve(*lost),)).html()


def test_names_cannot_leave_the_page_they_are_on():
    evil = "<script>alert('1')</script>&\"x\""
    card = Card(
        evil,
        ((evil, evil),),
        (Number(evil, 1.0, evil, 2.0),),
        curves=(Curve(U, U),),
        axes=(evil, evil),
    )
    page = ElementTree.fromstring(card.html())
    assert not [e for e in page.iter() if "script" in e.tag]
    assert evil in "".join(page.itertext())


def test_an_inverse_and_a_trajectory_show_how_they_run(judgement, record):
    title, *rows = str(judgement.trajectory).split("\n")
    assert title == "Trajectory: successful"
    assert [row.split()[0] for row in rows] == ["t", *record.names]
    assert [row.split()[-1] for row in rows[1:]] == [*record.units]
    inverse = hj.Inverse(record.t, record.u, record.w, 0 * record.w)
    assert "0 to 6 s" in str(inverse) and "<svg" in inverse._repr_html_()


def test_what_follows_a_reference_shows_names_and_units(record):
    gain, t = {"u": 2.0}, np.linspace(0, 1, 9)
    bare = hj.models.SparseModel.from_terms(gain, target="value")
    named = hj.models.SparseModel.from_terms(gain, target="value", **NAMED)
    untimed = replace(record, clocked=False)
    for verb in (hj.invert, hj.control):
        for found in (verb(named, t, t), verb(bare, record), verb(bare, untimed)):
            _, time, *rows = str(found.value).split("\n")
            assert [row.split()[0] for row in rows] == ["voltage", "displacement"]
            assert [row.split()[-1] for row in rows] == ["V", "µm"]
            assert "no clock" in time or found.value.clocked
        assert not found.value.clocked


def test_what_a_verb_finds_out_is_told_in_lines(record):
    """Made up, so that what is to be shown is plain."""
    bad = Outliers(jnp.arange(60) % 4 == 3, record, jnp.zeros(60), jnp.array(0.25))
    assert str(bad).split("\n") == [
        "15 of 60 outputs are bad: off by 0.25 µm or more",
        "  rows  3, 7, 11, 15, 19, 23, 27, 31, 35, 39, ...",
    ]
    assert "<svg" in bad._repr_html_()
    shares = jnp.array([[0.2, 0.6, 1.0], [0.1, 0.9, 0.3]])
    stable = Stability(
        ("w", "u", "du"), jnp.ones(2), shares, jnp.array(2.5), jnp.array(3.0)
    )
    title, *lines = str(stable).split("\n")
    assert "selects 2.5 of 3 terms, at 2 thresholds" in title
    assert [line.split() for line in lines] == [["du", "100", "%"], ["u", "90", "%"]]
    drawn = {"a": jnp.array([1.0, 300.0, 2.0])}
    spread = Bootstrap(drawn, {"a": jnp.array(0.5)}, jnp.array([True, False, True]))
    title, line = str(spread).split("\n")
    assert title.startswith("Bootstrap of 3 fits, 1 of which failed: medians")
    assert line.split() == ["a", "1.5", "±", "0.5"]
    none = replace(spread, good=jnp.zeros(3, bool))
    assert str(none) == "Bootstrap of 3 fits, 3 of which failed"
    many = jax.tree.map(lambda x: jnp.stack([x, x]), spread)  # as Equinox shows them
    assert repr(many).startswith("Bootstrap(")


def test_what_is_always_told_is_told_where_it_is_none():
    class Found(AbstractFindings):
        value: float
        result: hj.RESULTS
        weights: list[float] | None
        more: float | None = None

    found = Found(1.0, hj.RESULTS.successful, None)
    told = found.solution()
    assert told.stats == {"weights": None} and Found.told_by(told)
    assert not Found.told_by(hj.Solution(1.0, hj.RESULTS.successful, {}))
    assert Found.of(told).weights is None and Found.of(told).more is None
    assert Found(1.0, hj.RESULTS.successful, [2.0], 3.0).stats()["more"] == 3.0


def test_exponents_of_any_size_are_shown():
    assert "|w|^1e+19" in repr(hj.models.BoucWen(1.0, 0.5, 0.2, 1e19))


def test_a_start_of_nothing_is_not_shown():
    law = hj.models.LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7)
    t = np.linspace(0, 3, 50)
    record = hj.Recording(t, np.sin(t), np.sin(t))
    begun = hj.models.Started.at_rest(law, record)
    assert str(begun) == str(law)


def test_a_run_that_is_no_number_from_its_start_is_told_as_that(judgement, recwarn):
    run = eqx.tree_at(lambda each: each.w, judgement.trajectory, jnp.nan * T)
    assert ["displacement", "no", "number"] in [x.split() for x in str(run).split("\n")]
    assert "no number" in run._repr_html_() and not recwarn.list
