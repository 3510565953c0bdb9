"""What people are shown: results, as text, tables, HTML with a small loop, and LaTeX;
and progress, where somebody is watching."""

import html
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, SupportsFloat

import equinox as eqx
import numpy as np

from .checks import InputError, described, is_concrete


def markdown_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in Markdown, in which `|u'|` does not end a cell; raises
    `InputError` for what is none."""
    _check_table(table)
    cells = [[cell.replace("|", r"\|") for cell in row] for row in table]
    head, *body = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join([head, "|---" * len(table[0]) + "|", *body])


def markdown_page(sections: Iterable[str]) -> str:
    """Sections in Markdown, those that have text. Dollars are of names and units, such
    as US$, and set no mathematics, but around a section that is all of it."""
    shown = (
        each if each.startswith("$$") else each.replace("$", r"\$")
        for each in sections
        if each
    )
    return "\n\n".join(shown) + "\n"


_MARKS = re.compile(r"\*|(?<!\w)_|_(?!\w)")


def escaped(text: str) -> str:
    """Text that Markdown shows as it is, with what is `code` as code."""
    parts = text.split("`")
    # Not every Markdown takes a backslash before `<`.
    parts[::2] = [
        _MARKS.sub(r"\\\g<0>", part).replace("<", "&lt;") for part in parts[::2]
    ]
    return "`".join(parts)


def escaped_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in Markdown that shows cells as they are, with what is `code` as
    code."""
    return markdown_table([[escaped(cell) for cell in row] for row in table])


def plain_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in columns, for a terminal; raises `InputError` for what is
    none."""
    _check_table(table)
    return "\n".join(_aligned(table))


def _check_table(table: Any) -> None:
    rows = table if isinstance(table, list | tuple) else ()
    if not rows or not all(isinstance(row, list | tuple) for row in rows):
        got = described(table)
    elif len({len(row) for row in rows}) > 1:
        got = f"rows of {', '.join(str(len(row)) for row in rows)} cells"
    elif odd := [cell for row in rows for cell in row if not isinstance(cell, str)]:
        got = f"{described(odd[0])} in a cell"
    else:
        return
    raise InputError(
        "`table` must be a list of rows, each a list of as many texts, as "
        f"`hystjax.report.error_table` returns; got {got}."
    )


def _aligned(table: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    rows = (zip(row, widths, strict=True) for row in table)
    return ["  ".join(cell.ljust(n) for cell, n in row).rstrip() for row in rows]


_POINTS = 4000  # of a curve that are looked at
_WIDTH, _HEIGHT, _MARGIN = 280, 210, 26  # of a picture, in pixels
# As in `plot`: broad and pale what was recorded, so that a run drawn on it leaves both
# visible.
_RECORDED = 'stroke="#a9a9a9" stroke-width="3"'
_RUN = 'stroke="#D55E00" stroke-width="1.3"'


class Number(NamedTuple):
    """A number of a model: its name, value, unit and standard error, where known."""

    name: str
    value: float
    unit: str = ""
    error: float | None = None


class Curve(NamedTuple):
    """An output over its input, both of shape (n,), and whether it was recorded."""

    u: np.ndarray
    w: np.ndarray
    recorded: bool = False


@dataclass(frozen=True)
class Card:
    """What is shown of a result, however it is shown.

    **Attributes:**

    - `title`: one line, such as an equation.
    - `facts`: what else is known, as pairs of texts.
    - `numbers`: those of a model.
    - `latex`: the equation, without dollar signs.
    - `curves`: loops; the first says how far the picture reaches.
    - `axes`: what the input and the output are, with their units.
    """

    title: str
    facts: tuple[tuple[str, str], ...] = ()
    numbers: tuple[Number, ...] = ()
    latex: str = ""
    curves: tuple[Curve, ...] = ()
    axes: tuple[str, str] = ("", "")

    def text(self) -> str:
        """For terminals."""
        lines = (*_aligned(self.facts), *_aligned(_table(self.numbers)))
        return "\n".join([self.title, *(f"  {line}" for line in lines)])

    def html(self) -> str:
        """For notebooks; colours are those of the page."""
        beside = (_html_table(self.facts), _html_table(_table(self.numbers)))
        parts = [_picture(self.curves, self.axes), *beside]
        cells = "".join(f"<div>{part}</div>" for part in parts if part)
        return (
            '<div style="max-width:100%;overflow-x:auto">'
            '<div style="white-space:pre-wrap">'
            f"<code>{html.escape(self.title)}</code></div>"
            '<div style="display:flex;flex-wrap:wrap;gap:0 2em;align-items:flex-start">'
            f"{cells}</div></div>"
        )


class Shown(eqx.Module):
    """A result that shows itself by its card; while it is traced, or a batch without
    one, as Equinox shows every module."""

    def _card(self) -> Card | None:
        return None

    def __repr__(self) -> str:
        card = self._card()
        return eqx.tree_pformat(self) if card is None else card.text()

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str | None:
        card = self._card()
        return None if card is None else card.html()

    def _repr_latex_(self) -> str | None:
        card = self._card()
        return f"${card.latex}$" if card is not None and card.latex else None


def samples_card(title: str, of: Any, recorded: bool = False) -> Card | None:
    """The card of an input and an output over time: of what has `t`, `u` and `w`, each
    of shape (n,), `names`, `units` and `clocked`. `None` for batches, and while they
    are traced."""
    columns, names, units = (of.t, of.u, of.w), of.names, of.units
    if np.ndim(of.t) != 1 or not is_concrete(*columns):
        return None
    t, u, w = (np.asarray(x, float) for x in columns)
    ranges = [(names[0], _range(u, units[0])), (names[1], _range(w, units[1]))]
    every = np.diff(t)
    even = np.ptp(every) < 0.01 * np.mean(every)
    pace = f"every {np.mean(every):.4g} s" if even else "unevenly spaced"
    first, last = (moment(each, 4) for each in (t[0], t[-1]))
    time = f"{first} to {last} s, {pace}" if of.clocked else "no clock"
    labels = with_unit(names[0], units[0]), with_unit(names[1], units[1])
    curves = (Curve(u, w, recorded),)
    return Card(title, (("t", time), *ranges), curves=curves, axes=labels)


def _range(x: np.ndarray, unit: str) -> str:
    """From where to where a column goes, but for what is no number in it."""
    numbers = x[~np.isnan(x)]
    if not numbers.size:
        return "no number"
    low, high = _limits(np.min(numbers), np.max(numbers), 4)
    return f"{low} to {high} {unit}".strip()


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A number with its unit, such as `0.3829 µm`."""
    return f"{float(value):.{digits}g} {unit}".strip()


