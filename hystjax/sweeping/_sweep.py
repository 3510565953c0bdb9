"""One function over many values, on one device or many, in one go or several: many
lanes in one compiled program; where its chunks are kept, in memory or in a folder that
outlives it; and what it depends on, as fingerprints, equal for equal sweeps in any
process."""

import functools
import hashlib
import inspect
import io
import json
import math
import os
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Int, PyTree

from .._core import checks
from .._core.checks import VALUE_ASKED, ComputationError, InputError, warn
from .._core.files import made_folder, write_atomically, write_text
from .._core.show import Progress
from ._lanes import (
    AbstractSpace,
    Variable,
    dataset,
    value_asked,
    variables,
)

_MANIFEST, _FORMAT, _VERSION = "sweep.json", "hystjax sweep", 2
_TEMPORARY = ".hystjax-"  # of files that a killed process was writing
_OURS = re.compile(rf"{re.escape(_TEMPORARY)}.*|chunk-\d+\.npz")

Chunk = Mapping[str, np.ndarray]


class AbstractStore(ABC):
    """Chunks by number, each there whole or not at all."""

    @abstractmethod
    def __contains__(self, number: int) -> bool:
        """Whether a chunk is there."""

    @abstractmethod
    def put(self, number: int, chunk: Chunk) -> None:
        """Keep a chunk."""

    @abstractmethod
    def get(self, number: int) -> Chunk:
        """A chunk that is there."""


class Memory(AbstractStore):
    """Chunks of this process, gone with it."""

    def __init__(self):
        self._chunks: dict[int, Chunk] = {}

    def __contains__(self, number):
        return number in self._chunks

    def put(self, number, chunk):
        self._chunks[number] = chunk

    def get(self, number):
        return self._chunks[number]


class Folder(AbstractStore):
    """Chunks as files, beside a file that says what of.

    Each holds its number and the fingerprint of its sweep. One that is damaged is not
    there, with a warning, and will be made again: nothing is lost by that. One of
    another number or sweep is refused: somebody may have put it there on purpose.
    """

    def __init__(self, place: Path, manifest: Mapping[str, Any]):
        self._place = place
        self._names, self._sweep = manifest["names"], manifest["fingerprint"]

    def __contains__(self, number):
        file = self._file(number)
        if not file.is_file():
            return False
        if self._read(number) is None:
            warn(f"{file} is damaged and will be made again.")
            return False
        return True

    def put(self, number, chunk):
        arrays = [chunk[name] for name in self._names]
        stamp = {"number": number, "sweep": self._sweep}
        write_atomically(
            self._file(number), lambda file: np.savez(file, *arrays, **stamp)
        )

    def get(self, number):
        chunk = self._read(number)
        if chunk is None:
            raise InputError(
                f"{self._file(number)} is damaged. Delete it and call `sweep` again: "
                "it will be made again."
            )
        return chunk

    def _read(self, number: int) -> Chunk | None:
        """A chunk, or None where its file is damaged."""
        file = self._file(number)
        try:
            content = file.read_bytes()
        except OSError as error:
            raise InputError(
                f"{file} cannot be read ({error.strerror}). Let it be read, or delete "
                "it: it will be made again."
            ) from None
        try:
            with np.load(io.BytesIO(content)) as arrays:
                stamp = int(arrays["number"]), str(arrays["sweep"])
                chunk = {n: arrays[f"arr_{i}"] for i, n in enumerate(self._names)}
        except Exception:  # where bytes are lost or changed, anything may be raised
            return None
        if stamp != (number, self._sweep):
            raise InputError(
                f"{file} holds chunk {stamp[0]} of "
                f"{'this' if stamp[1] == self._sweep else 'another'} sweep; it was "
                "copied or renamed. Move it away and call `sweep` again: chunk "
                f"{number} will be made again."
            )
        return chunk

    def _file(self, number: int) -> Path:
        return self._place / f"chunk-{number:06d}.npz"


def kept_chunk(out: str | os.PathLike, chunk: int | None) -> int | None:
    """Lanes a chunk of the sweep in a folder, or else `chunk`.

    **Raises:** `InputError` when the folder has chunks of another size.
    """
    found = _manifest(Path(out))
    kept = chunk if found is None else found["chunk"]
    if chunk not in (None, kept):
        raise InputError(
            f"the sweep in {str(out)!r} has chunks of {kept} lanes, and `chunk` is "
            f"{chunk}; leave it out to go on there, or choose another folder."
        )
    return kept


