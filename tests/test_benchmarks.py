"""The benchmarks' stopwatch against a clock of our own, and that they run."""

import json
import math
import re
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
import pysindy as ps
import pytest

import hystjax as hj
from benchmarks import _numpy, _problem, _results
from benchmarks.__main__ import BENCHMARKS, main
from benchmarks._agreement import Disagreement, agreed, relative_difference
from benchmarks._curves import Climb
from benchmarks._noisy import CASES
from benchmarks._timing import Contestant, Effort, Timing, race
from benchmarks._truth import Truth


@dataclass
class Stopwatch:
    """A clock that stands still but for what contestants and rests take."""

    now: float = 0.0
    calls: list[str] = field(default_factory=list)
    rests: list[float] = field(default_factory=list)

    def read(self) -> float:
        return self.now

    def rest(self, duration: float) -> None:
        self.rests.append(duration)
        self.now += duration

    def contestant(self, name: str, durations, pieces: int = 1) -> Contestant:
        remaining = iter(durations)

        def call():
            self.calls.append(name)
            self.now += next(remaining)
            return name

        return Contestant(call, pieces)

    def race(self, contestants, effort: Effort) -> dict[str, Timing]:
        return race(contestants, effort, clock=self.read, sleep=self.rest)


def test_contestants_take_turns_after_a_first_call_each():
    watch = Stopwatch()
    contestants = {
        "A": watch.contestant("A", [10, 1, 3, 2, 2]),
        "B": watch.contestant("B", [20, 5, 7], pieces=4),
    }
    effort = Effort(rounds=2, turn=4, pause=0.5, patience=1000)
    timings = watch.race(contestants, effort)

    assert "".join(watch.calls) == "AB" + "AAB" + "AAB"
    assert watch.rests == [0.5] * 4
    a, b = timings["A"], timings["B"]
    assert (a.first, a.warm, a.result) == (10, (1, 3, 2, 2), "A")
    assert (b.first, b.warm, b.result) == (20, (5, 7), "B")
    # A piece is a quarter of a call; quartiles as statistics.quantiles(inclusive).
    assert a.quantiles == pytest.approx((1, 1.75, 2, 2.25))
    assert b.quantiles == pytest.approx((1.25, 1.375, 1.5, 1.625))


def test_a_slow_contestant_is_called_warm_once():
    watch = Stopwatch()
    contestants = {
        "fast": watch.contestant("f", [1] * 4),
        "slow": watch.contestant("s", [60, 60]),
    }
    effort = Effort(rounds=3, turn=0, pause=0, patience=50)
    timings = watch.race(contestants, effort)
    assert [len(timing.warm) for timing in timings.values()] == [3, 1]


def test_results_are_waited_for():
    watch = Stopwatch()

    class Late:
        def block_until_ready(self):
            watch.now += 2

    effort = Effort(rounds=1, turn=0, pause=0, patience=50)
    timings = watch.race({"late": Contestant(lambda: (Late(), [1.0]))}, effort)
    assert timings["late"].first == 2
    assert timings["late"].warm == (2,)


def _table(title: str = "a race") -> _results.Table:
    timings = {
        "ours": Timing(3.0, (0.0015, 0.002, 0.0025)),
        "theirs": Timing(4.0, (9.0, 10.0, 12.0), pieces=1000),
    }
    return _results.Table(title, "ours", timings, ("a note",))


def test_table_gives_the_ratio_of_medians():
    theirs = _table().as_dict()["contestants"]["theirs"]
    assert theirs["ratio"] == pytest.approx(0.010 / 0.002)
    assert (theirs["first_call"], theirs["warm_calls"]) == (4.0, 3)
    lines = _table().text().splitlines()
    assert re.split(r"\s{2,}", lines[4]) == [
        "theirs",
        "10 ms",
        "9 ms",
        "9.5 ms to 11 ms",
        "5",
        "4 s",
    ]


def test_scores_come_before_times():
    scores = {"ours": {"right, %": 99.0}, "theirs": {"right, %": 12.5}}
    table = _results.Table("t", "ours", _table().timings, (), scores)
    entries = table.as_dict()["contestants"]
    assert {name: entry["scores"] for name, entry in entries.items()} == scores
    lines = [re.split(r"\s{2,}", line) for line in table.text().splitlines()]
    assert lines[2][:3] == ["contestant", "right, %", "median"]
    assert lines[4][:3] == ["theirs", "12.5", "10 ms"]


