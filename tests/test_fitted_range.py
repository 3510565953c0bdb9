"""A law knows how far the inputs went that it was fitted on, and says where another
leaves that."""

import re
import warnings
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.cli import main
from hystjax.comparison import Compared, Comparison
from hystjax.models import (
    Behind,
    Butterfly,
    FittedRange,
    Instrumented,
    SparseModel,
    Started,
)
from hystjax.saving import difference
from hystjax.simulation import FixedStep

T = np.linspace(0.0, 4.0, 201)
U = 3 * np.sin(2 * np.pi * T) * np.exp(-0.1 * T)
TERMS = {"du": 0.5, "u*|du|": 0.3, "w*|du|": -0.4}
UNITS = {"units": ("V", "µm")}
METHOD = FixedStep(2)


REC = hj.Recording(T, U, np.cos(T), **UNITS)
KNOWN = FittedRange.of([REC])
# The one depends on the rate, the other does not.
RATE = SparseModel.from_terms(TERMS | {"w": -0.1}, **UNITS).fitted_on(KNOWN)
ANY_RATE = SparseModel.from_terms(TERMS, **UNITS).fitted_on(KNOWN)


def run(model, u, t=T):
    rec = hj.Recording(t, u, np.zeros(len(u)), **UNITS)
    return hj.simulate(model, rec, method=METHOD, throw=False)


def test_a_law_keeps_the_range_of_its_record_in_files_and_exports(tmp_path):
    speeds = np.abs(np.diff(U) / np.diff(T))
    assert (KNOWN.low, KNOWN.high) == (U.min(), U.max())
    assert str(KNOWN) == f"inputs from {KNOWN.in_words('')}"
    np.testing.assert_allclose(KNOWN.fastest, speeds.max(), rtol=1e-12)
    wider = hj.Recording(T, 2 * U + 1, REC.w, **UNITS)
    both = FittedRange.of([REC, wider])
    assert (both.low, both.high) == (2 * U.min() + 1, 2 * U.max() + 1)
    np.testing.assert_allclose(both.fastest, 2 * speeds.max(), rtol=1e-12)
    assert SparseModel.from_terms(TERMS).fitted_range is None
    hj.save(tmp_path / "law.json", ANY_RATE)
    back = hj.load(tmp_path / "law.json")
    assert eqx.tree_equal(
        (back.fitted_range, back.compact().fitted_range), 2 * (KNOWN,)
    )
    told = f"{U.min():.4g} V to {U.max():.4g} V, up to {speeds.max():.4g} V per s"
    assert f"Fitted range of u: {told}." in hj.export.to_numpy(ANY_RATE)


@pytest.mark.parametrize(
    "around",
    [lambda law: Started.at_rest(law, REC), Butterfly],
    ids=["started", "butterfly"],
)
def test_what_is_around_a_law_and_sees_its_input_keeps_the_range(around):
    law = SparseModel.from_terms({"u": 0.5, "play(u,0.5)": 0.3}, target="value")
    model = around(law.fitted_on(KNOWN))
    assert eqx.tree_equal(model.fitted_range, KNOWN)
    assert model.fitted_on(None).fitted_range is None
    with pytest.warns(UserWarning, match="leaves what this law was fitted on"):
        hj.simulate(model, hj.Recording(T, 2 * U, U))


@pytest.mark.parametrize(
    "around",
    [
        lambda law: Instrumented(law, input_gain=0.5, output_offset=0.1, **UNITS),
        lambda law: Behind(law, "play(u,0.2)", **UNITS),
        lambda law: Started.at_rest(Behind(law, "play(u,0.2)", **UNITS), REC),
    ],
    ids=["instrumented", "behind", "started behind"],
)
def test_what_drives_a_law_by_a_signal_keeps_the_range_of_the_input(around, tmp_path):
    law = SparseModel.from_terms({"u": 0.5, "u^3": 0.01}, target="value", **UNITS)
    inside = law.fitted_on(FittedRange(-9.0, 9.0))  # of the signal, once
    rec = hj.Recording(T, U, hj.simulate(around(law), REC).w, **UNITS)
    model = around(inside)
    around_it = re.compile("gain|radius|state")
    fixed = [name for name in model.parameters() if around_it.search(name)]
    fit = hj.refine(model, rec, fixed=fixed).value
    assert eqx.tree_equal(fit.fitted_range, KNOWN)
    hj.save(tmp_path / "law.json", fit)
    assert eqx.tree_equal(hj.load(tmp_path / "law.json").fitted_range, KNOWN)
    with pytest.warns(UserWarning, match="leaves what this law was fitted on"):
        hj.simulate(fit, hj.Recording(T, 2 * U, U, **UNITS))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hj.simulate(fit, rec)


