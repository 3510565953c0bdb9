"""A report folder: the law, its errors, its figures and the model file."""

import json
import math
import os
import platform
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jax
import numpy as np
from matplotlib.figure import Figure

from . import __version__, plot, refinement
from ._core import checks, files
from ._core.checks import InputError, described
from ._core.show import (
    escaped,
    escaped_table,
    markdown_page,
    markdown_table as markdown_table,
    plain_table as plain_table,
)
from ._core.solution import RESULTS, Solution, ended
from .discovery import Discovered, Suggestion
from .discovery.search import Trial
from .export import to_latex, to_text
from .loops._summary import compared
from .models import AbstractModel, as_model, save
from .plot._canvas import found_by
from .plot._models import hides
from .plot._terms import check_shares
from .recording import Recording
from .recording._as_measured import led_in
from .refinement import Refined
from .regression import Alias
from .simulation import FixedStep, Judgement, simulate
from .simulation._simulate import check_judgements, error_table as error_table

__all__ = ["error_table", "markdown_table", "plain_table", "write"]

_OTHERS = ("overview", "refinement", "hidden", "frontier", "inclusion")
_FIGURES = ("fitted", "unseen", "comparison", *_OTHERS)
_LONGEST = 200  # bytes of a name, to which .png and what is temporary are added


def __dir__() -> list[str]:
    return __all__