def _limits(low: float, high: float, digits: int) -> tuple[str, str]:
    """Two numbers, of which as much is told as tells them apart beside an offset."""
    largest, apart = max(abs(low), abs(high)), high - low
    if 0 < apart < largest < np.inf:
        digits += int(np.ceil(np.log10(largest / apart)))
    return f"{low:.{digits}g}", f"{high:.{digits}g}"


def moment(t: SupportsFloat, digits: int = 6) -> str:
    """A time or the number of a sample, without a unit; of a large one as much as tells
    it from its neighbours, such as thousandths of seconds since 1970."""
    whole = len(f"{abs(float(t)):.0f}")
    return f"{float(t):.{digits if whole <= 5 else whole + 3}g}"


def with_unit(name: str, unit: str) -> str:
    """Such as `displacement (µm)`."""
    return f"{name} ({unit})" if unit else name


def as_factor(unit: str) -> str:
    """A unit as it stands in products and below a stroke: one that is made of several
    is kept together, such as `(A/m)`."""
    return f"({unit})" if set(unit) & set(" /·*^²³") else unit


Dimension = tuple[float, float, float]
"""Powers of the units of output, input and second in another unit."""


def unit_of(dimension: Dimension, units: tuple[str, str]) -> str:
    """The unit of such powers, such as `µm V^-1`, by the units of input and output;
    `1` where all powers are zero."""
    w, u, s = dimension
    powers = ((units[1] or "[w]", w), (units[0] or "[u]", u), ("s", s))
    there = [(unit, float(f"{power:.3g}")) for unit, power in powers if power]
    there.sort(key=lambda factor: factor[1] < 0)  # `V s^2 µm^-1`, as it is said
    if [power for _, power in there] == [1]:
        return there[0][0]
    factors = (as_factor(unit) + (f"^{p:g}" if p != 1 else "") for unit, p in there)
    return " ".join(factors) or "1"


def _table(numbers: Sequence[Number]) -> list[tuple[str, ...]]:
    """Numbers as cells of text, with a column of standard errors where one is known."""
    if not numbers:
        return []
    known = any(number.error is not None for number in numbers)
    rows = []
    for name, value, unit, error in numbers:
        doubt = "" if error is None else f"± {error:.2g}"
        rows.append((name, f"{value:.4g}", *((doubt,) if known else ()), unit))
    return rows


def _html_table(rows: Iterable[Sequence[str]]) -> str:
    lines = "".join(
        "<tr>"
        + "".join(
            f'<td style="text-align:left;padding:1px 8px">{html.escape(cell)}</td>'
            for cell in row
        )
        + "</tr>"
        for row in rows
    )
    return f"<table>{lines}</table>" if lines else ""


