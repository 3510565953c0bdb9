"""Simulated records under noise, of which the true law is known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj
from hystjax.signals.excitation import AbstractExcitation

from ._problem import Columns

_SAMPLES = 1000
_ONE_RADIAN = 1 / (2 * np.pi)  # Hz
_DUHEM = {"du": 0.25, "w*|du|": -0.5, "u*|du|": 0.4}
_BOUC_WEN = {"du": 1.0, "w*|du|": -0.5, "du*|w|": -2.0}


# Excitations are made when they are needed: in the precision that is set by then.
def _sine() -> AbstractExcitation:
    return hj.excitation.Sine(1.0, _ONE_RADIAN)


def _decaying_sine() -> AbstractExcitation:
    return hj.excitation.DecayingSine(1.0, _ONE_RADIAN, time_constant=30.0)


def _multisine() -> AbstractExcitation:
    """One period, with the root mean square of the sine."""
    frequencies = np.array([3, 7, 11]) / 10 * _ONE_RADIAN
    return hj.excitation.Multisine(frequencies, np.sqrt(0.5), key=jax.random.key(0))


class Noisy(NamedTuple):
    """A record as hystjax and as PySINDy take it, which gets the exact slope of u."""

    record: hj.Recording
    columns: Columns

    @classmethod
    def of(cls, clean: hj.Recording, drawn: np.ndarray) -> "Noisy":
        """A record without noise, and the output that is drawn for it."""
        record = eqx.tree_at(lambda r: r.w, clean, jnp.asarray(drawn))
        u, du = map(np.asarray, clean.path.at(clean.t))
        controls = np.column_stack([u, du, np.abs(du), np.abs(drawn)])
        return cls(record, Columns(np.asarray(clean.t), drawn[:, None], controls))


@dataclass(frozen=True)
class Case:
    """Records that differ by their noise.

    **Attributes:** a `name`; the true `law`; the `level` of the noise, in standard
    deviations of the output or, if `multiplicative`, of each sample; the `degree` of
    the library; and what makes the `excitation`.
    """

    name: str
    law: Mapping[str, float]
    level: float
    multiplicative: bool = False
    degree: int = 2
    excitation: Callable[[], AbstractExcitation] = _sine

    @property
    def title(self) -> str:
        """The case in words."""
        kind = "multiplicative" if self.multiplicative else "additive"
        return f"{self.name}, {100 * self.level:g} % {kind} noise"

    def clean(self) -> hj.Recording:
        """The record without noise, from w = 0."""
        law = hj.models.SparseModel.from_terms(self.law)
        times = np.linspace(0, 20 * np.pi, _SAMPLES)
        return hj.generate(law, self.excitation(), times)

    def records(self, clean: hj.Recording, count: int) -> list[Noisy]:
        """The record under the noise of the seeds from 0 on."""
        w = np.asarray(clean.w)
        return [Noisy.of(clean, self.noisy(w, seed)) for seed in range(count)]

    def noisy(self, w: np.ndarray, seed: int) -> np.ndarray:
        """This output with noise."""
        noise = self.level * np.random.default_rng(seed).normal(size=len(w))
        return w * (1 + noise) if self.multiplicative else w + np.std(w) * noise


_SINE = "Duhem law, sine"

CASES = (
    *(Case(_SINE, _DUHEM, level) for level in (0.05, 0.1, 0.2, 0.4)),
    *(Case(_SINE, _DUHEM, level, multiplicative=True) for level in (0.05, 0.1)),
    Case(f"{_SINE}, library of degree 3", _DUHEM, 0.1, degree=3),
    *(Case("Bouc-Wen law, sine", _BOUC_WEN, level) for level in (0.05, 0.1)),
    Case("Duhem law, decaying sine", _DUHEM, 0.1, excitation=_decaying_sine),
    Case("Duhem law, multisine", _DUHEM, 0.1, excitation=_multisine),
)
