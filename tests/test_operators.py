"""Plays, relays and what is made of them: exact by every way, and found again."""

import re
from dataclasses import replace

import classical_equations as by_hand
import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings

import hystjax as hj
from hystjax import InputError
from hystjax._core.compiling import launched as launched_anywhere
from hystjax.library import Kind, Relays, Staircase, _memory, _operators, _parallel
from hystjax.library._memory import along_turns
from hystjax.library._operators import Lag
from hystjax.library._parallel import (
    Stack,
    Weighted,
    _at_samples,
    _last_pulls,
    enveloped,
    summed,
    weighted,
)
from hystjax.models import Envelope, Everett, PrandtlIshlinskii, Preisach
from hystjax.models._preisach import _together, best_sum, inputs_by_travel
from hystjax.signals import Signals

RNG = np.random.default_rng(5)
N = 1300  # so many that turning points may be the shorter way
SMOOTH = np.sin(np.linspace(0, 40, N)) * np.exp(-np.linspace(0, 2, N))
WALK = 0.05 * np.cumsum(RNG.normal(size=N))
RESTS = np.round(4 * SMOOTH) / 4  # stands still for a while, in either direction
RADII = np.array([0.0, 0.05, 0.2, 0.5])
INPUTS = {"smooth": SMOOTH, "a walk": WALK, "with rests": RESTS}


def started(u, radii=RADII):
    return np.clip(0.0, u[0] - radii, u[0] + radii)


def plays(u, radii, first):
    return enveloped(u, (u, u), radii, first)


ALONG = jax.jit(plays)
SUMMED = jax.jit(weighted)
ENDS = st.lists(st.floats(-1, 1), min_size=2, max_size=30)  # of straight lines


# --------------------------------------------------------------------- turning points


@pytest.mark.parametrize("name", INPUTS)
def test_the_short_way_is_the_long_one(name):
    u = INPUTS[name]
    found = ALONG(u, RADII, started(u))
    np.testing.assert_array_equal(found, by_hand.plays(u, RADII, started(u)))


@settings(max_examples=40, deadline=None)
@given(ENDS, st.integers(0, 2**32 - 1))
def test_the_short_way_is_the_long_one_whatever_the_turns(ends, seed):
    """Straight from one end to the next, in steps of any length, with rests."""
    rng = np.random.default_rng(seed)
    shares = np.sort(rng.uniform(0, len(ends) - 1, N))
    u = np.interp(np.repeat(shares[::2], 2), np.arange(len(ends)), ends)
    found = ALONG(u, RADII, started(u))
    np.testing.assert_array_equal(found, by_hand.plays(u, RADII, started(u)))


@settings(max_examples=40, deadline=None)
@given(ENDS, st.integers(0, 2**32 - 1))
def test_sums_by_pieces_are_those_of_the_loop_whatever_the_turns(ends, seed):
    """Of more plays than are taken together, between two edges; with turns at ends of
    blocks and inside, more than one of them too, and with rests."""
    rng = np.random.default_rng(seed)
    radii, weights = rng.uniform(0, 0.5, 11), rng.normal(size=11)
    shares = np.sort(rng.uniform(0, len(ends) - 1, N))
    u = np.interp(np.repeat(shares[::2], 2), np.arange(len(ends)), ends)
    first = np.clip(0.0, u[0] - radii, 1.5 * u[0] + 2 + radii)
    p, expected = first, []
    for each in u:
        p = np.clip(p, each - radii, 1.5 * each + 2 + radii)
        expected.append(weights @ p)
    found = SUMMED(Stack(first, radii, weights), u, (u, 1.5 * u + 2))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("large", [np.inf, 1e14])
def test_a_radius_that_no_input_comes_to_costs_a_sum_nothing(large):
    """Such a play never moves, wherever it is."""
    radii, weights = np.append(RADII, large), np.array([0.3, 0.5, 0.2, 0.1, 2.0])
    first = np.append(started(SMOOTH), 0.7)
    found = SUMMED(Stack(first, radii, weights), SMOOTH, (SMOOTH, SMOOTH))
    moving = by_hand.plays(SMOOTH, RADII, first[:-1]) @ weights[:-1]
    np.testing.assert_allclose(found, moving + 2.0 * 0.7, rtol=0, atol=1e-13)


def test_sums_in_batches_are_those_one_by_one():
    stack = Stack(np.zeros(4), RADII, np.array([0.3, 0.5, 0.2, 0.1]))
    for batch in (np.stack([SMOOTH, RESTS]), np.stack([SMOOTH, WALK])):
        along = jax.jit(jax.vmap(weighted, (None, 0, 0)))
        for one, u in zip(along(stack, batch, (batch, batch)), batch, strict=True):
            expected = by_hand.plays(u, RADII, np.zeros(4)) @ stack.weights
            np.testing.assert_allclose(one, expected, rtol=0, atol=1e-14)


def test_batches_of_inputs_take_the_way_that_is_short_for_all():
    """Of inputs with other numbers of turns, one of which has too many."""
    both = np.stack([SMOOTH, RESTS])
    every = np.stack([SMOOTH, RESTS, WALK])
    for batch in (both, every):
        first = np.stack([started(u) for u in batch])
        found = jax.jit(jax.vmap(plays, (0, None, 0)))(batch, RADII, first)
        for one, u in zip(found, batch, strict=True):
            np.testing.assert_array_equal(one, by_hand.plays(u, RADII, started(u)))