def begun(out: str | os.PathLike) -> bool:
    """Whether a folder holds a sweep."""
    return _manifest(Path(out)) is not None


def opened(
    out: str | os.PathLike, inputs: Mapping[str, Any], chunk: int, names: Sequence[str]
) -> Folder:
    """A folder for the sweep with these inputs; one that was begun there goes on.

    **Arguments:** the folder, made if need be; what the sweep depends on, by name, as
    JSON has it; the lanes a chunk; and the names of the arrays.

    **Raises:** `InputError` for a folder with another sweep, or with other files.
    """
    place = made_folder(out)
    found = _manifest(place)
    if found is None:
        _check_empty(place)
        content = {"format": _FORMAT, "version": _VERSION, "chunk": chunk}
        content |= {"inputs": dict(inputs), "names": list(names)}
        found = {**content, "fingerprint": _fingerprint(content)}
        write_text(place / _MANIFEST, json.dumps(found, indent=2) + "\n")
    changed = [name for name in inputs if found["inputs"].get(name) != inputs[name]]
    if changed:
        raise InputError(
            f"the folder {str(place)!r} holds a sweep with another "
            f"{' and another '.join(changed)}. Choose another folder, or remove that "
            "one; to go on, call it with the same inputs, code and versions as before."
        )
    return Folder(place, found)


def tidied(out: str | os.PathLike) -> None:
    """Remove what killed processes left half written."""
    for file in Path(out).glob(f"{_TEMPORARY}*"):
        file.unlink(missing_ok=True)


def _manifest(place: Path) -> dict[str, Any] | None:
    file = place / _MANIFEST
    if not file.is_file():
        return None
    try:
        found = json.loads(file.read_bytes())
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}).") from None
    except (ValueError, RecursionError):
        raise _damaged(file) from None
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise InputError(f"{file} is not of a sweep; choose another folder.")
    if found.get("version") != _VERSION:
        raise InputError(
            f"{file} has version {found.get('version')!r}, and this hystjax reads "
            f"version {_VERSION}; choose another folder."
        )
    content = {name: value for name, value in found.items() if name != "fingerprint"}
    if found.get("fingerprint") != _fingerprint(content):
        raise _damaged(file)
    return found


def _fingerprint(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _damaged(file: Path) -> InputError:
    return InputError(
        f"{file} is damaged. Delete it and call `sweep` again as before: it will be "
        "made again, and the chunks beside it are kept."
    )


def _check_empty(place: Path) -> None:
    # Chunks may be there: a damaged manifest was deleted, and they know their sweep.
    others = [f.name for f in place.iterdir() if not _OURS.fullmatch(f.name)]
    if others:
        raise InputError(
            f"the folder {str(place)!r} holds no sweep but other files, such as "
            f"{others[0]!r}; choose an empty one, or one that does not exist."
        )


_LANES = "lanes"
_SIDE_BY_SIDE = {"cpu": 32}  # more do not fit into the caches of a core
_SIDE_BY_SIDE_ELSEWHERE = 2**15  # a step of a loop takes a GPU as long for few lanes
_PORTIONS = 64  # of a sweep, each written when it is done


class Lane(eqx.Module):
    """A function of named values, and where it takes them from.

    **Attributes:**

    - `function`: called by the names of the parameters and of what is shared.
    - `space`: the values of each lane.
    - `shared`: further arguments, the same for all.
    """

    function: Callable[..., Any]
    space: AbstractSpace
    shared: dict[str, PyTree]

    def __call__(self, index: Int[Array, ""]) -> dict[str, Variable]:
        """The named arrays of one lane."""
        return variables(self.function(**self.space.at(index), **self.shared))


class Reads:
    """What a function reads besides its arguments, as it is now: what it closes over
    and the globals that it names, and those that functions of the same module name
    which are among them. Equal where all of these are the same objects, and arrays of
    NumPy hold the same numbers.

    JAX keeps what it compiles by the function that it was made of, and would go on
    with the numbers that were read when it was traced.
    """

    def __init__(self, function: Callable[..., Any]):
        self._objects: list[Any] = []  # alive, for others may take their ids
        home, waiting = getattr(function, "__module__", None), [function]
        while waiting:
            each = waiting.pop()
            if any(each is other for other in self._objects):
                continue
            self._objects.append(each)
            if getattr(each, "__module__", None) == home or each is function:
                waiting += _read_by(each)
        self._known = tuple(
            x.tobytes() if isinstance(x, np.ndarray) else id(x) for x in self._objects
        )

    def __hash__(self) -> int:
        return hash(self._known)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Reads) and self._known == other._known


