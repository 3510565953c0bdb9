"""Every family on a record, judged by the same blocks."""

import dataclasses
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play, plays
from test_cli import hystjax

import hystjax as hj
from hystjax import models, report
from hystjax.comparison import FAMILIES, _families
from hystjax.comparison._compare import Compared, _case, _far, _known, _ranked
from hystjax.comparison._families import Case, _offset
from hystjax.discovery._layout import blocks, layout
from hystjax.models import FittedRange, SparseModel
from hystjax.reproduce._classical import CASES

T = np.linspace(0, 20, 601)
U = np.exp(-T / 15) * np.sin(2.5 * T)
FEW = ("curve", "plays", "Dahl")  # quick ones


def recording(w, t=T):
    return hj.Recording(t, U, w, names=("voltage", "stroke"), units=("V", "µm"))


NOISE = 0.02 * np.random.default_rng(0).normal(size=len(T))
W = 0.4 * U + 0.5 * play(U, 0.15) + 0.3 * play(U, 0.42) + NOISE


@pytest.fixture(scope="module")
def found():
    return hj.compare(recording(W), families=(*FEW, "Everett"))


def test_the_family_of_the_device_comes_first(found):
    assert found.best.family == "plays"
    errors = [row.error for row in found.rows]
    assert errors == sorted(errors)
    # What is left is the noise, over the range, but for radii that are not on the grid.
    assert found.best.own == pytest.approx(np.std(NOISE) / np.ptp(W), rel=0.1)
    assert set(found.left_out) == {"Dahl"}  # whose loops run round the other way
    assert "other way" in found.left_out["Dahl"]


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 30.0])
def test_the_zero_of_an_output_is_no_matter(offset):
    """A device behind an offset is run backwards from the state in which it was."""
    force = hj.simulate(models.Dahl(6.0, 1.0, 1.0), recording(U), w0=0.0).w
    found = hj.compare(recording(force + NOISE + offset), families=("stops", "Dahl"))
    assert found.best.family == "Dahl"
    assert found.best.beyond == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.3, 1.0, 100.0])
def test_a_magnet_behind_any_offset_is_guessed(offset):
    """From a first output far beyond saturation no run of it comes near the others."""
    magnet = models.JilesAtherton(1.2e6, 150.0, 120.0, 1e-4, 0.2)
    u = 800 * U
    w = np.asarray(hj.simulate(magnet, hj.Recording(T, u, 0 * u)).w)
    record = hj.Recording(T, u, w + offset * np.ptp(w))
    case = _case((record,), None)
    known = _offset(models.JilesAtherton.guess(case.widest), case)
    assert known == pytest.approx(offset * np.ptp(w), abs=0.01 * np.ptp(w))


def test_weights_have_a_say_in_the_errors():
    """Of samples that count next to nothing as of those that do not count."""
    wrong = slice(200, 230)
    w = W.copy()
    w[wrong] += 3.0
    errors = []
    for small in (0.0, 1e-9):
        weights = np.ones(len(T))
        weights[wrong] = small
        found = hj.compare(recording(w), families=("curve", "plays"), weights=[weights])
        assert found.best.family == "plays"
        errors.append(found.best.own * found_range(w, weights))
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-3)


def found_range(w, weights):
    """Over which errors are told: that of all samples which have a weight."""
    return np.ptp(w[weights > 0])


def test_errors_are_those_of_fits_without_each_block(found):
    (rows,) = blocks([recording(W)], np.ones((1, len(W)), bool))
    errors = []
    for block in range(rows.max() + 1):
        out = rows == block
        cubic = np.polynomial.Polynomial.fit(U[~out], W[~out], 3)
        errors.append(np.sqrt(np.mean((cubic(U[out]) - W[out]) ** 2)) / np.ptp(W))
    curve = found["curve"]
    np.testing.assert_allclose(curve.blocks, errors, rtol=1e-8)
    assert curve.error == pytest.approx(np.prod(errors) ** (1 / len(errors)))
    spread = np.std(np.log(errors), ddof=1) / math.sqrt(len(errors))
    assert curve.standard_error == pytest.approx(curve.error * spread)
    assert curve.numbers == 4


def test_how_far_outputs_get_beyond_the_record(found):
    cubic = np.polynomial.Polynomial.fit(U, W, 3)
    middle, half = (W.max() + W.min()) / 2, np.ptp(W) / 2
    far = np.max(np.abs(cubic(1.5 * U) - middle)) / half
    assert found["curve"].beyond == pytest.approx(far)