@pytest.fixture(scope="module")
def truth():
    """On one sine |w|^2 is w^2, and du^2 is 1 - u^2."""
    case = CASES[0]
    return Truth(case.clean(), hj.library.Polynomial(3), case.law)


@pytest.mark.parametrize(
    "change, found",
    [
        ({}, True),
        ({"du": 0.0, "u^2*du": 0.2, "du^3": 0.2}, True),
        ({"w^2": 0.3, "|w|^2": -0.3, "u^2": 1.0, "du^2": 1.0, "1": -1.0}, True),
        ({"du": 0.0}, False),
        ({"du": 0.0, "u^2*du": 0.2}, False),
        ({"w^2": 1e-3}, False),
    ],
)
def test_laws_are_compared_by_what_the_excitation_tells_apart(truth, change, found):
    law = truth.vector(CASES[0].law | change)
    assert truth.is_found(law) == found


def test_a_law_is_apart_where_none_of_its_terms_is_part_of_another(truth):
    """On one sine du is u^2 du and du^3 together; of degree 2 no term has it inside."""
    assert not truth.apart
    case = CASES[0]
    assert Truth(case.clean(), hj.library.Polynomial(2), case.law).apart


def test_the_error_of_a_law_counts_missing_and_further_terms(truth):
    law = {"du": 0.25, "w*|du|": -0.7, "|w|^3": 0.1}
    size = math.hypot(0.25, 0.5, 0.4)
    expected = math.hypot(0.2, 0.4, 0.1) / size
    assert truth.error(truth.vector(law)) == pytest.approx(expected, rel=1e-9)
    assert truth.error(truth.vector(CASES[0].law)) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("case", CASES[:6])
def test_noise_is_as_strong_as_said(case):
    w = np.repeat([0.0, 3.0, -5.0], 40_000)
    noise = case.noisy(w, 3) - w
    scale = np.abs(w) if case.multiplicative else np.full_like(w, np.std(w))
    still = scale == 0
    assert np.all(noise[still] == 0)
    ratio = noise[~still] / scale[~still]
    assert np.std(ratio) == pytest.approx(case.level, rel=0.02)


def test_writing_replaces_a_benchmark_and_keeps_the_others(tmp_path):
    _results.write({"one": [_table("first")], "two": [_table("kept")]}, tmp_path)
    _results.write({"one": [_table("second")]}, tmp_path)
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    titles = {name: result["tables"][0]["title"] for name, result in found.items()}
    assert titles == {"one": "second", "two": "kept"}
    assert found["one"]["machine"]["precision"] == "float64"
    text = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    assert "### second" in text and "### kept" in text and "### first" not in text
    assert len(list(tmp_path.iterdir())) == 2


def test_other_devices_have_results_of_their_own(tmp_path, monkeypatch):
    _results.write({"one": [_table("kept")]}, tmp_path)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    _results.write({"one": [_table("of a GPU")]}, tmp_path)
    found = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    titles = {name: result["tables"][0]["title"] for name, result in found.items()}
    assert titles == {"one": "kept", "one_gpu": "of a GPU"}


def _climb(watch: Stopwatch, off: float = 0.0) -> Climb:
    """Who squares a size in its tenth of seconds, who takes its square, and who takes
    as long for any."""

    def contestant(size, duration, found):
        def call():
            watch.now += duration
            return np.array([found])

        return Contestant(call)

    return Climb(
        title="squares",
        over="sizes",
        contestants=lambda size: {
            "fast": contestant(size, size / 10, size**2),
            "slow": contestant(size, float(size**2), size**2 + off),
            "steady": contestant(size, 5.0, size**2),
        },
        apart=lambda timings: float(np.ptp([t.result[0] for t in timings.values()])),
        alike=("squares", 1e-6),
        notes=("a note",),
    )


EFFORT = Effort(rounds=2, turn=0, pause=0, patience=1000)


def test_who_is_slow_does_not_climb_on():
    watch = Stopwatch()
    curves = _climb(watch).timed((1, 2, 3), EFFORT, 3.0, watch.race)
    fast, slow, steady = curves.as_dict()["curves"].values()
    assert [p["size"] for p in fast] == [1, 2, 3]
    assert [p["median"] for p in fast] == pytest.approx([0.1, 0.2, 0.3])
    medians = {point["size"]: point["median"] for point in slow}
    assert medians == pytest.approx({1: 1.0, 2: 4.0})
    lines = [re.split(r"\s{2,}", line) for line in curves.text().splitlines()]
    assert [p["size"] for p in steady] == [1, 2, 3]
    assert lines[2] == ["sizes", "fast", "slow", "steady"]
    assert lines[4] == ["2", "200 ms", "4 s", "5 s"]
    assert lines[5][:2] == ["3", "300 ms"]
    with pytest.raises(Disagreement, match=r"squares differ by 0\.1"):
        _climb(watch, 0.1).timed((1,), EFFORT, 3.0, watch.race)


