"""What a process of its own takes: the whole job, from a file to a report with figures;
and the import alone."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import hystjax as hj

from . import _problem, pysindy_script
from ._agreement import agreed
from ._results import Table
from ._timing import Contestant, Effort, race

_COMMAND = "import sys; from hystjax.cli import main; sys.exit(main())"

_FORGETFUL = {"JAX_ENABLE_COMPILATION_CACHE": "false"}


def run(effort: Effort) -> tuple[Table, Table]:
    """The command line beside scripts that do the same with PySINDy and SciPy; and the
    import beside that of what it is built on."""
    return _jobs(effort), _imports(effort)


def _jobs(effort: Effort) -> Table:
    ours, again, theirs, sine = (
        "hystjax identify, nothing compiled yet",
        "hystjax identify, compiled by an earlier process",
        "PySINDy script",
        "PySINDy script, u a sine",
    )
    (file,) = hj.datasets.fetch("piezo_ayala")
    script = [sys.executable, pysindy_script.__file__, str(file)]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "hystjax")
        scripted = str(Path(folder, "script"))
        contestants = {
            ours: _process(_identify(file, report), _FORGETFUL),
            again: _process(_identify(file, report), _remembering(folder)),
            theirs: _process([*script, scripted]),
            sine: _process([*script, scripted, "--sine"]),
        }
        timings = race(contestants, effort)
        metrics = json.loads((report / "metrics.json").read_text(encoding="utf-8"))
    found = {rows: errors["nrmse"] for rows, errors in metrics["errors"].items()}
    apart = max(
        abs(found[rows] - value / 100)
        for name in (theirs, sine)
        for rows, value in _printed(timings[name].result).items()
    )
    notes = (
        agreed("NRMSE of fitted and unseen rows", apart, 1e-5),
        "each call is a new process: read the file, fit 10 000 rows, run free on these "
        "and 17 500 unseen ones, print the errors, draw three figures",
        "the script integrates with odeint; it interpolates the recorded u, or knows "
        "that it is a sine",
    )
    return Table("From a file to a report, in a new process", ours, timings, notes)


def _imports(effort: Effort) -> Table:
    base = "import jax, diffrax"
    lines = ("import hystjax", base, "import pysindy")
    contestants = {line: _process([sys.executable, "-c", line]) for line in lines}
    timings = race(contestants, effort)
    notes = ("each call is a new process; all of them have their bytecode",)
    return Table("Imports, in a new process", base, timings, notes)


def _identify(file: Path, report: Path) -> list[str]:
    rows = {"--rows": _problem.FITTED, "--test": _problem.UNSEEN}
    ranges = [f"{option}={a}:{b}" for option, (a, b) in rows.items()]
    columns = ["--time=1", "--input=3", "--output=2", "--units=V,µm"]
    settings = [f"--threshold={_problem.THRESHOLD}", f"--ridge={_problem.RIDGE}"]
    settings.append("--no-normalise")  # as PySINDy has it
    start = [sys.executable, "-c", _COMMAND, "identify", str(file)]
    return [*start, *columns, *ranges, *settings, f"--out={report}"]


def _remembering(folder: str) -> dict[str, str]:
    """Settings by which JAX keeps every program in a folder."""
    least = ("MIN_COMPILE_TIME_SECS", "MIN_ENTRY_SIZE_BYTES")
    settings = {f"JAX_PERSISTENT_CACHE_{name}": "0" for name in least}
    return {"JAX_COMPILATION_CACHE_DIR": str(Path(folder, "compiled")), **settings}


def _process(
    command: Sequence[str], settings: Mapping[str, str] = MappingProxyType({})
) -> Contestant:
    environment = {**os.environ, **settings}
    # A package that is installed has its bytecode, and a checkout keeps it by default.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def call() -> str:
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", env=environment
        )
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")
        return done.stdout

    return Contestant(call)


def _printed(output: str) -> dict[str, float]:
    """NRMSE in per cent by rows, of the script's output."""
    found = re.findall(r"^(fitted|unseen): NRMSE ([\d.]+) %$", output, re.MULTILINE)
    return {rows: float(value) for rows, value in found}
