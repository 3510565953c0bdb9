"""A record of a hundred million samples, on disk, with 21 terms."""

import tempfile
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj

from . import _multisine, _problem
from ._agreement import agreed, relative_difference
from ._alone import peak
from ._results import Table
from ._timing import FULL, Contestant, Effort, race
from ._units import spaced

_LONG, _SHORT = 10**8, 10**6  # samples
_CHUNK = 2**20
_STEP = 1e-3  # s
_SETTINGS = hj.regression.STLSQ(0.05)
_ROWS = 8192  # that are evaluated at a time


def run(effort: Effort) -> tuple[Table]:
    """The regression, beside what no regression can do without."""
    n = _LONG if effort is FULL else _SHORT
    ours, least = "hystjax.identify", "read the files and evaluate the library"
    with tempfile.TemporaryDirectory() as folder:
        _write(Path(folder), n)
        record = _record(folder)
        contestants = {
            ours: Contestant(lambda: _identified(record)),
            least: Contestant(lambda: _evaluated(record)),
        }
        timings = race(contestants, replace(effort, patience=2 * effort.patience))
        peaks = [peak(_first, folder, rows) for rows in (n // 10, n)]
        short = _record(folder, _SHORT)
        whole = _identified(short.window(0, _SHORT)).value.coefficients
        apart = relative_difference(_identified(short).value.coefficients, whole)
    law = timings[ours].result.value
    first = f"of the first {spaced(_SHORT)} samples"
    notes = (
        f"the law found: {law}; the one simulated: 0.25 u' + 0.4 u |u'| - 0.5 w |u'|",
        agreed(f"in chunks and in memory, coefficients ({first})", apart, 1e-10),
        f"peak memory of a process of its own: {peaks[1]:.0f} MiB, and "
        f"{peaks[0]:.0f} MiB for a tenth of the samples",
        "three columns of float64 in files of NumPy's own format, read 2^20 samples at "
        "a time; both differentiate, and make the regressors in rows that stay in the "
        "cache; times are of files that the system has cached, if memory was free",
    )
    title = f"Regression over {spaced(n)} samples on disk, 21 terms"
    return (Table(title, least, timings, notes),)


def _identified(record) -> hj.Solution:
    return hj.identify(record, _problem.LIBRARY, _SETTINGS)


def _evaluated(record: hj.LongRecording) -> float:
    """The regressors, made and added up, so that none is left out."""
    total = 0.0
    for start in range(0, len(record), _CHUNK):
        columns = record.read(start, start + _CHUNK)
        total += float(_sums(*columns))
    return total


@jax.jit
def _sums(t, u, w):
    difference = hj.differentiation.FiniteDifference()
    columns = w, u, difference(t, u), difference(t, w)
    cut = [jnp.pad(c, (0, -len(c) % _ROWS)).reshape(-1, _ROWS) for c in columns]

    def part(some):
        w, u, du, dw = some
        # Made, as an array, and not only added up while it is evaluated.
        rows = jax.lax.optimization_barrier(_problem.LIBRARY(w, u, du))
        return jnp.sum(rows) + jnp.sum(dw)

    return jnp.sum(jax.lax.map(part, cut))


def _write(folder: Path, n: int) -> None:
    """A Duhem law along four sines, with noise: t, u and w as files."""
    make = np.lib.format.open_memmap
    files = {c: make(folder / f"{c}.npy", "w+", float, (n,)) for c in "tuw"}
    random, w0 = np.random.default_rng(0), 0.0
    for start in range(0, n, _CHUNK):
        rows = np.arange(start, min(start + _CHUNK + 1, n))  # one more, to go on from
        t = _STEP * rows
        u, w = (np.asarray(x) for x in _multisine.simulated(t, w0))
        w0, stop = w[-1], min(start + _CHUNK, n)
        noisy = w + 1e-6 * random.normal(size=len(w))
        for file, column in zip(files.values(), (t, u, noisy), strict=True):
            file[start:stop] = column[: stop - start]


def _record(folder: str, n: int | None = None) -> hj.LongRecording:
    files = {name: Path(folder, f"{name}.npy") for name in "tuw"}
    if n is None:
        return hj.LongRecording.from_npy(**files, chunk=_CHUNK)
    mapped = {name: np.load(file, mmap_mode="r")[:n] for name, file in files.items()}
    return hj.LongRecording(**mapped, chunk=_CHUNK // 8)


def _first(folder: str, n: int) -> None:
    """The regression of the first rows."""
    record = _record(folder)
    part = {c: _Part(getattr(record, c), n) for c in "tuw"}
    _identified(hj.LongRecording(**part, chunk=_CHUNK))


class _Part:
    """The first rows of a column."""

    def __init__(self, column, n: int):
        self._column, self.shape = column, (n,)

    def __getitem__(self, rows: slice) -> np.ndarray:
        return self._column[rows]