def row(family, error, beyond, numbers=3):
    errors = (error / 2, 2 * error)
    model = hj.models.Dahl(1.0, 1.0)
    return Compared(family, model, errors, error, beyond, numbers, 1.0, "")


def test_families_that_run_away_come_after_those_that_nearly_do_as_well():
    rows = [row("far", 0.1, 3.0), row("near", 0.19, 1.5), row("poor", 0.21, 1.0)]
    assert [each.family for each in _ranked(rows, 0.0, 2.0)] == ["near", "far", "poor"]
    # A block that is met exactly leaves a mean and an error of it.
    exact = dataclasses.replace(rows[0], blocks=(0.0, 0.25))
    assert 0 < exact.error < 1e-100 and math.isfinite(exact.standard_error)
    # Where none that does nearly as well stays near, errors alone decide.
    rows = [row("poor", 0.21, 1.0), row("far", 0.1, 3.0), row("lost", 0.3, math.inf)]
    assert [each.family for each in _ranked(rows, 0.0, 2.0)] == ["far", "poor", "lost"]


def test_of_families_that_blocks_hardly_tell_apart_the_fewest_numbers_come_first():
    # One standard error of these blocks is log(2), to either side.
    best, alike = row("best", 0.1, 1.0, 9), row("alike", 0.165, 1.0, 4)
    worse, fewest = row("worse", 0.172, 1.0, 2), row("far", 0.12, 3.0, 1)
    ranked = [each.family for each in _ranked([fewest, worse, alike, best], 0.0, 2.0)]
    assert ranked == ["alike", "best", "worse", "far"]
    single = [
        Compared(n, best.model, (e,), e, 1.0, k, 1.0, "")
        for n, e, k in (("poor", 0.11, 1), ("good", 0.1, 2))
    ]
    assert [each.family for each in _ranked(single, 0.0, 2.0)] == ["good", "poor"]
    # Of a record without noise: nothing tells these apart that is known to so much.
    assert [each.family for each in _ranked(single, 0.12, 2.0)] == ["poor", "good"]
    rows = [row("exact, and far", 1e-9, 3.0, 1), row("near", 1e-3, 1.0)]
    assert _ranked(rows, 1e-3, 2.0)[0].family == "near"


def test_samples_without_weight_change_nothing():
    few = ("curve", "plays", "PrandtlIshlinskii")
    known = np.ones(len(T))
    known[[150, 400]] = 0
    spoilt = np.where(known > 0, W, 100 * np.ptp(W))
    clean, found = (
        hj.compare(recording(w), families=few, weights=[known]) for w in (W, spoilt)
    )
    assert [row.family for row in found.rows] == [row.family for row in clean.rows]
    for ours, theirs in zip(found.rows, clean.rows, strict=True):
        np.testing.assert_allclose(ours.blocks, theirs.blocks, rtol=1e-9)
    left = hj.simulate(found["curve"].model, recording(W)).w[known > 0] - W[known > 0]
    own = np.sqrt(np.mean(left**2)) / np.ptp(W[known > 0])
    assert found["curve"].own == pytest.approx(own, rel=1e-9)
    assert found.noise == pytest.approx(np.std(NOISE) / np.ptp(W), rel=0.1)
    with pytest.raises(hj.InputError, match="all 0: leave that recording out"):
        hj.compare(recording(W), families=few, weights=[0 * known])


@pytest.mark.parametrize("rows", [(200, len(T)), (0, 400)])
def test_what_is_guessed_is_of_the_rows_that_have_a_weight(rows):
    family, known = ["PrandtlIshlinskii"], np.zeros(len(T))
    known[slice(*rows)] = 1
    (found,) = hj.compare(recording(W), families=family, weights=[known]).rows
    (alone,) = hj.compare(recording(W).window(*rows), families=family).rows
    assert found.numbers == alone.numbers
    assert found.own == pytest.approx(alone.own, rel=1e-6)


@pytest.mark.slow
def test_a_family_has_the_steps_that_its_flow_needs():
    t = np.linspace(0, 10, 201)
    u = np.sin(2.5 * t)
    device = hj.models.Dahl(60.0, 1.0)
    # One step a sample is ten times as long as the device takes to turn round.
    once = hj.simulation.FixedStep(1)
    coarse = hj.simulate(device, hj.Recording(t, u, u), method=once, throw=False)
    assert np.max(np.abs(coarse.w)) > 1e9
    w = hj.simulate(device, hj.Recording(t, u, u), w0=0.0).w
    noise = 0.01 * np.random.default_rng(0).normal(size=len(t))
    ours = hj.compare(hj.Recording(t, u, w + noise), families=("Dahl",)).best
    assert ours.own == pytest.approx(np.std(noise) / np.ptp(w + noise), rel=0.1)
    assert ours.error < 1.3 * ours.own
    reference = hj.simulation.Adaptive()
    run = hj.simulate(ours.model, hj.Recording(t, u, w + noise), method=reference)
    assert hj.metrics.nrmse(w, run.w) < ours.own


