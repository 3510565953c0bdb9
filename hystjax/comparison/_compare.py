"""All families that suit a record, judged by the same blocks of it."""

import itertools
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .. import refinement
from .._core import checks
from .._core.checks import ComputationError, InputError
from .._core.compiling import side_by_side
from .._core.show import Card, Progress, Shown, plain_table
from ..discovery._layout import farthest, layout
from ..models import AbstractModel, FittedRange
from ..recording import Recording, as_group
from ..recording._as_measured import across, noise_on_all
from ..refinement._certainty import steps
from ._families import FAMILIES, Case


class Compared(eqx.Module):
    """A family on a record.

    **Attributes:**

    - `family`: its name.
    - `model`: fitted to all samples.
    - `blocks`: root mean square errors of free runs on each block, of a fit without
        that block, over the range of the recordings.
    - `own`: the error of `model` on all samples, over the range. Where the model is
        refined its first output is fitted too, as on the blocks: from the recorded one,
        as `judge` begins, the error is larger where that is noisy.
    - `beyond`: how far the output of `model` gets from the middle of the recorded one,
        over half of its range, under inputs 1.5 times as large, three times as fast and
        half as fast, and under the input run backwards, of which a third counts.
    - `numbers`: how many were fitted.
    - `seconds`: it took, compiling included.
    - `note`: what else is to be known.
    """

    family: str = eqx.field(static=True)
    model: AbstractModel
    blocks: tuple[float, ...] = eqx.field(static=True)
    own: float = eqx.field(static=True)
    beyond: float = eqx.field(static=True)
    numbers: int = eqx.field(static=True)
    seconds: float = eqx.field(static=True)
    note: str = eqx.field(static=True)

    @property
    def error(self) -> float:
        """The geometric mean of the errors on blocks: one block that goes where no
        other has been does not decide alone."""
        return float(np.exp(np.mean(self._logarithms)))

    @property
    def standard_error(self) -> float:
        """Of that mean, from how blocks differ; NaN of a single one."""
        if len(self.blocks) < 2 or not math.isfinite(self.error):
            return math.nan
        spread = float(np.std(self._logarithms, ddof=1))
        return self.error * spread / math.sqrt(len(self.blocks))

    @property
    def _logarithms(self) -> Float[np.ndarray, " b"]:
        # An error of nothing at all would be that of all blocks.
        return np.log(np.maximum(self.blocks, np.finfo(float).tiny))


class Comparison(Shown):
    """Families on a record.

    **Attributes:**

    - `rows`: one a family, in the order of `compare`.
    - `left_out`: why other families could not be fitted, by name.
    - `noise`: the standard deviation of the white noise on the recorded outputs, over
        their range, by what changes from sample to sample as no smooth output does:
        what no family is to follow. Few samples a cycle make it too large.

    **Source:** Rice (1984), doi 10.1214/aos/1176346788, for the noise.
    """

    rows: tuple[Compared, ...]
    left_out: Mapping[str, str] = eqx.field(static=True)
    noise: float = eqx.field(static=True)

    @property
    def best(self) -> Compared:
        """The family that comes first."""
        return self.rows[0]

    def __getitem__(self, family: str) -> Compared:
        rows = {row.family: row for row in self.rows}
        if family not in rows:
            raise KeyError(
                f"{family!r} is none of those compared, {', '.join(rows)}. "
                f"{checks.nearest(family, rows)}"
            )
        return rows[family]

    def table(self) -> list[list[str]]:
        """As cells of text, headings first; errors in % of the output's range."""
        head = ["family", "blocks left out, %", "own, %", "beyond"]
        head += ["numbers", "rate", "s"]
        return [head, *map(_cells, self.rows)]

    def noise_in_words(self) -> str:
        """How much of the errors no family is to follow."""
        return f"{100 * self.noise:.2g} % of the range of the output at most"

    def notes(self) -> list[str]:
        """What else is to be known, a line for each family or those that share it."""
        of: dict[str, list[str]] = {}
        for row in self.rows:
            of.setdefault(row.note, []).append(row.family)
        return [f"{', '.join(names)}: {note}" for note, names in of.items() if note]

    def _card(self) -> Card:
        head, *rows = self.table()
        facts = (
            (row[0], ", ".join(map(" ".join, zip(head[1:], row[1:], strict=True))))
            for row in rows
        )
        left_out = ((name, f"not fitted: {why}") for name, why in self.left_out.items())
        noise = ("noise", self.noise_in_words())
        notes = (("note", note) for note in self.notes())
        title = f"Comparison: {self.best.family} comes first"
        return Card(title, (*facts, *left_out, noise, *notes))

    def __repr__(self) -> str:
        return str(self)

    def __str__(self):
        text = f"{plain_table(self.table())}\n\nNoise: {self.noise_in_words()}."
        missing = [f"{name}: {why}" for name, why in self.left_out.items()]
        lists = {"Notes": self.notes(), "Not fitted": missing}
        parts = (["", f"{head}:", *lines] for head, lines in lists.items() if lines)
        return "\n".join(itertools.chain([text], *parts))


