"""Parse the command line and run a command; compiled programs are kept for the next
process."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import jax

from .._core import files
from .._core.errors import ComputationError, InputError
from .._core.files import user_cache
from . import (
    _compare,
    _data,
    _demo,
    _discover,
    _export,
    _identify,
    _invert,
    _loops,
    _reproduce,
    _simulate,
)

_CACHE = "jax_compilation_cache_dir"


def keep() -> None:
    """Let JAX keep what it compiles in the user's cache, unless its own settings, such
    as `JAX_COMPILATION_CACHE_DIR`, say where; without a word where that cannot be."""
    if jax.config.values[_CACHE] is not None:
        return
    folder = user_cache() / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update(_CACHE, str(folder))
        # Many small programs are half of the time.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


_BAD_INPUT, _NO_RESULT, _INTERRUPTED = 2, 3, 130

_DESCRIPTION = """\
Find small, readable laws for hysteresis in measured data.

  hystjax demo                                    see the main job run
  hystjax identify data.csv --time t --input V --output x --out report
  hystjax discover data.csv --time t --input V --output x --out report
  hystjax compare data.csv --time t --input V --output x
  hystjax simulate report/law.json other.csv --time t --input V --output x
  hystjax invert report/law.json reference.csv --time t --output x
  hystjax export report/law.json --to c --out law.c
  hystjax loops data.csv --input H --output B --units A/m,T
  hystjax forc curves.frc
"""

_EPILOG = """\
Compiled programs are kept in ~/.cache/hystjax/compiled, so that later runs start
faster; JAX_ENABLE_COMPILATION_CACHE=false leaves that out.

exit codes: 0 done; 2 bad input or arguments; 3 no usable law (it is empty or its
simulation diverges); 130 interrupted. Errors are one line on standard error."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    try:
        arguments = sys.argv[1:] if arguments is None else arguments
        for argument in arguments:  # they are printed, and written into reports
            files.encoded(f"the argument {argument!a}", argument)
        options = _parser().parse_args(arguments)
        jax.config.update("jax_enable_x64", True)
        keep()
        code = options.run(options)
        sys.stdout.flush()  # now, while a reader that has gone can be dealt with
        return code
    except InputError as error:
        return _fail(error, _BAD_INPUT)
    except ComputationError as error:
        return _fail(error, _NO_RESULT)
    except KeyboardInterrupt:
        return _fail("interrupted", _INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, where argparse prints its usage as well."""

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing and leaving."""
        raise InputError(f"{message}; see `{self.prog} --help`.")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="hystjax",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    from .. import __version__

    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in (
        _identify,
        _discover,
        _compare,
        _simulate,
        _invert,
        _export,
        _loops,
        _data,
        _reproduce,
        _demo,
    ):
        command.add(commands)
    return parser


def _fail(message: object, code: int) -> int:
    print(f"hystjax: error: {' '.join(str(message).split())}", file=sys.stderr)
    return code