@pytest.mark.slow
def test_a_fit_without_a_block_has_the_steps_that_it_needs_too():
    """Where the fit to all samples has enough, that without one may be lost."""
    clean = CASES["LuGre"].clean()
    t, u, w = (np.asarray(x)[::2] for x in (clean.t, clean.u, clean.w))
    noise = 0.01 * np.std(w) * np.random.default_rng(0).normal(size=len(w))
    record = hj.Recording(t, u, w + noise)
    row = hj.compare(record, families=("Dahl",)).best
    finer = _case((record,), None).with_steps(32)
    expected = finer.errors(_families.FAMILIES["Dahl"](finer).outputs)
    np.testing.assert_allclose(row.blocks, expected[:-1], rtol=0.05)


@pytest.mark.slow
def test_springs_that_slide_have_the_radii_that_they_need():
    """Two stops, each with a static curve, of radii that are on no grid."""
    radii = np.array([0.16, 0.52])

    def force(u):
        stops = u[:, None] - plays(u, radii)
        return 0.3 + stops @ [2.0, 0.5] + stops**3 @ [20.0, -1.0]

    clean = force(U)
    noise = 0.01 * np.std(clean) * NOISE / np.std(NOISE)
    found = hj.compare(recording(clean + noise), families=("stops", "two stops"))
    assert found.best.family == "two stops"
    assert found.best.numbers == 7
    assert found.best.own == pytest.approx(np.std(noise) / np.ptp(clean), rel=0.1)
    law = found.best.model
    got = sorted(float(radius) for radius in law.library.numbers.values())
    np.testing.assert_allclose(got, radii, rtol=0.02)
    # Where no input was, at twice the amplitude, it is the device.
    other = 2 * np.sin(1.7 * T)
    beyond = hj.judge(law, hj.Recording(T, other, force(other)))
    assert beyond.errors["nrmse"] < 0.01


def test_models_that_come_back_are_those_judged_on_all_samples(found):
    for row in found.rows:
        run = hj.simulate(row.model, recording(W))
        nrmse = float(hj.metrics.nrmse(W, run.w))
        assert nrmse == pytest.approx(row.own, rel=1e-6)
        assert row.model.units == ("V", "µm")


def test_a_density_of_either_sign_is_fitted_alike(found):
    plane = found["Everett"]
    assert plane.numbers == 1 + np.count_nonzero(plane.model.roots)  # and the offset
    mirrored = hj.compare(recording(-W), families=("Everett",)).best
    assert mirrored.model.sign == -plane.model.sign
    np.testing.assert_allclose(mirrored.blocks, plane.blocks, rtol=1e-6)
    assert mirrored.own == pytest.approx(plane.own, rel=1e-6)


def test_a_table_tells_what_was_tried(found):
    text = str(found).splitlines()
    assert text[0].split()[:2] == ["family", "blocks"]
    assert text[1].startswith("plays ") and text[3].startswith("curve ")
    assert text[-1].startswith("Dahl: ")
    with pytest.raises(KeyError, match="Did you mean 'plays'"):
        found["play"]
    share = f"{100 * found.best.error:.3g} ± "
    assert share in text[1] and "independent" in text[1]
    apart = dataclasses.replace(found.best, blocks=(0.2, 0.8))
    assert f" 40 ± {round(20 * math.log(4), -1):g} " in str(
        dataclasses.replace(found, rows=(apart,))
    )


def test_a_table_tells_what_else_is_to_be_known(found):
    assert "Notes" not in str(found)
    noted = [dataclasses.replace(each, note="still settles") for each in found.rows[:2]]
    lines = str(dataclasses.replace(found, rows=(*noted, *found.rows[2:]))).splitlines()
    assert lines[-5:-2] == ["Notes:", "plays, Everett: still settles", ""]