def _cells(row: Compared) -> list[str]:
    if math.isfinite(row.error):
        error = f"{100 * row.error:.3g}"
        if math.isfinite(row.standard_error):
            doubt = float(f"{100 * row.standard_error:.1g}")
            error = f"{error} ± {doubt:g}"
    else:
        error = "diverged"
    own = f"{100 * row.own:.3g}" if math.isfinite(row.own) else "diverged"
    rates = {True: "independent", False: "dependent", None: ""}
    rate = rates[row.model.rate_independent]
    beyond = f"{row.beyond:.2g}" if math.isfinite(row.beyond) else "diverged"
    numbers = str(row.numbers)
    return [row.family, error, own, beyond, numbers, rate, f"{row.seconds:.1f}"]


def compare(
    recordings: Recording | Sequence[Recording],
    *,
    families: Iterable[str] = tuple(FAMILIES),
    weights: refinement.Weights | None = None,
    progress: bool = False,
) -> Comparison:
    """Fit every family that may suit a record, and judge all by the same free runs.

    The samples are cut into blocks as `discover` cuts them: stretches that begin where
    a cycle does, or whole recordings where there are three and more. Each family is
    fitted once without each block and judged on that, and once to all samples. That is
    the model that comes back. A law's terms, and the radii of `PrandtlIshlinskii`, are
    chosen once, on all samples: their errors on blocks are a little too good for that,
    and rows that were kept from all of this are the better judge.

    Families are laws of the value that are linear in their numbers,

    - `"curve"`: a cubic of the input, which remembers nothing;
    - `"plays"`: nine plays beside it; `"plays and creep"`: and two slow lags;
    - `"plays behind a lag"`: all of these but the slow lags behind one fast lag;
    - `"stops"`: four stops and their cubes, springs that slide, beside the input, and
        with a clock its rate, a viscous term;

    `"two stops"`, two such springs alone, whose radii are refined too, and whose output
    no input makes leave; `"law"`, a sparse law of first order by `discover`; and models
    by their names in `hystjax.models`, each refined from what it guesses, as the
    `device` of a `models.Instrumented` with an `output_offset` where what it guesses
    misses the output by a constant above all.

    **Arguments:**

    - `recordings`: one, or several of one device. Without a clock only families are
        tried that do not depend on the rate.
    - `families`: those to be tried, of `comparison.FAMILIES`; all by default.
    - `weights`: of the samples, as for `refine`; by default recordings, where there are
        several, count by their `"range"`, as they are judged.
    - `progress`: whether to say on standard error how far it is, how long the rest may
        take and what is best so far, on a terminal or in a notebook.

    **Returns:** a `Comparison`, the least error on blocks first; but of families whose
    errors are at most twice the least, those come before all others whose outputs get
    not much farther from the middle of the recorded ones than inputs do that are 1.5
    times as large, each over half of its range, by 0.5 at most: nothing was measured
    there, and a model that runs away is known by no block. Of those no more than one
    standard error worse than the first, or no worse than outputs are known between
    samples, that of the fewest numbers takes its place.

    **Raises:** `InputError` for constant input or output, too few samples for two
    blocks, and unknown families; `ComputationError` where no family could be fitted.

    **Source:** blocks as in Roberts et al. (2017), doi 10.1111/ecog.02881; one standard
    error by Breiman et al. (1984), Classification and Regression Trees, section 3.4.3,
    doi 10.1201/9781315139470.
    """
    checks.concrete("`compare`", recordings)
    checks.answers(progress=progress)
    families = _names(families)
    group = as_group(recordings, "compare(recordings)")
    for each in group:
        checks.sized(u=each.u, w=each.w)
    case = _case(group, weights)
    rows: list[Compared] = []
    left_out: dict[str, str] = {}
    with Progress("families", len(families), asked=progress) as shown:
        for name, fitted in side_by_side(partial(_fitted, case), families):
            if isinstance(fitted, Compared):
                rows.append(fitted)
            else:
                left_out[name] = fitted
            shown.show(len(rows) + len(left_out), best=_best_of(case, rows))
    if not rows:
        raise ComputationError(
            "no family could be fitted: "
            + "; ".join(f"{name}: {why}" for name, why in left_out.items())
        )
    ranges = [float(np.ptp(np.asarray(each.w))) for each in case.group]
    return Comparison(
        tuple(_ranked(rows, _known(case, rows), _far(case))),
        left_out,
        noise_on_all(case.group, case.layout.samples.weight, ranges),
    )


