"""Plays and relays, many in parallel: plays along a whole input, their derivative, and
weighted sums of them; and relays on the half-plane of their thresholds, one by one and
as a staircase.

Sums take few operations a sample and play. Samples are taken in blocks. Where the input
turns at most once inside of each, a block has two pieces over which the input goes one
way: a loop over blocks finds the plays where pieces begin, and the sums at all samples
follow from these at once. Where it turns more often, a loop over samples does it.

All of that is for processors. Where a step of a loop is launched by itself, as on GPUs,
samples are put together instead: what one does to a play is to bring it between two
edges, and so is what several do.
"""

from functools import partial
from math import prod
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Float, Int, Shaped

from .._core import checks
from .._core.checks import InputError, is_concrete
from .._core.compiling import largest, launched
from ..signals import AbstractInputPath, Signals
from ._memory import FEW, AbstractMemory, along_turns, composed

_BLOCK = 32  # samples, for each of which there is a bit
_GROUP = 8  # plays: XLA makes one kernel of a loop that moves less than a kilobyte
_TOGETHER = 32  # plays whose values at all samples are in memory together
_GROUPS = 4  # whose part is added in one go


class Weighted(eqx.Module):
    """What is seen of plays where it is no more than their sum.

    **Attributes:** `weights`, shape (k,), of the plays; and `offset`, a scalar.
    """

    weights: Float[Array, " k"]
    offset: Float[Array, ""]

    def __call__(self, m: Float[Array, " k"], now: Signals) -> Float[Array, ""]:
        return self.offset + self.weights @ m


class Stack(NamedTuple):
    """Plays side by side, of shape (k,) each, or in groups, (..., 8)."""

    first: Float[Array, "*k"]
    radii: Float[Array, "*k"]
    weights: Float[Array, "*k"]


class _Ends(NamedTuple):
    """Where pieces end, one for each block: what pulls plays up and down there, and
    which way the input has gone, 1 up or -1 down."""

    rising: Float[Array, " b"]
    falling: Float[Array, " b"]
    way: Float[Array, " b"]


