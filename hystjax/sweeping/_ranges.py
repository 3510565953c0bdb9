"""Ranges from which samples are drawn."""

import equinox as eqx
import numpy as np

from .._errors import InputError


class Uniform(eqx.Module):
    """Every value between `low` and `high` is as likely."""

    low: float
    high: float

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        return self.low + (self.high - self.low) * share


class LogUniform(eqx.Module):
    """Every ratio is as likely between `low` and `high`, both positive."""

    low: float
    high: float

    def __check_init__(self):
        if not 0 < self.low < self.high:
            raise InputError(
                f"`LogUniform({self.low}, {self.high})` needs 0 < low < high."
            )

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values that a share (0 to 1) of all lie below."""
        return self.low * (self.high / self.low) ** share
