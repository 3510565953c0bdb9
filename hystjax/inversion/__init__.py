"""The input that makes a device go where one says."""

from ._invert import Inverse as Inverse, invert as invert