def pulled(
    p: Float[Array, " k"], low: Float[Array, " k"], high: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Plays `p` after their edges have moved to `low` and `high`."""
    # Not `clip`, whose derivative is a mean of both sides where they meet, which at
    # radius 0 is always: the side that pulls tells the change with the radius.
    p = jnp.where(p > high, high, p)
    return jnp.where(p < low, low, p)


def carried(
    p: Float[Array, "*k"],
    was: Float[Array, "*k"],
    low: Float[Array, "*k"],
    high: Float[Array, "*k"],
) -> Float[Array, "*k"]:
    """What `pulled` gives, with the derivative of plays of radius 0, which go along
    where the input rests too; their lower edge `was` there before."""
    resting = (low == high) & (p == low) & (p == was)
    return jnp.where(resting, p + (low - was), pulled(p, low, high))


def weighted(
    stack: Stack,
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, " n"], Float[Array, " n"]],
) -> Float[Array, " n"]:
    """The weighted sum of plays at n inputs, between which they go one way.

    **Arguments:** the plays, at the first input; the inputs; and what pulls plays up
    and what pulls them down there.

    **Returns:** what a loop over the samples gives, but for rounding. It has no
    derivatives of its own.
    """
    if launched():
        return _at_once(stack, envelopes)
    if len(u) <= FEW:
        return _looped(stack, *envelopes)
    # Radii are added and taken off again. One that no edge comes to, and which may be
    # infinite, is as good as the least of these.
    farthest = jnp.max(jnp.abs(jnp.stack(envelopes)))
    within = jnp.minimum(stack.radii, farthest + jnp.abs(stack.first))
    stack = stack._replace(radii=within)
    inputs, rising, falling = (_blocks(x) for x in (u, *envelopes))
    before = jnp.concatenate([inputs[:1, 0], inputs[:-1, -1]])
    turn, once = _turns(inputs, before)

    at_turn = (jnp.arange(len(turn)), turn)
    first = jnp.where(inputs[at_turn] < before, -1.0, 1.0).astype(u.dtype)
    last = jnp.where(inputs[:, -1] < inputs[at_turn], -1.0, 1.0).astype(u.dtype)
    ends = (
        _Ends(rising[at_turn], falling[at_turn], first),
        _Ends(rising[:, -1], falling[:, -1], last),
    )
    later = jnp.arange(_BLOCK) > turn[:, None]
    way = jnp.where(later, last[:, None], first[:, None])
    edge = jnp.where(way > 0, rising, -falling)

    def by_pieces():
        return way * _summed(stack, ends, later, edge)

    def one_by_one():
        return _blocks(_looped(stack, *envelopes))

    several = largest(jnp.sum(~once, dtype=jnp.int32))
    sums = jax.lax.cond(several == 0, by_pieces, one_by_one)
    return sums.reshape(-1)[: len(u)]


def _turns(
    inputs: Float[Array, "b s"], before: Float[Array, " b"]
) -> tuple[Int[Array, " b"], Bool[Array, " b"]]:
    """The sample of each block at which its first piece may end, and whether there are
    no more than two; of inputs in blocks, and of those before each block."""
    change = inputs - jnp.concatenate([before[:, None], inputs[:, :-1]], axis=1)
    # All that has to be known of a block are two numbers: bits where the input rises,
    # and bits where it falls.
    none = jnp.uint32(0)
    bits = jnp.left_shift(jnp.uint32(1), jnp.arange(_BLOCK, dtype=jnp.uint32))
    rises, falls = (
        jnp.sum(jnp.where(moves, bits, none), axis=1, dtype=jnp.uint32)
        for moves in (change > 0, change < 0)
    )

    def comes_first(one, other):
        lowest = other & (~other + 1)
        return (other == 0) | (one < lowest)

    peak, valley = comes_first(rises, falls), comes_first(falls, rises)
    highest = 31 - jax.lax.clz(jnp.where(peak, rises, falls)).astype(jnp.int32)
    return jnp.maximum(highest, 0), peak | valley


def _summed(
    stack: Stack,
    ends: tuple[_Ends, _Ends],
    later: Bool[Array, "b s"],
    edge: Float[Array, "b s"],
) -> Float[Array, "b s"]:
    """Weighted sums of plays at the samples of blocks, times the way that the input
    goes, of the edges that pull plays that way, times the way.

    Times its way, a play is the larger of what it was at the end of the piece before
    and of its edge, less its radius: two operations and a product.
    """

    def held(group: Stack):
        """Plays where the pieces of each block begin, times their way and with their
        radii."""
        r = group.radii

        def over(p, ends: tuple[_Ends, _Ends]):
            before = []
            for end in ends:
                before.append(end.way * p + r)
                p = pulled(p, end.rising - r, end.falling + r)
            return p, before

        return jax.lax.scan(over, group.first, ends)[1]

    def add(total, groups: Stack):
        first, second = jax.lax.map(held, groups)
        for i, weights in enumerate(groups.weights):
            for j, weight in enumerate(weights):
                p = jnp.where(later, second[i, :, j, None], first[i, :, j, None])
                # Not `maximum`, which looks for NaN and takes twice as long.
                total += weight * jnp.where(p > edge, p, edge)
        return total, None

    total = jnp.full_like(edge, -stack.radii @ stack.weights)
    return jax.lax.scan(add, total, _grouped(stack, _GROUPS, _GROUP))[0]


class _Edges(NamedTuple):
    """What samples do to plays: bring them between two values. Which sample the values
    are of, where that is asked: positive where it pulls down."""

    low: tuple[Shaped[Array, "n k"], ...]
    high: tuple[Shaped[Array, "n k"], ...]

    def bring(self, p: tuple[Shaped[Array, "*n k"], ...]) -> tuple[Array, ...]:
        """Plays between them, and which sample has pulled each last."""
        over, under = p[0] > self.high[0], p[0] < self.low[0]
        if len(p) > 1:
            # A play of radius 0 goes along where the input rests too, on the side that
            # pulled it there.
            held = ~over & ~under & (self.low[0] == self.high[0])
            over, under = over | (held & (p[1] > 0)), under | (held & (p[1] <= 0))
        return tuple(
            jnp.where(under, low, jnp.where(over, high, each))
            for low, high, each in zip(self.low, self.high, p, strict=True)
        )

    def then(self, later: "_Edges") -> "_Edges":
        """What these do and then those."""
        return _Edges(later.bring(self.low), later.bring(self.high))


def _at_once(
    stack: Stack, envelopes: tuple[Float[Array, " n"], Float[Array, " n"]]
) -> Float[Array, " n"]:
    """Weighted sums of plays at all samples together, some plays at a time."""

    def add(total, group: Stack):
        (p,) = _at_samples(envelopes, group.radii, group.first)
        return total + p @ group.weights, None

    groups = _grouped(stack, min(len(stack.radii), _TOGETHER))
    return jax.lax.scan(add, jnp.zeros_like(envelopes[0]), groups)[0]


def _at_samples(
    envelopes: tuple[Float[Array, "n *_k"], Float[Array, "n *_k"]],
    radii: Float[Array, " k"],
    first: Float[Array, " k"],
    *last: Int[Array, " k"],
) -> tuple[Array, ...]:
    """Plays at all samples together, and which sample has pulled each last where that
    is given of the first."""
    rising, falling = (x[:, None] if x.ndim == 1 else x for x in envelopes)
    low, high = rising - radii, falling + radii
    marks = [jnp.broadcast_to(_numbers(len(low))[:, None], low.shape) for _ in last]
    edges = _Edges((low, *(-mark for mark in marks)), (high, *marks))
    return composed(_Edges.then, edges).bring((first, *last))


def _numbers(n: int) -> Int[Array, " n"]:
    return jnp.arange(n, dtype=jnp.int32)


@custom_vmap
def _looped(
    stack: Stack, rising: Float[Array, " n"], falling: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Weighted sums of plays, sample after sample."""
    return _looped_by(_GROUP, stack, rising, falling)


@_looped.def_vmap
def _(size, batched, *rows):
    # XLA makes no kernels of loops over batches, and all plays at once are fewer steps.
    plays = rows[0].radii.shape[-1]
    axes = jax.tree.map(lambda along: 0 if along else None, tuple(batched))
    return jax.vmap(partial(_looped_by, plays), axes)(*rows), True


def _looped_by(size: int, stack: Stack, rising, falling) -> Float[Array, " n"]:
    def add(total, group: Stack):
        def to_sample(p, edges):
            low, high = edges
            p = pulled(p, low - group.radii, high + group.radii)
            return p, jnp.sum(group.weights * p)

        sums = jax.lax.scan(to_sample, group.first, (rising, falling))[1]
        return total + sums, None

    return jax.lax.scan(add, jnp.zeros_like(rising), _grouped(stack, size))[0]


def _blocks(x: Float[Array, " n"]) -> Float[Array, "b s"]:
    """Samples in blocks, the last of which rests at its end."""
    return jnp.pad(x, (0, -len(x) % _BLOCK), mode="edge").reshape(-1, _BLOCK)


def _grouped(stack: Stack, *shape: int) -> Stack:
    """Plays in groups, and some of no weight to fill the last."""
    extra = -len(stack.radii) % prod(shape)
    return Stack(*(jnp.pad(x, (0, extra)).reshape(-1, *shape) for x in stack))


@eqx.filter_custom_jvp
def enveloped(
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, "n *_k"], Float[Array, "n *_k"]],
    radii: Float[Array, " k"],
    first: Float[Array, " k"],
) -> Float[Array, "n k"]:
    """Plays between two functions of n inputs, between which they go one way.

    **Arguments:** the inputs; what pulls plays up and what pulls them down there, both
    rising with the input, for all plays or for each; the radii; and the plays at the
    first input.

    **Returns:** bit for bit what a loop over the samples gives, see `along_turns`. Its
    derivatives in all arguments are exact, in both directions.
    """

    def after(p, row):
        rising, falling = row
        return pulled(p, rising - radii, falling + radii)

    def at_once():
        return _at_samples(envelopes, radii, first)[0]

    return along_turns(after, first, envelopes, u, at_once=at_once)


