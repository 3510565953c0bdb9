"""Parse the command line and run a command."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import jax

from .. import _files
from .._errors import ComputationError, InputError
from . import _compiled, _data, _demo, _discover, _identify, _reproduce, _simulate

_BAD_INPUT, _NO_RESULT, _INTERRUPTED = 2, 3, 130

_DESCRIPTION = """\
Find small, readable laws for hysteresis in measured data.

  hystjax demo                                    see the main job run
  hystjax identify data.csv --time t --input V --output x --out report
  hystjax discover data.csv --time t --input V --output x --out report
  hystjax simulate report/law.json other.csv --time t --input V --output x
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
            _files.encoded(f"the argument {argument!a}", argument)
        options = _parser().parse_args(arguments)
        jax.config.update("jax_enable_x64", True)
        _compiled.keep()
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
    for command in (_identify, _discover, _simulate, _data, _reproduce, _demo):
        command.add(commands)
    return parser


def _fail(message: object, code: int) -> int:
    print(f"hystjax: error: {' '.join(str(message).split())}", file=sys.stderr)
    return code
