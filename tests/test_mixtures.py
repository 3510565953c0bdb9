"""Laws over libraries whose terms hold numbers on a grid, which are then refined."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import hystjax as hj
from hystjax.discovery import _explore
from hystjax.discovery._layout import layout
from hystjax.discovery._setting import Setting
from hystjax.discovery.search import Trial, ordered
from hystjax.library import Fourier, Lag, Play, Polynomial, Term

RADII = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
LIBRARY = Polynomial(1, ("w", "u", "du", "|du|")) + Play(RADII)


def device(plays, slowness, seconds=30.0, samples=601, fine=20):
    """The output of w' = u'/4 + sum of a play(u, r) - w / slowness, by plays in a loop
    and Heun's method on a finer grid of the same straight lines."""
    t = np.linspace(0, seconds, samples)
    u = np.exp(-t / 25) * np.sin(2 * t) + 0.25 * np.sin(0.7 * t)
    times = np.linspace(0, seconds, (samples - 1) * fine + 1)
    inputs, h = np.interp(times, t, u), times[1]
    radii, shares = np.array(list(plays)), np.array(list(plays.values()))
    state, w, outputs = np.clip(0.0, inputs[0] - radii, inputs[0] + radii), 0.0, [0.0]
    for before, now in pairwise(inputs):
        slope = 0.25 * (now - before) / h
        first = slope + shares @ state - w / slowness
        state = np.clip(state, now - radii, now + radii)
        second = slope + shares @ state - (w + h * first) / slowness
        w += h * (first + second) / 2
        outputs.append(w)
    return hj.Recording(t, u, np.array(outputs)[::fine])


def noisy(record, level, seed):
    drawn = np.random.default_rng(seed).standard_normal(len(record))
    w = np.asarray(record.w) + level * np.std(record.w) * drawn
    return hj.Recording(record.t, record.u, w)


@pytest.fixture(scope="module")
def between():
    return device({0.37: 0.3}, 1 / 0.3)


def numbers_of(solution):
    """Of the numbers in terms the value and the standard error."""
    law, errors = solution.value, solution.stats["standard_errors"]
    return [
        (float(x), float(errors[name]))
        for name, x in law.parameters().items()
        if name not in law.terms()
    ]


def has_one_play(solution, radius):
    """Whether the law is that of one play, its radius within four standard errors."""
    play, *others = sorted(solution.value.terms(), key=lambda n: "play" not in n)
    if set(others) != {"w", "du"} or not play.startswith("play"):
        return False
    ((found, error),) = numbers_of(solution)
    return abs(found - radius) < 4 * error


@pytest.mark.thorough
@pytest.mark.parametrize("level", [0.01, 0.05])
def test_a_radius_between_those_of_the_grid_is_found(between, level):
    found = hj.discover(noisy(between, level, 1), LIBRARY, largest=4)
    assert has_one_play(found, 0.37)
    # Names show the numbers, in the law's library and in what is said of it.
    (name,) = set(found.value.terms()) - {"w", "du"}
    radius = found.value.parameters()[f"{name}.radius"]
    assert Term.parse(name).factors[0][0].numbers == {"radius": float(radius)}
    assert name in found.value.library.names
    assert len(found.value.library) == len(LIBRARY)
    assert set(found.stats["standard_errors"]) == set(found.value.parameters())
    # What was judged: one number more than it has terms.
    chosen = found.stats["candidates"][0]
    assert chosen.size == (3, 1)
    assert found.stats["apart"] < 0.01


@pytest.mark.thorough
@pytest.mark.parametrize(("level", "least"), [(0.01, 19), (0.05, 19)])
def test_a_radius_between_those_of_the_grid_is_found_in_20_records(
    between, level, least
):
    right = 0
    for seed in range(100, 120):
        found = hj.discover(noisy(between, level, seed), LIBRARY, largest=4)
        right += has_one_play(found, 0.37)
    assert right >= least


@pytest.mark.thorough
def test_two_plays_that_are_neighbours_stay_two():
    """Of which no single one does the work."""
    record = device({0.3: 0.2, 0.4: 0.15}, 1 / 0.35)
    found = hj.discover(noisy(record, 0.01, 1), LIBRARY, largest=4)
    assert {n for n in found.value.terms() if "play" not in n} == {"w", "du"}
    (a, a_error), (b, b_error) = sorted(numbers_of(found))
    assert abs(a - 0.3) < 4 * a_error < 0.2 and abs(b - 0.4) < 4 * b_error < 0.2


def setting(library, known=()):
    return Setting((), None, library, 4, 6, 0.0, known=dict.fromkeys(known, 1.0))  # pyright: ignore[reportArgumentType]


