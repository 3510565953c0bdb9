"""Experiments on simulated records. 1, 2, 3 and 5: laws found again, from few and many
samples, and from features of another law. 7: a butterfly, the square of a Duhem law,
learned in two steps; and butterflies from input and output alone, which the paper does
not do."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from matplotlib.figure import Figure

from .._core.solution import Solution
from ..discovery import discover
from ..library import VARIABLES, BoucWen, Custom, Library, Polynomial, Term
from ..models import AbstractModel, Butterfly, SparseModel
from ..recording import Recording
from ..refinement import refine
from ..regression import compress
from ..regression.differentiation import FiniteDifference
from ..simulation import FixedStep, metrics, simulate
from ._document import (
    PUBLISHED,
    Comparison,
    Row,
    Side,
    as_run,
    errors_over,
    published_side,
    runs,
    side_by_side,
)
from ._published import (
    AS_PUBLISHED,
    ASYMMETRIC,
    EXPERIMENT_1,
    EXPERIMENT_2,
    EXPERIMENT_5,
    EXPERIMENT_7,
    MEASURES,
    REFINED_LAW,
    RIVALS,
    ROUNDED,
    ROUNDED_LAW,
    UNROUNDED_LAW,
    UNSEEN,
    Entry,
    Setup,
    coefficient_rows,
    copied,
    error_row,
    experiment_3_setup,
    fits,
    free_run_error,
    learned,
    network_rows,
    published_settings,
    refined,
    regression_rows,
    squared_error,
    three_laws,
    with_output,
)
from .baselines import LBFGS

COPIED = {
    1: {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.251},
    2: {"du": 4.999, "w*|du|": -0.25, "du*|w|": -0.499},
}


def experiment_1() -> Comparison:
    """Duhem law under a growing sine."""
    return _found_again(
        "Experiment 1: Duhem law, u = t sin t",
        EXPERIMENT_1,
        VARIABLES[:4],
        {"u*|du|": (0.4, 0.400), "w*|du|": (-0.5, -0.500), "du": (0.251, 0.251)},
        COPIED[1],
        (5.8e-6, 5.81e-6),
    )


def experiment_2() -> Comparison:
    """Bouc-Wen law under a sine."""
    return _found_again(
        "Experiment 2: Bouc-Wen law, u = sin t",
        EXPERIMENT_2,
        VARIABLES,
        {"du": (4.99, 4.999), "w*|du|": (-0.25, -0.250), "du*|w|": (-0.49, -0.499)},
        COPIED[2],
        (4.6e-6, 4.63e-6),
    )


def _found_again(title, setup: Setup, variables, published, terms, figures):
    record, unseen = setup.record(), setup.unseen()
    law = learned(record, variables=variables)
    laws = three_laws(law, terms, record)
    own, new = ([free_run_error(x, r) for x in laws.values()] for r in (record, unseen))
    rows = (
        *coefficient_rows(law, published),
        error_row("squared error, %", own[1]),
        error_row("  with the script's rounded law", own[0], *figures),
        error_row("  with the refined law", own[2]),
        error_row("on an unseen record", new[1]),
        error_row("  with the refined law, unseen", new[2]),
    )
    drawing = partial(
        side_by_side,
        published_side({ROUNDED_LAW: laws[ROUNDED_LAW]}, record),
        Side("On an unseen record", unseen, runs(laws, unseen)),
    )
    return Comparison(title, rows, (str(law), MEASURES, ROUNDED, UNSEEN), drawing)


SIZES = (1000, 5000, 10000)
_TERMS = ("du", "w*|du|", "du*|w|")
_JUDGED = ("SINDy", "linear regression", "ridge, alpha = 1", "MLP", "refined")
_PRINTED = {name: f"{name}, script's rounded law" for name in _JUDGED[:3]}
_PRINTED["MLP"] = "MLP, derivative of rows held out"
_NETWORK = {1000: (1.8e-3, 1.93e-3), 5000: (4.4e-4, 4.50e-4), 10000: (3.9e-4, 4.12e-4)}
_SIZE_NOTES = (
    "At 5000 samples and more the errors of the rounded laws of SINDy and linear "
    "regression are those of the rounding; at 10000 it lands SINDy's on the true law.",
    "At 1000 samples the rerun's 3.40e-4 for linear regression is 3.3951e-4 with "
    "odeint's default tolerance; integrated accurately it is 3.3950e-4.",
    "At 10000 samples the script simulates linear regression with 0.99 for 0.9999, a "
    "slip which makes its error 3e5 times larger; and the paper's entries of linear "
    "and ridge regression look swapped.",
)


def _entry(paper, rerun, *coefficients: float) -> Entry:
    return Entry(paper, rerun, dict(zip(_TERMS, coefficients, strict=True)))


SIZE_ENTRIES = {
    1000: {
        "SINDy": _entry(2.8e-4, 2.81e-4, 0.995, -0.504, -1.976),
        "linear regression": _entry(3.3e-4, 3.40e-4, 0.994, -0.504, -1.973),
        "ridge, alpha = 1": _entry(9e-2, 9.04e-2, 0.886, -0.584, -1.507),
    },
    5000: {
        "SINDy": _entry(1e-5, 1.06e-5, 1.0, -0.5, -1.999),
        "linear regression": _entry(2.3e-5, 2.32e-5, 0.999, -0.5, -1.998),
        "ridge, alpha = 1": _entry(4.1e-3, 4.15e-3, 0.973, -0.523, -1.882),
    },
    10000: {
        "SINDy": _entry("~0", 0.0, 1.0, -0.5, -2.0),
        "linear regression": _entry(1e-3, 9.42e-3, 0.99, -0.5, -1.999),
        "ridge, alpha = 1": _entry(9e-3, 1.06e-3, 0.986, -0.511, -1.94),
    },
}


def experiment_3(epochs: int | None = None) -> Comparison:
    """Bouc-Wen law, 1000, 5000 and 10000 samples of the same 10 cycles.

    **Arguments:** `epochs`: most epochs of a network's training, for a quick look; all
    by default.
    """
    rows = []
    for samples in SIZES:
        rows += [*size_rows(samples), *refined_rows(samples)]
        rows += mlp_rows(samples, epochs)
    title = "Experiment 3, Table I: Bouc-Wen law, u = sin t, squared errors in %"
    notes = (MEASURES, ROUNDED, UNSEEN, *RIVALS, *_SIZE_NOTES)
    return Comparison(title, tuple(rows), notes, partial(_drawn, tuple(rows)))


def size_rows(samples: int) -> list[Row]:
    """The regressions."""
    setup = experiment_3_setup(samples)
    judged = {"unseen record": setup.unseen()}
    return regression_rows(
        f"N = {samples}: ", setup.record(), BoucWen(), SIZE_ENTRIES[samples], judged
    )


def refined_rows(samples: int) -> list[Row]:
    """The law of SINDy refined."""
    setup = experiment_3_setup(samples)
    record, unseen = setup.record(), setup.unseen()
    label = f"N = {samples}: "
    # Eight steps a sample are too few for a thousand samples: as many as it takes.
    better = refined(learned(record), record, substeps=None)
    return [
        error_row(f"{label}refined, free run", free_run_error(better, record)),
        error_row(f"{label}refined, unseen record", free_run_error(better, unseen)),
    ]


def mlp_rows(samples: int, epochs: int | None = None) -> list[Row]:
    """The network."""
    setup = experiment_3_setup(samples)
    record, judged = setup.record(), {"unseen record": setup.unseen()}
    name = f"N = {samples}: MLP"
    data = (record, BoucWen(), judged)
    return [
        *network_rows(name, AS_PUBLISHED, *data, _NETWORK[samples], epochs=epochs),
        *network_rows(f"{name}, plain L-BFGS", LBFGS, *data, epochs=epochs),
    ]


def _drawn(rows: Sequence[Row]) -> Figure:
    """Table I as printed, and errors of the unrounded laws on unseen records."""
    found = {row.quantity: row for row in rows}
    panels = {"Table I as printed": {}, "Free runs on unseen records": {}}
    printed, unseen = panels.values()
    for method, source in _PRINTED.items():
        entries = [found[f"N = {n}: {source}"].paper for n in SIZES]
        printed[method] = [x if isinstance(x, float) else None for x in entries]
    for method in _JUDGED:
        unseen[method] = [
            found[f"N = {n}: {method}, unseen record"].hystjax for n in SIZES
        ]
    return errors_over(SIZES, "samples", panels)


UNFIT_ENTRIES = {
    "SINDy": Entry(None, 8.39e-4, {"du": 19.846, "w*|du|": -0.247, "u*|du|": 0.990}),
    "linear regression": Entry(
        "> 5", 6.41, {"du": 3.754, "w*|du|": -0.024, "du*|w|": 0.025}
    ),
    "ridge, alpha = 1": Entry(
        "> 5", 6.41, {"du": 3.7543, "w*|du|": -0.024, "du*|w|": 0.025}
    ),
}
# Ridge regression finds the law of linear regression, to three digits.
_DRAWN = ("SINDy", "linear regression")
_NOTE = (
    "Linear and ridge regression get the three features of the Bouc-Wen law, SINDy a "
    "library that holds those of the true one; with the true features they would find "
    "it too."
)


def experiment_5() -> Comparison:
    """Duhem law, with features of the Bouc-Wen law for linear and ridge regression."""
    record, unseen = EXPERIMENT_5.record(), EXPERIMENT_5.unseen()
    found = fits(record, BoucWen())
    better = refined(found["SINDy"], record)
    laws = {name: found[name] for name in _DRAWN} | {REFINED_LAW: better}
    drawing = partial(
        side_by_side,
        published_side(
            {x: copied(UNFIT_ENTRIES[x].terms, record) for x in _DRAWN}, record
        ),
        Side("On an unseen record", unseen, runs(laws, unseen)),
    )
    rows = (
        *regression_rows(
            "", record, BoucWen(), UNFIT_ENTRIES, {"unseen record": unseen}
        ),
        error_row("refined, free run", free_run_error(better, record)),
        error_row("refined, unseen record", free_run_error(better, unseen)),
    )
    title = "Experiment 5: features of another law, u = t sin t, squared errors in %"
    notes = (str(found["SINDy"]), MEASURES, ROUNDED, UNSEEN, _NOTE)
    return Comparison(title, rows, notes, drawing)


NOISE = (0.0, 0.01, 0.05)  # over the output's standard deviation
STARTS = 40
OFFSET = -1.0  # of the asymmetric butterfly, whose hidden device is biased
_METHOD = FixedStep(8)
DIRECT = (
    "Directly: y is hidden; the law of y, the offset c of z = y^2 + c and y(0) are "
    "fitted to z by trajectory matching, from 40 random starts. The worst of them is "
    "shown, and errors are against z without noise.",
    "The asymmetric butterfly is z = y^2 - 1 with y' = (0.6 + 0.4 u - 0.85 y) |u'| + "
    "0.2 u': the constant times |u'| biases y, and the wings differ.",
)
_STRUCTURE = (
    "All laws of up to four terms of the library of degree 2 with |w| are fitted, y "
    "being hidden. Equal ones, such as with du^2 for u^2, are tried once.",
    "The criterion is the extended BIC of the free run; less is better. z = y^2 does "
    "not tell y from -y, so of the signs of y's terms even in y only those relative to "
    "each other are known.",
)


class Attempts(NamedTuple):
    """Fits with y hidden from many starts.

    **Attributes:** relative `errors` against the clean record, shape (starts,), and
    `outputs` of free runs, shape (starts, n).
    """

    errors: Float[Array, " s"]
    outputs: Float[Array, "s n"]


def direct_attempts(name: str) -> dict[float, Attempts]:
    """Fits of a butterfly, `"experiment 7"` or `"asymmetric"`, by level of noise."""
    setup, offset = BUTTERFLIES[name]
    seen = butterfly(setup.record(), offset)
    key = jax.random.key(7)
    return {noise: attempts(seen, setup.law, noise, key) for noise in NOISE}


def direct_rows(found: Mapping[str, Mapping[float, Attempts]]) -> list[Row]:
    """Errors of the worst of the starts."""
    return [
        error_row(
            f"z directly, {name}, noise {100 * noise:g} %",
            float(jnp.max(each.errors)) ** 2,
        )
        for name, levels in found.items()
        for noise, each in levels.items()
    ]


def butterflies() -> Comparison:
    """Butterflies with y hidden: coefficients, and the choice of terms under noise."""
    rows = direct_rows({name: direct_attempts(name) for name in BUTTERFLIES})
    laws = []
    for name, (setup, offset) in BUTTERFLIES.items():
        clean = butterfly(setup.record(), offset)
        found = structure(_noisy(clean, 0.05, jax.random.key(29)))
        rows += _structure_rows(name, found, clean)
        laws.append(f"{name}: {found.value}")
    title = "Butterflies with their polarisation hidden, squared errors in %"
    return Comparison(title, tuple(rows), (*laws, MEASURES, *DIRECT, *_STRUCTURE))


def _structure_rows(name: str, found: Solution, clean: Recording) -> list[Row]:
    best, second = found.stats["candidates"][:2]
    error = float(metrics.relative_error(clean.w, simulate(found.value, clean).w))
    ahead = second.criterion - best.criterion
    return [
        Row(f"terms chosen, {name}, noise 5 %", None, None, ", ".join(best.terms)),
        Row("  next best terms", None, None, ", ".join(second.terms)),
        Row("  by which the criterion is better", None, None, ahead),
        error_row("  error of z", error**2),
    ]


def butterfly(record: Recording, offset: float) -> Recording:
    """The record of z = y^2 + offset, from that of y."""
    return Recording(
        record.t,
        record.u,
        record.w**2 + offset,
        names=(record.names[0], "strain z"),
        units=(record.units[0], ""),
        interpolation=record.interpolation,
    )


def attempts(
    clean: Recording, law: AbstractModel, noise: float, key: PRNGKeyArray
) -> Attempts:
    """Fits to noisy records of z from 40 random starts, with laws of the `law`'s
    kind."""
    return _attempts(clean, law, noise, jax.random.split(key, STARTS))


@eqx.filter_jit
def _attempts(clean: Recording, law: AbstractModel, noise, keys) -> Attempts:
    def attempt(key):
        noise_key, start_key = jax.random.split(key)
        record = _noisy(clean, noise, noise_key)
        fit = refine(_random(law, record, start_key), record, throw=False, substeps=8)
        run = simulate(fit.value, clean, method=_METHOD, throw=False)
        return Attempts(metrics.relative_error(clean.w, run.w), run.w)

    return jax.lax.map(attempt, keys, batch_size=STARTS)


def _random(law: AbstractModel, record: Recording, key) -> Butterfly:
    """A butterfly whose numbers are random: all of either sign but beta, without which
    no law forgets."""
    start = Butterfly(law)
    names = start.parameters()
    draws = jax.random.uniform(key, (len(names),), minval=-1.0, maxval=1.0)
    values = dict(zip(names, draws, strict=True))
    values["beta"] = jnp.abs(values["beta"])
    values["offset"] += jnp.min(record.w)
    return start.with_parameters(values)


def structure(record: Recording) -> Solution:
    """The terms of the hidden law."""
    low = float(np.min(record.w))
    return discover(
        record,
        Polynomial(2, VARIABLES),
        around=lambda law: Butterfly(law, low),
        size=float(np.ptp(record.w)) ** 0.5,
        key=jax.random.key(0),
    )


def _noisy(record: Recording, noise, key) -> Recording:
    errors = jax.random.normal(key, record.w.shape)
    return with_output(record, record.w + noise * jnp.std(record.w) * errors)


BUTTERFLIES: dict[str, tuple[Setup, float]] = {
    "experiment 7": (EXPERIMENT_7, 0.0),
    "asymmetric": (ASYMMETRIC, OFFSET),
}


# z' = 2 y y': its terms are those of y' times 2 y. In the library y stands for w.
_CHAIN = {
    "pull": lambda y, u, du: 2 * y * u * jnp.abs(du),
    "back": lambda y, u, du: 2 * y * y * jnp.abs(du),
    "along": lambda y, u, du: 2 * y * du,
}
_INNER = {"pull": "u*|du|", "back": "w*|du|", "along": "du"}
_PUBLISHED = {
    "u*|du|": (None, 0.399),
    "w*|du|": (None, -0.848),
    "du": (None, 0.200),
}
COPIED_BUTTERFLY = {"u*|du|": 0.4, "w*|du|": -0.849, "du": 0.2}
_BUTTERFLY_NOTES = (
    "In two steps, as in the paper: y is taken to be measured, z' = 2 y y' is "
    "regressed on features of z, y and u, and the law of y is read off it; w stands "
    "for y in that law.",
    "The paper prints a term 3.4 |u'| w y; with w = y^2, its output, it is 3.4 |u'| w.",
)


def experiment_7() -> Comparison:
    """Butterfly z = y^2, y a Duhem law under 4 sin t."""
    record, unseen = EXPERIMENT_7.record(), EXPERIMENT_7.unseen()
    law = inner_law(record)
    better = refined(law, record)
    rounded = copied(COPIED_BUTTERFLY, record)
    direct = {name: direct_attempts(name) for name in BUTTERFLIES}
    rows = (
        *coefficient_rows(law, _PUBLISHED),
        error_row("z, script's rounded law", _error(rounded, record), 3.1e-4, 3.16e-4),
        error_row("z, unrounded law", _error(law, record)),
        error_row("z, refined law of y", _error(better, record)),
        error_row("z, unseen record", _error(law, unseen)),
        error_row("z, unseen record, refined law of y", _error(better, unseen)),
        *direct_rows(direct),
    )
    title = "Experiment 7: butterfly, u = 4 sin t, squared errors in %"
    notes = (str(law), MEASURES, ROUNDED, UNSEEN, *_BUTTERFLY_NOTES, *DIRECT)
    laws = {ROUNDED_LAW: rounded, UNROUNDED_LAW: law, REFINED_LAW: better}
    drawing = partial(
        side_by_side,
        _squared(PUBLISHED, {ROUNDED_LAW: rounded}, record),
        _squared("On an unseen record", laws, unseen),
        _direct("asymmetric", direct["asymmetric"]),
    )
    return Comparison(title, rows, notes, drawing)


def _squared(title: str, laws: Mapping[str, AbstractModel], record: Recording) -> Side:
    """Free runs of laws of y, as those of z."""
    found = runs(laws, record)
    squares = {name: as_run(record, run.w**2) for name, run in found.items()}
    return Side(title, butterfly(record, 0.0), squares)


def _direct(name: str, levels: Mapping[float, Attempts]) -> Side:
    """Of each level of noise the worst start."""
    setup, offset = BUTTERFLIES[name]
    record = butterfly(setup.record(), offset)
    worst = {}
    for noise, each in levels.items():
        w = each.outputs[jnp.argmax(each.errors)]
        worst[f"{100 * noise:g} % noise"] = as_run(record, w)
    return Side(f"y hidden, {name}: worst of {STARTS} starts", record, worst)


def inner_law(record: Recording) -> SparseModel:
    """The law of y, from the record of y, by regression of z'."""
    difference = FiniteDifference()
    y, u = record.w, record.u
    _, du = difference.estimate(record.t, u)
    _, dz = difference.estimate(record.t, y**2)
    library = _library()
    problem = compress(library(y, u, du), dz)
    fit = published_settings().fit(problem)
    found = SparseModel(library, fit.coefficients, fit.support).terms()
    return copied({_INNER.get(name, name): x for name, x in found.items()}, record)


def _library() -> Library:
    """All products of two of the paper's features z, u and the chain rule's."""
    given = Library((Term.parse("w^2"), Term.parse("u"))) + Custom(_CHAIN)
    return Library((Term(),)) + given + given * given


def _error(law: AbstractModel, record: Recording) -> float:
    """Of z, by a free run of y."""
    return squared_error(record.w**2, simulate(law, record).w ** 2)