def _read_by(function: Any) -> list[Any]:
    """What a function closes over and the globals that it names; what a part of one
    holds, or the object of a method."""
    if isinstance(function, functools.partial):
        return [function.func, *function.args, *function.keywords.values()]
    if inspect.ismethod(function):
        held = getattr(function.__self__, "__dict__", {})
        return [function.__func__, function.__self__, *held.values()]
    function = inspect.unwrap(function)
    if not inspect.isfunction(function):
        return []
    cells = inspect.getclosurevars(function).nonlocals.values()
    codes, named = [function.__code__], list(cells)
    while codes:
        code = codes.pop()
        codes += [each for each in code.co_consts if inspect.iscode(each)]
        known = function.__globals__
        named += [known[name] for name in code.co_names if name in known]
    return named


@dataclass(frozen=True)
class Program:
    """The lanes of a chunk, shared out to devices.

    **Attributes:**

    - `lane`: what each does; its arrays lie on all devices.
    - `chunk`: lanes a call.
    - `batch`: lanes side by side on one device, by `vmap`; the batches of a chunk take
        turns.
    - `mesh`: the devices.
    - `reads`: what the function reads besides its arguments; equal programs that read
        the same are compiled once.
    """

    lane: Lane
    chunk: int
    batch: int
    mesh: Mesh
    reads: object

    def __call__(self, lanes: Int[np.ndarray, " m"]) -> dict[str, np.ndarray]:
        """The named arrays of up to `chunk` lanes, each with an axis of lanes first.

        **Raises:** `ComputationError` when a lane raises: then none has a result.
        """
        # The last lane again and again, for a program of one shape.
        filled = np.pad(lanes, (0, self.width - len(lanes)), mode="edge")
        try:
            found = jax.device_get(_run(*self._call(filled)))
        except (jax.errors.JaxRuntimeError, eqx.EquinoxRuntimeError) as error:
            raise ComputationError(
                f"`function` raised in one of the lanes {lanes[0]} to {lanes[-1]}, "
                "which stops the others. In a sweep give the verbs in it "
                "`throw=False`: then the lane's `result` tells instead."
            ) from error
        return {name: each.values[: len(lanes)] for name, each in found.items()}

    @property
    def width(self) -> int:
        """`chunk`, filled up to whole batches on every device."""
        return _whole(self.chunk, self.batch * self.mesh.size)

    @property
    def described(self) -> dict[str, Variable]:
        """What a call gives, in shapes instead of numbers."""
        return eqx.filter_eval_shape(_run, *self._call())

    @property
    def compiled(self) -> Any:
        """The program, ready to run."""
        return _run.lower(*self._call()).compile().compiled

    def _call(self, rows: Int[np.ndarray, " l"] | None = None):
        rows = np.zeros(self.width, int) if rows is None else rows
        return self.lane, rows, self.batch, self.mesh, self.reads

    @property
    def bytes(self) -> int:
        """Memory that one device needs for a chunk."""
        need = self.compiled.memory_analysis()
        arrays = need.argument_size_in_bytes + need.output_size_in_bytes
        return arrays + need.temp_size_in_bytes


def planned(
    lane: Lane,
    devices: Sequence[Any],
    memory: int,
    chunk: int | None,
    batch: int | None,
    reads: object = None,
) -> Program:
    """A program that keeps within `memory` bytes a device: as few lanes as that takes
    go side by side, and, where `chunk` is free, in a chunk.

    **Raises:** `InputError` when even one lane at a time takes more.
    """
    mesh = Mesh(np.array(devices), (_LANES,))
    arrays, static = eqx.partition(lane, eqx.is_array)
    everywhere = NamedSharding(mesh, PartitionSpec())
    lane = eqx.combine(jax.device_put(arrays, everywhere), static)
    lanes = len(lane.space)
    usual = _SIDE_BY_SIDE.get(devices[0].platform, _SIDE_BY_SIDE_ELSEWHERE)
    width = batch or min(usual, -(-lanes // mesh.size))
    size = chunk or _whole(lanes / _PORTIONS, width * mesh.size)
    while True:
        program = Program(lane, size, width, mesh, reads)
        need = program.bytes
        if need <= memory:
            return program
        before = width, size
        if batch is None:
            width = max(int(width * memory / need), 1)
        if chunk is None:
            size = _whole(size * memory / need / 2, width * mesh.size)
        if (width, size) == before:
            raise InputError(
                f"{width} lane(s) side by side, {size} in a chunk, need "
                f"{need / 2**20:.4g} MiB on each device, more than the `memory` of "
                f"{memory / 2**20:.4g} MiB. Allow more, give a smaller `chunk` or "
                "`batch`, or let `function` return less."
            )


def _whole(lanes: float, unit: int) -> int:
    """The first multiple of `unit` that is as many lanes or more."""
    return max(math.ceil(lanes / unit), 1) * unit


@eqx.filter_jit
def _run(lane: Lane, rows, batch: int, mesh: Mesh, reads) -> dict[str, Variable]:
    """The lanes of these rows. By `shard_map`, not by sharding what goes in: a solver's
    loop would then ask all devices at every step whether they are done."""
    arrays, static = eqx.partition(lane, eqx.is_array)

    def some(rows, arrays):
        one = eqx.combine(arrays, static)
        if batch == 1:  # loops over numbers are faster than over arrays of one
            return jax.lax.map(one, rows)
        found = jax.lax.map(jax.vmap(one), rows.reshape(-1, batch))
        return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), found)

    each, all_ = PartitionSpec(_LANES), PartitionSpec()
    shared_out = jax.shard_map(
        some, mesh=mesh, in_specs=(each, all_), out_specs=each, check_vma=False
    )
    with jax.default_device(mesh.devices.flat[0]):  # whose kind decides between ways
        return shared_out(jnp.asarray(rows), arrays)


