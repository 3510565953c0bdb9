"""Make the executed notebooks from the .py sources beside this file.

    python notebooks/build.py                 execute every source, write its .ipynb
    python notebooks/build.py quickstart      that one only
    python notebooks/build.py --check         execute all, compare, write nothing

The sources are what is edited and reviewed. A notebook holds the same cells and their
outputs, without times, versions or paths of the machine it was made on.
"""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

HERE = Path(__file__).resolve().parent
_METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def sources() -> list[Path]:
    """The sources of all notebooks."""
    return sorted(path for path in HERE.glob("*.py") if path != Path(__file__))


def read(source: Path) -> NotebookNode:
    """The notebook of a source, not executed."""
    notebook = jupytext.read(source, fmt="py:percent")
    notebook.metadata = nbformat.from_dict(_METADATA)
    for number, cell in enumerate(notebook.cells):
        cell.id, cell.metadata = f"{source.stem}-{number}", NotebookNode()
    return notebook


def executed(source: Path) -> NotebookNode:
    """The notebook of a source with its outputs.

    **Raises:** `RuntimeError` when a cell complains on standard error, or an output
    holds a path of this machine; nbclient's error when a cell fails.
    """
    notebook = read(source)
    path = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    client = NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        record_timing=False,
        resources={"metadata": {"path": str(HERE)}},
    )
    client.execute(env={**os.environ, "PYTHONPATH": path})
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            _clean(output)
    notebook.metadata = nbformat.from_dict(_METADATA)
    _refuse_paths(source, nbformat.writes(notebook))
    return notebook


def differences(source: Path) -> str:
    """How the committed notebook's cells differ from its source; empty if they do
    not."""
    target = source.with_suffix(".ipynb")
    if not target.is_file():
        return f"{target.name} is missing"
    ours, theirs = read(source).cells, nbformat.read(target, as_version=4).cells
    for number, (mine, committed) in enumerate(zip(ours, theirs, strict=False)):
        for key in ("cell_type", "source", "id"):
            if mine[key] != committed[key]:
                return f"{key} of cell {number} of {target.name} is not the source's"
    if len(ours) != len(theirs):
        return f"{target.name} has {len(theirs)} cells, its source {len(ours)}"
    return ""


def write(notebook: NotebookNode, target: Path) -> None:
    """Write a notebook whole or not at all."""
    temporary = target.with_suffix(".tmp")
    try:
        temporary.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _clean(output: NotebookNode) -> None:
    if output.output_type == "stream" and output.name == "stderr":
        raise RuntimeError(f"a cell complains: {output.text}")
    if "data" in output:
        output.metadata = NotebookNode()
        if "image/png" in output.data:  # the text beside it is for terminals
            output.data = NotebookNode({"image/png": output.data["image/png"]})


def _refuse_paths(source: Path, text: str) -> None:
    folders = {str(HERE.parent), str(Path.home()), sys.prefix, sys.base_prefix}
    folders.add(os.environ.get("HYSTJAX_DATA_DIR", ""))
    for folder in folders - {"", "/", "/usr"}:
        if re.search(rf"(?<!\w){re.escape(folder)}\b", text):
            raise RuntimeError(f"an output of {source.name} shows the path {folder}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the number of notebooks that are not in order."""
    known = {source.stem: source for source in sources()}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all")
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - known.keys():
        parser.error(f"no notebook {', '.join(unknown)}; there are {', '.join(known)}")
    stale = 0
    for name in options.names or known:
        source = known[name]
        notebook = executed(source)
        if not options.check:
            write(notebook, source.with_suffix(".ipynb"))
        problem = differences(source)
        stale += bool(problem)
        print(problem or f"{name}: done", flush=True)
    return stale


if __name__ == "__main__":
    sys.exit(main())