def test_neighbours_on_the_grid_are_tried_as_one_operator_between_them():
    library = Polynomial(1, ("w", "u")) * Play(RADII) + Lag([1.0, 5.0])
    law = Trial(
        {
            **{"play(u,0.3)": 1.0, "play(u,0.4)": 2.0, "play(u,0.6)": 3.0},
            "u*play(u,0.3)": 0.5,
        }
    )
    merged, itself = _explore.off_grid(setting(library), law)
    assert merged.terms == {
        "play(u,0.4)": 3.0,
        "play(u,0.6)": 3.0,
        "u*play(u,0.4)": 0.5,
    }
    assert merged.numbers == {
        "play(u,0.4).radius": pytest.approx(0.35),
        "play(u,0.6).radius": 0.6,
    }
    assert itself.terms == law.terms
    assert itself.numbers == {f"play(u,{r}).radius": r for r in (0.3, 0.4, 0.6)}
    # They begin where the numbers of a law have come to, and need not be of plays.
    moved = Trial(
        {"lag(u,1.0)": 1.0, "lag(u,5.0)": -0.5}, numbers={"lag(u,1.0).time": 2}
    )
    merged, _ = _explore.off_grid(setting(library), moved)
    assert merged.terms == {"lag(u,5.0)": 0.5}
    assert merged.numbers == {"lag(u,5.0).time": 3.5}


def test_a_part_of_a_law_is_tried_from_where_that_law_has_come_to(between):
    """The one without the term that does least, of which it has the radius."""
    record = noisy(between, 0.01, 1)
    free = Setting((record,), layout((record,), None, 1, False), LIBRARY, 4, 6, 0.0)
    numbers = {"play(u,0.4).radius": 0.37}
    truth = {"w": -0.3, "du": 0.25, "play(u,0.4)": 0.3}
    law = Trial(truth | {"u": 0.01}, numbers=numbers, starts=(float(record.w[0]),))
    close = _explore.close_to(free, np.arange(len(LIBRARY)), law)
    (guess,) = _explore.parts(free, close)
    assert guess.terms == {n: pytest.approx(x, rel=0.05) for n, x in truth.items()}
    assert guess.numbers == numbers
    # Without numbers a law has but one minimum close by, and without terms none.
    for other in (replace(law, numbers={}), replace(law, terms={"w": -1.0})):
        assert _explore.parts(free, close._replace(law=other)) == []
    # Nor is one tried with a sign that it is not to have.
    signed = free._replace(signs={"w": 1.0})
    assert _explore.parts(signed, close) == []


def test_what_holds_no_number_or_is_known_is_left_as_it_is():
    library = Polynomial(1, ("w",)) + Play([0.0, 0.1, 0.2]) + Fourier([2.0, 3.0])
    plain = Trial({"w": 1.0, "play(u,0.0)": 1.0})
    assert [*_explore.off_grid(setting(library), plain)] == []
    law = Trial({"w": 1.0, "play(u,0.2)": 1.0, "sin(2.0*u)": 1.0, "cos(3.0*u)": 1.0})
    (itself,) = _explore.off_grid(setting(library, ["play(u,0.1)", "cos(3.0*u)"]), law)
    assert itself.numbers == {"play(u,0.2).radius": 0.2, "sin(2.0*u).multiple": 2.0}


def test_a_law_goes_by_the_grid_that_its_numbers_have_come_closest_to():
    """So that it is one law, wherever it began; the sign of a radius means nothing."""
    within = setting(Polynomial(1, ("w",)) + Play(RADII))
    law = Trial({"play(u,0.3)": 1.0, "play(u,0.4)": 2.0})
    for numbers, names in [
        ((0.37, 0.52), ("play(u,0.4)", "play(u,0.5)")),
        ((0.52, -0.37), ("play(u,0.5)", "play(u,0.4)")),
        ((0.37, -0.38), ("play(u,0.3)", "play(u,0.4)")),  # one name does not do for two
    ]:
        of = dict(zip((f"{name}.radius" for name in law.terms), numbers, strict=True))
        named = _explore.on_grid(within, Trial(law.terms, numbers=of))
        assert named.terms == dict(zip(names, (1.0, 2.0), strict=True))
        radii = zip((f"{name}.radius" for name in names), numbers, strict=True)
        assert named.numbers == {name: abs(x) for name, x in radii}
        assert [*named.terms] == sorted(named.terms)  # in the library's order


def test_a_number_counts_as_a_term():
    two = Trial({"w": 1.0, "play(u,0.3)": 1.0, "play(u,0.4)": 1.0}, criterion=0.0)
    radius = {"play(u,0.4).radius": 0.37}
    one = Trial({"w": 1.0, "play(u,0.4)": 1.0}, criterion=1.0, numbers=radius)
    assert sum(one.size) == sum(two.size) == 3
    assert one.support != Trial(one.terms).support
    library = Polynomial(2, ("w", "u")) + Play(RADII)
    assert ordered([two, one], library)[0] is one
    # Numbers on the grid count too; where they do as well, they are not fitted.
    worse, equal = (Trial(one.terms, criterion=x) for x in (1.9, 1.05))
    assert ordered([two, one, worse], library)[0] is one
    assert ordered([two, one, equal], library)[0] is equal
    assert str(one).startswith("w, play(u,0.4), play(u,0.4).radius = 0.37: ")