_NEAR = 2.0  # times the least error
_FARTHER = 0.5  # than the input gets, each over half of its range


def _known(case: Case, rows: Sequence[Compared]) -> float:
    """To what share of their range the outputs of any model are known."""
    shares = [float(jnp.std(each.w) / jnp.ptp(each.w)) for each in case.group]
    spread = math.sqrt(np.mean(np.square(shares)))
    best = min(row.error for row in rows)
    return spread * refinement.known_to(case.group, best / spread)


def _far(case: Case) -> float:
    """How far outputs may get, over half of their range: somewhat farther than the
    input, over half of its own. That gets 1.5 times as far, or up to twice where it
    keeps to one side of zero, about which it is made larger."""
    outside = case.layout.outside
    assert outside is not None
    grid, reached = outside.grid, []
    for i, each in enumerate(case.group):  # the first of those outside are the larger
        u = np.asarray(each.u)
        middle = (u.max() + u.min()) / 2
        larger = np.stack([grid.start.u[i], grid.end.u[i]])
        reached.append(np.max(np.abs(larger - middle)) / (np.ptp(u) / 2))
    return float(max(reached)) + _FARTHER


def _ranked(rows: Sequence[Compared], known: float, far: float) -> list[Compared]:
    """Those that come first in front: one that blocks hardly tell from the first, or
    nothing can tell that is `known`, of the fewest numbers, before it."""
    least = max(known, min(row.error for row in rows))

    def order(row: Compared) -> tuple[bool, float]:
        near = row.error <= _NEAR * least and row.beyond <= far
        return not near, row.error

    first, *others = sorted(rows, key=order)
    most = max(known, first.error + first.standard_error)
    alike = [row for row in others if order(row) <= (order(first)[0], most)]
    plainest = min([first, *alike], key=lambda row: row.numbers)
    return [plainest, *(row for row in (first, *others) if row is not plainest)]


def _fitted(case: Case, name: str) -> Compared | str:
    """A family judged, or why it cannot be."""
    started = time.monotonic()
    try:
        fit = FAMILIES[name](case)
    except (InputError, ComputationError) as error:
        return str(error)
    *blocks, own = case.errors(fit.outputs).tolist()
    beyond = float(farthest(fit.case.layout, fit.model))
    reached = FittedRange.of(case.group)
    if fit.model.fitted_range is not None:  # a law knows others that follow as well
        reached = replace(reached, apart=fit.model.fitted_range.apart)
    seconds = time.monotonic() - started
    judged = tuple(blocks), own, beyond, fit.numbers, seconds
    return Compared(name, fit.model.fitted_on(reached), *judged, fit.note)


def _names(families: Iterable[str]) -> tuple[str, ...]:
    if isinstance(families, str) or not isinstance(families, Iterable):
        raise InputError(f"`families` must be a list of names, got {families!r}.")
    families = tuple(families)
    known = FAMILIES.keys()
    unknown = [x for x in families if not isinstance(x, str) or x not in known]
    if unknown or not families:
        near = checks.nearest(unknown[0], FAMILIES) if unknown else ""
        raise InputError(
            f"`families` must name some of {', '.join(FAMILIES)}; got "
            f"{', '.join(map(_described, unknown)) or 'none'}. {near}".strip()
        )
    twice = [name for i, name in enumerate(families) if name in families[:i]]
    if twice:
        raise InputError(f"`families` names {twice[0]!r} more than once.")
    return families


def _described(name: Any) -> str:
    return repr(name) if isinstance(name, str) else checks.described(name)


def _case(group: tuple[Recording, ...], weights: refinement.Weights | None) -> Case:
    """Recordings in blocks, of which there are two and more."""
    if weights is None and len(group) > 1:
        weights = "range"
    given = None if weights is None else refinement.weights_of(group, weights)
    if given is not None:  # no guess, range or noise is of what has no weight
        group = tuple(map(across, group, given))
    for each in group:
        checks.not_constant("u", each.u, "there is nothing to compare models on.")
        checks.not_constant("w", each.w, "there is nothing to compare models on.")
    laid_out = layout(group, given, steps(group, None), True)
    if laid_out.count < 2:
        raise InputError(
            f"too few samples to leave out blocks of them: {sum(map(len, group))}; "
            "give at least 90."
        )
    return Case(group, given, laid_out)


def _best_of(case: Case, rows: Sequence[Compared]) -> str:
    if not rows:
        return ""
    best = _ranked(rows, _known(case, rows), _far(case))[0]
    return f"{best.family} with {100 * best.error:.3g} %"
