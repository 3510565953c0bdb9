"""Whether the family that `compare` puts first is the best on rows nobody fitted."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import jax
import numpy as np

from ..comparison import compare
from ..recording import Recording
from ._choice import DEVICES, error_of, recordings_of, splits
from ._document import AbstractDocument, shown

_SPLITS = 2  # of each device
_TITLE = "Families that compare puts first, on rows nobody fitted (NRMSE in %)"
_NOTE = (
    "`compare` with all its families on one part of the recordings, and the error of "
    "each on the other part: free runs, the mean of its recordings. First: the family "
    "with the least error on blocks of its own part. Best: the one with the least "
    "error on the other. Place: of the first, among all on the other part."
)


@dataclass(frozen=True)
class Split:
    """A device, some of whose rows are fitted and others not.

    **Attributes:** the `device`; the `split` in words; the family that came `first`,
    and the `best` on the rows not fitted; their errors there, %, and the `place` there
    of the first.
    """

    device: str
    split: str
    first: str
    error: float
    best: str
    least: float
    place: int

    @property
    def ratio(self) -> float:
        """The error of the first over the least."""
        return self.error / self.least


@dataclass(frozen=True)
class FamiliesTable(AbstractDocument):
    """What came first, split by split."""

    rows: tuple[Split, ...]

    def cells(self):
        """Headings, and a line a split."""
        head = ("device", "fitted", "first", "error", "best", "error", "ratio", "place")
        lines = [
            (
                row.device,
                row.split,
                row.first,
                shown(row.error, 3),
                row.best,
                shown(row.least, 3),
                shown(row.ratio, 3),
                str(row.place),
            )
            for row in self.rows
        ]
        return [head, *lines]


def families(devices: Sequence[str] = DEVICES) -> FamiliesTable:
    """Judge what `compare` puts first on both halves of each device's recordings.

    **Raises:** `InputError` when a recording cannot be had.
    """
    rows = []
    for device in devices:
        for name, own, unseen in islice(splits(recordings_of(device)), _SPLITS):
            rows.append(_judged(device, name, own, unseen))
            jax.clear_caches()  # as in `choice`
    ratios = np.array([row.ratio for row in rows])
    firsts, near = np.sum(ratios <= 1.0), np.sum(ratios <= 1.1)
    said = (
        f"The first is the best in {firsts} of {len(rows)} splits, and within 10 % of "
        f"it in {near}; at worst it has {np.max(ratios):.3g} times its error."
    )
    return FamiliesTable(_TITLE, tuple(rows), (said, _NOTE))


def _judged(
    device: str, name: str, own: Sequence[Recording], unseen: Sequence[Recording]
) -> Split:
    rows = compare(own, progress=True).rows
    errors = np.array([error_of(row.model, unseen) for row in rows])
    least = int(np.argmin(errors))
    place = 1 + int(np.sum(errors < errors[0]))
    first, best = rows[0].family, rows[least].family
    return Split(
        device, name, first, float(errors[0]), best, float(errors[least]), place
    )
