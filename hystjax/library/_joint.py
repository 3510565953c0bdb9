"""The operators of a law, advanced together, those inside of others first; and
memory of what is known only as it moves: a state, and not the input."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.checks import InputError
from ..saving import check_candidates, check_known
from ..signals import Signals
from ._memory import AbstractMemory
from ._operators import (
    AbstractOperator,
    Lag,
    Play,
    Relaxation,
    Stop,
    Travel,
    cubic,
    operator_named,
    stretches,
    within,
)
from ._parallel import Plays

_ROUNDING = 64  # units of rounding, by which a play on its edge may be off it


class Operators(AbstractMemory):
    """The memory of a law: its operators, those of one kind as one array.

    **Attributes:**

    - `kinds`: the operators of each kind.
    - `arrays`: their numbers, one array for each kind.
    """

    kinds: tuple[tuple[AbstractOperator, ...], ...] = eqx.field(static=True)
    arrays: tuple[Float[Array, " _k"], ...]

    def __init__(
        self, operators: Sequence[AbstractOperator], numbers: Mapping[str, Array]
    ):
        """**Arguments:** the operators; and numbers by `name.what`, as of `Values`."""
        every = dict.fromkeys(each for one in operators for each in one.chain)
        kinds: dict[tuple[int, type], list[AbstractOperator]] = {}
        for each in every:  # what is inside comes before what is of it
            kinds.setdefault((len(each.chain), type(each)), []).append(each)
        ordered = sorted(kinds, key=lambda key: key[0])
        self.kinds = tuple(tuple(kinds[key]) for key in ordered)
        self.arrays = tuple(
            jnp.stack([_positive(each, numbers) for each in kind])
            for kind in self.kinds
        )

    @property
    def empty(self):
        return False

    @property
    def last(self) -> AbstractOperator:
        """The operator that comes last, with the others inside if it is a chain."""
        return self.kinds[-1][-1]

    def to_fields(self):
        kinds = zip(self.kinds, self.arrays, strict=True)
        every = [pair for both in kinds for pair in zip(*both, strict=True)]
        return {"signals": {operator.name: number for operator, number in every}}

    @classmethod
    def from_fields(cls, fields, context):
        check_known(cls, fields, ("signals",))
        signals = fields.get("signals")
        if not isinstance(signals, dict):
            raise InputError(f'"signals" must be an object, got {signals!r}.')
        check_candidates(len(signals))
        numbers = context.numbers("signals", signals)
        known, operators = {}, []
        for name, number in zip(signals, numbers, strict=True):
            operator = operator_named(name) or Relaxation.parse(name)
            if operator is None:
                raise InputError(f"{name!r} is no play, stop or lag.")
            known[f"{operator.name}.{operator.what}"] = jnp.asarray(number)
            operators.append(operator)
        return cls(operators, known)

    def start(self, now):
        states, known = [], {"u": jnp.asarray(now.u)}
        for kind, numbers in zip(self.kinds, self.arrays, strict=True):
            of = _inner(kind, known)
            m = type(kind[0]).start(numbers, now._replace(u=of))
            states.append(m)
            known |= _signals(kind, m, of)
        return tuple(states)

    def after(self, m, before, now):
        return self._after(m, before, now)[0]

    def _after(self, m, before, now):
        """The states, and how plays and stops have travelled, by name."""
        states = []
        travels = {"u": Travel(before.u, now.u, jnp.zeros_like(now.u))}
        for kind, numbers, each in zip(self.kinds, self.arrays, m, strict=True):
            sort = type(kind[0])
            if isinstance(kind[0].of, str):
                later = sort.after(numbers, each, before, now)
            else:
                of = [travels[_source(operator)] for operator in kind]
                inner = jax.tree.map(lambda *parts: jnp.stack(parts), *of)
                later = sort.behind(numbers, each, inner, before, now)
            states.append(later)
            for i, operator in enumerate(kind):
                if isinstance(operator, Play):
                    one = travels[_source(operator)]
                    travels[operator.name] = operator.travel(one, each[i], later[i])
        return tuple(states), travels

    def course(
        self, m: Any, before: Signals, now: Signals
    ) -> Iterator[tuple[Signals, Signals]]:
        """The last of the signals over a stretch of the input that goes one way, as an
        input of its own: in parts, in each of which it goes one way and is smooth,
        both ends of each with the rate inside of it."""
        operator, z = self.last, m[-1][-1:]
        _, travels = self._after(m, before, now)
        if isinstance(operator, Play):
            yield from stretches(before, now, travels[operator.name])
            return
        parts = [(before, now)]
        if not isinstance(operator.of, str):
            parts = stretches(before, now, travels[_source(operator)])
        for part in parts:
            start, turn, end = Lag.course(self.arrays[-1][-1:], z, *part)
            yield start, turn
            yield turn, end
            z = end.u[None]

    def signals(self, m: Any, now: Signals) -> Mapping[str, Signals]:
        """Its signals, by name, each with its rate on the side of `now.du`."""
        known = {"u": now}
        size = jnp.abs(now.u) + jnp.abs(now.t * now.du)
        for kind, numbers, each in zip(self.kinds, self.arrays, m, strict=True):
            for i, operator in enumerate(kind):
                # A play that goes along is on its edge, but for the rounding of a
                # sample that ends one interval and begins another.
                rounding = jnp.finfo(now.u.dtype).eps * (size + numbers[i])
                of = known[_source(operator)]
                known[operator.name] = operator.driven(
                    numbers[i], each[i], of, _ROUNDING * rounding
                )
        return known

    def along(self, m, grid):
        halves = (grid.start, grid.middle), (grid.middle, grid.end)
        # Over both halves of every step, by name.
        travels = {"u": tuple(Travel(a.u, b.u, jnp.zeros_like(a.u)) for a, b in halves)}
        states = []
        for kind, numbers, each in zip(self.kinds, self.arrays, m, strict=True):
            sort = type(kind[0])
            if isinstance(kind[0].of, str):
                rows = sort.along(numbers, each, grid)
            else:
                of = [travels[_source(operator)] for operator in kind]
                inner = jax.tree.map(lambda *parts: jnp.stack(parts, axis=-1), *of)
                rows = sort.along_behind(numbers, each, inner, grid)
            states.append(rows)
            for i, operator in enumerate(kind):
                if isinstance(operator, Play):
                    ends = pairwise(row[:, i] for row in rows)
                    both = zip(travels[_source(operator)], ends, strict=True)
                    travels[operator.name] = tuple(
                        operator.travel(one, *its) for one, its in both
                    )
        return tuple(zip(*states, strict=True))

    def seen(self, see, path):
        alone = len(self.kinds) == 1 and isinstance(self.kinds[0][0], Play)
        if not path.kinked or not alone:
            return super().seen(see, path)
        return Plays(self.arrays[0]).seen(_Alone(see), path)

    def values(self, m, now):
        stops = [isinstance(kind[0], Stop) for kind in self.kinds]
        known = {"u": jnp.asarray(now.u)} if any(stops) else {}
        for kind, each, less in zip(self.kinds, m, stops, strict=True):
            # Of plays and lags the state is the signal, whatever they are of.
            of = _inner(kind, known) if less else each
            known |= _signals(kind, each, of)
        return {name: value for name, value in known.items() if name != "u"}

    def kinks(self, m, now):
        # Of operators inside of others; where those behind start is not looked at.
        pulled = (
            Plays(numbers).kinks(each, now)
            for kind, numbers, each in zip(self.kinds, self.arrays, m, strict=True)
            if isinstance(kind[0], Play) and isinstance(kind[0].of, str)
        )
        return tuple(chain.from_iterable(pulled))


def _source(operator: AbstractOperator) -> str:
    """The name of what an operator is of."""
    of = operator.of
    return of if isinstance(of, str) else of.name


def _inner(
    kind: Sequence[AbstractOperator], known: Mapping[str, Float[Array, "*s"]]
) -> Float[Array, "*s k"]:
    """What each operator of one kind is of."""
    return jnp.stack([known[_source(operator)] for operator in kind], axis=-1)


def _signals(
    kind: Sequence[AbstractOperator], m: Float[Array, "*s k"], of: Float[Array, "*s k"]
) -> dict[str, Float[Array, "*s"]]:
    """The signals of operators of one kind by name, of their states and what they are
    of."""
    return {
        each.name: each.signal(m[..., i], of[..., i]) for i, each in enumerate(kind)
    }


class _Alone(eqx.Module):
    """A view of the memory of which the operators of one kind are all."""

    see: Callable

    def __call__(self, m, now):
        return self.see((m,), now)


def _positive(operator: AbstractOperator, numbers: Mapping[str, Array]) -> Array:
    """The number of an operator without its sign, which has no meaning, and on which a
    fit then needs no bound."""
    key = f"{operator.name}.{operator.what}"
    number = jnp.asarray(numbers.get(key, operator.nominal), jnp.result_type(float))
    # The derivative at 0 is 1: with 0, no fit would move a number from there.
    return jnp.where(number < 0, -number, number)


def followed(memory: AbstractMemory, m: Any, before: Signals, now: Signals) -> Any:
    """The state of a memory `now`, of the state `m` that was there `before`, where what
    drives it has gone in between as the cubic of its values and rates at both ends. It
    may have turned, once."""
    turn = _turn(before, now)
    return memory.after(memory.after(m, before, turn), turn, now)


def _turn(before: Signals, now: Signals) -> Signals:
    """Where it turns; at the end if it does not."""
    _, first, bend, curl = cubic(before, now, now.t - before.t)
    # Of other signs at the ends, its rate has one zero in between.
    turns = before.du * now.du < 0
    root = jnp.sqrt(jnp.where(turns, bend**2 - 3 * first * curl, 1.0))
    below = jnp.where(turns, jnp.sign(first) * root - bend, 1.0)
    return within(before, now, jnp.where(turns, first / below, 1.0))