def test_no_loop_over_samples_is_run_where_turns_are_few():
    """The states themselves say so: those of `after` are counted."""

    def counted(m, row):
        return jnp.maximum(m + 1, -1)

    def steps(u):
        return along_turns(counted, jnp.zeros(()), u, u)[-1]

    assert steps(jnp.asarray(SMOOTH)) < 30
    assert steps(jnp.asarray(WALK)) == N


@pytest.mark.parametrize("name", ["smooth", "a walk"])
def test_derivatives_are_those_of_the_loop(name):
    """In weights, radii, first states and the input; where a play is of radius 0 too,
    of which autodiff of `clip` would give a mean of both sides."""
    u, weights = jnp.asarray(INPUTS[name]), jnp.array([0.3, 0.5, 0.2, 0.1])
    target = jnp.cos(jnp.arange(N))

    def scanned(u, radii, first):
        def after(p, u):
            low, high = u - radii, u + radii
            p = jnp.where(p < low, low, jnp.where(p > high, high, p))
            return p, p

        return jax.lax.scan(after, first, u)[1]

    def loss(way, weights, radii, first, u):
        return jnp.sum(target * (way(u, radii, first) @ weights) ** 2)

    point = weights, jnp.asarray(RADII), jnp.asarray(started(u)), u
    one, other = (
        jax.jit(jax.grad(lambda *x, way=way: loss(way, *x), argnums=(0, 1, 2, 3)))
        for way in (plays, scanned)
    )
    for found, expected in zip(one(*point), other(*point), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    direction = jax.tree.map(lambda x: jnp.asarray(RNG.normal(size=x.shape)), point)
    forward = jax.jvp(lambda *x: loss(plays, *x), point, direction)[1]
    reverse = sum(jnp.vdot(a, b) for a, b in zip(one(*point), direction, strict=True))
    np.testing.assert_allclose(forward, reverse, rtol=1e-10)


@pytest.fixture
def launched(monkeypatch):
    """As on a GPU, where a loop over samples would launch each step by itself."""
    for where in (_memory, _operators, _parallel):
        monkeypatch.setattr(where, "launched", lambda: True)


def as_on_a_gpu(function, *arguments):
    """What a function gives without a loop over samples."""
    program = jax.make_jaxpr(lambda *x: function(*x))(*arguments)
    lengths = re.findall(r"\blength=(\d+)", str(program))
    assert "while[" not in str(program)
    assert all(int(length) < 20 for length in lengths)
    return jax.jit(lambda *x: function(*x))(*arguments)


@pytest.mark.usefixtures("launched")
@pytest.mark.parametrize("name", INPUTS)
def test_samples_put_together_are_those_one_by_one(name):
    """Plays to the last bit; a sum of more than are in memory together; heights."""
    u = INPUTS[name]
    found = as_on_a_gpu(plays, u, RADII, started(u))
    np.testing.assert_array_equal(found, by_hand.plays(u, RADII, started(u)))

    rng = np.random.default_rng(8)
    radii, weights = rng.uniform(0, 0.5, 41), rng.normal(size=41)
    first = started(u, radii)
    found = as_on_a_gpu(weighted, Stack(first, radii, weights), u, (u, u))
    expected = by_hand.plays(u, radii, first) @ weights
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)

    quarters = np.linspace(-1, 1, 9)  # on which the input rests
    levels = quarters if name == "with rests" else LEVELS
    memory = Staircase(jnp.asarray(levels), "demagnetised")
    grid = hj.Recording(None, u, u).path.grid(1)
    m = memory.start(Signals(*(x[0] for x in grid.start)))
    found = as_on_a_gpu(memory.along, m, grid)
    for one, other in zip(found, super(Staircase, memory).along(m, grid), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.usefixtures("launched")
def test_samples_put_together_have_the_derivatives_of_those_one_by_one():
    """Of a weighted sum, and of something else made of the plays."""
    target = jnp.cos(jnp.arange(N))
    point = jnp.array([0.3, 0.5, 0.2, 0.1]), jnp.asarray(RADII), jnp.asarray(WALK)

    def loss(along, weights, radii, u):
        first = jax.lax.stop_gradient(jnp.clip(0.0, u[0] - radii, u[0] + radii))
        return jnp.sum(target * along(weights, radii, first, u) ** 2)

    def by_loop(weights, radii, first, u):
        def after(p, u):
            low, high = u - radii, u + radii
            p = jnp.where(p < low, low, jnp.where(p > high, high, p))
            return p, weights @ p

        return jax.lax.scan(after, first, u)[1]

    def seen(weights, radii, first, u):
        see, rows = Weighted(weights, jnp.zeros(())), Signals(u, u, u)
        return summed(see, u, (u, u), radii, first, rows)

    def seen_otherwise(weights, radii, first, u):
        see = jax.tree_util.Partial(lambda weights, p, row: weights @ p, weights)
        return summed(see, u, (u, u), radii, first, u)

    expected = jax.grad(lambda *x: loss(by_loop, *x), (0, 1, 2))(*point)
    for along in (seen, seen_otherwise):
        gradient = jax.grad(lambda *x, along=along: loss(along, *x), (0, 1, 2))
        for one, other in zip(as_on_a_gpu(gradient, *point), expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)


def test_lags_put_together_are_those_one_by_one(monkeypatch):
    times, first = jnp.array([0.01, 0.3, 5.0]), jnp.array([0.2, -0.1, 0.0])
    t = np.cumsum(np.random.default_rng(9).uniform(0.001, 0.2, N))
    grid = hj.Recording(t, WALK, WALK).path.grid(1)
    expected = jax.jit(Lag.along)(times, first, grid)
    monkeypatch.setattr(_operators, "launched", lambda: True)
    found = as_on_a_gpu(Lag.along, times, first, grid)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


def test_loops_are_launched_anywhere_but_on_a_processor():
    """The one that JAX is told to take, or its own."""
    assert launched_anywhere() == (jax.default_backend() != "cpu")
    with jax.default_device(jax.devices("cpu")[0]):
        assert not launched_anywhere()
    with jax.default_device("cpu"):
        assert not launched_anywhere()
    with jax.default_device("gpu"):
        assert launched_anywhere()


# ----------------------------------------------------------------- Prandtl-Ishlinskii

T = np.linspace(0, 40, N)
STACK = PrandtlIshlinskii(RADII, [0.3, 0.5, 0.2, 0.1], 0.4)


@pytest.mark.parametrize("name", INPUTS)
def test_a_stack_is_the_sum_of_its_plays(name):
    u = INPUTS[name]
    record = hj.Recording(T, u, u + T)
    expected = by_hand.plays(u, RADII, started(u)) @ [0.3, 0.5, 0.2, 0.1] + 0.4
    ran = hj.simulate(STACK, record)
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-14)