@enveloped.def_jvp
def _(primals, tangents):
    u, envelopes, radii, first = primals
    _, d_envelopes, d_radii, d_first = tangents
    last = _last_pulls(*jax.lax.stop_gradient(primals))
    # Not together with what pulled: XLA would fuse two results into one slow loop.
    p = enveloped(u, envelopes, radii, first)
    return p, _change(last, d_envelopes, d_radii, d_first)


@eqx.filter_custom_jvp
def summed(
    see: Any,
    u: Float[Array, " n"],
    envelopes: tuple[Float[Array, " n"], Float[Array, " n"]],
    radii: Float[Array, " k"],
    first: Float[Array, " k"],
    rows: Any,
) -> Float[Array, " n"]:
    """A number made of the plays at each sample, which are never in memory together.

    **Arguments:** `see(p, row)`, a PyTree whose arrays may have derivatives, that makes
    the number; inputs, envelopes, radii and first plays as for `enveloped`; and what
    else `see` needs of each sample, a PyTree of arrays with leading axis n.
    """
    if isinstance(see, Weighted):
        return see.offset + weighted(Stack(first, radii, see.weights), u, envelopes)

    def after(p, row):
        rising, falling = row[0]
        return pulled(p, rising - radii, falling + radii)

    def seen(p, row):
        return see(p, row[1])

    def at_once():
        return _at_samples(envelopes, radii, first)[0]

    return along_turns(after, first, (envelopes, rows), u, seen, at_once)