def test_weights_of_plays_are_linear_fits_without_each_block():
    record = recording(W)
    ours = hj.compare(record, families=("PrandtlIshlinskii",)).best
    radii = np.asarray(ours.model.radii)
    first = hj.models.PrandtlIshlinskii.guess(record)
    np.testing.assert_array_equal(radii, first.radii)
    columns = np.column_stack([np.ones(len(T)), *(play(U, r) for r in radii)])
    (rows,) = blocks([record], np.ones((1, len(W)), bool))
    errors = []
    for block in range(rows.max() + 1):
        out = rows == block
        coefficients = np.linalg.lstsq(columns[~out], W[~out])[0]
        missed = columns[out] @ coefficients - W[out]
        errors.append(np.sqrt(np.mean(missed**2)) / np.ptp(W))
    np.testing.assert_allclose(ours.blocks, errors, rtol=1e-8)
    offset, *weights = np.linalg.lstsq(columns, W)[0]
    np.testing.assert_allclose(ours.model.weights, weights, rtol=1e-6)
    assert float(ours.model.offset) == pytest.approx(offset, rel=1e-6)
    assert ours.numbers == len(radii) + 1
    run = hj.simulate(ours.model, record)
    np.testing.assert_allclose(run.w, columns @ [offset, *weights], atol=1e-9)


def lagged(t, x, time):
    """A first-order lag of straight lines, settled at first."""
    out = [x[0]]
    for h, a, b in zip(np.diff(t), x[:-1], x[1:], strict=True):
        left = np.exp(-h / time)
        out.append(b + (out[-1] - a) * left - (b - a) * time / h * (1 - left))
    return np.array(out)


def columns_by_hand(family, t, u, span, slow, fast):
    """Sets of columns, of which the one that follows best is taken."""
    few, many = (span * np.array(x) for x in (_families._STOPS, _families._RADII))
    if family == "stops":
        du = np.diff(u) / np.diff(t)
        stops = np.array([u - play(u, r) for r in few])
        return [np.array([u**0, u, np.append(du, du[-1]), *stops, *stops**3])]
    creep = [lagged(t, u, time) for time in slow]
    if family == "plays and creep":
        stack = [play(u, r) for r in many]
        return [np.array([u**0, u, u**2, u**3, *stack, *creep])]
    fine = np.interp(np.arange(10 * len(t) - 9) / 10, np.arange(len(t)), t)
    plays = [play(np.interp(fine, t, u), r) for r in many]
    sets = []
    for time in fast:
        behind = lagged(t, u, time)
        stack = [lagged(fine, x, time)[::10] for x in plays]
        sets.append(np.array([u**0, behind, behind**2, behind**3, *stack, *creep]))
    return sets


@pytest.mark.parametrize(
    ("family", "numbers", "within"),
    [
        ("stops", 11, 1e-9),
        ("plays and creep", 15, 1e-9),
        # Of plays that turn between samples.
        pytest.param("plays behind a lag", 16, 1e-3, marks=pytest.mark.slow),
    ],
)
def test_stacks_are_linear_fits_without_each_block(family, numbers, within):
    """Of two recordings, of which the second takes longer and goes farther."""
    short, long = T[:201], T[200:]
    inputs = [0.5 + 0.3 * np.sin(3 * short), U[200:] + 0.5 * U[200]]
    times = [short, long]
    outputs = []
    for t, u in zip(times, inputs, strict=True):
        clean = u + 0.5 * play(u, 0.2) + 0.5 * lagged(t, u, 0.1) + 0.3 * u**2
        outputs.append(clean + 0.02 * np.random.default_rng(3).normal(size=len(t)))
    group = tuple(map(hj.Recording, times, inputs, outputs))
    case = Case(group, None, layout(group, None, 1, False))
    fit = FAMILIES[family](case)

    span = max(map(np.max, inputs)) - min(map(np.min, inputs))
    slow = np.ptp(long) * np.array(_families._CREEP)
    travel = np.sum(np.abs(np.diff(inputs[1])))
    fast = np.ptp(inputs[1]) * np.ptp(long) / travel * np.array(_families._LAGS)
    each = [
        columns_by_hand(family, t, u, span, slow, fast)
        for t, u in zip(times, inputs, strict=True)
    ]
    sets = [np.hstack(pair).T for pair in zip(*each, strict=True)]
    w = np.concatenate(outputs)
    lengths = np.array([[len(t)] for t in times])
    inside = np.arange(np.max(lengths)) < lengths
    rows = blocks(group, inside)[inside]
    for block, found in zip((*range(rows.max() + 1), None), fit.outputs, strict=True):
        seen = rows != block
        fits = [np.linalg.lstsq(x[seen], w[seen])[0] for x in sets]
        left = [
            np.sum((x[seen] @ c - w[seen]) ** 2)
            for x, c in zip(sets, fits, strict=True)
        ]
        best = np.argmin(left)
        ours = np.concatenate([x[: len(t)] for x, t in zip(found, times, strict=True)])
        off = np.max(np.abs(ours - sets[best] @ fits[best]))
        assert off < within * np.ptp(w)
    assert fit.numbers == numbers and fit.note == ""