FOUND = Compared("law", ANY_RATE, (0.01, 0.01), 0.01, 1.0, 3, 1.0, "")
PERIOD = np.linspace(0, 2 * np.pi, 60)  # whose last row is the first again


def in_single_precision():
    with jax.enable_x64(False):
        t = np.linspace(0, 1, 20_001)
        hj.aliases(hj.Recording(t, np.sin(t), np.cos(t)), hj.library.Polynomial(1))


@pytest.mark.parametrize(
    "call",
    [
        lambda: run(ANY_RATE, 2 * U),
        lambda: hj.generate(ANY_RATE, hj.excitation.Sine(9.0, 1.0), T, method=METHOD),
        lambda: hj.plot.comparison(
            Comparison((FOUND,), {}, 0.01), hj.Recording(T, 2 * U, U, **UNITS)
        ),
        lambda: hj.Recording(
            PERIOD,
            np.sin(PERIOD),
            np.cos(PERIOD),
            interpolation=hj.interpolation.BandLimited(),
        ),
        in_single_precision,
    ],
    ids=["simulate", "generate", "plot", "constructor", "aliases"],
)
def test_warnings_show_the_line_that_calls(call):
    with pytest.warns(UserWarning) as warned:
        call()
    # Libraries may say to their own developers that something is deprecated.
    ours = {each.filename for each in warned if each.category is UserWarning}
    assert ours == {__file__}


