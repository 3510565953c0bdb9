"""Parse the command line and run a command; compiled programs are kept for the next
process."""

import argparse
import contextlib
import glob
import io
import itertools
import os
import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import jax

from .._core import files
from .._core.checks import ComputationError, InputError, nearest
from .._core.files import user_cache
from . import _arguments, _given, _laws, _loops, _saved

_CACHE = "jax_compilation_cache_dir"
_PLATFORMS = "jax_platforms"


def _kept() -> Path | None:
    """Where compiled programs are kept, but for a user without a home."""
    with contextlib.suppress(InputError):
        return user_cache() / "compiled"


def keep() -> None:
    """Let JAX keep what it compiles in the user's cache, unless its own settings, such
    as `JAX_COMPILATION_CACHE_DIR`, say where; without a word where that cannot be."""
    folder = _kept()
    if folder is None or jax.config.values[_CACHE] is not None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update(_CACHE, str(folder))
        # Many small programs are half of the time.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


# What JAX says of a program whose file it can neither read nor write.
_NOT_KEPT = re.compile(r"Error \w+ persistent compilation cache entry for '([^']+)'")


def _is_of_cache(message: str) -> bool:
    """Whether a warning is of our cache alone. What JAX has half written, as on a full
    disk, it would read in vain ever after and never replace: that is removed here."""
    found, folder = _NOT_KEPT.match(message), _kept()
    if not found or folder is None or jax.config.values[_CACHE] != str(folder):
        return False
    for file in folder.glob(f"{glob.escape(found[1])}-*"):
        with contextlib.suppress(OSError):
            file.unlink()
    return True


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
Compiled programs are kept in ~/.cache/hystjax/compiled, or in hystjax/compiled of
XDG_CACHE_HOME where that is set, so that later runs start faster;
JAX_ENABLE_COMPILATION_CACHE=false leaves that out. A GPU, which takes longer for single
records than a processor does, is used where JAX_PLATFORMS=cuda asks for it.

exit codes: 0 done; 2 bad input or arguments; 3 no usable law (it is empty or its
simulation diverges); 130 interrupted. Errors are one line on standard error."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # As on standard error: µ and the like, where the terminal or file has none.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        arguments = sys.argv[1:] if arguments is None else arguments
        for argument in arguments:  # they are printed, and written into reports
            files.encoded(f"the argument {argument!a}", argument)
        options = _parser().parse_args(arguments)
        jax.config.update("jax_enable_x64", True)
        if not jax.config.values[_PLATFORMS]:
            # Single records take longer on a GPU, and so does finding one.
            jax.config.update(_PLATFORMS, "cpu")
        keep()
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            code = options.run(options)
        if sys.stdout is not None:  # as without a console
            sys.stdout.flush()  # now, while a reader that has gone can be dealt with
        return code
    except InputError as error:
        return _fail(error, _BAD_INPUT)
    except ComputationError as error:
        return _fail(error, _NO_RESULT)
    except KeyboardInterrupt:
        return _fail("interrupted", _INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone, as `| head` does
        _give_up_output()
        return 0
    except OSError as error:  # of a full disk, such as /dev/full plays
        _give_up_output()
        return _fail(f"the output cannot be written: {error.strerror}", _BAD_INPUT)


def run() -> NoReturn:
    """The command line as a process of its own, which ends with the exit code."""
    code = main()
    if code == _INTERRUPTED:
        # Threads may be compiling still: XLA aborts where Python is taken down under
        # it, and may take half a minute to end by itself.
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)
    sys.exit(code)


def _give_up_output() -> None:
    """Let what is still to be written go nowhere, or Python would try again at exit."""
    if sys.stdout is not None:
        with contextlib.suppress(OSError, ValueError):  # of what is no file
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _warn(message: Any, *_: Any, **__: Any) -> None:
    """A warning in one line, without the place in the code that it is from."""
    if _is_of_cache(str(message)):
        return
    _tell(f"hystjax: warning: {_said(message)}")


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, where argparse prints its usage as well."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        # What begins so is a value and no option: -30:150 and -1e-3 as well as -30; and
        # units of which the first is none, -,MPa.
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf|,)")

    def error(self, message: str) -> NoReturn:
        """Raise instead of printing and leaving."""
        raise InputError(f"{message}; see `{self.prog} --help`.")

    def parse_args(self, args=None, namespace=None):  # pyright: ignore
        """What is not known is answered, options with the nearest one."""
        options, rest = self.parse_known_args(args, namespace)
        if rest and not _taken_late(options, rest):
            options.parser._refuse(rest)
        return options

    def parse_known_args(self, args=None, namespace=None):  # pyright: ignore
        # Before what is missing: a name that is misspelt is that too. What stands
        # behind a command is of that.
        own = iter(args or ())
        if self._subparsers is not None:
            own = itertools.takewhile(lambda each: each.startswith("-"), own)
        unknown = [each for each in own if self._unknown(each)]
        if unknown:
            self._refuse(unknown[:1])
        return super().parse_known_args(args, namespace)

    def _unknown(self, given: str) -> bool:
        name = given.partition("=")[0]
        known = any(each.startswith(name) for each in self._option_string_actions)
        return name.startswith("--") and not known

    def _refuse(self, given: Sequence[str]) -> NoReturn:
        near = nearest(given[0].partition("=")[0], self._option_string_actions)
        self.error(f"unrecognized arguments: {' '.join(given)}{_aside(near)}")

    def _check_value(self, action, value):
        if action.choices is not None and value not in action.choices:
            listed = ", ".join(map(repr, action.choices))
            near = nearest(value, map(str, action.choices))
            message = f"invalid choice: {value!r} (choose from {listed}){_aside(near)}"
            raise argparse.ArgumentError(action, message)


def _taken_late(options: argparse.Namespace, rest: Sequence[str]) -> bool:
    """Whether what is left is the one argument that may be left out, and was put behind
    an option, where argparse of Python 3.11 does not look for it."""
    left_out = [
        action
        for action in options.parser._get_positional_actions()
        if action.nargs == "?" and getattr(options, action.dest) is action.default
    ]
    if len(rest) > 1 or rest[0].startswith("-") or not left_out:
        return False
    value = options.parser._get_values(left_out[0], list(rest))
    setattr(options, left_out[0].dest, value)
    return True


def _aside(said: str) -> str:
    """In brackets, if anything is said."""
    return f" ({said.strip()})" if said else ""


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
    for add in (
        _laws.add_identify,
        _laws.add_discover,
        _laws.add_compare,
        _saved.add_simulate,
        _saved.add_invert,
        _saved.add_export,
        _loops.add,
        _given.add_data,
        _given.add_reproduce,
        _given.add_demo,
    ):
        add(commands)
    return parser


def _fail(message: object, code: int) -> int:
    _tell(f"hystjax: error: {_said(message)}")
    return code


def _tell(line: str) -> None:
    """On standard error, if that can be written."""
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr)


def _said(message: object) -> str:
    """A message in one line, in words of the command line."""
    return _arguments.as_options(" ".join(str(message).split()))
