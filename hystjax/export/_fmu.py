"""Functional mock-up units: a law in C, packed for co-simulation."""

import os
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from importlib import resources
from pathlib import Path
from xml.sax.saxutils import quoteattr

from .._core import checks, files
from .._core.checks import InputError
from .._core.solution import Solution
from ..models import AbstractModel, AbstractSequenceModel, as_model
from ..recording import Recording
from ._c import to_c
from ._program import ends, identifier, line
from ._sums import one_line, to_text

# Hidden, so that of two laws in one process none calls the functions of the other.
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off")
_FLAGS += ("-fvisibility=hidden",)
_FOLDERS = {2: "linux64", 3: "x86_64-linux"}
_SAME_TIME = (1980, 1, 1, 0, 0, 0)  # so that the same law is the same file


def fmu(
    path: str | os.PathLike[str],
    model: AbstractModel | AbstractSequenceModel | Solution,
    *,
    version: int = 2,
    name: str = "law",
    record: Recording | None = None,
) -> Path:
    """Write a device as an FMU for co-simulation: C sources, and where there is a
    compiler on 64-bit Linux a binary of them; a warning says where that cannot be
    compiled. No Python is in it.

    Its inputs are `u` and its derivative `du`: over a step of length h the input goes
    straight from where it was to u + du h. So a master that sets both follows a sampled
    input as `simulation.FixedStep(1)` does; with `du` left at 0, `u` is the input at
    the end of the step. The output is `w`, of devices whose output sees the derivative
    of the input with the `du` that was set last; `w0` is a parameter, the output at the
    start, for laws of its rate.

    **Arguments:**

    - `path`: of the file, which should end in `.fmu`.
    - `model`: one device.
    - `version`: of the Functional Mock-up Interface, 2 or 3.
    - `name`: of the unit.
    - `record`: as for `to_c`.

    **Returns:** the path.

    **Raises:** `InputError` as `to_c`, and for another version.
    """
    model = as_model(model, "fmu(path, model)")
    if checks.whole("version", version) not in _FOLDERS:
        raise InputError(f"`version` of the interface must be 2 or 3, got {version!r}.")
    identifier(name)
    source = to_c(model, record=record)
    token = str(uuid.uuid5(uuid.NAMESPACE_URL, f"hystjax {version} {source}"))
    kept = resources.files("hystjax.export") / "fmi"
    parts = {
        "law.c": source,
        **{
            each: (kept / each).read_text(encoding="utf-8")
            for each in ("instance.h", "functions.h", f"fmi{version}.c")
        },
    }
    main = f"fmi{version}.c"
    parts[main] = f'#define FMU_TOKEN "{token}"\n{parts[main]}'
    describe = _description_2 if version == 2 else _description_3
    content: dict[str, str | bytes] = {
        "modelDescription.xml": describe(model, name, token),
        **{f"sources/{each}": text for each, text in parts.items()},
    }
    if version == 3:
        content["sources/buildDescription.xml"] = _BUILD.format(name=quoteattr(name))
    binary = _compiled(parts, main)
    if binary is not None:
        content[f"binaries/{_FOLDERS[version]}/{name}.so"] = binary
    files.write_atomically(path, lambda stream: _pack(stream, content))
    return Path(path)


def _pack(stream, content: dict[str, str | bytes]) -> None:
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for place, data in content.items():
            archive.writestr(zipfile.ZipInfo(place, _SAME_TIME), data)


def _compiled(parts: dict[str, str], main: str) -> bytes | None:
    """A shared library for this machine, if that is 64-bit Linux with a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    known = os.name == "posix" and os.uname().sysname == "Linux"
    if compiler is None or not known or os.uname().machine != "x86_64":
        return None
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name, text in parts.items():
                (Path(folder) / name).write_text(text, encoding="utf-8")
            command = [compiler, *_FLAGS, main, "-o", "law.so", "-lm"]
            subprocess.run(command, cwd=folder, check=True, capture_output=True)
            return (Path(folder) / "law.so").read_bytes()
    # A compiler without its headers, say, or no room where temporary files go.
    except (OSError, subprocess.CalledProcessError) as error:
        why = getattr(error, "stderr", b"").decode(errors="replace") or error
        checks.warn(
            f"the unit has no binary, only sources: {compiler} did not compile them "
            f"({one_line(str(why))[:300]}). Mend that and write it again, or use it "
            "where units are compiled from their sources."
        )
        return None


def _head(model, name: str, version: str, token: str) -> str:
    from .. import __version__

    law = quoteattr(line(to_text(model)))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="{version}" modelName={quoteattr(name)} '
        f'{token} description={law} generationTool="hystjax {__version__}" '
        'variableNamingConvention="flat">\n'
    )


def _description_2(model, name: str, token: str) -> str:
    u, w = ends(model.names, model.units)
    head = _head(model, name, "2.0", f'guid="{token}" numberOfEventIndicators="0"')
    rows = [
        ("u", 0, 'causality="input"', u, ' start="0"'),
        ("du", 1, 'causality="input"', f"derivative of u, per s ({u})", ' start="0"'),
        ("w", 2, 'causality="output" initial="calculated"', w, ""),
        (
            "w0",
            3,
            'causality="parameter" variability="fixed"',
            f"w at the start ({w})",
            ' start="0"',
        ),
        ("time", 4, 'causality="independent"', "time, in s", ""),
    ]
    variables = "".join(
        f'<ScalarVariable name="{each}" valueReference="{i}" {kind} '
        f"description={quoteattr(about)}><Real{start}/></ScalarVariable>\n"
        for each, i, kind, about, start in rows
    )
    return f"""{head}<CoSimulation modelIdentifier={quoteattr(name)}
 canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true"
 canGetAndSetFMUstate="true" canSerializeFMUstate="true"
 canNotUseMemoryManagementFunctions="true">
<SourceFiles><File name="fmi2.c"/></SourceFiles>
</CoSimulation>
<ModelVariables>
{variables}</ModelVariables>
<ModelStructure>
<Outputs><Unknown index="3"/></Outputs>
<InitialUnknowns><Unknown index="3"/></InitialUnknowns>
</ModelStructure>
</fmiModelDescription>
"""


def _description_3(model, name: str, token: str) -> str:
    u, w = ends(model.names, model.units)
    rows = [
        ("time", 4, 'causality="independent" variability="continuous"', "time, in s"),
        ("u", 0, 'causality="input" start="0"', u),
        ("du", 1, 'causality="input" start="0"', f"derivative of u, per s ({u})"),
        ("w", 2, 'causality="output" initial="calculated"', w),
        (
            "w0",
            3,
            'causality="parameter" variability="fixed" start="0"',
            f"w at the start ({w})",
        ),
    ]
    variables = "".join(
        f'<Float64 name="{each}" valueReference="{i}" {kind} '
        f"description={quoteattr(about)}/>\n"
        for each, i, kind, about in rows
    )
    head = _head(model, name, "3.0", f'instantiationToken="{token}"')
    return f"""{head}<CoSimulation modelIdentifier={quoteattr(name)}
 canHandleVariableCommunicationStepSize="true"
 canGetAndSetFMUState="true" canSerializeFMUState="true"/>
<ModelVariables>
{variables}</ModelVariables>
<ModelStructure>
<Output valueReference="2"/>
<InitialUnknown valueReference="2"/>
</ModelStructure>
</fmiModelDescription>
"""


_BUILD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
<BuildConfiguration modelIdentifier={name}>
<SourceFileSet language="C99"><SourceFile name="fmi3.c"/></SourceFileSet>
</BuildConfiguration>
</fmiBuildDescription>
"""
