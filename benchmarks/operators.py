"""Operators with memory along 100 000 samples, beside loops over all of them."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj

from ._agreement import agreed
from ._results import Table
from ._timing import QUICK, Contestant, Effort, Timing, race

_PLAYS = 32
_LEVELS = 140  # 9870 relays
_LOOP = "jax.lax.scan by hand"
_NUMPY = "NumPy loop"
_OURS = "hystjax.simulate"
_ALL = "hystjax, all plays of all samples"
_ALL_LOOP = f"{_LOOP}, all plays of all samples"


def run(effort: Effort) -> tuple[Table, ...]:
    """Plays along an input of few turning points and of many, their gradient, and
    relays."""
    n = 5_000 if effort == QUICK else 100_000
    t = np.linspace(0, 130, n)
    smooth = np.sin(2 * np.pi * t) * np.exp(-t / 200)
    smooth += 0.1 * np.sin(2 * np.pi * 0.37 * t)
    walk = 0.05 * np.cumsum(np.random.default_rng(0).normal(size=n))
    rng = np.random.default_rng(1)
    stack = hj.models.PrandtlIshlinskii(
        np.linspace(0.01, 0.9, _PLAYS), rng.uniform(0, 1, _PLAYS)
    )
    relays = hj.models.Preisach(
        np.linspace(-1.1, 1.1, _LEVELS + 1),
        rng.uniform(0, 1, _LEVELS * (_LEVELS + 1) // 2),
    )
    return (
        _simulated(f"{_PLAYS} plays along {n} samples, smooth", stack, smooth, effort),
        _simulated(
            f"{_PLAYS} plays along {n} samples, a random walk", stack, walk, effort
        ),
        _differentiated(stack, smooth, effort),
        _relays(relays, smooth, effort),
    )


def _record(u: np.ndarray) -> hj.Recording:
    return hj.Recording(None, u, u)


def _looped(u, radii, weights):
    """The sum of plays by a loop over samples, as one would write it."""

    def after(p, u):
        p = jnp.clip(p, u - radii, u + radii)
        return p, p @ weights

    return jax.lax.scan(after, jnp.zeros_like(radii), u)[1]


def _all_looped(u, radii):
    def after(p, u):
        p = jnp.clip(p, u - radii, u + radii)
        return p, p

    return jax.lax.scan(after, jnp.zeros_like(radii), u)[1]


def _in_numpy(u, radii, weights):
    p, out = np.zeros_like(radii), np.empty_like(u)
    for i, each in enumerate(u):
        p = np.clip(p, each - radii, each + radii)
        out[i] = p @ weights
    return out


def _simulated(title, stack, u, effort) -> Table:
    record, path = _record(u), _record(u).path
    radii, weights = stack.radii, stack.weights
    by_loop, all_by_loop = jax.jit(_looped), jax.jit(_all_looped)

    @jax.jit
    def every(path):
        memory = stack.memory
        return memory.along(memory.first(path), path.grid(1))[2]

    inputs = jnp.asarray(u)
    calls: dict[str, Callable] = {
        _OURS: lambda: hj.simulate(stack, record).w,
        _LOOP: lambda: by_loop(inputs, radii, weights),
        _ALL: lambda: every(path),
        _ALL_LOOP: lambda: all_by_loop(inputs, radii),
        _NUMPY: lambda: _in_numpy(u, np.asarray(radii), np.asarray(weights)),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    results = {name: np.asarray(timing.result) for name, timing in timings.items()}
    apart = max(
        np.max(np.abs(results[_OURS] - results[_LOOP])),
        np.max(np.abs(results[_OURS] - results[_NUMPY])),
        np.max(np.abs(results[_ALL] - results[_ALL_LOOP][1:])),
    )
    turns = len(path.turning_points()[0])
    notes = (
        agreed("outputs", float(apart), 1e-12),
        f"the input turns {turns} times",
        _ratio(timings, _LOOP, _OURS),
        _ratio(timings, _NUMPY, _OURS),
        _ratio(timings, _ALL_LOOP, _ALL),
        _single(stack, u, results[_OURS]),
    )
    return Table(title, _OURS, timings, notes)


def _ratio(timings: dict[str, Timing], slow: str, fast: str) -> str:
    factor = timings[slow].median / timings[fast].median
    return f"{slow} takes {factor:.1f} times as long as {fast}"


def _single(stack, u, reference) -> str:
    """What single precision loses."""
    inputs, radii, weights = (
        jnp.asarray(x, jnp.float32) for x in (u, stack.radii, stack.weights)
    )
    device = hj.models.PrandtlIshlinskii(radii, weights, jnp.zeros((), jnp.float32))
    times = np.arange(len(u), dtype=np.float32)
    w = hj.simulate(device, hj.Recording(times, inputs, inputs)).w
    lost = np.max(np.abs(np.asarray(w, float) - reference)) / np.ptp(reference)
    return f"in float32 the output is off by at most {lost:.1g} of its range"


def _differentiated(stack, u, effort) -> Table:
    record, inputs = _record(u), jnp.asarray(u)
    path = record.path

    def ours(radii, weights, path):
        device = hj.models.PrandtlIshlinskii(radii, weights)
        w = hj.simulate(device, path, w0=0.0, method=hj.simulation.FixedStep(1)).w
        return jnp.mean((w - path.samples()[0]) ** 2)

    def loop(radii, weights, u):
        return jnp.mean((_looped(u, radii, weights) - u) ** 2)

    by_rule = jax.jit(jax.value_and_grad(ours, (0, 1)))
    by_loop = jax.jit(jax.value_and_grad(loop, (0, 1)))
    name = f"{_OURS}, gradient"
    other = f"{_LOOP}, gradient"
    calls = {
        name: lambda: by_rule(stack.radii, stack.weights, path),
        other: lambda: by_loop(stack.radii, stack.weights, inputs),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    one, another = (timings[each].result[1] for each in (name, other))
    apart = max(
        float(jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b)))
        for a, b in zip(one, another, strict=True)
    )
    notes = (agreed("gradients", apart, 1e-9), _ratio(timings, other, name))
    title = (
        f"Mean square and its gradient in {_PLAYS} radii and weights, {len(u)} samples"
    )
    return Table(title, name, timings, notes)


def _relays(model, u, effort) -> Table:
    record, inputs = _record(u), jnp.asarray(u)
    row, column = np.tril_indices(_LEVELS)
    up, down = model.levels[row + 1], model.levels[column]
    first = (
        model.memory.start(record.path.signals()._replace(u=inputs[0]))[column] > row
    )

    def one_by_one(u, weights):
        def after(m, u):
            m = (u >= up) | (m & (u > down))
            return m, weights @ jnp.where(m, 1.0, -1.0)

        return jax.lax.scan(after, first, u)[1]

    by_loop = jax.jit(one_by_one)
    relays = f"{_LOOP} over every relay"
    calls = {
        _OURS: lambda: hj.simulate(model, record).w,
        relays: lambda: by_loop(inputs, model.weights),
    }
    timings = race({name: Contestant(call) for name, call in calls.items()}, effort)
    ours, theirs = (timings[name].result for name in calls)
    apart = float(jnp.max(jnp.abs(ours - theirs)) / jnp.max(jnp.abs(theirs)))
    notes = (agreed("outputs", apart, 1e-12), _ratio(timings, relays, _OURS))
    title = f"Preisach, {len(row)} relays along {len(u)} samples"
    return Table(title, _OURS, timings, notes)