@summed.def_jvp
def _(primals, tangents):
    see, u, envelopes, radii, first, rows = primals
    d_see, _, d_envelopes, d_radii, d_first, d_rows = tangents
    w = summed(*primals)
    u, envelopes, radii, first = _still((u, envelopes, radii, first))

    def change(d_see, d_envelopes, d_radii, d_first, d_rows):
        def seen(m, row):
            p, last = m
            here, d_here = row[1:]
            d_p = _change(last, d_envelopes, d_radii, d_first)
            moved = eqx.filter_jvp(
                lambda see, p, row: see(p, row), (see, p, here), (d_see, d_p, d_here)
            )
            return moved[1]

        after, start, marked, at_once = _marking(u, envelopes, radii, first)
        each = marked, rows, d_rows
        return along_turns(after, start, each, u, seen, at_once)

    return w, change(d_see, d_envelopes, d_radii, d_first, d_rows)


def _last_pulls(u, envelopes, radii, first) -> Shaped[Array, "n k"]:
    """Which sample has last pulled each play: positive where down, negative where up, 0
    where none has since the first, at which plays are where that has put them."""
    after, start, marked, at_once = _marking(u, envelopes, radii, first)
    return along_turns(after, start, (marked,), u, lambda m, row: m[1], at_once)


def _marking(u, envelopes, radii, first):
    """What `along_turns` needs for plays and their last pulls."""

    def after(m, row):
        rising, falling, number = row[0]
        low, high = rising - radii, falling + radii
        return _Edges((low, -number), (high, number)).bring(m)

    start = first, jnp.zeros(first.shape, jnp.int32)
    at_once = partial(_at_samples, envelopes, radii, *start)
    return after, start, (*envelopes, _numbers(len(u))), at_once


def _change(last: Shaped[Array, "*n k"], d_envelopes, d_radii, d_first):
    """What becomes of plays that these samples have pulled last, where `None` stands
    for no change.

    A play is what it was when it was last pulled: an edge at that sample, so that it
    changes with the radius by -1, 1, or if it has never been pulled not at all.
    """
    change = []
    if d_radii is not None:
        change.append(jnp.sign(last).astype(d_radii.dtype) * d_radii)
    if d_first is not None:
        change.append(jnp.where(last == 0, d_first, 0.0))
    for side, moved in zip((-1, 1), d_envelopes, strict=True):
        if moved is not None:
            # One envelope for all plays, or one for each.
            own = () if moved.ndim == 1 else (jnp.arange(moved.shape[1]),)
            at_pull = moved[(jnp.abs(last), *own)]
            change.append(jnp.where(side * last > 0, at_pull, 0.0))
    return sum(change[1:], change[0]) if change else None


@jax.custom_jvp
def _still(numbers: Any) -> Any:
    """Numbers that a first derivative takes for constants."""
    return numbers


@_still.defjvp
def _(primals, tangents):
    raise InputError(
        "simulated plays have first derivatives only; take second ones of "
        "`model.memory.along`, which keeps what they need."
    )


