"""`hystjax export`: a saved law as a program, a unit for simulators, or text."""

from pathlib import Path

from .. import export
from .._core import files
from .._core.checks import InputError
from ..models import load
from . import _arguments

_DETAILS = """\
With FILE, the recording that the law is from, the file that is made tells its range and
holds a test of itself against the first samples of it.

formats:
  c         C99: a struct, and functions for a step and for the inverse's step
  fmu2      a unit for co-simulation, FMI 2.0, with its C sources
  fmu3      the same, FMI 3.0
  python    functions that need NumPy alone
  matlab    a function of MATLAB and Octave
  modelica  a package of Modelica
  latex     the equation
  text      the equation, as it is printed

examples:
  hystjax export report/law.json --to c --out law.c
  hystjax export report/law.json piezo.csv --time 1 --input 3 --output 2 \\
      --to fmu3 --out piezo.fmu
"""


def _fmu2(path, model, **how) -> None:
    export.fmu(path, model, version=2, **how)


def _fmu3(path, model, **how) -> None:
    export.fmu(path, model, version=3, **how)


def _text(write, *names: str):
    """What writes the text that a function of a model makes, given options by names."""

    def to(path, model, **how) -> None:
        text = write(model, **{name: how[name] for name in names})
        files.write_text(path, text if text.endswith("\n") else f"{text}\n")

    return to


# How each is written, and how its file is called by default.
_FORMATS = {
    "c": (_text(export.to_c, "name", "record"), ".c"),
    "fmu2": (_fmu2, ".fmu"),
    "fmu3": (_fmu3, ".fmu"),
    "python": (_text(export.to_numpy, "record"), ".py"),
    "matlab": (_text(export.to_matlab, "name", "record"), ".m"),
    "modelica": (_text(export.to_modelica, "name", "record"), ".mo"),
    "latex": (_text(export.to_latex), ".tex"),
    "text": (_text(export.to_text), ".txt"),
}


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "export", run, "a saved law for use elsewhere", _DETAILS
    )
    parser.add_argument("model", metavar="MODEL.json", help="a law saved by hystjax")
    _arguments.add_recording(
        parser, output_required=False, input_required=False, file_required=False
    )
    option = parser.add_argument
    _arguments.add_rows(parser)
    option("--to", choices=_FORMATS, required=True, help="what to make")
    option("--name", default="law", help="what names in it begin with (default: law)")
    option("--out", metavar="FILE", help="(default: its name and the usual ending)")


def run(options) -> int:
    """Write the file."""
    write, ending = _FORMATS[options.to]
    out = Path(options.out or f"{options.name}{ending}")
    _arguments.check_out(out, options.model, options.file)
    model = load(options.model)
    write(out, model, name=options.name, record=_record(options))
    print(model)
    print(f"wrote {out}")
    return 0


def _record(options):
    if options.file is None:
        return None
    if options.input is None or options.output is None:
        raise InputError("with FILE, say which columns are its --input and --output.")
    return _arguments.chosen_rows(options, _arguments.recording(options))