def test_gradients_of_simulations_are_those_of_the_states():
    """A simulation sees its plays block by block; its memory keeps them all."""
    record = hj.Recording(T, SMOOTH, SMOOTH + T)
    path = record.path

    def kept(model):
        starts, _, ends = model.memory.along(model.memory.first(path), path.grid(1))
        p = jnp.concatenate([starts, ends[-1:]])
        return jnp.sum(jnp.sin(T) * (p @ model.weights + model.offset) ** 2)

    def seen(model):
        w = hj.simulate(model, record, w0=0.0).w
        return jnp.sum(jnp.sin(T) * w**2)

    for found, expected in zip(
        jax.tree.leaves(jax.grad(seen)(STACK)),
        jax.tree.leaves(jax.grad(kept)(STACK)),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_stops_are_what_plays_leave():
    radii, weights = np.array([0.1, 0.4]), np.array([2.0, 0.5])
    model = PrandtlIshlinskii.of_stops(radii, weights, direct=0.2, offset=1.0)
    stops = WALK[:, None] - by_hand.plays(WALK, radii, started(WALK, radii))
    ran = hj.simulate(model, hj.Recording(None, WALK, WALK))
    expected = 1.0 + 0.2 * WALK + stops @ weights
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-14)


def test_envelopes_saturate():
    """Against the generalised play by hand."""
    rising, falling = Envelope(1.0, 2.0, -0.3), Envelope(1.1, 2.0, 0.1, 0.1)
    radii = np.array([0.05, 0.3])
    model = PrandtlIshlinskii(radii, [1.0, 0.5], rising=rising, falling=falling)
    u = 2 * SMOOTH

    def edges(u):
        return np.tanh(2 * u - 0.3), 1.1 * np.tanh(2 * u + 0.1) + 0.1

    p, expected = np.zeros(2), []
    for low, high in zip(*edges(u), strict=True):
        p = np.clip(p, low - radii, high + radii)
        expected.append(p @ [1.0, 0.5])
    ran = hj.simulate(model, hj.Recording(None, u, u))
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-14)
    lowest = np.min(ran.w), np.max(ran.w)
    assert lowest[0] > -1.5 and lowest[1] < 1.8


def test_its_equation_is_that_of_a_law_of_plays():
    assert str(STACK) == (
        "w = 0.4 + 0.3 u + 0.5 play(u, 0.05) + 0.2 play(u, 0.2) + 0.1 play(u, 0.5)"
    )
    radii, slopes = STACK.density()
    np.testing.assert_allclose(slopes, [0.3, 0.8, 1.0, 1.1])
    np.testing.assert_array_equal(radii, RADII)
    twice = PrandtlIshlinskii([0.2, 0.0, -0.2], [0.5, 1.0, 0.25])
    assert twice.terms() == {"play(u,0.2)": 0.75, "u": 1.0}


def test_the_derivative_in_a_radius_of_zero_is_that_of_either_side():
    """Of the input itself, which from rest at 0 has never turned without moving."""
    u, target = SMOOTH[:200], jnp.cos(jnp.arange(200))
    record = hj.Recording(None, u, u)

    def loss(radius):
        model = PrandtlIshlinskii(jnp.stack([radius]), [0.3])
        return jnp.sum(target * hj.simulate(model, record).w)

    way = np.append(0.0, np.sign(np.diff(u)))
    expected = -0.3 * np.sum(np.asarray(target) * way)
    assert float(jax.grad(loss)(jnp.array(0.0))) == pytest.approx(expected)