def test_it_tells_how_much_is_noise(found):
    assert found.noise == pytest.approx(np.std(NOISE) / np.ptp(W), rel=0.1)
    said = f"{100 * found.noise:.2g} % of the range of the output at most"
    assert f"Noise: {said}." in str(found).splitlines()
    assert said in found._repr_html_()
    # Of several recordings each counts by its own range, and all samples alike.
    shares = [0.0, 0.01, 0.03]
    random = np.random.default_rng(1)
    each = [
        recording(size * (np.sin(T) + 2 * share * random.normal(size=len(T))))
        for size, share in zip((1.0, 1e-3, 10.0), shares, strict=True)
    ]
    each[2] = each[2].window(0, 401)
    noise = hj.compare(each, families=("curve",)).noise
    sizes = [
        size / np.ptp(row.w) for size, row in zip((1.0, 1e-3, 10.0), each, strict=True)
    ]
    expected = [2 * share * size for share, size in zip(shares, sizes, strict=True)]
    mean = np.average(np.square(expected), weights=[*map(len, each)])
    assert noise == pytest.approx(np.sqrt(mean), rel=0.05)
    # Straight lines across dropouts have none, and may be most of a record.
    known = np.arange(len(T)) % 100 < 20
    found = hj.compare(recording(W), families=("curve",), weights=[1.0 * known])
    expected = np.std(NOISE[known]) / np.ptp(W[known])
    assert found.noise == pytest.approx(expected, rel=0.3)


def test_a_device_that_still_settles_does_not_spoil_the_fit():
    settling = W + 2 * np.exp(-T / 0.3)
    found = hj.compare(recording(settling), families=("plays",))
    assert "settles" in found.best.note
    still = hj.compare(recording(W), families=("plays",))
    assert still.best.note == ""
    (rows,) = blocks([recording(W)], np.ones((1, len(W)), bool))
    later = rows >= 0
    # What is over before it spoils the others is fitted too.
    brief = hj.compare(recording(W + np.exp(-T / 0.05)), families=("plays",))
    assert brief.best.note == ""
    run = hj.simulate(found.best.model, recording(settling))
    missed = np.asarray(run.w)[later] - W[later]
    assert np.sqrt(np.mean(missed**2)) < 1.1 * np.std(NOISE[later])


def test_a_first_stretch_that_only_goes_farthest_is_fitted_too():
    """Of a sine that decays none of the others go so far, and a device that saturates
    is another there."""
    w = W + np.tanh(3 * U)
    found = hj.compare(recording(w), families=("plays",)).best
    radii = [radius for radius in map(float, found.model.library.numbers.values())]
    assert len(radii) == 9
    columns = np.column_stack([U**0, U, U**2, U**3, *(play(U, r) for r in radii)])
    missed = columns @ np.linalg.lstsq(columns, w)[0] - w
    assert found.own == pytest.approx(np.sqrt(np.mean(missed**2)) / np.ptp(w))
    assert found.note == ""


def test_what_rounding_leaves_is_no_device_that_settles():
    w = 0.4 * U + 0.5 * play(U, 0.04 * np.ptp(U)) + 0.2 * play(U, 0.2 * np.ptp(U))
    found = hj.compare(recording(w), families=("plays",)).best
    assert found.own < 1e-12 and found.note == ""


@pytest.mark.slow
def test_an_input_that_just_comes_by_zero_is_judged_as_one_that_does_not():
    """Made larger about zero, or about its middle, it gets farther or less far."""
    u = (1 - np.cos(2.5 * T)) * np.exp(-T / 15) / 2
    w = u + 0.2 * play(u, 0.1) + NOISE / 10
    families, orders = ("Everett", "plays"), []
    for low in (0.0, 0.01):
        found = hj.compare(hj.Recording(T, u + low, w), families=families)
        assert found["plays"].beyond == pytest.approx(1.5 if low else 2, abs=0.1)
        orders.append([each.family for each in found.rows])
    assert orders == [["plays", "Everett"]] * 2