class Plays(AbstractMemory):
    """Plays as one array: exact, and fast where the input turns seldom.

    **Attributes:**

    - `radii`: shape (k,), input units, or those of the envelopes.
    - `rising`, `falling`: what pulls them up, and down: functions of the input that
        rise with it, the input itself by default. Where `rising` is above `falling`,
        the lower of both pulls up and the higher down.

    Plays start from 0, or as close to 0 as the first input lets them.
    """

    radii: Float[Array, " k"] = eqx.field(converter=partial(checks.vector, "radii"))
    rising: Any = None
    falling: Any = None

    def __check_init__(self):
        checks.positive("radii", self.radii, zero=True)

    @property
    def empty(self):
        return False

    def start(self, now):
        origin = now._replace(u=jnp.zeros_like(now.u))
        return self.after(jnp.zeros_like(self.radii), origin, now)

    def after(self, m, before, now):
        (was, _), (low, high) = self._envelopes(before.u), self._envelopes(now.u)
        return carried(m, was - self.radii, low - self.radii, high + self.radii)

    def values(self, m, now):
        return {f"play {i}": each for i, each in enumerate(m)}

    def kinks(self, m, now):
        low, high = self._envelopes(now.u)
        return *(low - self.radii - m), *(high + self.radii - m)

    def along(self, m, grid):
        u = grid.nodes
        nodes = enveloped(u, self._envelopes(u), self.radii, m)
        middles = jax.vmap(self.after)(nodes[:-1], grid.start, grid.middle)
        return nodes[:-1], middles, nodes[1:]

    def seen(self, see, path):
        if not path.kinked:
            return super().seen(see, path)
        now = path.signals()
        envelopes = self._envelopes(now.u)
        return summed(see, now.u, envelopes, self.radii, self.first(path), now)

    def _envelopes(self, u):
        rising, falling = self.rising, self.falling
        if rising is falling is None:
            return u, u
        up = u if rising is None else rising(u)
        down = u if falling is None else falling(u)
        # Where a fit has them cross, which pulls last is left to the order of the work.
        return jnp.minimum(up, down), jnp.maximum(up, down)


_TIE = 1e-6  # share of the range of levels by which thresholds count as equal

INITIAL = ("demagnetised", "up", "down")


def check_initial(initial: str) -> None:
    """Raise `InputError` for a past that has no name."""
    if initial not in INITIAL:
        raise InputError(
            f"`initial` must be one of {', '.join(INITIAL)}; got {initial!r}."
        )


class Relays(AbstractMemory):
    """Relays: switches that the input turns up at one value and down at a lower one.

    For teaching and for tests: `models.Preisach` gives the sum of a whole half-plane of
    them for the work of its edge.

    **Attributes:**

    - `up`, `down`: thresholds, shape (k,), input units; `up` above `down`. A relay is
        up from where the input comes to `up` until it comes back to `down`.
    - `initial`: how they stand before the first input: all `"up"` or `"down"`, or
        `"demagnetised"`, those up whose thresholds have a mean below 0.

    **Source:** Preisach (1935), doi 10.1007/BF01349418.
    """

    up: Float[Array, " k"] = eqx.field(converter=partial(checks.vector, "up"))
    down: Float[Array, " k"] = eqx.field(converter=partial(checks.vector, "down"))
    initial: str = eqx.field(static=True, default="demagnetised")

    def __check_init__(self):
        check_initial(self.initial)
        if self.up.shape != self.down.shape:
            raise InputError(
                "each relay must have an input to turn up at and one to turn down at; "
                f"got {len(self.up)} of `up` and {len(self.down)} of `down`."
            )
        if is_concrete(self.up, self.down) and not jnp.all(self.up > self.down):
            raise InputError(
                "each relay must turn up at a higher input than it turns down: `up` "
                "must be above `down` everywhere."
            )

    def start(self, now: Signals) -> Bool[Array, " k"]:
        stand = {
            "up": jnp.ones(self.up.shape, bool),
            "down": jnp.zeros(self.up.shape, bool),
            "demagnetised": self.up + self.down < 0,
        }
        return self.after(stand[self.initial], now, now)

    def after(self, m, before, now):
        return jnp.where(
            now.u >= self.up, True, jnp.where(now.u <= self.down, False, m)
        )

    def values(self, m, now):
        return {f"relay {i}": jnp.where(up, 1.0, -1.0) for i, up in enumerate(m)}


