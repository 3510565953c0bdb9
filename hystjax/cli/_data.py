"""`hystjax data`: the measured recordings hystjax knows."""

from .. import datasets
from . import _arguments

_DETAILS = """\
Recordings are read from the folder in HYSTJAX_DATA_DIR, else from the cache, else
downloaded from their source; files are checked by SHA-256.

examples:
  hystjax data list
  hystjax data fetch piezo_ayala
  hystjax data path piezo_ayala
"""


def add(commands) -> None:
    """Add the command."""
    parser = _arguments.command(
        commands, "data", run, "list, fetch or locate measured recordings", _DETAILS
    )
    parser.add_argument("action", choices=("list", "fetch", "path"))
    parser.add_argument("name", nargs="?", help="a recording (fetch: default all)")


def run(options) -> int:
    """Print the registry, or paths of files."""
    if options.action == "list":
        print(datasets.listing())
    elif options.action == "path":
        print(datasets.path(options.name or ""))
    else:
        for name in [options.name] if options.name else datasets.names():
            print(*datasets.fetch(name), sep="\n")
    return 0
