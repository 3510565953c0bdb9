"""Puts the tables of figures into the guides, out of what `python -m benchmarks` and
`hystjax reproduce NAME --out docs/reproduced` have written: `make tables`, after these.

A table stands between two comments, the first of which says what makes it, one of the
functions here or a study:

    <!-- table: noise -->
    <!-- end of table -->
"""

import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
DOCS, STUDIES = ROOT / "docs", ROOT / "docs" / "reproduced"
sys.path.append(str(ROOT))

from benchmarks._units import seconds  # noqa: E402
from hystjax._core import files  # noqa: E402
from hystjax._core.show import markdown_table  # noqa: E402

Cells = Sequence[Sequence[str]]
_PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.S)


def filled(text: str) -> str:
    """A page with its tables as they are to be now."""

    def table(place: re.Match[str]) -> str:
        name = place[2]
        cells = TABLES[name]() if name in TABLES else study(name)
        return f"{place[1]}\n{markdown_table(cells)}\n\n{place[3]}"

    return _PLACE.sub(table, text)


def main() -> None:
    """Fill the pages in."""
    for page in sorted(DOCS.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        files.write_text(page, filled(text))


# ------------------------------------------------------------------- by `reproduce`


def study(name: str) -> list[list[str]]:
    """The table of a study as it was printed, headings first."""
    page = (STUDIES / f"{name}.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.startswith("|")]
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    cells = [[cell.strip().replace(r"\|", "|") for cell in row] for row in rows]
    return [cells[0], *cells[2:]]


def _paper() -> Cells:
    """Errors of the paper's laws, from three of its experiments."""
    head = ["experiment", "figure", "paper", "rerun of its scripts", "hystjax"]
    figures = ("squared error, %", "NRMSE", "with the script's", "rounded law, unseen")
    rows = []
    for title in ("1, Duhem", "2, Bouc–Wen", "6, measured piezo"):
        told = title
        for row in study(f"experiment_{title[0]}")[1:]:
            if row[0].startswith(figures):
                rows.append([told, *row[:4]])
                told = ""
    return [head, *rows]


def _boucwen() -> Cells:
    """Of the benchmark's oscillator from random starts the worst, by run."""
    head, *every = study("boucwen")
    distances = ("unseen", "multisine", "sweep")
    rows = [["", "starts that find it", "largest error of a parameter, %", *distances]]
    for run in dict.fromkeys(row[0] for row in every):
        starts = [dict(zip(head, row, strict=True)) for row in every if row[0] == run]
        names = head[head.index("m") : head.index("n") + 1]
        error = max(abs(float(start[name])) for start in starts for name in names)
        far = [max((s[name] for s in starts), key=float) for name in distances]
        found = sum(start[""] == "converged" for start in starts)
        rows.append([run, f"{found} of {len(starts)}", f"{error:g}", *far])
    return rows


def _found_again() -> Cells:
    """In how many records of classical models their numbers are found, by noise."""
    head, *every = study("classical")
    fits = [dict(zip(head, row, strict=True)) for row in every]
    noises = dict.fromkeys(fit["noise, %"] for fit in fits)
    rows = [["model", "numbers fitted", *(f"{noise} %" for noise in noises)]]
    for model in dict.fromkeys(fit["model"] for fit in fits):
        own = [fit for fit in fits if fit["model"] == model]
        seeds = (fit["seeds within 4 s.e."] for fit in own)
        rows.append([model, own[0]["numbers"], *seeds])
    return rows


# ------------------------------------------------------------------ by `benchmarks`


def _benchmark(name: str) -> list[Mapping[str, Any]]:
    path = ROOT / "benchmarks" / "results.json"
    return json.loads(path.read_text(encoding="utf-8"))[name]["tables"]


def _noise() -> Cells:
    """How often the right terms are found under noise, and how far off they are."""
    ours, *rivals = (
        "hystjax.discover",
        "pysindy STLSQ",
        "pysindy SR3",
        "pysindy ensemble STLSQ",
        "pysindy weak form, STLSQ",
    )
    scores = ("right, %", "error, %", "error ratio")
    others = ("STLSQ", "SR3", "ensemble", "weak form")
    rows = [["records", "`hj.discover`", "its error, %", "error ratio", *others]]
    for table in _benchmark("discover"):
        found = table["contestants"]
        own = [found[ours]["scores"][score] for score in scores]
        their = [found[name]["scores"]["right, %"] for name in rivals]
        title = table["title"].partition(" noise:")[0]
        rows.append([title, *(f"{x:.3g}" for x in own + their)])
    last = _benchmark("discover")[-1]["contestants"]
    own, *times = (seconds(last[name]["median"]) for name in (ours, *rivals))
    return [*rows, ["median time of the last of these, warm", own, "", "", *times]]


_GROUPS = {
    "all of them": "all",
    "those of them": "the same, told, and no term equal to a true one on the record",
    "such excitations": "the same, told",
    "the weakest term": "told",
    "excitations of several": "several amplitudes or frequencies",
    "a sine or a triangle": "a sine or a triangle",
    "does not mark": "not marked by `discover`",
    "marked as": "marked as not for other amplitudes and frequencies",
}


def _population() -> Cells:
    """How laws that were drawn at random are found, and how they carry."""
    head = ["laws", "number", "right, `hj.discover`, %", "true terms listed, %"]
    head += ["coefficient error, ratio", "unseen, ratio", "its 95th percentile"]
    rows = [[*head, "STLSQ right, %", "weak form right, %"]]
    for table in _benchmark("population"):
        found = table["contestants"]
        own = found["hystjax.discover"]["scores"]
        names = ("pysindy STLSQ", "pysindy weak form, STLSQ")
        group = next(said for part, said in _GROUPS.items() if part in table["title"])
        number = _said(r"\((\d+)\)$", [table["title"]])
        listed = _said(r"the true terms are among .* in (\d+) %", table["notes"])
        scores = ("error ratio", "unseen ratio", "its 95th percentile")
        figures = [own[each] for each in scores]
        figures += [found[name]["scores"]["right, %"] for name in names]
        right = f"{own['right, %']:.3g}"
        rows.append([group, number, right, listed, *(f"{x:.3g}" for x in figures)])
    return rows


def _said(pattern: str, texts: Iterable[str]) -> str:
    """What one of some texts says."""
    return next(found[1] for text in texts if (found := re.search(pattern, text)))


class _Job(NamedTuple):
    """A row of the table of speed, and its peers.

    **Attributes:** what is done; which table of which benchmark tells; whose times
    these are; and what peers do, by the name that they have there.
    """

    what: str
    benchmark: str
    table: int
    ours: str
    peers: Mapping[str, str]


_FIT, _SIMULATED = "hystjax.identify", "hystjax.simulate"
_ONE, _SINE = "pysindy.SINDy.fit", "scipy odeint, u a sine"
_SCAN, _SCIPY = "jax.lax.scan by hand", "scipy least_squares over odeint"
_SCRIPTS = {
    "PySINDy script": "PySINDy script, u interpolated",
    "PySINDy script, u a sine": "PySINDy script, u a sine",
}
_JOBS = (
    _Job(
        "one STLSQ fit, 10 000 rows, 21 terms",
        *("regress", 0, _FIT),
        {
            f"{_ONE}, one target": f"`{_ONE}`, the same target",
            f"{_ONE}, five targets": "the paper's script, five targets",
        },
    ),
    _Job(
        "1000 thresholds in one call, a fit",
        *("thresholds", 0, "hystjax, 1000 thresholds"),
        {f"{_ONE}, 10 of them": f"`{_ONE}`"},
    ),
    _Job(
        "100 000 fits, 100 thresholds of 1000 bootstraps, by `hj.sweep`, a fit",
        *("bootstraps", 0, "hystjax.sweep, 1000 bootstraps of 100 thresholds"),
        {f"{_ONE}, 10 of them": f"`{_ONE}`"},
    ),
    _Job(
        "100 000 000 samples on disk, 21 terms",
        *("long_record", 0, _FIT),
        {"read the files and evaluate the library": "reading, and the library alone"},
    ),
    _Job(
        "simulate 10 000 samples, the default",
        *("simulate", 0, "hystjax.simulate, the default"),
        {
            _SINE: "SciPy `odeint`, u a sine in closed form",
            "scipy odeint, u interpolated": "`odeint`, u interpolated",
            "pysindy simulate, u a sine": "`pysindy.SINDy.simulate`",
        },
    ),
    _Job(
        "the same by `FixedStep`",
        *("simulate", 0, "hystjax.simulate, FixedStep(1)"),
        {_SINE: "SciPy `odeint`, u a sine in closed form"},
    ),
    _Job(
        "gradient of the default in five coefficients",
        *("simulate", 1, "gradient of the default"),
        {
            "hystjax.simulate, the default": "the simulation alone",
            "differences of scipy odeint, u a sine": "differences of `odeint`",
        },
    ),
    _Job(
        "32 plays, 100 000 samples, 260 turning points",
        *("operators", 0, _SIMULATED),
        {_SCAN: "`lax.scan` by hand", "NumPy loop": "a NumPy loop"},
    ),
    _Job(
        "the same along a random walk",
        *("operators", 1, _SIMULATED),
        {_SCAN: "`lax.scan` by hand"},
    ),
    _Job(
        "its mean square's gradient in 32 radii and weights",
        *("operators", 2, f"{_SIMULATED}, gradient"),
        {f"{_SCAN}, gradient": "derivatives of `lax.scan`"},
    ),
    _Job(
        "9870 relays, 100 000 samples",
        *("operators", 3, _SIMULATED),
        {f"{_SCAN} over every relay": "every relay by `lax.scan`"},
    ),
    _Job(
        "refine five coefficients over 10 000 samples",
        *("refine", 0, "hystjax.refine"),
        {_SCIPY: "SciPy `least_squares` over `odeint`"},
    ),
    _Job(
        "refine three over 1000, 256 records in one call, each",
        *("refine", 2, "hystjax.refine, 32 at a time"),
        {f"{_SCIPY}, 4 of them": "the same"},
    ),
    _Job(
        "the same for 4096 records by `hj.sweep`, each",
        *("refinements", 0, "hystjax.sweep, 4096 lanes"),
        {f"{_SCIPY}, 4 of them": "the same"},
    ),
    _Job(
        "`hj.compare`, all families on 10 000 samples of a piezo",
        *("comparison", 0, "hystjax.compare"),
        {f"{_SCIPY}, one law": "SciPy `least_squares` over `odeint`, one law"},
    ),
    _Job(
        "`hystjax identify`, whole process, nothing compiled yet",
        *("process", 0, "hystjax identify, nothing compiled yet"),
        _SCRIPTS,
    ),
    _Job(
        "the same, compiled by an earlier process",
        *("process", 0, "hystjax identify, compiled by an earlier process"),
        _SCRIPTS,
    ),
)


def _speed() -> Cells:
    """How long jobs take, and their peers."""
    rows = [["job", "warm", "first call", "peer", "its time", "times as fast"]]
    for job in _JOBS:
        found = _benchmark(job.benchmark)[job.table]["contestants"]
        ours = found[job.ours]
        first = [job.what, seconds(ours["median"]), seconds(ours["first_call"])]
        for name, said in job.peers.items():
            their = found[name]["median"]
            ratio = _two_digits(their / ours["median"])
            rows.append([*first, said, seconds(their), ratio])
            first = ["", "", ""]
    return rows


def _precision() -> Cells:
    """What is lost in single precision, and what is won."""
    rows = [["stage", "loss, multisine", "loss, piezo", "time, float32 over float64"]]
    for table in _benchmark("precision"):
        single = table["contestants"]["float32"]
        figures = *single["scores"].values(), single["ratio"]
        rows.append([table["title"], *map(_two_digits, figures)])
    return rows


_SIZES = (
    ("a fit of {} samples, 21 terms", 0, (10_000, 1_000_000)),
    ("fits of 1000 samples, {} of them", 2, (1, 10_000)),
    ("simulations of 1000 samples, {} of them", 3, (1, 100_000)),
    ("refinements over 1000 samples, {} of them", 4, (1, 10_000)),
)


def _gpu() -> Cells:
    """One call and many on a GPU and on two cores, a dash where none was timed."""
    rows = [["", "GPU", "the 16 cores beside it", "two cores elsewhere"]]
    machines = ("scaling_gpu", "gpu"), ("scaling_gpu", "cpu"), ("scaling", "cpu")
    for said, place, sizes in _SIZES:
        for size in sizes:
            row = [said.format(f"{size:,}".replace(",", " "))]
            for name, device in machines:
                curves = _benchmark(name)[place]["curves"].items()
                (curve,) = (each for what, each in curves if f"({device})" in what)
                times = {each["size"]: each["median"] for each in curve}
                row.append(seconds(times[size]) if size in times else "–")
            rows.append(row)
    return rows


def _two_digits(x: float) -> str:
    return f"{float(f'{x:.2g}'):g}"


TABLES: Mapping[str, Callable[[], Cells]] = {
    "paper": _paper,
    "boucwen": _boucwen,
    "found_again": _found_again,
    "noise": _noise,
    "population": _population,
    "speed": _speed,
    "precision": _precision,
    "gpu": _gpu,
}

if __name__ == "__main__":
    main()
