"""Laws of terms that change their sign with input and output: looked for on their own
too, and judged with the others."""

from types import SimpleNamespace

import numpy as np
import pytest

import hystjax as hj
from hystjax import search
from hystjax.discovery import _choosing, _discover, _setting
from hystjax.library import Library, Polynomial, Term
from hystjax.regression import formulation
from hystjax.regression._identify import factor

ODD = frozenset({"u", "du", "w*|du|"})
LIBRARY = Library(tuple(map(Term.parse, ("u*du", "u*|du|", "w*|du|", "w^2", "du"))))
TIMES = np.linspace(0, 1, 201)


def trial(terms, blocks=(), squares=1.0, criterion=0.0):
    names = dict.fromkeys(terms.split(), 1.0)
    return search.Trial(
        names, squares=squares, criterion=criterion, blocks=tuple(blocks)
    )


@pytest.mark.usefixtures("unchecked")
def test_the_best_of_each_size_are_judged_of_odd_laws_too(monkeypatch):
    """By what the best of these misses; each law once."""
    squares = {"u*du": 1.0, "w^2": 1.1, "u^2": 1.2, "w*du": 1.3, "u*|w|": 1.9}
    laws = [trial(name, squares=x) for name, x in squares.items()]
    odd = [
        trial(name, squares=x) for name, x in (("du", 4.0), ("u", 8.9), ("w*|du|", 9.1))
    ]
    nothing = trial("", (9.0, 9.0))
    judged = []
    monkeypatch.setattr(
        _choosing._explore, "left_out", lambda _, each: judged.extend(each) or []
    )
    layout = SimpleNamespace(count=1, blocks=np.zeros((1, 3)))
    monkeypatch.setattr(_choosing, "_has_rest", lambda _: False)
    ones = np.ones((1, 3))
    monkeypatch.setattr(_choosing, "_of_constants", lambda _: (ones, ones))
    setting = SimpleNamespace(odd=ODD, layout=layout)
    _choosing._by_blocks(setting, [*laws, *odd, nothing])  # pyright: ignore
    assert judged == [*laws[:3], *odd[:2]]
    judged.clear()
    setting.odd = ODD | {"u*du"}
    _choosing._by_blocks(setting, [*laws, *odd, nothing])  # pyright: ignore
    assert judged == laws[:3]  # of those the other two are hopeless


def rising(sign=1.0):
    u = TIMES - 0.5
    return hj.Recording(TIMES, u, sign * np.tanh(3 * u))


def told(record, library, part=()):
    problem = factor((record,), library, formulation.WeakForm(10))
    return _discover._mirrored(problem, library, dict.fromkeys(part, 1.0), (record,))


def test_of_terms_that_are_equal_where_the_input_rises_the_odd_ones_are_tried():
    record = rising()
    problem = factor((record,), LIBRARY, formulation.WeakForm(10))
    mirrored = told(record, LIBRARY)
    names = np.array(LIBRARY.names)
    assert [*names[mirrored]] == ["u*|du|", "w*|du|", "du"]
    assert names[0] == "u*du"
    for first, lost in ((mirrored, "u*du"), (np.arange(0), "u*|du|")):
        order = _discover._order(LIBRARY, {}, first)
        assert sorted(order) == [*range(len(LIBRARY))]
        rows, _ = _discover._tried(problem, LIBRARY, {}, True, order)
        assert [*names[rows]] == [name for name in names if name != lost]
    # Those of a known part come before all.
    order = _discover._order(LIBRARY, {"u*du": 1.0}, np.array([1, 2]))
    assert order.tolist() == [0, 1, 2, 3, 4]
    assert _discover._order(LIBRARY, {}, np.array([1, 4])).tolist() == [1, 4, 0, 2, 3]


def test_odd_laws_are_of_a_known_part_that_is_odd():
    names = ("w", "u*du", "du")
    odd = Library(tuple(map(Term.parse, names)))
    assert told(rising(), odd, names[:1]).tolist() == [2]
    even = Library(tuple(map(Term.parse, ("|w|", "u*du", "du"))))
    assert not len(told(rising(), even, ("|w|",)))
    alone = Library(tuple(map(Term.parse, ("w", "du", "w*|du|"))))
    assert not len(told(rising(), alone))  # all are, which are tried in any case
    aside = hj.Recording(TIMES, TIMES + 1, np.tanh(TIMES - 0.5))
    assert not len(told(aside, odd, names[:1]))  # one side of zero alone


