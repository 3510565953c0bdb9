"""Signs of terms, and a part of the law, that are known before it is looked for."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import hystjax as hj
from hystjax.cli import main
from hystjax.discovery import _choosing, _explore, _setting, search
from hystjax.discovery._layout import layout
from hystjax.discovery._setting import fixed_part, signs_of, with_part
from hystjax.library import Library, Polynomial, Term
from hystjax.models import SparseModel
from hystjax.regression import compress
from hystjax.signals import Signals
from hystjax.simulation import FixedStep

RNG = np.random.default_rng(3)
TRUTH = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
SETTING = _setting.Setting((), None, Polynomial(2), 4, 6, 0.0)  # pyright: ignore


def test_laws_of_another_sign_are_neither_tried_nor_taken():
    setting = SETTING._replace(signs=signs_of(Polynomial(2), {"|du|*w": -1, "du": 1}))
    right = search.Trial({"du": 1.0, "w*|du|": -0.1}, squares=1.0, beyond=0.0)
    wrong = dataclasses.replace(right, terms={"du": 1.0, "w*|du|": 0.1})
    without = dataclasses.replace(right, terms={"u*|du|": -0.1})
    admitted = [_explore.admitted(setting, each) for each in (right, wrong, without)]
    assert admitted == [True, False, True]
    assert _explore.untried(setting, [[wrong, right]], {}, 2) == [right]
    assert _explore.untried(SETTING, [[wrong]], {}, 2) == [wrong]
    worse = dataclasses.replace(right, squares=2.0)
    (said,) = _choosing._refused(setting, (worse, wrong), worse, "µm")
    assert "1 that follow better" in said and "`signs=None`" in said


def test_laws_that_are_known_to_be_impossible_tell_nothing_of_how_far_others_go():
    known = SETTING._replace(
        known={"w*|du|": -0.8}, signs=signs_of(Polynomial(2), {"w": 1})
    )
    assert _choosing._possible(known, {"w*|du|": -0.8, "du": 1.0})
    assert not _choosing._possible(known, {"w": 1.0, "du": 1.0})
    assert not _choosing._possible(known, {"w*|du|": -0.8, "w": -1.0})


def test_laws_that_are_refused_for_two_reasons_are_told_of_by_themselves(monkeypatch):
    left, each = search.Trial({"u": 1.0}, squares=9.0), []
    for name, squares in (("w", 1.0), ("du", 2.0), ("w^2", 3.0)):
        each.append(search.Trial({name: 1.0}, squares=squares))
    forgets = {"w": False, "du": False, "w^2": True}
    stays = {"w": False, "du": True, "w^2": False}
    for name, told in (("forgets", forgets), ("stays", stays)):
        look = lambda _, trial, told=told: told[next(iter(trial.terms))]  # noqa: E731
        monkeypatch.setattr(_explore, name, look)
    said = list(_choosing._refused(SETTING, (*each, left), left, "µm"))
    options = "`fading=False`", "`guard=False`", "`fading=False, guard=False`"
    for line, option in zip(said, options, strict=True):
        assert line.startswith("1 that follow better") and option in line


def test_a_law_is_tried_again_where_a_guess_promises_far_less_than_it_left():
    tried = {"du": 1.0}, {"w": 1.0}, {"u": 1.0}
    left = {
        each.support: each for each in (search.Trial(t, squares=8.0) for t in tried)
    }
    better, hardly, second = (
        search.Trial(terms, squares=squares)
        for terms, squares in zip(tried, (1.0, 3.0, 0.5), strict=True)
    )
    lists = [[better, second], [hardly]]
    assert _explore.untried(SETTING, lists, left, 2) == [better]


def test_what_a_known_part_leaves_is_its_least_squares():
    a, b = RNG.normal(size=(40, 5)), RNG.normal(size=40)
    known = np.array([0.7, 0.0, -2.0, 0.0, 0.0])
    problem = compress(jnp.asarray(a), jnp.asarray(b)).less(jnp.asarray(known))
    kept = np.array([1, 3, 4])
    triangle, target = map(np.asarray, (problem.triangle, problem.target))
    found = np.linalg.lstsq(triangle[:, kept], target, rcond=None)[0]
    expected = np.linalg.lstsq(a[:, kept], b - a @ known, rcond=None)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_a_choice_beside_a_known_part_is_their_sum():
    candidates = Polynomial(1, ("w", "du", "|du|"))
    library, part = with_part(candidates, {"|du|*u": 0.4, "du": 0.25})
    assert library.names[:2] == ("u*|du|", "du") and part == {"u*|du|": 0.4, "du": 0.25}
    assert set(library.names) == {*candidates.names, "u*|du|"}
    rows = jnp.array([library.names.index("w"), 0])
    choice = search.Choice(
        library,
        rows,
        jnp.array([True, False]),
        (jnp.asarray(-0.5), jnp.asarray(9.0)),
        fixed_part(library, part),
    )
    law = SparseModel.from_terms({"u*|du|": 0.4, "du": 0.25, "w": -0.5})
    w, u, du = jnp.asarray(RNG.normal(size=(3, 20)))
    now = Signals(jnp.zeros(20), u, du)
    ours, expected = (jax.vmap(each.rate)(w, (), now) for each in (choice, law))
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


T = np.linspace(0, 12, 241)
U = np.sin(1.3 * T) * (0.4 + 0.1 * T)


def recorded():
    truth = SparseModel.from_terms(TRUTH)
    run = hj.simulate(truth, hj.Recording(T, U, 0 * U), method=FixedStep(2))
    noise = np.random.default_rng(4).normal(size=len(T))
    return hj.Recording(T, U, np.asarray(run.w) + 0.02 * np.std(run.w) * noise)


FEW = Library(tuple(map(Term.parse, ("1", "w", "du", "|du|", "w*|du|"))))


@pytest.mark.slow
def test_a_law_is_found_beside_what_is_known_of_it():
    given = {"known": {"u*|du|": 0.4}, "signs": {"w*|du|": -1}, "guard": False}
    found = hj.discover(recorded(), FEW, **given, largest=2, width=3)
    terms = found.value.terms()
    assert terms.keys() == TRUTH.keys() and terms["u*|du|"] == 0.4
    assert found.stats["standard_errors"].keys() == {"du", "w*|du|"}
    for name, error in found.stats["standard_errors"].items():
        assert abs(terms[name] - TRUTH[name]) < 4 * float(error)
    for trial in found.stats["candidates"]:
        assert "u*|du|" not in trial.terms and trial.terms.get("w*|du|", -1) <= 0


@pytest.mark.slow
def test_what_is_known_is_not_chosen_again():
    """Of laws of the input alone, w less what a known part integrates to is the record
    of the others: how sure these are is the same."""
    candidates = Library(tuple(map(Term.parse, ("du", "|du|", "u*|du|"))))
    integral = cumulative_trapezoid(U, T, initial=0.0)  # exact, of straight lines
    noise = np.random.default_rng(3).normal(size=len(T))
    path = cumulative_trapezoid(np.abs(np.gradient(U, T)), T, initial=0.0)
    w = 0.5 * U + 0.02 * path + 0.3 * np.std(U) * noise
    options = {"largest": 2, "width": 3, "fading": False, "guard": False}
    shares = []
    for output, known in ((w, {}), (w + 0.01 * integral, {"u": 0.01})):
        record = hj.Recording(T, U, output)
        found = hj.discover(record, candidates, known=known, **options)
        shares.append(hj.inclusion(found, record, key=jax.random.key(0), samples=50))
    assert shares[1] == shares[0]
    assert any(0 < share < 1 for share in shares[0].values())


def test_a_known_part_is_no_choice(monkeypatch):
    """Evidence is that of the same law among the candidates alone."""
    record = hj.Recording(T, U, np.cos(T))
    alone = Library(tuple(map(Term.parse, ("du", "|du|", "u*|du|"))))
    law, without = search.Trial({"du": 1.0}, squares=2.0), search.Trial({}, squares=9.0)
    monkeypatch.setattr(_choosing, "_without_law", lambda *_: without)
    criteria = []
    for known in ({}, {"w": 0.1, "u^2*du": 0.2}):
        library, part = with_part(alone, known)
        laid_out = layout((record,), None, 1, False)
        setting = SETTING._replace(group=(record,), layout=laid_out, library=library)
        setting = setting._replace(known=part)
        assert setting.candidates.names == alone.names
        judged = _choosing._by_evidence(setting, (law,))
        criteria.append([trial.criterion for trial in judged])
    assert criteria[1] == pytest.approx(criteria[0], rel=1e-14)


@pytest.mark.slow
def test_terms_of_another_sign_are_not_included():
    """Told of `discover`, with the names that terms have in the law it found."""
    candidates = Library(tuple(map(Term.parse, ("du", "|du|", "u*|du|"))))
    path = cumulative_trapezoid(np.abs(np.gradient(U, T)), T, initial=0.0)
    noise = np.random.default_rng(3).normal(size=len(T))
    record = hj.Recording(T, U, 0.5 * U + 0.1 * path + 0.3 * np.std(U) * noise)
    options = {"largest": 2, "width": 3, "fading": False, "guard": False}
    found = hj.discover(record, candidates, signs={"|du|": 1, "du": 1}, **options)
    assert found.value.terms().keys() == {"du", "|du|"}
    assert found.stats["signs"] == {"du": 1, "|du|": 1}
    assert "signs" not in hj.discover(record, candidates, **options).stats
    turned = dataclasses.replace(found, stats=found.stats | {"signs": {"|du|": -1}})
    shares = [
        hj.inclusion(each, record, key=jax.random.key(0), samples=50)
        for each in (found, turned)
    ]
    assert shares[0]["|du|"] == 1 and shares[1]["|du|"] == 0


@pytest.mark.thorough
def test_where_all_is_known_no_law_is_found():
    alone = hj.discover(recorded(), FEW, known=TRUTH, largest=2, throw=False)
    assert alone.result == hj.RESULTS.no_law
    assert alone.value.terms() == TRUTH and "what is known of it" in alone.stats["why"]


REC = hj.Recording(T, U, np.cos(T))


@pytest.mark.parametrize(
    "given, message",
    [
        ({"signs": {"w^3": 1}}, "which is no candidate"),
        ({"signs": {"w*|du|": 2}}, "`signs` are 1 or -1"),
        ({"signs": {"w*|du|": np.ones(2)}}, "`signs` are 1 or -1"),
        ({"signs": {"wat": 1}}, "wat"),
        ({"signs": ["du"]}, r"`signs` must hold numbers by the names.*got \['du'\]"),
        ({"signs": {"u*|du|": 1, "|du|*u": -1}}, "`signs` names a term twice"),
        ({"known": {"w": np.nan}}, "must hold finite numbers, got nan for 'w'"),
        ({"known": {"du": "x"}}, "must hold finite numbers, got 'x' for 'du'"),
        ({"known": {"du": [1.0, 2.0]}}, "must hold finite numbers"),
        ({"known": ["du"]}, r"`known` must hold numbers by the names.*got \['du'\]"),
        ({"known": {"du": 1.0}, "signs": {"du": -1}}, "`known` says 1 for 'du', and"),
        ({"known": dict.fromkeys(hj.library.Duhem().names, 1.0)}, "nothing is left"),
        ({"known": {"du": 1.0}, "around": hj.models.Butterfly}, "`around` hides"),
        ({"known": {"w": 1.0}, "recordings": hj.Recording(None, U, T)}, "no clock"),
    ],
)
def test_what_is_no_knowledge_is_refused(unchecked, given, message):
    arguments = {"recordings": REC, "library": hj.library.Duhem()} | given
    if "around" in given:
        arguments |= {"size": 1.0, "key": jax.random.key(0)}
    with pytest.raises(hj.InputError, match=message):
        hj.discover(**arguments)


@pytest.mark.parametrize(
    "option", [("--sign", "w*|du|"), ("--sign", "w=1"), ("--known", "w=much")]
)
def test_options_that_say_nothing_are_refused(option, capsys):
    columns = ("--input", "u", "--output", "w")
    assert main(["discover", "none.csv", *columns, *option]) == 2
    assert "such as" in capsys.readouterr().err