@pytest.mark.parametrize("u", [RESTS, np.concatenate([np.zeros(9), RESTS])])
def test_a_radius_of_zero_follows_each_sample_where_the_input_rests_too(u):
    """It is the input itself, sample by sample, in both ways to put samples together
    and step by step."""
    target, times = np.cos(np.arange(len(u))), np.arange(float(len(u)))
    model, u = PrandtlIshlinskii([0.0], [0.3]), jnp.asarray(u)

    def simulated(u):
        return target @ hj.simulate(model, hj.Recording(times, u, 0 * u)).w

    def stepped(u):
        def step(state, now):
            m = model.memory.after(*state, now)
            return (m, now), 0.3 * m[0]

        rows = Signals(jnp.asarray(times), u, jnp.zeros_like(u))
        first = jax.tree.map(lambda x: x[0], rows)
        began = model.memory.start(first), first
        return target @ jax.lax.scan(step, began, rows)[1]

    for found in (jax.grad(simulated)(u), jax.grad(stepped)(u)):
        np.testing.assert_allclose(found, 0.3 * target, atol=1e-15)
    given = (u, u), jnp.asarray(RADII), jnp.asarray(started(np.asarray(u)))
    marks = jnp.zeros(len(RADII), jnp.int32)
    together = _at_samples(*given, marks)[1]
    np.testing.assert_array_equal(together[:, 0], _last_pulls(u, *given)[:, 0])


def test_its_density_is_the_slope_of_a_first_loading():
    """Whatever the order of its plays."""
    radii, weights = np.array([0.5, 0.0, 0.2]), np.array([0.3, 1.0, -0.4])
    at, slopes = PrandtlIshlinskii(radii, weights).density()
    np.testing.assert_array_equal(at, np.sort(radii))
    expected = [np.sum(weights[radii <= each]) for each in np.sort(radii)]
    np.testing.assert_allclose(slopes, expected, rtol=1e-15)


def test_plays_of_no_weight_make_no_hysteresis():
    assert PrandtlIshlinskii([0.0, 0.2], [1.0, 0.0]).kind is Kind.MEMORYLESS
    assert PrandtlIshlinskii([0.0, 0.2], [1.0, 0.1]).kind is Kind.RATE_INDEPENDENT


def test_bad_stacks_are_refused():
    with pytest.raises(InputError, match=r"one length.*\(2,\) and \(1,\)"):
        PrandtlIshlinskii([0.1, 0.2], [1.0])
    with pytest.raises(InputError, match=r"`radii` .* shapes \(\) and \(\)"):
        PrandtlIshlinskii(0.1, 1.0)
    with pytest.raises(InputError, match=r"shapes \(2,\) and \(1,\)"):
        PrandtlIshlinskii.of_stops([0.1, 0.2], [1.0])
    with pytest.raises(InputError, match="real numbers, or arrays of them; got a list"):
        PrandtlIshlinskii([[0.1], [0.2, 0.3]], [1.0, 1.0])
    with pytest.raises(InputError, match="`scale` must be positive, got -1"):
        Envelope(-1.0, 1.0)


@pytest.mark.parametrize("side", ["rising", "falling"])
def test_numbers_in_the_place_of_an_envelope_are_refused(unchecked, side):
    with pytest.raises(InputError, match=rf"`{side}` .*`Envelope\(.*got a tuple"):
        PrandtlIshlinskii([0.1], [1.0], **{side: (1.0, 0.8)})


# --------------------------------------------------------------------------- Preisach

ROWS = 9
ROW, COLUMN = np.tril_indices(ROWS)
LEVELS = np.linspace(-0.7, 0.9, ROWS + 1) + 0.02 * np.sin(np.arange(ROWS + 1))
RELAY_WEIGHTS = RNG.uniform(0, 1, len(ROW))


def relayed(u, up, down, m):
    """Sums of relays one by one, by NumPy."""
    out = []
    for each in u:
        m = np.where(each >= up, True, np.where(each <= down, False, m))
        out.append(np.where(m, 1.0, -1.0))
    return np.array(out)


# Relays turn where the input comes to a threshold, and not only beyond it.
AT_LEVELS = LEVELS[np.random.default_rng(6).integers(0, len(LEVELS), N)]


@pytest.mark.parametrize("initial", ["demagnetised", "up", "down"])
@pytest.mark.parametrize("name", [*INPUTS, "at levels"])
def test_the_staircase_is_the_relays_one_by_one(name, initial):
    u, (up, down) = INPUTS.get(name, AT_LEVELS), (LEVELS[ROW + 1], LEVELS[COLUMN])
    first = {
        "up": np.ones(len(ROW), bool),
        "down": np.zeros(len(ROW), bool),
        "demagnetised": up + down < LEVELS[0] + LEVELS[-1],
    }[initial]
    expected = 0.3 + relayed(u, up, down, first) @ RELAY_WEIGHTS
    model = Preisach(LEVELS, RELAY_WEIGHTS, 0.3, initial)
    found = hj.simulate(model, hj.Recording(None, u, u)).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("around", ["ideal instruments", "started", "no wrapper"])
def test_relays_inside_of_other_models_turn_at_their_levels(around):
    """Whole numbers of volts, and the last sample at a threshold too."""
    levels = np.arange(ROWS + 1) / 10
    u = levels[np.random.default_rng(7).integers(0, ROWS + 1, N)]
    record = hj.Recording(np.cumsum(RNG.uniform(0.01, 1, N)), u, u)
    up, down = levels[ROW + 1], levels[COLUMN]
    model = Preisach(levels, RELAY_WEIGHTS, initial="down")
    expected = relayed(u, up, down, np.zeros(len(ROW), bool)) @ RELAY_WEIGHTS
    model = {
        "ideal instruments": lambda: hj.models.Instrumented(model, 1.0),
        "started": lambda: hj.models.Started.at_rest(model, record),
        "no wrapper": lambda: model,
    }[around]()
    found = hj.simulate(model, record).w
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_relays_are_memory_too():
    """They turn at their thresholds, from where they stood before the first input."""
    up, down = LEVELS[[5, 8]], LEVELS[[1, 6]]
    u = np.append(0.0, AT_LEVELS)
    path = hj.Recording(None, u, u).path
    for initial, stand in (
        *(("down", [False, False]), ("up", [True, True])),
        ("demagnetised", [True, False]),
    ):
        relays = Relays(up, down, initial)
        starts, _, ends = relays.along(relays.first(path), path.grid(1))
        found = np.concatenate([starts, ends[-1:]])
        expected = relayed(u, up, down, np.array(stand)) > 0
        np.testing.assert_array_equal(found, expected)
        signals = relays.values(found[-1], Signals(*(x[-1] for x in path.signals())))
        assert float(signals["relay 0"]) == 2.0 * found[-1][0] - 1
    with pytest.raises(InputError, match="`up` must be above `down`"):
        Relays([0.1], [0.2])
    with pytest.raises(InputError, match=r"`initial` must be one of.*'left'"):
        Relays([0.2], [0.1], "left")


