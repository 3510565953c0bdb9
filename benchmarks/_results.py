"""Tables of timings: for the terminal, for people and for programs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hystjax import _files
from hystjax.report import markdown_table, plain_table

from ._machine import machine
from ._timing import Timing

_HERE = Path(__file__).parent
_JSON, _MARKDOWN = "results.json", "RESULTS.md"
_PREFACE = """\
# Benchmarks

Written by `make benchmarks`. Contestants take turns in one run; times are of warm
calls, with the first call, which compiles, in a column of its own. The ratio compares
medians: how many times as long as the contestant marked 1.
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
        """For JSON: times in s a piece of work, the first call's in s a call."""
        unit = self.timings[self.against].median
        return {
            "title": self.title,
            "against": self.against,
            "contestants": {
                name: _entry(timing, unit, self.scores.get(name))
                for name, timing in self.timings.items()
            },
            "notes": list(self.notes),
        }

    def text(self) -> str:
        """For the terminal."""
        table = self.as_dict()
        return "\n".join([self.title, "", plain_table(_cells(table)), *self.notes])


def write(results: Mapping[str, Sequence[Table]], folder: Path = _HERE) -> None:
    """Write results of some benchmarks; what the files say of others stays."""
    path = folder / _JSON
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    for name, tables in results.items():
        found = [table.as_dict() for table in tables]
        known[name] = {"date": when, "machine": machine(), "tables": found}
    known = dict(sorted(known.items()))
    _files.write_text(path, json.dumps(known, indent=2, ensure_ascii=False) + "\n")
    _files.write_text(folder / _MARKDOWN, _markdown(known))


def _entry(
    timing: Timing, unit: float, scores: Mapping[str, float] | None
) -> dict[str, Any]:
    low, lower, median, upper = timing.quantiles
    entry = {
        "median": median,
        "minimum": low,
        "lower_quartile": lower,
        "upper_quartile": upper,
        "ratio": median / unit,
        "first_call": timing.first,
        "warm_calls": len(timing.warm),
        "pieces_a_call": timing.pieces,
    }
    return entry | {"scores": dict(scores)} if scores else entry


def _cells(table: Mapping[str, Any]) -> list[list[str]]:
    contestants = table["contestants"]
    scores = contestants[table["against"]].get("scores", {})
    timed = ["median", "minimum", "quartiles", "ratio", "first call"]
    head = ["contestant", *scores, *timed]
    rows = [
        [
            name,
            *(f"{entry['scores'][score]:.3g}" for score in scores),
            _seconds(entry["median"]),
            _seconds(entry["minimum"]),
            f"{_seconds(entry['lower_quartile'])} to "
            f"{_seconds(entry['upper_quartile'])}",
            f"{entry['ratio']:.3g}",
            _seconds(entry["first_call"]),
        ]
        for name, entry in contestants.items()
    ]
    return [head, *rows]


def _markdown(results: Mapping[str, Any]) -> str:
    sections = [_PREFACE]
    for name, result in results.items():
        about = ", ".join(f"{k} {v}" for k, v in result["machine"].items())
        sections.append(f"## {name}\n\n{result['date']}; {about}.\n")
        for table in result["tables"]:
            notes = "\n".join(f"- {note}" for note in table["notes"])
            sections.append(
                f"### {table['title']}\n\n{markdown_table(_cells(table))}\n\n{notes}\n"
            )
    return "\n".join(sections)


def spaced(count: int) -> str:
    """A count with its thousands apart."""
    return f"{count:,}".replace(",", " ")


def _seconds(value: float) -> str:
    """Three digits and a unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{float(f'{value / size:.3g}'):g} {unit}"
    return f"{float(f'{value / 1e-6:.3g}'):g} µs"
