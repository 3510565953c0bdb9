"""Tables of timings: for the terminal, for people and for programs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jax

from hystjax import plot
from hystjax._core import files
from hystjax.report import markdown_table, plain_table

from . import _draw
from ._curves import Curves, cells as cells_of_curves
from ._machine import machine
from ._timing import Timing
from ._units import seconds

_HERE = Path(__file__).parent
_JSON, _MARKDOWN = "results.json", "RESULTS.md"
_PREFACE = """\
# Benchmarks

Written by `make benchmarks`, a section a run. Contestants take turns in one run; times
are of warm calls, with the first call in a column of its own: it compiles what nothing
before it in the same run has compiled. The ratio compares medians: how many times as
long as the contestant marked 1. Notes on how often contestants were asked in sections
of a GPU were written by hand, where the time on it allowed less.
"""


@dataclass(frozen=True)
class Table:
    """One comparison.

    **Attributes:**

    - `title`: what was done.
    - `against`: the contestant whose median divides the others'.
    - `timings`: by contestant.
    - `notes`: on what the contestants agree, and what to know.
    - `scores`: what else there is to compare, by contestant and then by its name.
    """

    title: str
    against: str
    timings: Mapping[str, Timing]
    notes: Sequence[str] = ()
    scores: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "title": self.title,
            "against": self.against,
            "contestants": {name: self._entry(name) for name in self.timings},
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """For the terminal."""
        table = self.as_dict()
        return "\n".join([self.title, "", plain_table(_cells(table)), *self.notes])

    def _entry(self, name: str) -> dict[str, Any]:
        timing, scores = self.timings[name], self.scores.get(name)
        ratio = timing.median / self.timings[self.against].median
        entry = timing.as_dict() | {"ratio": ratio}
        return entry | {"scores": dict(scores)} if scores else entry


def write(
    results: Mapping[str, Sequence[Table | Curves]], folder: Path = _HERE
) -> None:
    """Write results of some benchmarks; what the files say of others stays, and so
    does what they say of the same ones on a processor when this is none."""
    path = folder / _JSON
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    kind = jax.default_backend()
    if kind != "cpu":
        results = {f"{name}_{kind}": tables for name, tables in results.items()}
    for name, tables in results.items():
        found = [table.as_dict() for table in tables]
        known[name] = {"date": when, "machine": machine(), "tables": found}
    known = dict(sorted(known.items()))
    files.write_text(path, json.dumps(known, indent=2, ensure_ascii=False) + "\n")
    files.write_text(folder / _MARKDOWN, _markdown(known))
    for name in results:
        if curves := _curves_of(known[name]):
            plot.save(_draw.drawn(curves), folder / f"{name}.png")


def _cells(table: Mapping[str, Any]) -> list[list[str]]:
    contestants = table["contestants"]
    scores = contestants[table["against"]].get("scores", {})
    timed = ["median", "minimum", "quartiles", "ratio", "first call"]
    head = ["contestant", *scores, *timed]
    rows = [
        [
            name,
            *(f"{entry['scores'][score]:.3g}" for score in scores),
            seconds(entry["median"]),
            seconds(entry["minimum"]),
            f"{seconds(entry['lower_quartile'])} to {seconds(entry['upper_quartile'])}",
            f"{entry['ratio']:.3g}",
            seconds(entry["first_call"]),
        ]
        for name, entry in contestants.items()
    ]
    return [head, *rows]


def _curves_of(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [table for table in result["tables"] if "curves" in table]


def _markdown(results: Mapping[str, Any]) -> str:
    sections = [_PREFACE]
    for name, result in results.items():
        about = ", ".join(f"{k} {v}" for k, v in result["machine"].items())
        sections.append(f"## {name}\n\n{result['date']}; {about}.\n")
        if _curves_of(result):
            sections.append(f"![Times over sizes]({name}.png)\n")
        for table in result["tables"]:
            cells = cells_of_curves(table) if "curves" in table else _cells(table)
            notes = "\n".join(f"- {note}" for note in table["notes"])
            sections.append(
                f"### {table['title']}\n\n{markdown_table(cells)}\n\n{notes}\n"
            )
    return "\n".join(sections)