def test_curves_are_drawn_beside_their_table(tmp_path):
    watch = Stopwatch()
    curves = _climb(watch).timed((1, 2), EFFORT, 3.0, watch.race)
    _results.write({"growth": [curves], "one": [_table("kept")]}, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "RESULTS.md",
        "growth.png",
        "results.json",
    ]
    text = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    assert "](growth.png)" in text and "](one.png)" not in text
    assert re.search(r"\| 2 \| 200 ms \| 4 s \| 5 s \|", text)


def test_numpy_by_hand_makes_the_library():
    w, u, du = np.random.default_rng(0).normal(size=(3, 20))
    ours = hj.library.Polynomial(3)(*map(jnp.asarray, (w, u, du)))
    theirs = _numpy.regressors(np.array([w, u, du, np.abs(du), np.abs(w)]), 3)
    np.testing.assert_allclose(theirs, ours, rtol=1e-12)


def test_numpy_by_hand_is_pysindys_stlsq():
    random = np.random.default_rng(1)
    theta = random.normal(size=(200, 8))
    slope = theta @ [1.0, 0, -0.5, 0, 0.08, 0, 0, 2] + 0.1 * random.normal(size=200)
    reference = ps.STLSQ(threshold=0.1, alpha=0.05).fit(theta, slope[:, None]).coef_[0]
    assert 0 < np.sum(reference != 0) < 8
    found = _numpy.stlsq(theta, slope, 0.1, 0.05)
    np.testing.assert_allclose(found, reference, rtol=1e-9)
    assert not np.any(_numpy.stlsq(theta, slope, 10.0, 0.05))


def test_numpy_by_hand_integrates():
    t = np.linspace(0, 2, 101)
    # w' = u - w with u = t, and for two first outputs at once.
    first = np.array([0.0, 1.0])
    found = _numpy.marched(lambda w, u, du: u - w, t, t, first)
    exact = t[:, None] - 1 + (first + 1) * np.exp(-t)[:, None]
    np.testing.assert_allclose(found, exact, atol=1e-8)


@pytest.mark.parametrize("error", [1e-3, math.nan, math.inf])
def test_contestants_that_disagree_are_not_compared(error):
    assert "at most 1e-06" in agreed("coefficients", 1e-9, 1e-6)
    with pytest.raises(Disagreement, match="coefficients differ by"):
        agreed("coefficients", error, 1e-6)


def test_difference_is_relative_but_to_zeros():
    assert relative_difference([2.02, 0.003], [2.0, 0.0]) == pytest.approx(0.01)
    assert math.isnan(relative_difference([math.nan], [1.0]))


def test_unknown_benchmark_is_named(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["regres"])
    error = capsys.readouterr().err
    assert "no benchmark 'regres'" in error and all(b in error for b in BENCHMARKS)


def test_missing_recording_is_one_line(monkeypatch, capsys):
    def missing():
        raise hj.InputError("the recording is not on disk; set HYSTJAX_DATA_DIR")

    monkeypatch.setattr(_problem, "recording", missing)
    assert main(["regress", "--quick"]) == 1
    assert "error: the recording is not on disk" in capsys.readouterr().err


QUICK = (
    (pytest.mark.slow, "regress thresholds long_record loops simulate refine"),
    (pytest.mark.thorough, "bootstraps discover controller"),
    (pytest.mark.thorough, "refinements scaling precision"),
)


@pytest.mark.recordings
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=mark) for mark, names in QUICK for name in names.split()],
)
def test_quick_benchmark_agrees_and_writes_nothing(name, monkeypatch, capsys):
    def unwanted(*_):
        raise AssertionError("a quick run wrote results")

    if name == "loops":
        pytest.importorskip("pmagpy")

    monkeypatch.setattr(_results, "write", unwanted)
    assert main([name, "--quick"]) == 0
    printed = capsys.readouterr().out
    other = "scipy" if name.startswith("refine") else "pysindy"
    others = {"long_record": "read the files", "precision": "float32"}
    others |= {"loops": "pmagpy", "controller": "scipy"}
    other = (others | {"scaling": "PySINDy"}).get(name, other)
    told = "devices" if name == "scaling" else "ratio"
    assert "hystjax" in printed and other in printed and told in printed