@pytest.mark.slow
def test_all_recordings_tell_whether_an_output_leads():
    """Of springs that slide: loops tell, and not a single way up, though it is longer
    than they are wide."""
    ramp, thin = np.linspace(-1, 1, 200), U[::3]
    inputs, noise = (ramp, thin, 0.7 * thin), (5 * NOISE, NOISE, NOISE)
    group = tuple(
        hj.Recording(None, u, sum(u - play(u, r) for r in (0.05, 0.2)) + each[: len(u)])
        for u, each in zip(inputs, noise, strict=True)
    )
    assert max(group, key=lambda each: np.ptp(each.u)) is group[0]
    assert models.Everett.guess(group[0]).curve is None
    fit = _families.everett(Case(group, None, layout(group, None, 1, True)))
    assert fit.model.curve is not None
    left = fit.outputs[-1, 1, : len(thin)] - group[1].w
    assert np.std(left) < 1.5 * np.std(NOISE)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("low, input_gets", [(-0.5, 1.5), (0.0, 2.0)])
def test_outputs_may_get_somewhat_farther_than_the_input(low, input_gets):
    """From the middle, over half of the range; from zero on inputs go twice as far."""
    u = low + (1 - np.cos(2.5 * T)) / 2
    group = (hj.Recording(T, u, u),)
    case = SimpleNamespace(group=group, layout=layout(group, None, 2, True))
    assert _far(case) == pytest.approx(input_gets + 0.5, abs=0.01)


def test_recordings_count_by_their_own_range():
    """A block is a whole recording then, and its error is over its own range."""
    each = [recording(size * W) for size in (1.0, 0.3, 1.0)]
    found = hj.compare(each, families=("curve",))
    assert len(found.best.blocks) == 3
    errors = []
    for out in range(3):
        kept = [i for i in range(3) if i != out]
        target = np.concatenate([each[i].w / np.ptp(each[i].w) for i in kept])
        scales = np.concatenate([np.full(len(U), np.ptp(each[i].w)) for i in kept])
        columns = np.vander(np.tile(U, 2), 4) / scales[:, None]
        coefficients = np.linalg.lstsq(columns, target)[0]
        missed = (np.vander(U, 4) @ coefficients - each[out].w) / np.ptp(each[out].w)
        errors.append(np.sqrt(np.mean(missed**2)))
    np.testing.assert_allclose(found.best.blocks, errors, rtol=1e-6)


def test_two_recordings_count_by_their_range():
    pair = recording(W), recording(0.3 * W)
    weights = _case(pair, None).weights
    assert weights is not None
    ranges = [np.ptp(each.w) for each in pair]
    ratio = float(np.mean(weights[1]) / np.mean(weights[0]))
    assert ratio == pytest.approx((ranges[0] / ranges[1]) ** 2)


@pytest.mark.usefixtures("unchecked")
def test_outputs_are_known_to_what_lines_miss_of_the_input():
    """Of a sine, over a step h, h^2/8 of the spread; that of outputs over their range
    is a root mean square of those of all recordings."""
    t = np.linspace(0, 20, 401)
    outputs = np.sin(t), np.sign(np.sin(t))
    case = SimpleNamespace(group=[hj.Recording(t, np.sin(t), w) for w in outputs])
    spreads = [np.std(w) / np.ptp(w) for w in outputs]
    expected = np.sqrt(np.mean(np.square(spreads))) * t[1] ** 2 / 8
    known = _known(case, [row("good", 0.02, 1.0), row("poor", 0.5, 1.0)])
    assert known == pytest.approx(expected, rel=0.02)


def test_what_a_law_knows_of_others_is_kept(monkeypatch):
    def marked(case):
        fit = _families.curve(case)
        reached = dataclasses.replace(FittedRange.of(case.group), apart=0.3)
        return fit._replace(model=fit.model.fitted_on(reached))

    monkeypatch.setitem(FAMILIES, "curve", marked)
    known = hj.compare(recording(W), families=("curve",)).best.model.fitted_range
    assert float(known.apart) == 0.3 and float(known.high) == np.max(U)


def test_without_a_clock_only_what_needs_none_is_tried():
    bare = hj.Recording(None, U, W)
    found = hj.compare(bare, families=("plays", "plays and creep", "LuGre"))
    assert [row.family for row in found.rows] == ["plays"]
    assert "clock" in found.left_out["plays and creep"]
    assert "clock" in found.left_out["LuGre"]