def test_heights_between_samples():
    """At middles of steps too."""
    memory = Staircase(jnp.asarray(LEVELS), "demagnetised")
    grid = hj.Recording(None, WALK, WALK).path.grid(1)
    m = memory.start(Signals(*(x[0] for x in grid.start)))
    for one, other in zip(
        memory.along(m, grid), super(Staircase, memory).along(m, grid), strict=True
    ):
        np.testing.assert_array_equal(one, other)


MODELS = {
    "Preisach": Preisach(LEVELS, RELAY_WEIGHTS),
    "Everett": Everett(
        [0.0, 0.1, 0.35], np.linspace(-0.7, 0.9, 5), RNG.uniform(0.2, 1, (3, 4))
    ),
    "Everett, of stops": Everett(
        [0.02, 0.1, 0.35],
        np.linspace(-0.5, 0.7, 5),
        RNG.uniform(0.2, 1, (3, 4)),
        sign=-1,
        curve=RNG.uniform(-0.3, 0.5, 4),
    ),
    "Prandtl-Ishlinskii": STACK,
}


@pytest.mark.parametrize("name", MODELS)
def test_return_points_are_remembered_and_minor_loops_congruent(name):
    drive = hj.properties.Drive(-0.7, 0.9, 1.0, cycles=2, steps=64)
    found = hj.properties.examine(MODELS[name], drive)
    assert float(found.memory_loss) <= 1e-15
    # Differences of outputs of the order of 1, whose rounding they have.
    assert float(found.incongruency) <= 1e-14
    assert float(found.rate_dependence) <= 1e-15


def test_an_everett_function_is_what_outputs_fall_by():
    model = MODELS["Everett"]
    highs, lows = np.array([0.9, 0.6, 0.3, 0.3]), np.array([-0.7, -0.2, 0.25, 0.3])
    for high, low in zip(highs, lows, strict=True):
        u = np.r_[0.0, -3.0, high, low]
        w = hj.simulate(model, hj.Recording(None, u, u + 1)).w
        np.testing.assert_allclose(model.everett(high, low), w[2] - w[3], atol=1e-14)
    falls = np.asarray(model.everett(highs[:, None], np.linspace(-2, 0.2, 7)))
    assert np.all(np.diff(falls, axis=1) <= 1e-15)  # rising with the width
    leading = replace(model, curve=jnp.array([0.9, 0.2, -0.1, 0.5]), sign=-1)
    for high, low in zip(highs, lows, strict=True):
        u = np.r_[0.0, -3.0, high, low]
        w = hj.simulate(leading, hj.Recording(None, u, u + 1)).w
        np.testing.assert_allclose(leading.everett(high, low), w[2] - w[3], atol=1e-14)
    mirrored = Everett(-model.radii, model.centres, model.roots)  # the same plays
    np.testing.assert_array_equal(
        mirrored.everett(highs, lows), model.everett(highs, lows)
    )


def test_bad_planes_are_refused():
    with pytest.raises(InputError, match="6 relays"):
        Preisach([0.0, 1.0, 2.0, 3.0], np.ones(5))
    for levels in ([0.0, 2.0, 1.0], [0.0, np.nan, 1.0], 0.0):
        with pytest.raises(InputError, match="`levels` must be two numbers or more"):
            Preisach(levels, np.ones(3))
    with pytest.raises(InputError, match="above its diagonal"):
        Preisach([0.0, 1.0, 2.0], [[1.0, 3.0], [1.0, 1.0]])
    with pytest.raises(InputError, match=r"`roots` .* shape \(1, 1\); got \(2, 1\)"):
        Everett([0.1], [0.0, 1.0], np.ones((2, 1)))
    with pytest.raises(InputError, match=r"`curve` .* shape \(1,\); got \(2,\)"):
        Everett([0.1], [0.0, 1.0], np.ones((1, 1)), curve=[1.0, 2.0])
    square = np.tril(np.arange(1.0, 10.0).reshape(3, 3))
    model = Preisach([0.0, 1.0, 2.0, 3.0], square)
    np.testing.assert_array_equal(model.plane(), square)


# ------------------------------------------------------------------------ first models


TRUTH = PrandtlIshlinskii([0.11, 0.37], [0.8, 0.5], -0.2)


@pytest.fixture(scope="module")
def clean():
    return np.asarray(
        hj.simulate(TRUTH, hj.Recording(None, SMOOTH[::2], SMOOTH[::2])).w
    )


