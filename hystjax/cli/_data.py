"""`hystjax data`: the measured recordings hystjax knows."""

from ..recording import datasets
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
    """Add the command and its actions."""
    parser = _arguments.command(
        commands, "data", None, "list, fetch or locate measured recordings", _DETAILS
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    _arguments.command(
        actions, "list", _list, "show what each recording is, its licence and source"
    )
    fetch = _arguments.command(
        actions, "fetch", _fetch, "download one recording, or all, and say where it is"
    )
    fetch.add_argument("name", metavar="NAME", nargs="?", help="default: all")
    path = _arguments.command(
        actions, "path", _path, "say where a recording is, without a download"
    )
    path.add_argument("name", metavar="NAME")


def _list(options) -> int:
    print(datasets.listing())
    return 0


def _fetch(options) -> int:
    for name in [options.name] if options.name else datasets.names():
        print(*datasets.fetch(name), sep="\n")
    return 0


def _path(options) -> int:
    print(datasets.path(options.name))
    return 0