def write(
    folder: str | os.PathLike,
    model: AbstractModel | Solution,
    judgements: Mapping[str, Judgement],
    *,
    aliases: Sequence[Alias] = (),
    suggestions: Sequence[Suggestion] = (),
    refined: tuple[AbstractModel, Solution] | None = None,
    discovered: Solution | None = None,
    inclusion: Mapping[str, float] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Path:
    """Write a report on a law.

    The folder gets `report.md` (for people), `metrics.json` (for programs), `law.json`
    (for `hystjax.load`), `overview.png` and one `<rows>.png` a judgement. It is made
    when it does not exist; files of the same names are replaced, each in one move. Of
    an earlier report there, figures that this one does not have are removed: those
    named here, `fitted.png`, `unseen.png` and `comparison.png`.

    **Arguments:**

    - `folder`: where to write.
    - `model`: the law, or what `refine` or `discover` returned, which tells too how
        certain it is.
    - `judgements`: free runs by what their rows are, such as `fitted` and `unseen`, the
        first two of which are in `overview.png`; not by the name of another figure, or
        two that differ in capitals alone.
    - `aliases`: what the excitation cannot tell apart.
    - `suggestions`: inputs that would, from `hystjax.suggest_excitation`.
    - `refined`: for a refined law, the one before, and the `Solution` of `refine`; adds
        standard errors, stability and, where the first recording that was refined on is
        among the judgements, `refinement.png`.
    - `discovered`: the `Solution` of `discover`; adds standard errors, stability, the
        best laws of each size with `frontier.png`, and what is hardly told from the
        chosen one.
    - `inclusion`: what `hystjax.inclusion` returns; adds `inclusion.png`.
    - `settings`: how the law was found, by name; written as text.

    Where the law's output is hidden in a model, as in `models.Oscillator`, and the
    model refined or discovered, `hidden.png` shows it along the first recording that it
    was refined on, or else the first judged; unless the device had settled before that,
    from an input that is not known.

    **Returns:** the path of `report.md`.

    **Raises:** `InputError` when the folder cannot be written, or a text not as UTF-8,
    for a name of rows that cannot be one of a figure, and for a `refined` or
    `discovered` of another verb, or that found no law.
    """
    check_judgements(judgements)
    _check_names(judgements)
    _check_findings(refined, discovered)
    given = model if isinstance(model, Solution) and refined is None else None
    if discovered is None and Discovered.told_by(given):
        discovered = given
    solution = refined[1] if refined is not None else discovered
    if solution is None and Refined.told_by(given):
        solution = given
    model = as_model(model, "write(folder, model, judgements)")
    if inclusion is not None:
        check_shares("inclusion", inclusion)
    checks.several("aliases", aliases, Alias, "hystjax.aliases")
    checks.several("suggestions", suggestions, Suggestion, "hystjax.suggest_excitation")
    checks.concrete("`hystjax.report.write`", model, judgements)
    settings = _as_text(settings)
    for text in (*judgements, *settings, *settings.values()):
        files.encoded(f"{text!a} of `judgements` or `settings`", text)
    place = files.made_folder(folder)
    old = figures_of_another(place)
    save(place / "law.json", model)
    files.write_text(place / "metrics.json", metrics_text(model, judgements, settings))
    figures = _figures(place, judgements, model)
    if refined is not None:
        figures += _refinement_figures(place, judgements, *refined)
    figures += _hidden_figures(place, judgements, solution)
    if discovered is not None:
        figures.append(_saved(place / "frontier.png", plot.frontier(discovered)))
    if inclusion is not None:
        figures.append(_saved(place / "inclusion.png", plot.inclusion(inclusion)))
    sections = (
        *_law(model),
        _coefficients(model, solution),
        _certainty(solution),
        _errors(judgements),
        *(_loops(rows, judgement) for rows, judgement in judgements.items()),
        _rivals(discovered),
        _ambiguities(aliases, suggestions),
        "\n\n".join(f"![{escaped(path.stem)}]({quote(path.name)})" for path in figures),
        _settings(settings),
    )
    files.write_text(place / "report.md", markdown_page(sections))
    for path in old - set(figures):
        path.unlink(missing_ok=True)
    return place / "report.md"


def _as_text(settings: Any) -> dict[str, str]:
    if not isinstance(settings, Mapping | None):
        raise InputError(
            f"`settings` must be values by name, got {described(settings)}."
        )
    return {str(name): str(value) for name, value in (settings or {}).items()}


def _check_names(judgements: Mapping[str, Judgement]) -> None:
    for rows in judgements:
        plain = isinstance(rows, str) and not set(rows) & set("/\\\0")
        plain = plain and len(rows.encode(errors="replace")) <= _LONGEST
        if not plain or not rows.strip() or rows.casefold() in _OTHERS:
            raise InputError(
                f"`judgements` has the rows {rows!r}, whose figure cannot be "
                f"`{rows}.png` in the folder. Take another name, of at most {_LONGEST} "
                f"bytes, without / and none of {', '.join(_OTHERS)}."
            )
    # One file, where files are told apart without regard to case.
    folded = Counter(map(str.casefold, judgements))
    alike = [rows for rows in judgements if folded[rows.casefold()] > 1]
    if alike:
        raise InputError(
            f"`judgements` has the rows {' and '.join(map(repr, alike))}, whose "
            "figures would be one file on Windows and macOS. Take names that differ in "
            "more than capitals."
        )


def _check_findings(refined: Any, discovered: Any) -> None:
    pair = isinstance(refined, Sequence) and len(refined) == 2
    if refined is not None and not (pair and Refined.told_by(refined[1])):
        raise InputError(
            "`refined` must be a pair, the law before and what `refine` returned; got "
            f"{described(refined)}."
        )
    if discovered is None:
        return
    told = isinstance(discovered, Solution)
    if told and bool(ended(discovered.result, RESULTS.no_law)):
        raise InputError(
            f"`discovered` found no law to report: {discovered.stats['why']} Leave it "
            "out to report the model without one."
        )
    found_by("discover", "discovered", discovered, Discovered)


def figures_of_another(place: Path) -> set[Path]:
    """Those of an earlier report in the folder, if there is one."""
    if not (place / "report.md").is_file():
        return set()
    paths = {place / f"{name}.png" for name in _FIGURES}
    return {path for path in paths if path.is_file()}


def _loops(rows: str, judgement: Judgement) -> str:
    """What the law makes of the numbers of loops, where the rows have any."""
    runs = {"law": judgement.trajectory}
    try:
        table = escaped_table(compared(judgement.recording, runs))
    except InputError:  # no cycle, or a law that did not stay finite
        return ""
    if judgement.weights is not None and not np.all(judgement.weights):
        table = "Some of these samples have no weight, and loops are made of all."
    return f"## Loops, {escaped(rows)}\n\n{table}"


def metrics_text(
    model: AbstractModel,
    judgements: Mapping[str, Judgement],
    settings: Mapping[str, str],
) -> str:
    """A law and its errors for programs."""
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
        "terms": model.numbers(),
        "errors": errors,
        "settings": settings,
        "versions": versions,
        "device": jax.devices()[0].device_kind,
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _figures(place: Path, judgements: Mapping[str, Judgement], model) -> list[Path]:
    each = list(judgements.values())
    runs = [(judgement.recording, judgement.trajectory) for judgement in each]
    test = runs[1] if len(runs) > 1 else (None, None)
    weights = [judgement.weights for judgement in each]
    told = {"model": model, "weights": weights[:2], "labels": list(judgements)[:2]}
    overview = plot.overview(*runs[0], *test, **told)
    figures = {"overview": overview} | {
        rows: plot.fit(*run, weights=own)
        for rows, run, own in zip(judgements, runs, weights, strict=True)
    }
    return [_saved(place / f"{name}.png", figure) for name, figure in figures.items()]


def _refined_on(
    judgements: Mapping[str, Judgement], solution: Solution
) -> Judgement | None:
    """The judgement of the first recording that was refined on, `None` where there is
    none: of that alone the fit, run again from where it began, misses what it left."""
    fit = Refined.of(solution)
    end, left = int(np.asarray(fit.lengths)[0]), np.asarray(fit.residuals)[0]
    left = left[:end]
    used = left != 0
    if any(name.startswith("start[0,") for name in fit.certainty.names):
        used[1:] = False  # from hidden states, which the first output does not tell
    method = FixedStep(fit.substeps)
    with checks.on_trial():
        for judged in judgements.values():
            rows = _as_long(judged, end)
            if rows is None or not used.any():
                continue
            run = simulate(fit.value, rows, w0=fit.w0[0], method=method, throw=False)
            w = np.asarray(rows.w)
            off = np.max(np.abs(np.asarray(run.w) - left - w)[used])
            if off <= np.sqrt(np.finfo(w.dtype).eps) * np.ptp(w):
                return judged
    return None


def _as_long(judged: Judgement, n: int) -> Recording | None:
    """What was judged, with the lead-in, as a fit of n samples would have it: behind
    a part of its period, if it is one; `None` where it has another length."""
    rows = judged.recording if judged.whole is None else judged.whole
    if len(rows) == n:
        return rows
    try:
        return led_in(rows, None, n - len(rows), periodic=True)[0]
    except InputError:  # no period, or too long
        return None


def _refinement_figures(place: Path, judgements, before, solution) -> list[Path]:
    after = _refined_on(judgements, solution)
    if after is None:
        return []
    runs = after.alike(before).trajectory, after.trajectory
    figure = plot.refinement(after.recording, *runs, solution, weights=after.weights)
    return [_saved(place / "refinement.png", figure)]


def _hidden_figures(place: Path, judgements, solution: Solution | None) -> list[Path]:
    """What nobody measures, along the first recording that was refined on, or else the
    first that was judged: none where nothing is hidden, or the device had settled from
    a past that is not known."""
    if solution is None or not hides(solution.value):
        return []
    stats = solution.stats
    known = _refined_on(judgements, solution)
    judged = next(iter(judgements.values())) if known is None else known
    rows, first = judged.recording, judged.w0 if known is None else stats["w0"][0]
    # Behind a lead-in no start is fitted, and residuals are zero up to there.
    behind = np.argmax(np.asarray(stats["residuals"])[0] != 0) > 1
    fitted = any(name.startswith("start[") for name in stats["certainty"].names)
    settled = judged.periodic or bool(judged.lead_in or (behind and not fitted))
    if judged.periodic:
        twice, _ = led_in(rows, None, len(rows), periodic=True)
        rows = twice.window(len(rows), len(twice))
    if settled and rows.past is None:
        return []
    first = None if settled else first
    figure = plot.hidden(rows, solution, labels=["law"], w0=first, settled=settled)
    return [_saved(place / "hidden.png", figure)]


def _saved(path: Path, figure: Figure) -> Path:
    plot.save(figure, path)
    return path


def _law(model: AbstractModel) -> Iterator[str]:
    """The law, its equation, and what is known of its kind."""
    plain = model.kind is not None and not model.kind.hysteretic
    title = "A law without hysteresis" if plain else "A law of hysteresis"
    yield f"# {title}\n\n```\n{to_text(model)}\n```"
    if model.addends() is not None:
        yield f"$${to_latex(model)}$$"
    yield _kind(model)


def _kind(model: AbstractModel) -> str:
    """What kind of law it is, and what it was fitted on, as sentences."""
    said = str(model.kind or "")
    known = model.fitted_range
    sentences = [f"{said[0].upper()}{said[1:]}."] if said else []
    if known is not None:
        sentences.append(f"Fitted on inputs from {known.in_words(model.units[0])}.")
    return " ".join(sentences)


def _coefficients(model: AbstractModel, solution: Solution | None) -> str:
    rows = [
        [f"`{name}`", f"{value:.6g}", "" if error is None else f"{error:.2g}", unit]
        for name, value, unit, error in model.listed(
            solution.stats["standard_errors"] if solution else None
        )
    ]
    head = ["term", "value", "standard error", "unit"]
    return "## Coefficients\n\n" + escaped_table([head, *rows])


def _certainty(solution: Solution | None) -> str:
    """What refinement knows beyond the coefficients."""
    if solution is None:
        return ""
    stats = solution.stats
    lines = [f"- {int(stats['num_steps'])} steps of trajectory matching"]
    lines += [f"- {escaped(each)}" for each in refinement.statements(solution)]
    return "## Certainty\n\n" + "\n".join(lines)


def _errors(judgements: Mapping[str, Judgement]) -> str:
    begun = {judgement.begun(): None for judgement in judgements.values()}
    return (
        f"## Errors of the free run\n\n{'. '.join(begun)}; ratios in per cent.\n\n"
        + escaped_table(error_table(judgements))
    )


def _settings(settings: Mapping[str, str]) -> str:
    lines = [f"- {escaped(f'{name}: {value}')}" for name, value in settings.items()]
    return "\n".join(["## Settings\n", *lines]) if lines else ""


def _rivals(discovered: Solution | None) -> str:
    """The best laws of each size, and those hardly told from the best."""
    if discovered is None:
        return ""
    stats = discovered.stats
    chosen = stats["candidates"][0]
    text = f"## Laws that were tried\n\n{escaped(stats['why'])}\n\n"
    text += "The best of each number of terms:\n\n"
    text += escaped_table(_trial_table(stats["frontier"].values(), chosen))
    if stats["alike"]:
        text += "\n\nHardly told from the best:\n\n"
        text += escaped_table(_trial_table(stats["alike"], chosen))
    return text


def _trial_table(trials: Iterable[Trial], chosen: Trial) -> list[list[str]]:
    """Laws by what decided between them."""
    rows = []
    for trial in trials:
        names = ", ".join(f"`{name}`" for name in trial.named)
        judged = f"{trial.criterion - chosen.criterion:+.1f}"
        if chosen.blocks:
            judged = f"{trial.unseen:.4g}" if trial.blocks else "far off"
        rows.append([names, f"{trial.rmse:.4g}", judged])
    criterion = "criterion over the chosen law's"
    by = "on blocks left out" if chosen.blocks else criterion
    return [["terms", "rms error", by], *rows]


def _always(alias: Alias) -> bool:
    """Whether a term equals another on every record, such as `|du|^2` and `du^2`."""
    return {_even(name) for name in alias.combination} == {_even(alias.term)}


def _even(name: str) -> frozenset[tuple[str, float]]:
    """The factors of a term, with even powers of |x| as those of x."""
    powers: dict[str, float] = {}
    for factor in name.split("*"):
        base, _, power = factor.partition("^")
        number = float(power or 1)
        even = base.startswith("|") and number % 2 == 0
        base = base.strip("|") if even else base
        powers[base] = powers.get(base, 0) + number
    return frozenset(powers.items())


def _ambiguities(aliases: Sequence[Alias], suggestions: Sequence[Suggestion]) -> str:
    aliases = [alias for alias in aliases if not _always(alias)]
    if not aliases:
        return ""
    lines = "\n".join(f"- {escaped(str(alias))}" for alias in aliases)
    text = (
        "## What this excitation cannot tell apart\n\nA law with one of these terms "
        "has rivals with others; another amplitude, a decaying sine or a second "
        f"frequency would decide.\n\n{lines}"
    )
    for each in suggestions:
        terms = ", ".join(f"`{name}`" for name in each.resolved)
        text += f"\n- To tell {terms} from simpler ones: {each.excitation}."
    return text
