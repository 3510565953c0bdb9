"""How many terms a law of the measured piezo needs."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .. import datasets
from .._discover import discover
from .._jit import jit
from .._judge import judge
from .._recording import Recording
from ..library import Library, Polynomial
from ..models import SparseModel
from ..search import Candidate
from ..simulation import FixedStep
from ._document import AbstractDocument, shown

_LARGEST, _WIDTH = 8, 24
_AT_ONCE = 32  # laws that are simulated side by side
_TITLE = "Laws of the measured piezo by size (NRMSE of free runs in %)"
_NOTES = (
    "`discover` on rows 35000:45000, with the library of degree 3 and `width=24`; "
    "unseen are rows 17500:35000; free runs start at the measured first output. Noise "
    "at rest: 0.124 %.",
    "On the left the best law by the rows it was fitted to. On the right, of all laws "
    "of that size that were refined, the one of the least error on the unseen rows: a "
    "choice that knows these rows, and so no result, but what a better rule of choice "
    "could win.",
)


@dataclass(frozen=True)
class Law:
    """A law and the errors of its free run, %, on its `own` and on `unseen` rows."""

    terms: tuple[str, ...]
    own: float
    unseen: float

    def cells(self) -> tuple[str, ...]:
        """What is shown."""
        return shown(self.own, 4), shown(self.unseen, 4), ", ".join(self.terms)


@dataclass(frozen=True)
class Size:
    """Laws of so many `terms`: the one `chosen` by its own rows, and the one that turns
    out `best` on the unseen ones."""

    terms: int
    chosen: Law
    best: Law


@dataclass(frozen=True)
class SizeTable(AbstractDocument):
    """Laws of each size."""

    rows: tuple[Size, ...]

    def cells(self):
        """Headings, and a line a size."""
        heads = ("own rows", "unseen", "law")
        lines = [
            (str(row.terms), *row.chosen.cells(), *row.best.cells())
            for row in self.rows
        ]
        return [("terms", *heads, *(f"{head}, best unseen" for head in heads)), *lines]


def sizes() -> SizeTable:
    """Laws of up to eight terms of the measured piezo, chosen and best.

    **Raises:** `InputError` when the recording cannot be had.
    """
    record = datasets.load("piezo_ayala")
    own, unseen = record.window(35000, 45000), record.window(17500, 35000)
    library = Polynomial(3)
    stats = discover(own, library, largest=_LARGEST, width=_WIDTH, progress=True).stats
    candidates = stats["candidates"]
    errors = [_errors(candidates, library, rows) for rows in (own, unseen)]
    laws = [
        Law(tuple(candidate.terms), float(on_own), float(on_unseen))
        for candidate, on_own, on_unseen in zip(candidates, *errors, strict=True)
    ]
    rows = (_size(size, chosen, laws) for size, chosen in stats["frontier"].items())
    return SizeTable(_TITLE, tuple(rows), _NOTES)


def _size(size: int, chosen: Candidate, laws: Sequence[Law]) -> Size:
    same = [law for law in laws if len(law.terms) == size]
    by_own_rows = next(law for law in same if law.terms == tuple(chosen.terms))
    return Size(size, by_own_rows, min(same, key=lambda law: law.unseen))


def _errors(
    candidates: Sequence[Candidate], library: Library, recording: Recording
) -> Float[np.ndarray, " m"]:
    """NRMSE of the free runs, %; infinite for a law that diverges."""
    rows = [
        [candidate.terms.get(name, 0.0) for name in library.names]
        for candidate in candidates
    ]
    errors = 100 * np.asarray(_nrmse(jnp.array(rows), library, recording))
    return np.where(np.isfinite(errors), errors, np.inf)


@jit
def _nrmse(
    coefficients: Float[Array, "m k"], library: Library, recording: Recording
) -> Float[Array, " m"]:
    # All laws over the whole library, for one program.
    everything = np.ones(len(library), bool)

    def one(row):
        law = SparseModel(library, row, everything)
        return judge(law, recording, method=FixedStep()).errors["nrmse"]

    return jax.lax.map(one, coefficients, batch_size=_AT_ONCE)