@pytest.mark.slow
def test_a_stack_is_found_from_its_own_record(clean):
    record = hj.Recording(None, SMOOTH[::2], clean)
    found = hj.refine(PrandtlIshlinskii.guess(record), record).value
    heavy = np.flatnonzero(found.weights > 1e-6)
    np.testing.assert_allclose(found.radii[heavy], TRUTH.radii, atol=1e-6)
    np.testing.assert_allclose(found.weights[heavy], TRUTH.weights, atol=1e-6)


@pytest.mark.slow
def test_a_stack_is_found_under_noise(clean):
    """Its output, that is: of near radii noise tells only the sum of the weights."""
    noise = 0.01 * float(np.std(clean)) * RNG.normal(size=len(clean))
    record = hj.Recording(None, SMOOTH[::2], clean + noise)
    found = hj.refine(PrandtlIshlinskii.guess(record), record).value
    w = hj.simulate(found, record).w
    assert float(hj.metrics.nrmse(clean, w)) < 0.005


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_a_radius_of_0_holds_up_no_other(unit):
    """Under noise by which the play of radius 0 would be less: SciPy's minimum."""
    u, weights = SMOOTH[::2], np.array([0.5, 0.3, 0.2])

    def free_run(x, least=0.0):
        radii = np.array([least, *x[:2]])
        return by_hand.plays(u, radii, started(u, radii)) @ x[2:5] + x[5]

    noise = 0.01 * np.random.default_rng(3).normal(size=len(u))
    w = free_run(np.array([0.15, 0.4, *weights, 0.0])) + noise
    start = np.array([0.18, 0.35, *weights, 0.0])
    best = scipy.optimize.least_squares(lambda x: free_run(x) - w, start, xtol=1e-12)
    assert np.sum((free_run(best.x, 1e-5) - w) ** 2) > 2 * best.cost
    stack = PrandtlIshlinskii(unit * np.array([0, *start[:2]]), weights / unit)
    found = hj.refine(stack, hj.Recording(None, unit * u, w))
    np.testing.assert_allclose(found.value.radii / unit, [0, *best.x[:2]], atol=3e-4)


def test_a_stack_of_stops_is_found_too():
    truth = PrandtlIshlinskii.of_stops([0.15], [3.0], 0.5, offset=2.0)
    u = SMOOTH[::2]
    clean = hj.simulate(truth, hj.Recording(None, u, u)).w
    record = hj.Recording(None, u, clean, names=("x", "F"), units=("m", "N"))
    found = PrandtlIshlinskii.guess(record)
    assert found.names == ("x", "F") and found.units == ("m", "N")
    assert float(hj.metrics.nrmse(clean, hj.simulate(found, record).w)) < 0.01


def test_an_output_that_is_the_input_is_guessed_as_it_is():
    """Plays are as close as stops then: rounding takes either."""
    u = SMOOTH[::2]
    for slope in (*np.linspace(-2, -0.3, 8), *np.linspace(0.3, 2, 8)):
        found = PrandtlIshlinskii.guess(hj.Recording(None, u, slope * u))
        assert not np.any(found.radii)
        assert float(np.sum(found.weights)) == pytest.approx(slope)


@pytest.mark.parametrize(
    ("family", "sign"),
    [(Preisach, -1.0), pytest.param(Everett, 1.0, marks=pytest.mark.slow)],
)
def test_planes_are_guessed(family, sign):
    u = WALK / np.max(np.abs(WALK))
    clean = sign * hj.simulate(STACK, hj.Recording(None, u, u)).w
    record = hj.Recording(None, u, clean)
    start = family.guess(record)
    ran = hj.simulate(start, record).w
    # A grid of 12 steps over the range is off by some half of a step.
    assert float(hj.metrics.nrmse(clean, ran)) < 0.06


def superelastic(strain):
    """Stress of a wire that is elastic but for a share of martensite, which grows and
    shrinks along two lines, with a slope between them: one element at a time."""
    stress, share = [], 0.0
    for u in strain:
        most, least = (np.clip((40 * u - at) / 3, 0, 1) for at in (0.6, 1.0))
        share = min(max(share, least), most)
        stress.append(40 * u - 1.2 * share)
    return np.array(stress)


@pytest.mark.slow
def test_an_output_that_leads_is_guessed_by_stops_and_held_on_other_loops():
    """Flags and loops inside of them; and so mirrored."""
    t = np.linspace(0, 1, 301)
    fitted = 0.04 * (1 - np.cos(14 * np.pi * t)) * (1 - 0.8 * t)
    other = np.interp(t, np.linspace(0, 1, 6), [0, 0.06, 0.02, 0.05, 0.03, 0.07])
    for up in (1, -1):
        found = Everett.guess(hj.Recording(None, fitted, up * superelastic(fitted)))
        assert found.curve is not None and found.sign == -up
        unseen = hj.Recording(None, other, up * superelastic(other))
        w = hj.simulate(found, unseen).w
        assert float(hj.metrics.nrmse(unseen.w, w)) < 0.03


def test_beyond_the_centres_stops_go_on_as_at_the_ends():
    model = MODELS["Everett, of stops"]
    u = np.r_[0.0, np.linspace(1.2, 5.0, 20), np.linspace(4.0, -5.0, 20)]
    w = np.asarray(hj.simulate(model, hj.Recording(None, u, u)).w)
    width = 0.3  # of the centres
    last, first = (np.asarray(model.curve)[i] / width for i in (-1, 0))
    np.testing.assert_allclose(np.diff(w[1:21]) / np.diff(u[1:21]), last, atol=1e-12)
    np.testing.assert_allclose(np.diff(w[-8:]) / np.diff(u[-8:]), first, atol=1e-12)


