"""Periods, and by how much the output is behind."""

import numpy as np
from jaxtyping import Float, Int

from ._tips import Column, Tips


def timing(
    t: Float[np.ndarray, " n"],
    u: Column,
    w: Column,
    rows: Int[np.ndarray, "c 3"],
    tips: Tips,
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Period of each cycle, s; the angle by which the fundamental wave of the output is
    behind that of the input, rad, from -π to π; and its standard error.

    Waves are fitted by least squares over the samples of a cycle, with a constant.
    """
    index = np.arange(len(t))
    begun, ended = (np.interp(tips.places[:, i], index, t) for i in (0, 2))
    steps = np.gradient(t)[rows]
    lags, errors = [], []
    for i, (start, _, stop) in enumerate(rows):
        part = slice(start, stop)

        def behind(since, until, part=part):
            inverse = _waves(t[part], since, until)
            waves = [complex(*(inverse @ column.x[part])) for column in (u, w)]
            return inverse, waves, np.angle(waves[0] * np.conj(waves[1]))

        inverse, waves, lag = behind(begun[i], ended[i])
        # A phase moves by what is across its wave.
        moved = [
            column.noise * np.linalg.norm([-wave.imag, wave.real] @ inverse)
            for column, wave in zip((u, w), waves, strict=True)
        ]
        moved = [m / abs(wave) ** 2 for m, wave in zip(moved, waves, strict=True)]
        # And where noise hides when the cycle begins and ends, with its period.
        early, _, late = tips.place_error[i] * steps[i]
        if early or late:
            moved += [
                behind(begun[i] + early, ended[i])[2] - lag,
                behind(begun[i], ended[i] + late)[2] - lag,
            ]
        lags.append(lag)
        errors.append(np.linalg.norm(moved))
    return ended - begun, np.array(lags), np.array(errors)


def _waves(t: Float[np.ndarray, " k"], since: float, until: float):
    """What gives real and imaginary part of the fundamental wave of samples."""
    phase = 2 * np.pi * (t - since) / (until - since)
    columns = [np.cos(phase), -np.sin(phase), np.ones_like(phase)]
    return np.linalg.pinv(np.stack(columns, axis=1))[:2]