def _picture(curves: Sequence[Curve], axes: tuple[str, str]) -> str:
    """A small drawing of loops, as SVG."""
    drawn = [_thinned(curve) for curve in curves]
    drawn = [curve for curve in drawn if len(curve.u) > 1]
    if not drawn:
        return ""
    # A law that runs away would flatten what was recorded: the first sets the frame.
    low, high = (
        np.array([limit(drawn[0].u), limit(drawn[0].w)]) for limit in (np.min, np.max)
    )
    span = np.where(high > low, high - low, 1.0)
    lines = []
    for curve in drawn:
        points = " ".join(_pixels(curve, low, span))
        pen = _RECORDED if curve.recorded else _RUN
        lines.append(
            f'<polyline points="{points}" fill="none" {pen} stroke-linejoin="round"/>'
        )
    return _frame("".join(lines), axes, low, high)


def _thinned(curve: Curve) -> Curve:
    """Some thousand finite points, as many as a small picture can show."""
    u, w = np.asarray(curve.u, float), np.asarray(curve.w, float)
    rows = np.unique(np.linspace(0, len(u) - 1, min(len(u), _POINTS)).astype(int))
    rows = rows[np.isfinite(u[rows]) & np.isfinite(w[rows])]
    return curve._replace(u=u[rows], w=w[rows])


def _pixels(curve: Curve, low: np.ndarray, span: np.ndarray) -> list[str]:
    """The points of a curve, without those that would not move the pen."""
    inside = np.array([_WIDTH, _HEIGHT]) - 2 * _MARGIN
    share = (np.stack([curve.u, curve.w], axis=1) - low) / span
    share = np.clip(share, -0.5, 1.5)
    share[:, 1] = 1 - share[:, 1]
    pixels = np.round(_MARGIN + share * inside, 1)
    moved = np.any(np.diff(pixels, axis=0, prepend=np.nan) != 0, axis=1)
    return [f"{x:g},{y:g}" for x, y in pixels[moved]]


_LETTER = 5.5  # pixels that a letter of a picture takes, about


def _cut(label: str, room: float) -> str:
    """A label as far as it fits into so many pixels."""
    letters = int(room / _LETTER)
    return label if len(label) <= letters else f"{label[: letters - 1]}…"


def _frame(lines: str, axes: tuple[str, str], low, high) -> str:
    """Lines inside of a box, whose corners say how far input and output go."""
    right, bottom = _WIDTH - _MARGIN, _HEIGHT - _MARGIN
    inner = f'width="{right - _MARGIN}" height="{bottom - _MARGIN}"'
    box = f'<rect x="{_MARGIN}" y="{_MARGIN}" {inner}'
    first, last = _limits(low[0], high[0], 3)
    beside = _LETTER * (1 + max(len(first), len(last)))
    across = _cut(axes[0], right - _MARGIN - 2 * beside)
    reach = f", {' to '.join(_limits(low[1], high[1], 3))}"
    upwards = _cut(axes[1], _WIDTH - _MARGIN - _LETTER * len(reach)) + reach
    texts = (
        (_MARGIN, bottom + 12, "start", first),
        (right, bottom + 12, "end", last),
        ((_MARGIN + right) / 2, bottom + 12, "middle", across),
        (_MARGIN, _MARGIN - 6, "start", upwards),
    )
    said = "".join(
        f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}">{html.escape(text)}</text>'
        for x, y, anchor, text in texts
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" role="img" font-family="sans-serif" '
        f'font-size="10" fill="currentColor">{box} fill="none" stroke="currentColor" '
        f'stroke-opacity="0.3"/><svg x="0" y="0" width="{_WIDTH}" height="{_HEIGHT}">'
        f"{lines}</svg>{said}</svg>"
    )


def on_terminal() -> bool:
    """Whether standard error is a terminal; a program without a console has none."""
    return sys.stderr is not None and sys.stderr.isatty()


def say(message: str) -> None:
    """Print a line of progress to standard error, when that is a terminal."""
    if on_terminal():
        print(message, file=sys.stderr, flush=True)


class Progress:
    """A line on how much is done of how much, how fast, how long the rest will take,
    and what is best so far: on a terminal, and in a notebook where it was asked for.

    **Arguments:** of `what` there are how many in all, as far as is known, and how many
    are done already; and whether it was asked for, `None` where nobody could.
    """

    def __init__(
        self,
        what: str,
        total: int | None = None,
        done: int = 0,
        asked: bool | None = None,
    ):
        from tqdm import tqdm  # slow to import

        watched = on_terminal() or (bool(asked) and _is_notebook(sys.stderr))
        self._bar = tqdm(
            total=total,
            initial=done,
            unit=f" {what}",
            file=sys.stderr,
            disable=asked is False or not watched,
            dynamic_ncols=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._bar.close()

    def show(self, done: int, total: int | None = None, best: str = "") -> None:
        """Say how far it is, unless that was said just now; of how many, where that has
        changed; and what is best so far."""
        if total is not None:
            self._bar.total = total
        if best:
            self._bar.set_postfix_str(f"best {best}", refresh=False)
        if not self._bar.disable:
            self._bar.update(done - self._bar.n)


def _is_notebook(stream: object) -> bool:
    return type(stream).__module__.startswith("ipykernel")