class OwnLaw(hj.models.AbstractModel):
    """A law of one's own around another, whose constructor takes no range."""

    law: SparseModel
    gain: jax.Array

    def __init__(self, law, gain=2.0):
        self.law, self.gain = law, jnp.asarray(gain)

    def rate(self, x, m, now):
        return self.law.rate(x, m, now)

    def start(self, m, now, seen):
        return seen / self.gain

    def output(self, x, m, now):
        return self.gain * x


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        hj.models.Dahl(1.0, 2.0, **UNITS),
        hj.models.BoucWenForce(0.5, 1.5, 0.3, 0.8, 1.4, **UNITS),
        hj.models.PrandtlIshlinskii([0.0, 0.5], [0.5, 0.3], **UNITS),
        hj.models.Preisach([-2.5, 0.1, 2.5], [0.3, 0.2, 0.4], **UNITS),
        Instrumented(hj.models.PrandtlIshlinskii([0.0, 0.5], [0.5, 0.3]), **UNITS),
        OwnLaw(ANY_RATE),
    ],
    ids=["Dahl", "Bouc-Wen", "plays", "relays", "instrumented", "own"],
)
def test_any_model_keeps_the_range_that_it_was_fitted_on(model, tmp_path):
    names = model.parameters().keys()
    rec = hj.Recording(T, U, hj.simulate(model, REC, throw=False).w, **UNITS)
    fixed = [name for name in names if re.search("gain|radii|levels", name)]
    few = {"max_steps": 2, "substeps": 1, "throw": False}
    fit = hj.refine(model, rec, fixed=fixed, **few).value
    assert eqx.tree_equal(fit.fitted_range, KNOWN)
    assert (fit.names, fit.units) == (REC.names, REC.units)
    assert fit.fitted_on(None).fitted_range is None
    assert fit.parameters().keys() == names  # none of what it was fitted on
    hj.save(tmp_path / "model.json", fit)
    for same in (
        hj.load(tmp_path / "model.json"),
        fit.with_parameters(fit.parameters()),
    ):
        assert difference(same, fit) is None
    with pytest.warns(UserWarning, match="leaves what this law was fitted on"):
        hj.simulate(fit, hj.Recording(T, 2 * U, U, **UNITS), throw=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hj.simulate(fit, rec)


def test_a_fit_keeps_names_and_units_of_its_own():
    named = {"names": ("field", "flux"), "units": ("A/m", "T")}
    model = SparseModel.from_terms({"u": 0.5, "u^3": 0.01}, target="value", **named)
    w = hj.simulate(model, hj.Recording(T, U, U, **named)).w
    for names, units in ((("H", "B"), ("A/m", "T")), (("H", "B"), ("", ""))):
        rec = hj.Recording(T, U, w, names=names, units=units)
        fit = hj.refine(model, rec).value
        assert (fit.names, fit.units) == (named["names"], named["units"])


@pytest.mark.parametrize("what", ["PrandtlIshlinskii", "Preisach", "Everett"])
def test_a_guess_by_least_squares_is_a_fit(what):
    rec = hj.Recording(T, U, np.sin(U) + 0.1 * np.sign(np.cos(2 * np.pi * T)), **UNITS)
    assert eqx.tree_equal(getattr(hj.models, what).guess(rec).fitted_range, KNOWN)


def test_a_fit_of_where_a_law_starts_keeps_range_and_units():
    law = SparseModel.from_terms(
        {"u": 0.5, "play(u,0.5)": 0.3}, target="value", **UNITS
    )
    rec = hj.Recording(T, U, hj.simulate(law, REC).w, **UNITS)
    fit = hj.refine(Started.at_rest(law, rec), rec, fixed=["play(u,0.5).radius"])
    assert eqx.tree_equal(fit.value.fitted_range, KNOWN)
    units = {each.name: each.unit for each in fit.value.listed()}
    assert units["u"] == "µm V^-1"


def test_without_a_clock_there_is_no_rate():
    known = FittedRange.of([hj.Recording(None, U, U)])
    assert known.fastest is None
    assert float(known.left_by(T, 1e3 * U, False).rate) == 0
    assert FittedRange.of([REC, hj.Recording(None, U, U)]).fastest is None


def test_any_way_of_an_input_that_stood_still_is_beyond():
    known = FittedRange.of([hj.Recording(T, np.full_like(U, 2.0), T)])
    beyond = known.left_by(T, U, False)
    assert float(beyond.input) == pytest.approx(np.max(np.abs(U - 2.0)))
    assert 0 < beyond.rate < np.inf and beyond.since == T[0]


def test_the_sample_that_a_fast_change_begins_at_is_told():
    u = np.where(T < 2.0, U, 4 * U - 3 * np.interp(2.0, T, U))
    speeds = np.abs(np.diff(u) / np.diff(T))
    first = np.flatnonzero(speeds > 1.25 * float(KNOWN.fastest))[0]
    wide = FittedRange(low=-20.0, high=20.0, fastest=KNOWN.fastest)
    beyond = wide.left_by(T, u, False)
    assert beyond.since == T[first]
    said = beyond.in_words(wide, "V")
    assert f"{speeds.max() / float(KNOWN.fastest):.3g} times as fast" in said
    assert "outside" not in said
    slow = wide.left_by(T, 1.2 * U + 30.0, False)  # as noise on an input does
    assert slow.rate > 0.1 and "times as fast" not in slow.in_words(wide, "V")


@pytest.mark.parametrize(("apart", "told"), [(0.02, True), (0.005, False)])
def test_laws_that_part_elsewhere_are_told_where_they_do(apart, told):
    known = FittedRange(KNOWN.low, KNOWN.high, KNOWN.fastest, apart)
    said = known.left_by(T, 3 * U, False).in_words(known, "V")
    assert ("differ by some 2 % of the output's range" in said) == told


@pytest.mark.slow
def test_without_a_clock_a_run_is_told_by_the_sample():
    rec = hj.Recording(None, U, U, **UNITS)
    gone = int(
        np.argmax(np.maximum(2 * U - U.max(), U.min() - 2 * U) > 0.05 * np.ptp(U))
    )
    with pytest.warns(UserWarning, match=f"from sample {gone} on the input leaves"):
        far = hj.simulate(
            ANY_RATE.fitted_on(FittedRange.of([rec])), hj.Recording(None, 2 * U, U)
        )
    assert "no clock" in str(far) and far.units == UNITS["units"]
    law = SparseModel.from_terms({"w*|du|": 900.0, "du": 1.0})
    with pytest.raises(hj.ComputationError, match=r"It was lost at row \d+"):
        hj.simulate(law, rec)


@pytest.mark.parametrize("stretch, shift", [(1.0, 0.0), (1.6, 0.0), (1.0, -4.0)])
def test_an_input_outside_is_measured_and_told(stretch, shift):
    u = stretch * U + shift
    out = np.maximum(np.maximum(u - U.max(), U.min() - u), 0) / np.ptp(U)
    speeds = np.abs(np.diff(u) / np.diff(T))
    fast = np.append(speeds, speeds[-1]) / np.max(np.abs(np.diff(U) / np.diff(T)))
    gone = np.flatnonzero((out > 0.05) | (fast > 1.25))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        beyond = run(RATE, u).stats["beyond"]
    np.testing.assert_allclose(beyond.input, out.max(), rtol=1e-12)
    np.testing.assert_allclose(beyond.rate, stretch - 1, atol=1e-12)
    assert beyond.since == (T[gone[0]] if gone.size else np.inf)
    if not gone.size:
        assert not caught
        return
    (said,) = (str(each.message) for each in caught)
    assert f"from t = {T[gone[0]]:g} s on" in said
    assert f"outside by {100 * out.max():.3g} % of the width" in said
    assert ("1.6 times as fast" in said) == (stretch == 1.6)


def test_a_faster_input_matters_where_the_rate_does():
    with pytest.warns(UserWarning, match="it runs 2 times as fast"):
        beyond = run(RATE, U, T / 2).stats["beyond"]
    np.testing.assert_allclose(beyond.rate, 1.0, rtol=1e-12)
    assert beyond.input == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(ANY_RATE, U, T / 2)
        run(RATE, U * 1.04, T / 1.1)  # no more than noise does
        assert "beyond" not in run(ANY_RATE.fitted_on(None), 3 * U).stats


def test_an_inverse_says_where_its_input_leaves_the_range():
    plays = hj.models.PrandtlIshlinskii([0.0, 0.5], [0.5, 0.3], **UNITS)
    model = plays.fitted_on(KNOWN)
    far = hj.simulate(plays, hj.Recording(T, 1.5 * U, U, **UNITS)).w
    with pytest.warns(UserWarning, match="leaves what this law was fitted on"):
        solution = hj.invert(model, far, T, u0=1.5 * U[0])
    np.testing.assert_allclose(solution.value.u, 1.5 * U, atol=1e-9)
    beyond, outside = solution.stats["beyond"], (1.5 * U.max() - U.max()) / np.ptp(U)
    np.testing.assert_allclose(beyond.input, outside, rtol=1e-9)
    assert beyond.rate == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        near = hj.invert(model, hj.simulate(plays, REC).w, T)
    assert near.stats["beyond"].since == np.inf
    assert "beyond" not in hj.invert(plays, far, T).stats
    # Where samples are only numbered there is no time to tell.
    first = np.flatnonzero(1.5 * U - U.max() > 0.05 * np.ptp(U))[0]
    with pytest.warns(UserWarning, match=f"from sample {first} on the input leaves"):
        hj.invert(model, hj.Recording(None, 1.5 * U, far, **UNITS))


def test_under_vmap_it_is_a_statistic():
    scales = jnp.array([1.0, 2.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = jax.vmap(lambda x: run(ANY_RATE, x * U).stats["beyond"])(scales)
    one_by_one = [KNOWN.left_by(T, x * U, True) for x in (1.0, 2.0)]
    for name in ("input", "rate", "since"):
        expected = [getattr(each, name) for each in one_by_one]
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-12)


def test_what_is_no_range_is_refused(unchecked):
    with pytest.raises(hj.InputError, match="fitted_range"):
        RATE.fitted_on((0, 1))  # pyright: ignore
    with pytest.raises(hj.InputError, match="fitted_range"):
        Behind(RATE, "play(u,0.2)", fitted_range=(0, 1))  # pyright: ignore


def test_the_command_says_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    hj.save("law.json", ANY_RATE)
    for name, u in (("inside", U), ("outside", 2 * U)):
        np.savetxt(f"{name}.csv", np.column_stack([T, u, REC.w]), delimiter=",")
        file = ["law.json", f"{name}.csv", "--time", "0", "--input", "1"]
        assert main(["simulate", *file, "--output", "2"]) == 0
        said = capsys.readouterr().err
        found = re.findall("the input leaves what this law was fitted on", said)
        assert len(found) == (name == "outside")
    assert Path("simulated.csv").exists()