def test_an_output_that_is_lost_has_an_infinite_error():
    record = recording(W)
    laid_out = layout((record,), None, 1, False)
    case = Case((record,), None, laid_out)
    outputs = np.stack([W] * (laid_out.count + 1))[:, None].copy()
    outputs[1] = np.nan
    outputs[2] = 1e300
    errors = case.errors(outputs)
    assert errors[0] == 0 and not np.isfinite(errors[1:3]).any()


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_models_are_matched_without_each_block(offset):
    """As `refine` does where samples have no weight; behind an offset, if there is."""
    truth = hj.models.Dahl(6.0, 1.0, 1.0)
    w = np.asarray(hj.simulate(truth, recording(W), w0=0.0).w) + NOISE + offset
    record = recording(w)
    found = hj.compare(record, families=("Dahl", "curve"))
    assert found.best.family == "Dahl"
    assert found.best.numbers == (4 if offset else 3)
    guess = hj.models.Dahl.guess(record)
    if offset:
        moved = float(found.best.model.parameters()["output_offset"])
        assert moved == pytest.approx(offset, abs=0.01)
        assert found.notes() == ["Dahl: " + _families._MOVED]
        guess = hj.models.Instrumented(guess, output_offset=0.0)
    (rows,) = blocks([record], np.ones((1, len(W)), bool))
    for block in (0, rows.max()):
        weights = jnp.where(rows == block, 0.0, 1.0)
        alone = hj.refine(guess, record, weights=[weights])
        start = alone.stats["w0"][0]
        method = hj.simulation.FixedStep()
        run = hj.simulate(alone.value, record, w0=start, method=method)
        missed = (np.asarray(run.w) - w)[rows == block]
        error = np.sqrt(np.mean(missed**2)) / np.ptp(w)
        assert found.best.blocks[block] == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"families": ("play",)}, "'plays'"),
        ({"families": ()}, "none"),
        ({"families": "plays"}, "must be a list of names, got 'plays'"),
        ({"families": 3}, "must be a list of names, got 3"),
        ({"families": [hj.models.Duhem(0.4, 0.5, 0.25)]}, "got a Duhem"),
        ({"families": ("plays", "curve", "plays")}, "'plays' more than once"),
    ],
)
def test_bad_arguments(arguments, said, unchecked):
    with pytest.raises(hj.InputError, match=said):
        hj.compare(recording(W), **arguments)


def test_families_come_in_any_collection():
    sets = ({"curve"}, iter(("curve",)), dict.fromkeys(("curve",)))
    found = [hj.compare(recording(W), families=each) for each in sets]
    assert [[row.family for row in each.rows] for each in found] == [["curve"]] * 3


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (hj.Recording(T[:40], U[:40], W[:40]), "at least 90"),
        (hj.Recording(T, 0 * U, W), "`u`"),
        (hj.Recording(T, U, 0 * W), "`w`"),
    ],
)
def test_records_that_tell_nothing(record, said):
    with pytest.raises(hj.InputError, match=said):
        hj.compare(record, families=("curve",))


def test_what_is_no_record_is_told_of_this_call(unchecked):
    with pytest.raises(hj.InputError, match=r"The order is `compare\(recordings\)`"):
        hj.compare(None)


def test_where_nothing_can_be_fitted_it_is_said():
    with pytest.raises(hj.ComputationError, match=r"Dahl: .*other way"):
        hj.compare(recording(W), families=("Dahl",))


@pytest.mark.slow
def test_the_command_line_writes_a_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = np.column_stack([T, U, W]).tolist()
    lines = ["t,V,x", *(",".join(map(repr, row)) for row in rows)]
    Path("stack.csv").write_text("\n".join(lines) + "\n")
    columns = ("--time", "t", "--input", "V", "--output", "x", "--units", "V,µm")
    ran = hystjax(
        *("compare", "stack.csv", *columns, "--families", ",".join(FEW)),
        *("--rows", "0:400", "--test", "400:601", "--out", "report"),
    )
    assert (ran.code, ran.err) == (0, "")
    assert "best: plays" in ran.out and "unseen" in ran.out
    text = Path("report/report.md").read_text(encoding="utf-8")
    assert "| plays |" in text and "Not fitted" in text
    assert "Of these the noise is" in text and "Noise: " in ran.out
    law = hj.load("report/law.json")
    for name, rows in (("fitted", (0, 400)), ("unseen", (400, 601))):
        run = hj.simulate(law, recording(W).window(*rows))
        off = np.sqrt(np.mean((run.w - W[slice(*rows)]) ** 2)) / np.ptp(W[slice(*rows)])
        (told,) = re.findall(rf"^{name} +(\S+) %", ran.out, re.MULTILINE)
        assert float(told) == pytest.approx(100 * off, rel=1e-3) and off < 0.05
    assert Path("report/comparison.png").stat().st_size > 10_000
    told = json.loads(Path("report/metrics.json").read_text(encoding="utf-8"))
    assert told["law"] == str(law) and told["settings"] == {"family": "plays"}
    assert told["errors"]["unseen"]["nrmse"] == pytest.approx(off, rel=1e-6)
    # Of another law's report that was there nothing stays, and the other way round.
    report.write("report", law, {"fitted": hj.judge(law, recording(W))})
    figures = {each.name for each in Path("report").glob("*.png")}
    assert figures == {"overview.png", "fitted.png"}
    again = hystjax(
        *("compare", "stack.csv", *columns, "--families", "curve", "--out", "report")
    )
    assert again.code == 0
    figures = {each.name for each in Path("report").glob("*.png")}
    assert figures == {"comparison.png"}
    shared = hystjax(
        *("compare", "stack.csv", *columns, "--rows", "0:400", "--test", "300:500")
    )
    assert shared.code == 2 and "shares rows" in shared.err


