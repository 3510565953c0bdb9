"""Voltages of measured piezos, from what they measured alone."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import uniform_filter1d

from .._core.solution import RESULTS, Solution
from ..inversion import invert
from ..library import Lag, Play, Polynomial
from ..models import AbstractLaw, SparseModel
from ..recording import Recording, datasets
from ..refinement import refine
from ..regression import Ridge, identify
from ..regression.formulation import Direct
from ..simulation import FixedStep
from ._document import AbstractDocument, shown
from ._published import learned

_SMOOTHED = 50  # samples, 10 ms, of piezo_ayala
_RADII = 0.95 * np.linspace(0, 1, 10)[1:]  # of half the input's range
_LAGS = (0.01, 0.1, 1.0)  # s
_CUBIC = ("w^3", "w^2*u", "w*u^2")
_HEADINGS = ("device", "model", "numbers", "off, %", "smoothed, %", "band, %")
_NOTES = (
    "The output of rows not fitted is the reference; off: what the inverse asks for "
    "less the voltage that was applied, root mean square in % of its range. smoothed: "
    "the output averaged over 10 ms, where its noise is less.",
    "piezo_ayala: fitted to rows 35001 to 45001, the voltage of rows 17500 to 35000. "
    "piezo_yan9a: fitted to the first half, the voltage of the second.",
    "line: the voltage as a straight line of the output, by least squares on the rows "
    "fitted; plays: nine, with radii up to 95 % of the amplitude, and a cubic of the "
    "input; lags: of the input, of 10 ms, 0.1 and 1 s; cubic law: with w^3, w^2 u and "
    "w u^2, which of ten such sets of terms followed the fitted rows best.",
    "band: the standard error that the covariance of a refined law's numbers gives the "
    "voltage, through the derivatives of the inverse, root mean square. What is off "
    "beyond it is the law's form.",
)


@dataclass(frozen=True)
class Voltage:
    """By how much the voltage that an output asks for is off the one applied.

    **Attributes:**

    - `device`, `model`: their names.
    - `numbers`: how many were fitted.
    - `off`, `smoothed`: root mean square, % of the range, from the output as it was
        measured and averaged; `None` where it was not averaged.
    - `band`: the standard error of `off`'s voltage; `None` where none is known.
    """

    device: str
    model: str
    numbers: int
    off: float
    smoothed: float | None = None
    band: float | None = None


@dataclass(frozen=True)
class VoltageTable(AbstractDocument):
    """Devices and models."""

    rows: tuple[Voltage, ...]

    def cells(self):
        """Headings, and a line a device and model."""
        lines = [
            (
                r.device,
                r.model,
                str(r.numbers),
                *(shown(each, 3) for each in (r.off, r.smoothed, r.band)),
            )
            for r in self.rows
        ]
        return [_HEADINGS, *lines]


def voltages() -> VoltageTable:
    """Ask inverses of two measured piezos for the voltage of rows not fitted.

    **Raises:** `InputError` when a recording cannot be had.
    """
    ayala, yan9a = (datasets.load(name) for name in ("piezo_ayala", "piezo_yan9a"))
    own, unseen = ayala.window(35001, 45001), ayala.window(17500, 35000)
    law = learned(own, threshold=0.01)
    wider = SparseModel.from_terms(
        law.terms() | dict.fromkeys(_CUBIC, 0.0), names=own.names, units=own.units
    )
    laws = {
        "law": law,
        "law, refined": refine(law, own),
        "cubic law, refined": refine(wider, own),
    }
    first, second = yan9a.split(0.5)
    rows = [
        *_judged("piezo_ayala", laws | _fitted(own), unseen, _averaged(unseen)),
        *_judged("piezo_yan9a", _fitted(first), second),
    ]
    return VoltageTable("Voltages from measured outputs", tuple(rows), _NOTES)


def _fitted(record: Recording) -> dict[str, AbstractLaw]:
    """What linear regression makes of a record, by name."""
    radii = np.ptp(record.u) / 2 * _RADII
    plays = Play(radii) + Polynomial(3, ("u",))
    libraries = {"plays": plays, "plays and lags": plays + Lag(_LAGS)}
    found = {
        name: identify(record, library, Ridge(1e-9), formulation=Direct()).value
        for name, library in libraries.items()
    }
    return {"line": _line(record)} | found


def _judged(
    device: str,
    models: Mapping[str, AbstractLaw | Solution],
    unseen: Recording,
    averaged: Recording | None = None,
) -> Iterator[Voltage]:
    """Voltages by several models, from an output as it was measured, and averaged."""
    for name, model in models.items():
        law = model.value if isinstance(model, Solution) else model
        off, band = _off(model, unseen)
        smoothed = None if averaged is None else _off(model, averaged)[0]
        yield Voltage(device, name, len(law.terms()), off, smoothed, band)


def _averaged(record: Recording) -> Recording:
    w = uniform_filter1d(np.asarray(record.w), _SMOOTHED, mode="nearest")
    return eqx.tree_at(lambda r: r.w, record, jnp.asarray(w))


def _line(record: Recording) -> AbstractLaw:
    """The law whose voltage is a straight line of the output, by least squares."""
    slope, level = np.polyfit(record.w, record.u, 1)
    terms = {"1": float(-level / slope), "u": float(1 / slope)}
    return SparseModel.from_terms(terms, target="value")


def _off(model: Any, record: Recording) -> tuple[float, float | None]:
    """How far off the voltages of an inverse are, and their standard errors, % of the
    range, root mean square."""
    found = invert(model, record, method=FixedStep(1))
    if found.result != RESULTS.successful:
        return float("inf"), None
    share = 100 / np.ptp(record.u)
    off = share * np.sqrt(np.mean((found.value.u - record.u) ** 2))
    errors = found.stats.get("u_standard_errors")
    band = None if errors is None else share * np.sqrt(np.nanmean(errors**2))
    return float(off), None if band is None else float(band)
