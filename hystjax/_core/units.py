"""Units: which text is one, which physics asks for, and what others are in these."""

import re

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
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "µm": ("m", 1e-6),
    "nm": ("m", 1e-9),
    "in": ("m", 0.0254),
    "ft": ("m", 0.3048),
    "mN": ("N", 1e-3),
    "kN": ("N", 1e3),
    "MN": ("N", 1e6),
    "kgf": ("N", 9.80665),
    "lbf": ("N", 4.4482216152605),
    "kip": ("N", 4448.2216152605),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "GPa": ("Pa", 1e9),
    "bar": ("Pa", 1e5),
    "psi": ("Pa", 6894.757293168361),
    "ksi": ("Pa", 6894757.293168361),
    "kV": ("V", 1e3),
    "mV": ("V", 1e-3),
}


def to_si(unit: str) -> tuple[str, float]:
    """The SI unit of a unit, and by what values in it are multiplied; itself and 1 for
    one that is not known. In *hybrid SI* fields are in T, as µ0 H, and stay so."""
    return _BY_SPELLING.get(_spelt(unit), (unit, 1.0))


def _spelt(unit: str) -> str:
    """One spelling of a unit: `um` is `µm`, and `cm^3` is `cm³`."""
    letters = str.maketrans("μ²³", "µ23", "^")
    return re.sub(r"^u(?=[a-zA-Z])", "µ", unit.translate(letters))


_BY_SPELLING = {_spelt(unit): known for unit, known in _SI.items()}
_PRODUCT = str.maketrans("", "", "·* ")


def differ(one: str, other: str) -> bool:
    """Whether both units are known and not the same, however they are spelt: `um` is
    `µm`, and `A m²` is `A·m^2`."""
    if not (one and other):
        return False
    plain = [_spelt(unit).translate(_PRODUCT) for unit in (one, other)]
    return plain[0] != plain[1]


_SIMPLE = "V A T N Pa m g s min h Hz J W F H Ω Ohm G Oe K rad L bar"
_ALONE = "% ° °C °F deg rpm in ft lb lbf kip psi ksi emu ε με strain"
_ONE = "|".join(
    [rf"[pnuµμmckMG]?(?:{'|'.join(_SIMPLE.split())})", *map(re.escape, _ALONE.split())]
)
_POWER = r"(?:\^?-?\d|[²³]|⁻[¹²³])?"
_UNIT = re.compile(rf"(?:{_ONE}){_POWER}(?:\s*[/·*\s]\s*(?:{_ONE}){_POWER})*")


def is_unit(text: str) -> bool:
    """Whether text is a usual unit of what is measured, such as `A/m` or `N·m`."""
    return _UNIT.fullmatch(text) is not None