def test_neighbours_on_a_grid_are_taken_together_but_for_the_input_itself():
    radii, weights = np.arange(6.0), np.array([1.0, 2.0, 3.0, 0.0, 4.0, 0.0])
    at, share = _together(radii, weights)
    np.testing.assert_allclose(at, [0.0, (2.0 + 6.0) / 5, 4.0])
    np.testing.assert_allclose(share, [1.0, 5.0, 4.0])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("curve", [(), (0.5, -0.3)])
def test_what_a_plane_rises_by_is_least_squares_of_the_samples_that_count(sign, curve):
    """Without a rise that is no more than noise makes, beside a curve or without."""
    rng, free = np.random.default_rng(12), len(curve)
    columns, rises = rng.uniform(size=(30, free + 4)), np.array([0.4, 1e-5, 0.3, 0.2])
    w = 0.7 + columns @ [*curve, *sign * rises]
    counted = np.arange(30) < 20
    w[~counted] = 5 * rng.normal(size=10)
    flat = Everett(
        *([0.0, 0.1], [-1.0, 0.0, 1.0], jnp.zeros((2, 2))),
        curve=jnp.zeros(2) if curve else None,
    )
    found = flat.fitted(
        jnp.asarray(columns), jnp.asarray(w), jnp.asarray(1.0 * counted)
    )
    kept = np.delete(columns, free + 1, axis=1)[counted]
    numbers = np.linalg.lstsq(np.column_stack([np.ones(20), kept]), w[counted])[0]
    lowest, static, signed = numbers[0], numbers[1 : free + 1], numbers[free + 1 :]
    assert found.sign == sign
    np.testing.assert_allclose(
        found.roots.ravel() ** 2, sign * np.insert(signed, 1, 0.0), rtol=1e-9
    )
    if curve:
        np.testing.assert_allclose(found.curve, static, rtol=1e-9)
    above = np.sum(static if curve else signed)
    assert float(found.offset) == pytest.approx(lowest + above / 2)


def test_guesses_of_planes_are_dense_where_the_output_changes():
    """An input that goes six times through -1 to 1, and a play of it, and what the play
    leaves; a fifth of the grid is even."""
    legs = np.linspace(0, 6, 301)
    u = 2 * np.abs((legs + 1) % 2 - 1) - 1
    moved = by_hand.play(u, 0.3, u[0])

    def at(shares, nodes, travel):
        even = (nodes - nodes[0]) / (nodes[-1] - nodes[0])
        reached = np.cumsum([0.0, *travel]) / np.sum(travel)
        return np.interp(shares, 0.2 * even + 0.8 * reached, nodes)

    lags = Everett.guess(hj.Recording(None, u, moved))
    assert lags.curve is None and lags.sign == 1
    # Upwards it moves from -0.4 on, but the first time from -0.7, and so down.
    passed = np.array([-1.0, -0.7, -0.4, 0.4, 1.0]), [0.9, 1.2, 4.8, 1.8]
    aside = np.arange(8) / 16
    radii = (at(0.5 + aside, *passed) - at(0.5 - aside, *passed)) / 2
    np.testing.assert_allclose(lags.radii, radii, atol=0.03)
    centres = at(np.linspace(0, 1, 11), *passed)
    np.testing.assert_allclose(lags.centres, centres, atol=0.03)

    leads = Everett.guess(hj.Recording(None, u, 3 * (u - moved)))
    assert leads.curve is not None and leads.sign == -1
    back = np.array([0.0, 0.3, 0.6, 2.0]), [1.8, 1.5, 0.0]  # from each turn
    slips = at((np.arange(8) + 0.5) / 8, *back) / 2
    np.testing.assert_allclose(leads.radii, slips, atol=0.02)
    np.testing.assert_allclose(leads.centres, np.linspace(-1, 1, 11), atol=1e-12)


def test_what_nothing_can_be_read_off_is_refused():
    t = np.arange(50.0)
    for model in (PrandtlIshlinskii, Preisach, Everett):
        with pytest.raises(InputError, match=r"`u` is constant \(1.0\)"):
            model.guess(hj.Recording(t, np.ones(50), t))


# ---------------------------------------------------------------------------- pictures


def test_the_plane_of_thresholds_is_drawn_with_its_staircase():
    model = Preisach(LEVELS, RELAY_WEIGHTS, names=("field", "moment"))
    turns = np.array([-0.7, 0.9, -0.3, 0.4, 0.05])
    (panel, _) = hj.plot.preisach(model, turns).axes
    x, y = panel.lines[-1].get_data()
    # Between two levels the edge is at the highest level reached since the input was
    # last below them.
    for low, high, top in zip(x[::2], x[1::2], y[::2], strict=True):
        column = np.searchsorted(LEVELS, (low + high) / 2) - 1
        later = turns[np.flatnonzero(turns <= LEVELS[column])[-1] :]
        reached = LEVELS[np.max(later) >= LEVELS]
        if np.max(later) > LEVELS[column + 1]:
            assert top == pytest.approx(reached[-1])
        else:
            assert np.isnan(top)
    with pytest.raises(InputError, match=r"`turns` must be inputs in order.*\(2, 2\)"):
        hj.plot.preisach(model, np.zeros((2, 2)))


