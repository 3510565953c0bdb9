"""A report folder: the law, its errors, its figures and the model file."""

import itertools
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import jax

from . import __version__, _files, plot
from ._aliases import Alias
from ._errors import InputError
from ._judge import Judgement
from ._serialise import save
from .export import to_latex, to_text
from .models import AbstractModel, SparseModel

_RATIOS = {
    "nrmse": "NRMSE",
    "relative_error": "relative error",
    "relative_squared_error": "squared error",
}


def write(
    folder: str | os.PathLike,
    model: AbstractModel,
    judgements: Mapping[str, Judgement],
    *,
    aliases: Sequence[Alias] = (),
    settings: Mapping[str, str] | None = None,
) -> Path:
    """Write a report on a law.

    The folder gets `report.md` (for people), `metrics.json` (for programs), `law.json`
    (for `hystjax.load`), `overview.png` and one `<rows>.png` a
    judgement. It is made when
    it does not exist; files of the same names are replaced, each in one move.

    **Arguments:**

    - `folder`: where to write.
    - `model`: the law.
    - `judgements`: free runs by what their rows are, such as `fitted` and `unseen`.
    - `aliases`: what the excitation cannot tell apart.
    - `settings`: how the law was found, by name.

    **Returns:** the path of `report.md`.

    **Raises:** `InputError` when the folder cannot be written.
    """
    place = _made(Path(folder))
    settings = dict(settings or {})
    save(place / "law.json", model)
    _files.write_text(place / "metrics.json", _metrics(model, judgements, settings))
    figures = _figures(place, judgements, model)
    sections = (
        f"# A law of hysteresis\n\n```\n{to_text(model)}\n```\n\n$${to_latex(model)}$$",
        _coefficients(model),
        "## Errors of the free run\n\n"
        "From the first sample's output alone; ratios in per cent.\n\n"
        + markdown_table(error_table(judgements)),
        _ambiguities(aliases),
        "\n\n".join(f"![{path.stem}]({path.name})" for path in figures),
        "## Settings\n\n" + "\n".join(f"- {k}: {v}" for k, v in settings.items()),
    )
    text = "\n\n".join(section for section in sections if section) + "\n"
    _files.write_text(place / "report.md", text)
    return place / "report.md"


def error_table(judgements: Mapping[str, Judgement]) -> list[list[str]]:
    """Errors by rows as cells of text, headings first; ratios in per cent."""
    table = [["rows", *_RATIOS.values(), "R²", "largest error"]]
    for rows, judgement in judgements.items():
        errors = {name: float(value) for name, value in judgement.errors.items()}
        if not math.isfinite(errors["nrmse"]):
            table.append([rows, "diverged", *[""] * (len(table[0]) - 2)])
            continue
        unit = judgement.recording.units[1]
        ratios = [f"{100 * errors[name]:.4g} %" for name in _RATIOS]
        largest = f"{errors['max_error']:.4g} {unit}".strip()
        table.append([rows, *ratios, f"{errors['r2']:.6g}", largest])
    return table


def markdown_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in Markdown, in which `|u'|` does not end a cell."""
    cells = [[cell.replace("|", r"\|") for cell in row] for row in table]
    head, *body = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join([head, "|---" * len(table[0]) + "|", *body])


def plain_table(table: Sequence[Sequence[str]]) -> str:
    """A table of text in columns, for a terminal."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


def _made(place: Path) -> Path:
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the report folder {str(place)!r} cannot be made ({error.strerror}); "
            "choose another."
        ) from None
    return place


def _metrics(model, judgements, settings) -> str:
    errors = {
        rows: {
            name: float(value) if math.isfinite(value) else None
            for name, value in judgement.errors.items()
        }
        for rows, judgement in judgements.items()
    }
    versions = {"python": platform.python_version(), "hystjax": __version__}
    versions |= {name: version(name) for name in ("jax", "diffrax", "numpy")}
    content = {
        "law": str(model),
        "terms": model.terms(),
        "errors": errors,
        "settings": settings,
        "versions": versions,
        "device": jax.devices()[0].device_kind,
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _figures(place: Path, judgements: Mapping[str, Judgement], model) -> list[Path]:
    runs = [(each.recording, each.trajectory) for each in judgements.values()]
    first_two = itertools.chain.from_iterable(runs[:2])
    figures = {"overview": plot.overview(*first_two, model=model)}
    figures |= {
        rows: plot.fit(*run) for rows, run in zip(judgements, runs, strict=True)
    }
    paths = [place / f"{name}.png" for name in figures]
    for path, figure in zip(paths, figures.values(), strict=True):
        plot.save(figure, path)
    return paths


def _coefficients(model: AbstractModel) -> str:
    units = model.coefficient_units() if isinstance(model, SparseModel) else {}
    rows = [
        [f"`{name}`", f"{value:.6g}", units.get(name, "")]
        for name, value in model.terms().items()
    ]
    return "## Coefficients\n\n" + markdown_table([["term", "value", "unit"], *rows])


def _ambiguities(aliases: Sequence[Alias]) -> str:
    if not aliases:
        return ""
    plain = (str(alias).replace("*", r"\*") for alias in aliases)
    lines = "\n".join(f"- {alias}" for alias in plain)
    return (
        "## What this excitation cannot tell apart\n\nA law with one of these terms "
        "has rivals with others; another amplitude, a decaying sine or a second "
        f"frequency would decide.\n\n{lines}"
    )
