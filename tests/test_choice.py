"""The studies of what `discover` and `compare` choose on rows nobody fitted."""

import dataclasses
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax.comparison import Compared, Comparison
from hystjax.discovery import _discover, search
from hystjax.discovery.search import Trial
from hystjax.reproduce import _trust, reproduce


def recording(amplitude, n=120):
    t = np.linspace(0, 12, n)
    return hj.Recording(t, amplitude * np.sin(t), amplitude * np.cos(t))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_no_row_is_fitted_and_judged(count):
    recordings = [recording(1.0 + i) for i in range(count)]

    def rows(parts):
        """Each row by its time and the amplitude that it belongs to."""
        return {
            (round(float(t), 9), round(float(jnp.hypot(u, w)), 6))
            for each, _ in parts
            for t, u, w in zip(each.t, each.u, each.w, strict=True)
        }

    every = rows((each, None) for each in recordings)
    names = []
    for name, own, unseen in _trust.splits(recordings):
        assert own and unseen
        assert not rows(own) & rows(unseen)
        assert rows(own) | rows(unseen) == every
        for part in (*own, *unseen):  # the whole one is the circle of this radius
            radius = float(jnp.hypot(part.rows.u[0], part.rows.w[0]))
            np.testing.assert_allclose(part.whole, 2 * radius, rtol=2e-3)
        names.append(name)
    assert len(set(names)) == len(names) == 6
    if count > 1:
        low, high = next(s[1:] for s in _trust.splits(recordings) if "low" in s[0])
        assert max(p.whole for p in low) < min(p.whole for p in high)


def test_a_table_says_how_often_the_choice_was_good(monkeypatch):
    splits = iter(
        [
            _trust.Split("a", "first half", 3, 1.05, 1.0, 4.0),
            _trust.Split("a", "second half", 2, 3.0, 2.0, 2.0),
        ]
    )
    monkeypatch.setattr(_trust, "splits", lambda _: [("", [], []), ("", [], [])])
    monkeypatch.setattr(_trust, "_judged", lambda *_: next(splits))
    monkeypatch.setattr(_trust, "recordings_of", lambda _: [])
    table = _trust.choice(["a"])
    assert table.notes[0].startswith("Chosen within 10 % of the best in 50 %")
    assert (
        "at worst 1.5 times; by the old rule in 50 %, at worst 4 times"
        in (table.notes[0])
    )
    assert table.cells()[1][3:] == ("1.05", "1", "1.05", "4")


def test_a_stretch_at_rest_counts_by_the_range_of_its_recording():
    t = np.linspace(0, 12, 120)
    record = hj.Recording(t, np.sin(t), np.where(t < 6, 3 * np.sin(t), -0.5 + 1e-6 * t))
    law = hj.models.SparseModel.from_terms({"u": 3.0}, target="value")
    whole = float(np.ptp(record.w))
    parts = [_trust.Part(each, whole) for each in record.split(0.5)]
    missed = [np.asarray(3 * each.u - each.w) for each, _ in parts]
    expected = [100 * np.sqrt(np.mean(each**2)) / whole for each in missed]
    ours = [_trust.error_of(law, some) for some in (parts[:1], parts[1:], parts)]
    np.testing.assert_allclose(ours, [*expected, np.mean(expected)], atol=1e-9)
    np.testing.assert_allclose(parts[1].weights, whole**-2)


@pytest.mark.usefixtures("unchecked")
def test_where_all_laws_are_refused_the_output_stays(monkeypatch):
    law = hj.models.SparseModel.from_terms({"w": 0.0})
    nothing = SimpleNamespace(stats={"candidates": ()}, value=law)
    monkeypatch.setattr(_trust, "discover", lambda *_, **__: nothing)
    record = recording(2.0)
    parts = [_trust.Part(each, 4.0) for each in record.split(0.5)]
    row = _trust._judged("a", "first half", parts[:1], parts[1:])
    w = np.asarray(parts[1].rows.w)
    expected = 100 * np.sqrt(np.mean((w - w[0]) ** 2)) / 4
    assert row.terms == 0 and row.ratio == row.ratio_by_old_rule == 1
    np.testing.assert_allclose(row.chosen, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("criteria", "expected"),
    [
        # Fewer terms, as long as the criterion hardly tells them from its best.
        ({"du,u*|du|,w": 0.0, "w*|du|,du": 5.9, "u": 6.1}, "w*|du|,du"),
        # Of as many one that no rate is in, whatever the degrees; then lower ones.
        ({"w,w*|du|": 0.0, "u*|du|,w*|du|": 2.0}, "u*|du|,w*|du|"),
        ({"u*|du|,w*|du|": 0.0, "du,w*|du|": 3.0}, "du,w*|du|"),
        ({"du,w*|du|": 3.0, "du,u*|du|": 1.0}, "du,u*|du|"),
    ],
)
def test_the_old_rule_takes_the_plainest_within_six(criteria, expected):
    trials = [
        Trial(dict.fromkeys(names.split(","), 1.0), criterion=value)
        for names, value in criteria.items()
    ]
    law = _trust._by_old_rule(trials, hj.library.Polynomial(2))
    assert ",".join(law.terms) == expected