_HOST_CALLS = ("pure_callback", "io_callback")
# Of these a name and a release say all: what they compute with, they are given.
_KNOWN = ("equinox._errors", "hystjax")


def inputs(lane: Lane, version: str | None = None) -> dict[str, str]:
    """Fingerprints of the values swept over, of what is shared, and of the function;
    and the caller's word on the version of what no fingerprint sees.

    That of the function is of the program JAX makes of it for one lane, so that a
    change anywhere in its code or in what it closes over is seen. Python code which
    that program calls on the host is seen by name alone.

    **Raises:** `InputError` when such code is the caller's own and has no `version`.
    """
    function = _of_function(lane, version)
    # Arrays that it holds, as a method of a module does, are given to the program.
    if jax.tree.leaves(eqx.filter(lane.function, eqx.is_array)):
        function = _digest(lane.function, function)
    return {
        "space": _digest(lane.space, repr(jax.tree.structure(lane.space))),
        "shared arguments": _digest(lane.shared),
        "function": function,
        "version": version or "",
    }


def _digest(tree: Any, text: str = "") -> str:
    digest = hashlib.sha256(text.encode())
    for leaf in jax.tree.leaves(eqx.filter(tree, eqx.is_array)):
        _add(digest, leaf)
    return digest.hexdigest()


def _of_function(lane: Lane, version: str | None) -> str:
    arrays, static = eqx.partition(lane, eqx.is_array)

    def one(arrays, index):
        return eqx.combine(arrays, static)(index)

    # By shapes: where arrays lie is no part of it.
    traced = jax.jit(one).trace(*jax.eval_shape(lambda *x: x, arrays, jnp.array(0)))
    texts = [traced.lower().as_text()]
    texts += [_named(call, version) for call in _host_calls(traced.jaxpr)]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def _host_calls(jaxpr) -> Iterator[Any]:
    """The Python functions that a program calls and whose results it uses."""
    for equation in jaxpr.eqns:
        if equation.primitive.name in _HOST_CALLS:
            callback = equation.params["callback"]
            yield getattr(callback, "callback_func", callback)
        for inner in jax.tree.leaves(list(equation.params.values())):
            if hasattr(inner, "eqns"):
                yield from _host_calls(inner)


def _named(function: Any, version: str | None) -> str:
    module = getattr(function, "__module__", None) or ""
    name = f"{module}.{getattr(function, '__qualname__', type(function).__qualname__)}"
    if any(f"{module}.".startswith(f"{known}.") for known in _KNOWN):
        # Not by its metadata: on a path, where nothing is installed, there is none.
        return f"{name} {sys.modules[module.partition('.')[0]].__version__}"
    if not version:
        raise InputError(
            f"`function` calls Python code on the host (`{name}`), whose changes no "
            "fingerprint sees: `out` would go on with numbers of older code. Give "
            "`version`, any word, and another one whenever that code, or what it "
            "reads, changes."
        )
    return name


