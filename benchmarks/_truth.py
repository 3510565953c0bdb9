"""Whether a law is the true one, and how far its coefficients are off."""

from collections.abc import Mapping

import numpy as np

import hystjax as hj

_EQUAL = 1e-6  # share of a term by which it may differ from others and count as equal
_ZERO = 1e-9  # of the largest coefficient: what rounding leaves
_FORMULATION = hj.formulation.WeakForm(20)  # without the error of differences


class Truth:
    """The true law of a record, among laws of one library.

    Terms that are equal on the record's excitation are one, or a sum of simpler ones:
    laws are compared by what remains.
    """

    def __init__(
        self, clean: hj.Recording, library: hj.library.Library, law: Mapping[str, float]
    ):
        """**Arguments:** the record without noise, and the law's coefficients by term,
        none of which may be a combination of simpler ones."""
        self.names = library.names
        self._simpler = _simpler(clean, library)
        self._coefficients = self._distinct(self.vector(law))

    def vector(self, law: Mapping[str, float]) -> np.ndarray:
        """Coefficients of all terms of the library."""
        return np.array([law.get(name, 0.0) for name in self.names])

    def is_found(self, coefficients: np.ndarray) -> bool:
        """Whether a law has exactly the right terms."""
        found = np.abs(self._distinct(coefficients))
        return np.array_equal(found > _ZERO * found.max(), self._coefficients != 0)

    @property
    def apart(self) -> bool:
        """Whether no term of the library equals, on this excitation, one of the law's,
        or a sum with one of them."""
        rows = np.abs(self._simpler - np.eye(len(self.names)))
        others = self._simpler[rows.sum(axis=1) > 0]
        return not np.any(np.abs(others[:, self._coefficients != 0]) > _ZERO)

    def error(self, coefficients: np.ndarray) -> float:
        """The length of the error of all coefficients, relative to the true ones'."""
        error = self._distinct(coefficients) - self._coefficients
        return float(np.linalg.norm(error) / np.linalg.norm(self._coefficients))

    def _distinct(self, coefficients: np.ndarray) -> np.ndarray:
        return coefficients @ self._simpler


def _simpler(clean: hj.Recording, library: hj.library.Library) -> np.ndarray:
    """Each term, a row, by the terms that the excitation tells apart."""
    names = library.names
    rows = np.eye(len(names))
    # In the library's order: what a term is made of comes before it.
    for alias in hj.aliases(clean, library, formulation=_FORMULATION, tolerance=_EQUAL):
        parts = ((names.index(name), c) for name, c in alias.combination.items())
        rows[names.index(alias.term)] = sum(c * rows[i] for i, c in parts)
    return rows