def test_no_law_is_taken_where_blocks_are_followed_best_without_one():
    """Though some are hardly worse, and a constant has no evidence of its own."""
    blocks = (1.0, 1.2, 0.9, 1.1)
    law = Trial({"du": 1.0}, criterion=0.0, squares=1.0, blocks=(1.1, 1.1, 1.0, 1.1))
    without = Trial({}, criterion=np.inf, squares=2.0, blocks=blocks)
    library = hj.library.Polynomial(2)
    assert search.ordered([law, without], library)[0] is without
    better = dataclasses.replace(law, blocks=(0.9, 1.1, 0.8, 1.0))
    assert search.ordered([better, without], library)[0] is better


@pytest.mark.usefixtures("unchecked")
def test_a_search_that_the_time_cuts_short_keeps_the_law_before():
    law, none = SimpleNamespace(refined=1, why="It."), SimpleNamespace(refined=None)
    law._replace = lambda why: SimpleNamespace(refined=1, why=why)
    task = SimpleNamespace(end=-np.inf, seconds=3.0)
    better = _discover._better
    _, kept = better(task, ("before", law), ("after", none))
    assert kept.refined and "The time was up" in kept.why
    task.end = np.inf
    assert better(task, ("before", law), ("after", none)) == ("before", law)
    assert better(task, ("before", none), ("after", law)) == ("after", law)


@pytest.mark.slow
def test_a_dashpot_does_not_run_away():
    """Three times as fast its force is three times as large."""
    t = np.linspace(0, 30, 601)
    u, du = np.sin(1.3 * t), 1.3 * np.cos(1.3 * t)
    u, du = u + 0.5 * np.sin(2.9 * t), du + 1.45 * np.cos(2.9 * t)
    record = hj.Recording(t, u, 2 * du, interpolation=hj.interpolation.Cubic())
    terms = map(hj.library.Term.parse, ("du", "u", "u^3"))
    found = hj.discover(record, hj.library.Library(tuple(terms)), target="value")
    assert found.value.terms().keys() == {"du"}


@pytest.mark.slow
def test_families_are_ranked_by_rows_that_none_was_fitted_on(monkeypatch):
    def gain(factor):
        return hj.models.SparseModel.from_terms({"u": factor}, target="value")

    def row(family, model, error):
        return Compared(family, model, (error, error), error, 1.0, 1, 0.0, "")

    rows = row("tight", gain(1.2), 0.1), row("true", gain(1.0), 0.2)
    lost = row("lost", hj.models.SparseModel.from_terms({"w": 1e9}), 0.3)
    compared = Comparison((*rows, lost), {}, 0.0)
    monkeypatch.setattr(_trust, "compare", lambda *_, **__: compared)
    t = np.linspace(0, 12, 120)
    record = hj.Recording(t, np.sin(t), 1.1 * np.sin(t) - 0.05)
    monkeypatch.setattr(_trust, "recordings_of", lambda _: [record])
    table = _trust.families(["a"])
    first, second = table.rows
    assert (first.first, first.best, first.place) == ("tight", "true", 2)
    unseen = record.split(0.5)[1]
    u, w = np.asarray(unseen.u), np.asarray(unseen.w)
    for error, factor in ((first.error, 1.2), (first.least, 1.0)):
        expected = np.sqrt(np.mean((factor * u - w) ** 2)) / np.ptp(w)
        np.testing.assert_allclose(error, 100 * expected, rtol=1e-9)
    assert second.split == "second half"
    assert table.notes[0].startswith("The first is the best in 0 of 2 splits")


@pytest.mark.recordings
@pytest.mark.thorough
def test_the_family_that_comes_first_is_the_best_where_nobody_fitted():
    rows = reproduce("families").rows
    assert sum(row.place == 1 for row in rows) >= 0.8 * len(rows)


@pytest.mark.recordings
@pytest.mark.thorough
def test_what_is_chosen_holds_on_rows_nobody_fitted():
    table = reproduce("choice")
    ratios = np.array([row.ratio for row in table.rows])
    assert len(ratios) >= 30
    assert np.all(ratios < 2) and np.mean(ratios <= 1.1) >= 0.9