def _add(digest, leaf) -> None:
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    array = np.asarray(leaf)
    digest.update(f"{array.dtype} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())


if TYPE_CHECKING:
    import xarray


def sweep(
    function: Callable[..., Any],
    space: AbstractSpace,
    *,
    shared: Mapping[str, Any] | None = None,
    dims: Mapping[str, str | Sequence[str]] | None = None,
    coords: Mapping[str, Any] | None = None,
    out: str | os.PathLike | None = None,
    version: str | None = None,
    memory: int = 2**30,
    chunk: int | None = None,
    batch: int | None = None,
    devices: Any = None,
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
        dictionary or PyTree of arrays. What it closes over, and the globals that it
        names, are taken as they are at the call; of objects among these that were
        changed in place only arrays are looked at again, unless there is `out`.
    - `space`: `sweeping.Grid(...)`, all combinations of values, or
        `sweeping.Samples(...)`, points.
    - `shared`: further arguments by name, the same for all lanes. Arrays passed like
        this are not compiled into the program.
    - `dims`: names of the axes that an array has in each lane, or that of its only one,
        by the array's name.
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
    - `batch`: lanes side by side on a device, by default 32 on a CPU and 32 768
        elsewhere if `memory` allows. With the same `batch` any number of devices of a
        kind give the same numbers, to 1e-12 and mostly to the last bit: what a program
        for several devices sums may be fused, and then rounded, otherwise.
    - `devices`: those to use, one or several, by default all of this process.

    **Returns:** a dataset whose axes are the parameters, or `sample` for samples, and
    then those of each array. `result` holds how each lane ended, such as `successful`;
    the others are explained in its attributes. Of a `Solution` there are the
    coefficients and the support of a law by `term` (for other models the parameters),
    and those of its `stats` that are numbers or vectors. A function that says nothing
    of how it ended has failed where a number is not finite (`nonfinite`); of parts that
    say it, such as the trajectory of a `Judgement`, that decides.

    **Raises:** `InputError` for a folder with another sweep or with other files, for
    a `function` that does not take what is swept over and shared by its names, or asks
    for the value of it, as `float` and `if` do, for lanes that take more than `memory`,
    for several processes without `out`, for what is no number among the results, and
    for names in `dims` and `coords` that are not there, all before lanes are run;
    `ComputationError` when the function raises while it runs.
    """
    checks.concrete("`sweep`", function, space, shared)
    _check_order(function, space)
    shared = {} if shared is None else shared
    _check_names(function, space, shared)
    lane = Lane(function, space, _as_arrays(dict(shared)))
    checks.positive("memory", checks.number("memory", memory))
    chunk = None if chunk is None else checks.count("chunk", chunk)
    batch = None if batch is None else checks.count("batch", batch)
    _check_out(out)
    if out is not None:
        chunk = kept_chunk(out, chunk)
    chosen = _chosen(devices)
    try:
        # What is kept must be what the fingerprint sees, changes of any kind among it.
        reads = Reads(function) if out is None else object()
        program = planned(lane, chosen, memory, chunk, batch, reads)
    except VALUE_ASKED as error:
        first = space.at(jnp.array(0))
        raise value_asked(function, {**first, **lane.shared}) from error
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


def _check_out(out) -> None:
    if not isinstance(out, str | os.PathLike | None):
        raise InputError(
            f"`out` must be the path of a folder, got {checks.described(out)}."
        )
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


def _check_names(function: Any, space: AbstractSpace, shared: Any) -> None:
    """That the function can be called by the names of what is swept over and shared."""
    if not isinstance(shared, Mapping):
        raise InputError(
            "`shared` must hold further arguments by name, such as `{'record': "
            f"record}}`, got {checks.described(shared)}."
        )
    both = [name for name in space.names if name in shared]
    if both:
        raise InputError(
            f"`shared` has {both[0]!r}, which is a parameter of the sweep too; give "
            "one of them another name."
        )
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some functions do not tell
        return
    names = [*space.names, *shared]
    try:
        signature.bind(**dict.fromkeys(names))
    except TypeError as error:
        raise InputError(
            f"`function` is called by the names {', '.join(map(repr, names))}, of "
            f"parameters and what is `shared`, and does not take that: {error}."
        ) from None


def _chosen(devices: Any) -> list[Any]:
    """Those to use, by default all of this process."""
    if devices is None:
        return jax.local_devices()
    if isinstance(devices, jax.Device):
        return [devices]
    found = list(devices) if isinstance(devices, Sequence | np.ndarray) else []
    known = all(isinstance(each, jax.Device) for each in found)
    if not found or not known or len(set(found)) < len(found):
        raise InputError(
            "`devices` must be one device or several, each once, such as "
            f"`jax.devices()[:1]`, got {devices!r}."
        )
    return found


def _as_arrays(tree: Any) -> Any:
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf, tree
    )