def test_options_in_notes_are_those_of_discover(tmp_path, monkeypatch):
    why = "What follows better was refused (`guard=False` admits it)."
    nothing = SimpleNamespace(refined=None, why=why)
    monkeypatch.setattr(_families, "discover", lambda *_, **__: nothing)
    monkeypatch.setattr(_families, "Discovered", SimpleNamespace(of=lambda each: each))
    both = hj.compare(recording(W), families=("law", "curve"))
    assert both.left_out == {"law": f"`discover` says: {why}"}
    monkeypatch.chdir(tmp_path)
    np.savetxt("stack.csv", np.column_stack([T, U, W]), delimiter=",")
    ran = hystjax(
        *("compare", "stack.csv", "--time", 0, "--input", 1, "--output", 2),
        *("--families", "law,curve", "--out", "report"),
    )
    said = "law: `hystjax discover` says: What follows better was refused (--any-reach"
    assert said in ran.out
    assert said in Path("report/report.md").read_text(encoding="utf-8")


def test_every_family_has_a_name_that_can_be_typed():
    assert all("," not in name for name in FAMILIES)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("lift", "more"), [(0.0, 0.0), (4.0, 0.0), (0.7, 1.0)])
def test_an_offset_of_the_output_is_told_from_a_device_of_another_kind(lift, more):
    """Of a lag of 0.05 s, w' = 20 (u - w), whose output is a sine in closed form; with
    another beside it, an offset leaves 0.71 of 0.99."""
    t = np.linspace(0, 4 * np.pi, 401)
    size, late = 1 / np.hypot(1, 0.05), np.arctan(0.05)
    w = lift + size * np.sin(t - late) + more * np.cos(5 * t)
    record = hj.Recording(t, np.sin(t), w)
    near = SimpleNamespace(widest=record, substeps=1)
    found = _offset(SparseModel.from_terms({"u": 20.0, "w": -20.0}), near)
    assert found == (pytest.approx(lift, abs=1e-3) if lift > 1 else None)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ({"du": 3.0}, "misses the output by 7[01] "),
        ({"w^2": 50.0, "1": 9.0}, "runs away"),
        ({"w": 3.0, "1": 1.0}, "runs away"),  # to 1e16, in so short a time
    ],
)
def test_what_is_said_of_guesses_that_are_far(terms, said):
    t = np.linspace(0, 4 * np.pi, 401)
    near = SimpleNamespace(widest=hj.Recording(t, np.sin(t), np.sin(t)), substeps=1)
    with pytest.raises(hj.InputError, match=f"what it guesses {said}"):
        _offset(SparseModel.from_terms(terms), near)


@pytest.mark.usefixtures("unchecked")
def test_what_is_only_rounded_is_not_taken_for_settling(monkeypatch):
    """By fits that follow to 1e-12 of the range, in the first stretch to 1e-11; and by
    such as miss a tenth of it there."""
    unseen = np.arange(100) < 20
    samples = SimpleNamespace(
        weight=np.ones((1, 100)), w=np.zeros((1, 100)), spread=np.ones(())
    )
    case = SimpleNamespace(
        layout=SimpleNamespace(samples=samples, blocks=np.where(unseen, -1, 0)[None])
    )
    monkeypatch.setattr(_families, "_triangles", lambda *_: {})

    def followed(first, others):
        missed = np.where(unseen, first, others)[None, None]
        return _families._Followed(0, np.ones(1), missed)

    for size, settles in ((1e-11, False), (0.1, True)):
        fits = {(): followed(size, size / 10), (-1,): followed(1.0, size / 100)}
        monkeypatch.setattr(
            _families, "_followed", lambda *_, unseen, fits=fits: fits[(*unseen,)]
        )
        found = _families._linear(case, [])
        assert (found.note != "") == settles
        assert found.outputs is fits[(-1,) if settles else ()].outputs
