"""Networks for what laws miss: on measured devices, and on simulated ones of which the
law misses nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from .._core.show import say
from .._core.solution import Solution
from ..discovery import complete, discover
from ..library import Polynomial
from ..models import AbstractLaw, Hybrid, SparseModel
from ..recording import Recording, datasets
from ..refinement import refine
from ..signals.excitation import Multisine
from ..simulation import generate
from ._devices import Task, four_terms
from ._document import AbstractDocument, shown
from ._measured import MR_DAMPER, mean_error

_KEY = jax.random.key(0)
_SEEDS = 20
_WIDTH, _NARROW = 16, 8  # units; fewer where there are many samples, for time
_NOISE = (0.01, 0.02, 0.05)
_COMPLETE = {
    "Duhem": {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5},
    "Bouc-Wen": {"du": 1.0, "w*|du|": -0.8, "du*|w|": 0.3},
}
_TITLE = "Laws, and networks for what they miss (NRMSE of free runs in %)"
_NOTES = (
    "One hidden layer, of 16 units for the piezo, 81 numbers, and of 8 for all others, "
    "41, beside the law's own, which stay as they are. The form of the network and how "
    "its units are drawn were settled by fitting rows 35000:40000 of piezo_ayala and "
    "judging rows 40000:45000.",
    "piezo_ayala: fitted to means of ten rows of 35000:45000, judged on the rows "
    "themselves, and on 17500:35000.",
    "mr_damper: six terms; every second recording by amplitude is fitted, errors are "
    "means of the recordings'. friction_damper: the law that `discover` chooses for "
    "the recordings of one amplitude, every eighth sample, judged on the other's.",
)


@dataclass(frozen=True)
class Completed:
    """A law and a network for what it misses.

    **Attributes:** the `device`; what was `fitted`; the `numbers` of both; errors of
    the law alone, `own` and `unseen`, and with the network, `own_with` and
    `unseen_with`, %; whether the network was `kept`, and `why`; and the `terms` that it
    is offered in.
    """

    device: str
    fitted: str
    numbers: int
    own: float
    unseen: float
    own_with: float
    unseen_with: float
    kept: bool
    why: str
    terms: str


@dataclass(frozen=True)
class HybridTable(AbstractDocument):
    """Laws and networks, device by device."""

    rows: tuple[Completed, ...]

    def cells(self):
        """Headings, and a line a fit."""
        head = ("device", "fitted", "numbers", "law: own", "unseen")
        lines = [
            (
                row.device,
                row.fitted,
                str(row.numbers),
                *(shown(x, 4) for x in (row.own, row.unseen)),
                *(shown(x, 4) for x in (row.own_with, row.unseen_with)),
                "yes" if row.kept else "no",
            )
            for row in self.rows
        ]
        return [(*head, "with network: own", "unseen", "kept"), *lines]


def hybrid() -> HybridTable:
    """Complete laws of three devices, and laws that miss nothing.

    **Raises:** `InputError` when a recording cannot be had.
    """
    rows = (piezo(), *_mr_damper(), *_friction_damper())
    refused = [not kept for kept in missing_nothing(range(_SEEDS))]
    told = (
        f"Beside {len(refused)} simulated laws that miss nothing, under 1 to 5 % "
        f"noise, the network was refused {sum(refused)} times."
    )
    whys = tuple(f"{row.device}, {row.fitted}: {row.why} {row.terms}" for row in rows)
    return HybridTable(_TITLE, rows, (told, *_NOTES, *whys))


def piezo() -> Completed:
    """A law of four terms of the measured piezo, and a network.

    **Raises:** `InputError` when the recording cannot be had.
    """
    record = datasets.load("piezo_ayala")
    task = Task(record.window(35000, 45000), record.window(17500, 35000))
    law = four_terms(task)
    fitted = [task.own.afresh().averaged(10)]
    row = "piezo_ayala", "rows 35000:45000"
    records = fitted, [task.own], [task.unseen]
    return _completed(row, law, *records, substeps=1, width=_WIDTH)


def _mr_damper() -> Iterator[Completed]:
    names = datasets.records("mr_damper")
    each = [datasets.load("mr_damper", name) for name in names]
    for name, own, unseen in (
        ("every second", each[::2], each[1::2]),
        ("the others", each[1::2], each[::2]),
    ):
        start = SparseModel.from_terms(MR_DAMPER)
        law = refine(start, own, weights="range", substeps=2, throw=False)
        yield _completed(("mr_damper", name), law, own, own, unseen, substeps=2)


def _friction_damper() -> Iterator[Completed]:
    names = datasets.records("friction_damper")
    each = {name: _thinned(datasets.load("friction_damper", name), 8) for name in names}
    small, large = (
        [record for name, record in each.items() if name.endswith(f"_{size}")]
        for size in ("0.5in", "1in")
    )
    for size, own, unseen in (("0.5 in", small, large), ("1 in", large, small)):
        law = discover(own, Polynomial(2), weights="range")
        yield _completed(("friction_damper", size), law, own, own, unseen, substeps=4)


def _completed(
    row: tuple[str, str],
    law: AbstractLaw | Solution,
    fitted: Sequence[Recording],
    own: Sequence[Recording],
    unseen: Sequence[Recording],
    *,
    substeps: int,
    width: int = _NARROW,
) -> Completed:
    say(f"{', '.join(row)} ...")
    weights = "range" if len(fitted) > 1 else None
    stats = complete(law, fitted, key=_KEY, width=width, weights=weights).stats
    with_network: Hybrid = stats["trained"]
    errors = {
        f"{rows}{of}": mean_error(model, records, substeps)
        for of, model in (("", stats["law"]), ("_with", with_network))
        for rows, records in (("own", own), ("unseen", unseen))
    }
    offers = [f"{each.law}: {100 * each.share:.0f} %" for each in stats["offers"]]
    told = f"Of it in terms: {'; '.join(offers)}." if offers else ""
    return Completed(
        *row,
        numbers=with_network.size,
        **errors,
        kept=stats["kept"],
        why=stats["why"],
        terms=told,
    )


def missing_nothing(seeds: Sequence[int]) -> Iterator[bool]:
    """Whether a network is kept beside the law that made a record, one of each seed."""
    names = list(_COMPLETE)
    t = jnp.linspace(0, 20, 801)
    for seed in seeds:
        law = SparseModel.from_terms(_COMPLETE[names[seed % len(names)]])
        wave, noise, weights = jax.random.split(jax.random.key(seed), 3)
        force = Multisine(jnp.arange(1, 6) / 10, 1.5, key=wave)
        additive = _NOISE[seed % len(_NOISE)]
        record = generate(law, force, t, additive=additive, key=noise)
        # As measured ones come, of which only the samples are known.
        sampled = Recording(record.t, record.u, record.w)
        found = complete(law, sampled, key=weights, width=_NARROW)
        say(f"seed {seed}: {found.stats['why']}")
        yield found.stats["kept"]


def _thinned(record: Recording, stride: int) -> Recording:
    columns = (x[::stride] for x in (record.t, record.u, record.w))
    return Recording(*columns, names=record.names, units=record.units)