class Staircase(AbstractMemory):
    """What all relays of a grid of thresholds remember: the edge between those that are
    up and those that are down, as one height for each column.

    The relay (i, j), i >= j, turns up at `levels[i + 1]` and down at `levels[j]`. Of a
    column j those up to some i are up, and no others: as many as the highest input
    since it was last at `levels[j]` or below has come to.

    **Attributes:**

    - `levels`: thresholds, shape (L + 1,), input units, rising.
    - `initial`: how relays stand before the first input: all `"up"` or `"down"`, or
        `"demagnetised"`, those up whose thresholds have a mean below that of the first
        and the last level.

    **Source:** Mayergoyz (1991), doi 10.1007/978-1-4612-3028-1.
    """

    levels: Float[Array, " n"] = eqx.field(converter=partial(checks.vector, "levels"))
    initial: str = eqx.field(static=True)

    def __check_init__(self):
        check_initial(self.initial)

    @property
    def empty(self):
        return False

    def start(self, now: Signals) -> Int[Array, " L"]:
        """Heights: how many of the levels after the first are below them."""
        columns, up = self.levels[:-1], self.levels[1:]
        centre = (self.levels[0] + self.levels[-1]) / 2
        # Relays whose mean is that of the levels stand down, whatever the rounding.
        edge = 2 * centre - columns - _TIE * (self.levels[-1] - self.levels[0])
        stand = {
            "up": jnp.full(columns.shape, len(up)),
            "down": jnp.zeros(columns.shape, int),
            "demagnetised": jnp.searchsorted(up, edge, side="right"),
        }
        heights = stand[self.initial].astype(jnp.int32)
        return self.after(heights, now, now)

    def after(self, m, before, now):
        reached = jnp.searchsorted(self.levels[1:], now.u, side="right")
        heights = jnp.maximum(m, reached.astype(m.dtype))
        return jnp.where(now.u <= self.levels[:-1], 0, heights)

    def values(self, m, now):
        return {f"height {j}": height.astype(float) for j, height in enumerate(m)}

    def along(self, m, grid):
        # Heights are numbers of levels, which have no derivatives.
        nodes = self._along(m, grid.nodes)
        middles = jax.vmap(self.after)(nodes[:-1], grid.start, grid.middle)
        return nodes[:-1], middles, nodes[1:]

    def _along(self, m: Int[Array, " L"], u: Float[Array, " n"]) -> Int[Array, "n L"]:
        memory, u = jax.lax.stop_gradient((self, u))

        def after(m, u):
            now = Signals(u, u, u)  # of which it looks at the input
            return memory.after(m, now, now)

        return along_turns(after, m, u, u, at_once=partial(memory._at_once, m, u))

    def seen(self, see: Any, path: AbstractInputPath) -> Float[Array, " n"]:
        if not path.kinked:
            return super().seen(see, path)
        memory = jax.lax.stop_gradient(self)
        now = path.signals()

        def after(m, row):
            return memory.after(m, row, jax.lax.stop_gradient(row))

        first = self.first(path)
        at_once = partial(memory._at_once, first, jax.lax.stop_gradient(now.u))
        return along_turns(after, first, now, now.u, see, at_once)

    def _at_once(self, m: Int[Array, " L"], u: Float[Array, " n"]) -> Int[Array, "n L"]:
        """Heights at all samples together. One sample raises them to some height, or
        takes them down to 0; several raise them, or leave them at a height of their
        own."""
        reached = jnp.searchsorted(self.levels[1:], u, side="right").astype(m.dtype)
        emptied = u[:, None] <= self.levels[:-1]

        def both(one, other):
            (emptied, height), (again, more) = one, other
            return emptied | again, jnp.where(again, more, jnp.maximum(height, more))

        each = emptied, jnp.where(emptied, 0, reached[:, None])
        emptied, height = composed(both, each)
        return jnp.where(emptied, height, jnp.maximum(m, height))
