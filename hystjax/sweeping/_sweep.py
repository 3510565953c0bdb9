"""One function over many values: on one device or many, in one go or several."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from .._core import checks
from .._core.checks import InputError
from .._core.progress import Progress
from ._program import Lane, Program, inputs, planned
from ._space import AbstractSpace
from ._store import AbstractStore, Memory, begun, kept_chunk, opened, tidied
from ._variables import dataset

if TYPE_CHECKING:
    import xarray


def sweep(
    function: Callable[..., Any],
    space: AbstractSpace,
    *,
    shared: Mapping[str, Any] | None = None,
    dims: Mapping[str, Sequence[str]] | None = None,
    coords: Mapping[str, Any] | None = None,
    out: str | os.PathLike | None = None,
    version: str | None = None,
    memory: int = 2**30,
    chunk: int | None = None,
    batch: int | None = None,
    devices: Sequence[Any] | None = None,
) -> "xarray.Dataset":
    """Call a function with all values of a space, as one compiled program.

        def fit(threshold, seed):
            noisy = ...
            return hj.identify(noisy, library, STLSQ(threshold), throw=False)

        grid = hj.sweeping.Grid(threshold=jnp.logspace(-3, 0, 50), seed=jnp.arange(100))
        hj.sweep(fit, grid)["coefficients"].sel(term="du").mean("seed")

    Lanes run side by side by `jax.vmap`, in chunks. A lane that fails says so in its
    `result` and changes nothing in the others.

    **Arguments:**

    - `function`: called with one value of each parameter, by name; any of the verbs
        may be in it, with `throw=False`. Returns a `Solution`, a `Trajectory`, or any
        dictionary or PyTree of arrays.
    - `space`: `sweeping.Grid(...)`, all combinations of values, or
        `sweeping.Samples(...)`, points.
    - `shared`: further arguments by name, the same for all lanes. Arrays passed like
        this are not compiled into the program.
    - `dims`: names of the axes that an array has in each lane, by the array's name.
    - `coords`: values along such axes, by the axis's name.
    - `out`: a folder into which every chunk is written when it is done. The same call
        then goes on where one before it was stopped, and needs no more time when
        nothing is missing. Several processes (`jax.distributed`) need it, and share it.
        A chunk whose file is damaged is made again, with a warning.
    - `version`: a word of yours, needed with `out` when `function` calls Python code of
        yours on the host (`jax.pure_callback`): no fingerprint sees what that code
        does, so give another word whenever it, or what it reads, changes.
    - `memory`: most bytes on each device; it limits how many lanes run at a time.
    - `chunk`: lanes a chunk; about 1/64 of all by default.
    - `batch`: lanes side by side on a device, by default 32 on a CPU and 4096 elsewhere
        if `memory` allows. With the same `batch` any number of devices of a kind give
        the same numbers, to 1e-12 and mostly to the last bit: what a program for
        several devices sums may be fused, and then rounded, otherwise.
    - `devices`: those to use, by default all of this process.

    **Returns:** a dataset whose axes are the parameters, or `sample` for samples, and
    then those of each array. `result` holds how each lane ended, such as `successful`;
    the others are explained in its attributes. Of a `Solution` there are the
    coefficients and the support of a law by `term` (for other models the parameters),
    and those of its `stats` that are numbers or vectors. A function that says nothing
    of how it ended has failed where a number is not finite (`nonfinite`).

    **Raises:** `InputError` for a folder with another sweep or with other files, for
    lanes that take more than `memory`, for several processes without `out`, for what is
    no number among the results, and for names in `dims` and `coords` that are not
    there, all before lanes are run; `ComputationError` when the function raises while
    it runs.
    """
    checks.concrete("`sweep`", function, space, shared)
    _check_order(function, space)
    lane = Lane(function, space, _as_arrays(shared or {}))
    checks.positive("memory", memory)
    for name, value in (("chunk", chunk), ("batch", batch)):
        checks.positive(name, checks.whole(name, 1 if value is None else value))
    _check_processes(out)
    if out is not None:
        chunk = kept_chunk(out, chunk)
    devices = jax.local_devices() if devices is None else devices
    program = planned(lane, devices, memory, chunk, batch)
    described = program.described
    names = described, dims or {}, coords or {}
    dataset(space, _blank(space, described), *names)  # raises before the work
    store = _store(out, lane, version, program.chunk, tuple(described))
    _fill(store, program)
    return dataset(space, _gathered(store, program), *names)


def _blank(space: AbstractSpace, described: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Zeros of the shapes that results will have, which take no memory."""
    shapes = {name: each.values.shape[1:] for name, each in described.items()}
    zero = np.zeros((), int)
    return {n: np.broadcast_to(zero, (len(space), *s)) for n, s in shapes.items()}


def _fill(store: AbstractStore, program: Program) -> None:
    """Run the chunks that are missing; of several processes each has its share."""
    mine = range(jax.process_index(), _count(program), jax.process_count())
    sizes = {number: len(_rows(program, number)) for number in mine}
    missing = [number for number in mine if number not in store]
    total = sum(sizes.values())
    done = total - sum(sizes[number] for number in missing)
    with Progress("lanes", total, done) as progress:
        for number in missing:
            store.put(number, program(_rows(program, number)))
            done += sizes[number]
            progress.show(done)
    _wait_for_all("filled")


def _gathered(store, program: Program) -> dict[str, np.ndarray]:
    chunks = [store.get(number) for number in range(_count(program))]
    return {name: np.concatenate([c[name] for c in chunks]) for name in chunks[0]}


def _store(out, lane: Lane, version, chunk: int, names) -> AbstractStore:
    if out is None:
        return Memory()
    known = inputs(lane, version)
    first = jax.process_index() == 0
    if first or begun(out):  # a wrong folder is an error of every process
        opened(out, known, chunk, names)
    if first:
        tidied(out)
    _wait_for_all("opened")
    return opened(out, known, chunk, names)


def _count(program: Program) -> int:
    return -(-len(program.lane.space) // program.chunk)


def _rows(program: Program, number: int) -> np.ndarray:
    """The lanes of a chunk."""
    first = number * program.chunk
    return np.arange(first, min(first + program.chunk, len(program.lane.space)))


def _wait_for_all(what: str) -> None:
    if jax.process_count() > 1:
        from jax.experimental import multihost_utils

        multihost_utils.sync_global_devices(f"hystjax sweep {what}")


def _check_processes(out) -> None:
    if out is None and jax.process_count() > 1:
        raise InputError(
            f"these are {jax.process_count()} processes, which each run a part of the "
            "sweep: give `out`, a folder that all of them can reach."
        )


def _check_order(function: Any, space: Any) -> None:
    if isinstance(space, AbstractSpace) and callable(function):
        return
    hint = ""
    if isinstance(function, AbstractSpace):
        hint = "Were they swapped? "
    elif isinstance(space, Mapping):
        hint = "A dictionary of values makes a grid: `Grid(**values)`. "
    raise InputError(
        "`sweep(function, space)` takes a function and a `hystjax.sweeping.Grid` or "
        f"`Samples`, got {checks.described(function)} and {checks.described(space)}. "
        f"{hint}".rstrip()
    )


def _as_arrays(tree: Any) -> Any:
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf, tree
    )