def test_weights_are_drawn_over_their_radii():
    (panel,) = hj.plot.densities({"a stack": STACK}).axes
    points = next(each for each in panel.lines if each.get_label() == "a stack")
    np.testing.assert_allclose(points.get_xdata(), RADII)
    np.testing.assert_allclose(points.get_ydata(), STACK.weights)
    turned = eqx.tree_at(lambda model: model.radii, STACK, -STACK.radii)
    (panel,) = hj.plot.densities({"turned": turned}).axes
    points = next(each for each in panel.lines if each.get_label() == "turned")
    np.testing.assert_allclose(points.get_xdata(), RADII)
    with pytest.raises(InputError, match="`models` is empty"):
        hj.plot.densities({})


# ---------------------------------------------------------------------------- grids


@given(st.integers(1, 4), st.integers(2, 30))
def test_a_grid_is_as_dense_as_the_output_travels(power, count):
    """w = u^p from 0 to 1 travels u^p up to u; a fifth is shared evenly."""
    u = np.linspace(0, 1, 4001)
    shares = np.linspace(0, 1, count)
    nodes = inputs_by_travel("x", hj.Recording(None, u, u**power), shares)
    np.testing.assert_allclose(0.2 * nodes + 0.8 * nodes**power, shares, atol=1e-3)
    there_and_back = np.concatenate([u, u[::-1]])
    twice = hj.Recording(None, there_and_back, there_and_back**power)
    np.testing.assert_allclose(
        inputs_by_travel("x", twice, shares), nodes, rtol=0, atol=1e-9
    )


def test_weights_are_least_squares_of_the_columns_that_are_kept():
    """Those of SciPy's NNLS, again and again without columns to which it gives less
    than a thousandth of all."""
    rng = np.random.default_rng(2)
    columns = np.cumsum(rng.normal(size=(200, 12)), axis=0)
    weights = np.append(rng.uniform(0.5, 1.0, 4), rng.uniform(0.0, 0.004, 8))
    w = columns @ weights - 3 + 0.5 * rng.normal(size=200)
    kept = np.arange(12)
    constants = np.column_stack([np.ones(200), -np.ones(200)])
    dropped = 0
    while True:
        every = np.column_stack([columns[:, kept], constants])
        *found, up, down = scipy.optimize.nnls(every, w)[0]
        found = np.array(found)
        small = found < 1e-3 * np.sum(found)
        if not np.any(found[small] > 0):
            break
        kept, dropped = kept[~small], dropped + 1
    assert dropped
    _, sign, got, constant = best_sum([jnp.asarray(columns)], jnp.asarray(w))
    expected = np.zeros(12)
    expected[kept] = found
    np.testing.assert_allclose(sign * got, expected, atol=1e-12)
    np.testing.assert_allclose(constant, up - down, rtol=1e-11)


def test_envelopes_that_cross_make_one_output_however_many_samples_there_are():
    """By a loop where the input turns often, and by what it leaves where seldom."""
    law = PrandtlIshlinskii(
        [0.05], [1.0], rising=Envelope(1, 1, 0, 0.2), falling=Envelope(1, 1, 0, -0.2)
    )
    t = np.linspace(0, 9, 9001)
    outputs = []
    for every in (10, 1):
        record = hj.Recording(t[::every], np.sin(t[::every]), 0 * t[::every])
        outputs.append(hj.simulate(law, record).w[:: 10 // every])
    np.testing.assert_allclose(*outputs, atol=1e-4)
    # What pulls is the lower one up and the higher one down.
    turned = replace(law, rising=law.falling, falling=law.rising)
    both = hj.Recording(t, np.sin(t), t)
    np.testing.assert_array_equal(hj.simulate(law, both).w, hj.simulate(turned, both).w)


def test_operators_inside_of_each_other_are_as_many_as_a_file_holds(tmp_path):
    three = "play(play(play(u,0.1),0.1),0.1)"
    record = hj.Recording(None, np.sin(np.arange(60.0)), np.cos(np.arange(60.0)))
    law = hj.identify(
        record,
        hj.library.Play([0.1], of=three),
        hj.regression.LeastSquares(),
        formulation=hj.formulation.Direct(),
    ).value
    hj.save(tmp_path / "law.json", law)
    assert hj.load(tmp_path / "law.json").terms() == law.terms()
    with pytest.raises(InputError, match="no more than 4 operators"):
        hj.library.Play([0.1], of=f"play({three},0.1)")


@pytest.mark.slow
def test_laws_whose_radii_were_swept_are_laws_like_others(tmp_path):
    t = np.linspace(0, 12, 300)
    record = hj.Recording(None, np.sin(t) * np.exp(-t / 20), np.zeros(300))
    truth = PrandtlIshlinskii([0.1, 0.3], [1.0, 2.0])
    record = hj.Recording(None, record.u, hj.simulate(truth, record).w)

    def found(radii):
        return hj.identify(
            record,
            hj.library.Play(radii),
            hj.regression.LeastSquares(),
            formulation=hj.formulation.Direct(),
        ).value

    laws = jax.vmap(found)(jnp.array([[0.1, 0.3], [0.2, 0.4]]))
    one = jax.tree.map(lambda x: x[0], laws)
    assert str(one) == "w = 1 play(u, 0.1) + 2 play(u, 0.3)"
    hj.save(tmp_path / "law.json", one)
    again = hj.load(tmp_path / "law.json")
    assert again.terms() == pytest.approx({"play(u,0.1)": 1.0, "play(u,0.3)": 2.0})