@pytest.mark.parametrize(
    ("u", "w", "expected"),
    [
        ((-1.0, 1.0), (-5.0, 5.0), True),
        ((-0.2, 1.0), (-5.0, 0.9), True),
        ((-0.05, 1.0), (-5.0, 5.0), False),
        ((-1.0, 1.0), (-5.0, 0.3), False),
        ((1.0, 3.0), (-5.0, 5.0), False),
        ((-1.0, 1.0), (-5.0, -2.0), False),
    ],
)
def test_symmetry_is_asked_where_both_sides_of_zero_are_recorded(u, w, expected):
    """On one recording or another."""
    t = np.linspace(0, 1, 9)
    ends = [np.interp(t, (0, 1), pair) for pair in (u, w)]
    whole = hj.Recording(t, *ends)
    assert _discover._about_zero((whole,)) is expected
    assert _discover._about_zero(whole.split(0.5)) is expected


@pytest.mark.usefixtures("unchecked")
def test_the_search_goes_on_among_odd_terms_where_blocks_decide(monkeypatch):
    """With the laws that were found among all."""
    library = Polynomial(2)
    names = list(library.names)
    rows, mirrored = np.array([0, 2, 3, 5]), np.array([2, 5])
    problem = SimpleNamespace(columns=lambda rows: rows)
    task = SimpleNamespace(
        library=library, problem=problem, mirrored=mirrored, told=rows, end=1.0
    )
    task.progress = task.draws = None
    task.records = ()
    before, seen = (trial("w"),), {}

    def explored(task, setting, problem, tried=()):
        return before

    def regressed(setting, problem, rows):
        seen["columns"], seen["among"] = problem, rows
        return ()

    def explore(setting, stages, end, progress, tried):
        seen["before"] = tried
        return (*tried, trial("u"))

    monkeypatch.setattr(_discover, "_explored", explored)
    monkeypatch.setattr(_discover, "wants_more", lambda *_: False)
    monkeypatch.setattr(_discover, "regressed", regressed)
    monkeypatch.setattr(_discover, "explore", explore)
    setting = _setting.Setting((), None, library, 3, 6, 0.0)  # pyright: ignore
    for decided in (False, True):
        monkeypatch.setattr(_discover, "decided_by_blocks", lambda *_, d=decided: d)
        last, tried = _discover._searched(task, setting, rows)  # pyright: ignore
        assert list(last.library.names) == [names[row] for row in rows]
        assert last.odd == ({names[2], names[5]} if decided else set())
        assert len(tried) == (2 if decided else 1)
    assert seen["before"] == before
    np.testing.assert_array_equal(seen["columns"], rows)
    np.testing.assert_array_equal(seen["among"], [1, 3])


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("wanted", "needed", "searches"),
    [
        ((1, 1), (1, 1), [1]),
        ((2, 2), (2, 2), [1, 2]),
        ((2, 8, 8), (2, 8, 8), [1, 2, 8]),
        ((2, 8, 32), (2, 8, 32), [1, 2, 8]),
        # For want of any law that explains the record once alone.
        ((4, 16, 64), (1, 1, 1), [1, 4]),
        ((4, 16, 64), (None, None, None), [1, 4]),
    ],
)
def test_the_search_is_made_again_with_the_steps_of_its_law(
    monkeypatch, wanted, needed, searches
):
    steps = []

    def laid_out(setting, weights, substeps):
        return SimpleNamespace(
            layout=SimpleNamespace(samples=SimpleNamespace(substeps=substeps)),
            weights=weights,
        )

    def once(task, setting):
        steps.append(setting.layout.samples.substeps)
        needs = needed[len(steps) - 1]
        refined = None if needs is None else SimpleNamespace(substeps=needs)
        found = SimpleNamespace(substeps=wanted[len(steps) - 1], refined=refined)
        return setting, found

    monkeypatch.setattr(_discover, "_laid_out", laid_out)
    monkeypatch.setattr(_discover, "_found_once", once)
    monkeypatch.setattr(_discover, "_by_variance", lambda *_: None)
    task = SimpleNamespace(records=(), end=np.inf)
    _, found = _discover._found(task, laid_out(None, None, 1))  # pyright: ignore
    assert steps == searches and found.substeps == wanted[len(steps) - 1]
    steps.clear()
    task.records = (1,)  # hidden laws are found without any
    _discover._found(task, laid_out(None, None, 1))  # pyright: ignore
    assert steps == [1]


@pytest.mark.recordings
@pytest.mark.slow
@pytest.mark.parametrize("fitted", [0, 1])
def test_half_a_loop_of_steel_tells_the_other_half(fitted):
    """That rises or falls alone: terms of u' and |u'| are the same there, and with the
    first of each two the other half is missed by its whole range."""
    halves = hj.datasets.load("no27_steel").split(0.5)
    own, unseen = halves[fitted], halves[1 - fitted]
    found = hj.discover(own)
    assert float(hj.judge(found.value, unseen).errors["nrmse"]) < 0.1
    # What might stand in the place of its terms is told.
    assert {"u*du", "|du|", "w*du"} <= {each.term for each in found.stats["aliases"]}
