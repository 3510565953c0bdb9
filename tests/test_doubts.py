"""What looks wrong with a record, and what does not."""

import re
from pathlib import Path

import jax
import numpy as np
import pytest
from classical_equations import plays
from test_cli import hystjax

import hystjax as hj

RNG = np.random.default_rng(0)
T = np.arange(3000) / 600
U = np.sin(2 * np.pi * T) * np.exp(-0.05 * T)


def stack(u, radii=(0.0, 0.1, 0.3), weights=(0.5, 0.3, 0.4)):
    return plays(u, np.array(radii)) @ weights


W = stack(U)
NOISY = W + 1e-4 * RNG.normal(size=len(W))
HELD = np.interp(T % 1, [0, 0.2, 0.3, 0.7, 0.8, 1], [0, 1, 1, -1, -1, 0])


def doubts(t, u, w):
    return hj.doubts(hj.Recording(t, u, w, units=("V", "µm")))


def without(rows):
    return tuple(np.delete(x, rows) for x in (T, U, W))


def spiked(rows, value):
    w = NOISY.copy()
    w[rows] = value
    return w


WRONG = {
    "a gap": (without(np.arange(400, 700)), r"none for 0\.5017 s after row 399, where"),
    "rounded times": (
        (np.round(T, 3), U, W),
        r"rounded to 0\.001 s.*period, about 0\.0016\d+ s \(600 Hz\)",
    ),
    "times rounded to a twelfth": (
        (np.round(0.0124 * np.arange(3000), 3), U, W),
        r"rounded to 0\.001 s.*\(80\.6\d Hz\)",
    ),
    "rounded dates": ((np.round(1.7e9 + T, 3), U, W), r"rounded to 0\.001 s"),
    "milliseconds since 1970": (
        (1.7e12 + 20.0 * np.arange(3000), U, W),
        "do they count milliseconds?",
    ),
    "a sentinel in the input": (
        (T, np.where(np.arange(3000) == 9, 1e6, U), W),
        "input has 1 value.*in row 9: .*take windows without them",
    ),
    "numbers of samples": ((np.arange(3000.0), U, W), "go up by exactly 1 s"),
    "sentinels": (
        (T, U, spiked(np.arange(400, 405), -9999.0)),
        "output has 5 value.*such as -9999 µm in rows 400, 401, 402, 403, 404: ",
    ),
    "a sentinel at the start": ((T, U, spiked([0], 1e6)), "1 value.*in row 0: "),
    "a sensor at its end": (
        (T, U, np.minimum(NOISY, 0.8)),
        "output stays at 0.8 µm.*first in rows 89, 696, 1304, 1914: ",
    ),
    "a sensor at its lower end": (
        (T, U, np.maximum(NOISY, -0.7)),
        "output stays at -0.7 µm.*first in rows",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_told_with_its_rows(what):
    columns, said = WRONG[what]
    (found,) = doubts(*columns)
    assert re.search(said, found)


def test_several_things_are_told_one_by_one():
    t, u, w = without(np.arange(400, 700))
    gap, rounded = doubts(np.round(t, 3), u, w)
    assert "none for 0.502 s after row 399" in gap and "rounded to 0.001 s" in rounded


RIGHT = {
    "clean": (T, U, W),
    "noisy": (T, U, NOISY),
    "a play, which dwells": (T, U, stack(U, [0.3], [1.0])),
    "a clock that jitters": (T + 1e-4 * RNG.uniform(size=len(T)), U, W),
    "times of many digits": (np.round(np.arange(3000) / 25600, 6), U, W),
    "times rounded to a twenty-third": (np.round(0.0234 * np.arange(3000), 3), U, W),
    "four bits": (T, U, np.round(8 * W) / 8),
    "logarithmic times": (np.geomspace(1, 100, 3000), U, W),
    "eight bits": (T, np.round(50 * U) / 50, np.round(60 * NOISY) / 60),
    "an input that is held": (T, HELD, stack(HELD)),
    "a step": (T, 1.0 * (T > 1), NOISY),
    "an impulse": (T, U, np.exp(-(((T - 2) / 0.01) ** 2)) + 1e-3 * NOISY),
    "an output that never changes": (T, U, np.zeros_like(T)),
    "a random walk": (T, np.cumsum(RNG.standard_t(2, size=3000)), NOISY),
    "no clock": (None, U, W),
    "few samples": (np.arange(40.0), U[:40], spiked([3], 1e9)[:40]),
}


@pytest.mark.parametrize("what", RIGHT)
def test_nothing_is_said_of_what_is_right(what):
    assert doubts(*RIGHT[what]) == ()


@pytest.mark.recordings
@pytest.mark.parametrize("name", hj.datasets.names())
def test_nothing_is_said_of_measured_recordings(name):
    for record in hj.datasets.records(name):
        assert hj.doubts(hj.datasets.load(name, record)) == ()


def test_the_command_line_says_so_in_its_own_words(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = np.stack([np.round(T, 3), U, W], axis=1)[: 3 * 600]
    options = {"delimiter": ",", "header": "t,V,x", "comments": "", "fmt": "%.9g"}
    np.savetxt("rounded.csv", rows, **options)
    given = ("loops", "rounded.csv", "--time", "t", "--input", "V", "--output", "x")
    told = hystjax(*given)
    assert told.code == 0 and "give --period, about 0.0016" in told.err
    assert Path("hystjax-loops/report.md").exists()
    even = hystjax(*given[:2], "--period", 1 / 600, *given[4:])
    assert (even.code, even.err) == (0, "")


@pytest.mark.usefixtures("unchecked")
def test_slips_are_named():
    with pytest.raises(hj.InputError, match=r"`recording`.*got an array"):
        hj.doubts(T)  # pyright: ignore
    with pytest.raises(hj.InputError, match="`doubts`"):
        jax.jit(lambda w: hj.doubts(hj.Recording(T, U, w)) and w)(W)
