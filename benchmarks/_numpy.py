"""Jobs of hystjax as one would write them by hand in NumPy."""

from collections.abc import Callable
from itertools import combinations_with_replacement

import numpy as np


def identified(
    t: np.ndarray,
    u: np.ndarray,
    w: np.ndarray,
    degree: int,
    threshold: float,
    ridge: float,
) -> np.ndarray:
    """Coefficients of the law of a record, terms in the order of
    `hystjax.library.Polynomial`."""
    du, dw = (np.gradient(x, t, edge_order=2) for x in (u, w))
    theta = regressors(np.array([w, u, du, np.abs(du), np.abs(w)]), degree)
    return stlsq(theta, dw, threshold, ridge)


def regressors(variables: np.ndarray, degree: int) -> np.ndarray:
    """All products of up to `degree` of the variables, of which each is a row: shape
    (n, k)."""
    terms = {(): np.ones(variables.shape[1])}
    for size in range(1, degree + 1):
        for chosen in combinations_with_replacement(range(len(variables)), size):
            terms[chosen] = terms[chosen[:-1]] * variables[chosen[-1]]
    return np.stack(list(terms.values())).T


def stlsq(
    theta: np.ndarray, slope: np.ndarray, threshold: float, ridge: float
) -> np.ndarray:
    """PySINDy's STLSQ on one orthogonal factorisation of all rows. Normal equations
    would be faster, but on the measured piezo they find another law."""
    terms = theta.shape[1]
    triangle = np.linalg.qr(np.column_stack([theta, slope]), mode="r")
    factor, moment = triangle[:terms, :terms], triangle[:terms, terms]
    root = np.sqrt(ridge) * np.eye(terms)
    kept, before = np.arange(terms), None
    while len(kept) != before:
        before = len(kept)
        rows = np.vstack([factor[:, kept], root[:, kept]])
        solved = np.linalg.lstsq(rows, np.append(moment, np.zeros(terms)))[0]
        kept = kept[np.abs(solved) >= threshold]
    coefficients = np.zeros(terms)
    coefficients[kept] = np.linalg.lstsq(factor[:, kept], moment)[0]
    return coefficients


def marched(rate: Callable, t: np.ndarray, u: np.ndarray, w0) -> np.ndarray:
    """The output of w' = rate(w, u, u') by a classical Runge-Kutta step a sample, u
    linear between samples: shape (n,), or (n, m) from m first outputs."""
    steps, inputs = np.diff(t).tolist(), u.tolist()
    w, found = w0, [w0]
    for step, here, there in zip(steps, inputs, inputs[1:], strict=False):
        du, middle = (there - here) / step, (here + there) / 2
        first = rate(w, here, du)
        second = rate(w + step / 2 * first, middle, du)
        third = rate(w + step / 2 * second, middle, du)
        fourth = rate(w + step * third, there, du)
        w = w + step / 6 * (first + 2 * (second + third) + fourth)
        found.append(w)
    return np.array(found)
