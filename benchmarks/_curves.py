"""Times over the size of a problem."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hystjax.report import plain_table

from ._agreement import agreed
from ._timing import Contestant, Effort, Timing, race
from ._units import seconds, spaced

_GROWN = 1.5  # times as long as for the size before is no noise


@dataclass(frozen=True)
class Curves:
    """How the times of contestants grow.

    **Attributes:**

    - `title`: what was done.
    - `over`: what is counted by the sizes, such as `samples`.
    - `points`: timings of whole calls by size, and then by contestant.
    - `notes`: on what the contestants agree, and what to know.
    """

    title: str
    over: str
    points: Mapping[int, Mapping[str, Timing]]
    notes: Sequence[str] = ()

    def as_dict(self) -> dict[str, Any]:
        """For JSON: the points of each contestant, times in s a call."""
        names = dict.fromkeys(
            name for racing in self.points.values() for name in racing
        )
        return {
            "title": self.title,
            "over": self.over,
            "curves": {
                name: [
                    {"size": size, **racing[name].as_dict()}
                    for size, racing in self.points.items()
                    if name in racing
                ]
                for name in names
            },
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """For the terminal."""
        table = cells(self.as_dict())
        return "\n".join([self.title, "", plain_table(table), *self.notes])


def cells(table: Mapping[str, Any]) -> list[list[str]]:
    """Medians, a row for each size, of what `Curves.as_dict` gives."""
    medians = {
        name: {point["size"]: point["median"] for point in points}
        for name, points in table["curves"].items()
    }
    sizes = sorted({size for curve in medians.values() for size in curve})
    rows = [
        [
            spaced(size),
            *(
                seconds(curve[size]) if size in curve else ""
                for curve in medians.values()
            ),
        ]
        for size in sizes
    ]
    return [[table["over"], *medians], *rows]


@dataclass(frozen=True)
class Climb:
    """Problems of growing size.

    **Attributes:**

    - `title`, `over`: as of `Curves`.
    - `contestants`: those for a size; the first is what the others are compared with.
    - `apart`: how far the results of a race differ.
    - `alike`: what `apart` says, in words, and the most that it may be.
    - `notes`: what to know.
    """

    title: str
    over: str
    contestants: Callable[[int], Mapping[str, Contestant]]
    apart: Callable[[Mapping[str, Timing]], float]
    alike: tuple[str, float]
    notes: Sequence[str] = ()

    def timed(
        self,
        sizes: Sequence[int],
        effort: Effort,
        longest: float,
        race: Callable[..., Mapping[str, Timing]] = race,
    ) -> Curves:
        """Races of all sizes. Whose call takes more than `longest`, s, and more than
        one of the size before, is left out of larger ones: a GPU takes as long for a
        thousand lanes as for one.

        **Raises:** `Disagreement` when results differ by more than they may.
        """
        points, apart, left_out = {}, 0.0, set()
        before: dict[str, float] = {}
        for size in sizes:
            entered = self.contestants(size)
            racing = {name: c for name, c in entered.items() if name not in left_out}
            if not racing:
                break
            timings = race(racing, effort)
            apart = max(apart, self.apart(timings))
            points[size] = {
                name: replace(t, result=None) for name, t in timings.items()
            }
            took = {name: min(timing.warm) for name, timing in timings.items()}
            left_out |= {
                name
                for name, time in took.items()
                if time > max(longest, _GROWN * before.get(name, time))
            }
            before |= took
        notes = (
            agreed(self.alike[0], apart, self.alike[1]),
            *self.notes,
            f"who takes more than {longest:g} s, and more than for less, is not asked "
            "for more",
        )
        return Curves(self.title, self.over, points, notes)
