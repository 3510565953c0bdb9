"""Units that physics asks for, and what others are in these."""

import numpy as np

# Into SI: the unit, and by what values are multiplied.
_SI = {
    "Oe": ("A/m", 1e3 / (4 * np.pi)),
    "kOe": ("A/m", 1e6 / (4 * np.pi)),
    "kA/m": ("A/m", 1e3),
    "MA/m": ("A/m", 1e6),
    "A/cm": ("A/m", 1e2),
    "G": ("T", 1e-4),
    "kG": ("T", 1e-1),
    "mT": ("T", 1e-3),
    "µT": ("T", 1e-6),
    "emu": ("A m²", 1e-3),
    "memu": ("A m²", 1e-6),
    "emu/cm³": ("A/m", 1e3),
    "emu/g": ("A m²/kg", 1.0),
    "mA m²": ("A m²", 1e-3),
    "µA m²": ("A m²", 1e-6),
    "nA m²": ("A m²", 1e-9),
    "mm": ("m", 1e-3),
    "µm": ("m", 1e-6),
    "nm": ("m", 1e-9),
    "in": ("m", 0.0254),
    "kN": ("N", 1e3),
    "lbf": ("N", 4.4482216152605),
    "kip": ("N", 4448.2216152605),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "GPa": ("Pa", 1e9),
    "ksi": ("Pa", 6894757.293168361),
    "kV": ("V", 1e3),
    "mV": ("V", 1e-3),
}


def to_si(unit: str) -> tuple[str, float]:
    """The SI unit of a unit, and by what values in it are multiplied; itself and 1 for
    one that is not known. In *hybrid SI* fields are in T, as µ0 H, and stay so."""
    return _SI.get(unit.replace("μ", "µ"), (unit, 1.0))
