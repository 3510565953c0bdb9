"""Every model does what every verb asks of it, whoever wrote it.

Each case is a model and, written by hand beside it, its equations for SciPy or NumPy.
"""

import functools
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import classical_equations as by_hand
import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hystjax as hj
from hystjax import InputError, models
from hystjax.library import AbstractMemory, Polynomial
from hystjax.models import (
    AbstractLaw,
    AbstractModel,
    Behind,
    BoucWen,
    BoucWenOscillator,
    Butterfly,
    Duhem,
    Envelope,
    Everett,
    Instrumented,
    Oscillator,
    PrandtlIshlinskii,
    Preisach,
    SparseModel,
)
from hystjax.reproduce.baselines import NeuralLaw
from hystjax.simulation import Adaptive, Automatic, FixedStep

STEP = 0.05
T = STEP * np.arange(101)
U = 0.3 + 1.1 * np.sin(2.1 * T) * np.exp(-0.1 * T) + 0.3 * np.sin(5.3 * T)
SLOPES = np.diff(U) / STEP
RATES = np.append(SLOPES, SLOPES[-1])  # right limits, at the end the left one
W0 = 0.2


# ---------------------------------------------------------------- models of strangers


def _grey(width):
    return Grey(1.0, 1.0, Grey.network_of(width, 0))


@hj.models.register(name="conformance/grey", like=_grey)
class Grey(AbstractLaw):
    """w' = a u' - b w |u'| + a network of w and u."""

    a: jax.Array = eqx.field(converter=jnp.asarray)
    b: jax.Array = eqx.field(converter=jnp.asarray)
    network: eqx.nn.MLP

    @staticmethod
    def network_of(width, seed):
        key = jax.random.key(seed)
        return eqx.nn.MLP(2, "scalar", width, 1, jnp.tanh, key=key)

    @property
    def width(self):
        return self.network.width_size

    def rate(self, x, m, now):
        known = self.a * now.du - self.b * x * jnp.abs(now.du)
        return known + self.network(jnp.stack([x, now.u]))


class Plays(AbstractMemory):
    """Plays as one array."""

    radii: jax.Array

    def start(self, now):
        return self.after(jnp.zeros_like(self.radii), now, now)

    def after(self, m, before, now):
        return jnp.clip(m, now.u - self.radii, now.u + self.radii)

    def values(self, m, now):
        return {}


class Stack(AbstractModel):
    """w = sum of c p, of plays p; nothing flows."""

    plays: Plays
    c: jax.Array

    @property
    def memory(self):
        return self.plays

    def start(self, m, now, seen):
        return ()

    def rate(self, x, m, now):
        return ()

    def output(self, x, m, now):
        return self.c @ m


class Creep(AbstractModel):
    """taus z' = u - z, settled at the start: z = u there; w = sum of c z."""

    taus: jax.Array
    c: jax.Array

    def start(self, m, now, seen):
        return jnp.full_like(self.taus, now.u)

    def rate(self, x, m, now):
        return (now.u - x) / self.taus

    def output(self, x, m, now):
        return self.c @ x


class Feedthrough(AbstractModel):
    """z' = -z / tau + u, w = z + a u + b u'."""

    tau: jax.Array
    a: jax.Array
    b: jax.Array

    @property
    def hidden(self):
        return False

    def start(self, m, now, seen):
        return seen - self.a * now.u - self.b * now.du

    def rate(self, x, m, now):
        return now.u - x / self.tau

    def output(self, x, m, now):
        return x + self.a * now.u + self.b * now.du


class FastAndSlow(AbstractModel):
    """A state that is a dictionary, of a number and an array."""

    k: jax.Array
    slow: jax.Array

    def start(self, m, now, seen):
        return {"fast": seen, "slow": jnp.zeros(2)}

    def rate(self, x, m, now):
        fast = now.du - self.k * x["fast"] * jnp.abs(now.du)
        return {"fast": fast, "slow": self.slow * (now.u - x["slow"])}

    def output(self, x, m, now):
        return x["fast"] + jnp.sum(x["slow"] ** 2)


# ---------------------------------------------------------------- equations once more


def flow(rate, x, output, beside=None, after=None):
    """Outputs of x' = rate(u, u', x, p) at the samples, by SciPy over every straight
    piece of the input; `after(p, u)` are p where the input has gone on to u."""
    x = np.atleast_1d(np.asarray(x, float))
    p, out = beside, []
    for i, (t, u, du) in enumerate(zip(T, U, RATES, strict=True)):
        out.append(output(u, du, x, p))
        if i == len(T) - 1:
            break

        def field(time, x, p=p, t=t, u=u, du=du):
            now = u + du * (time - t)
            return rate(now, du, x, None if after is None else after(p, now))

        ran = solve_ivp(field, (t, T[i + 1]), x, "DOP853", rtol=1e-11, atol=1e-12)
        x, p = ran.y[:, -1], p if after is None else after(p, U[i + 1])
    return np.array(out)


def first(u, du, x, p):
    return x[0]


def pulled(p, u, radii):
    return np.clip(p, u - radii, u + radii)


def duhem(u, du, w, p=None):
    return abs(du) * (0.4 * u - 0.5 * w) + 0.25 * du


def duhem_output():
    return flow(duhem, W0, first)


def polynomial(u, du, w, p):
    f, g = 0.1 + 0.4 * u - 0.05 * u**2, 0.25 + 0.1 * u
    return abs(du) * (f - 0.5 * w) + g * du


def bouc_wen(du, z, n, numbers=(1.0, 0.5, 0.2)):
    alpha, beta, gamma = numbers
    bend = beta * abs(du) * z * np.abs(z) ** (n - 1) + gamma * du * np.abs(z) ** n
    return alpha * du - bend


def sparse(u, du, w, p):
    return -0.1 + 0.5 * u - 1.2 * w + 0.3 * du + 0.2 * u * abs(du) - 0.3 * w * np.abs(w)


def remembering():
    """w' of a play and a lag, the lag as a further state."""
    radius = 0.25
    start = pulled(0.0, U[0], radius)

    def rate(u, du, x, p):
        w, z = x
        return [p + 0.5 * z - 1.5 * w + 0.2 * du, (u - z) / 0.5]

    return flow(rate, [W0, U[0]], first, start, lambda p, u: pulled(p, u, radius))


def values():
    """w = 0.3 u + 0.5 play(u, 0.2) + 0.4 play(u, 0.6) + 0.7 lag(u, 0.8)."""
    lag = flow(lambda u, du, z, p: (u - z) / 0.8, U[0], first)
    p = by_hand.plays(U, np.array([0.2, 0.6]))
    return 0.3 * U + p @ [0.5, 0.4] + 0.7 * lag


def oscillator():
    def rate(u, du, x, p):
        y, v, z = x
        force = u - 0.8 * v - 4.0 * y - z
        return [v, force / 1.5, bouc_wen(v, z, 1.0)]

    return flow(rate, [W0, 0.0, 0.0], first)


def on_slider():
    return by_hand.sliding(T, lambda t: np.interp(t, T, U), 0.3, 0.2, 1.0, 2.0, 0.1, W0)


def butterfly():
    return flow(duhem, 0.1, first) ** 2 - 0.3


GAINS = {"input_gain": 1.3, "input_offset": 0.1, "output_gain": 0.7}


def instrumented():
    """The device sees 1.3 u + 0.1; what is recorded is 0.7 y - 0.2."""

    def rate(u, du, y, p):
        return duhem(1.3 * u + 0.1, 1.3 * du, y)

    return 0.7 * flow(rate, (W0 + 0.2) / 0.7, first) - 0.2


def delayed():
    """By two samples, before which the output has stood still."""
    y = duhem_output()
    return np.concatenate([y[:1], y[:1], y[:-2]])


def instrumented_plays():
    p = by_hand.plays(1.3 * U + 0.1, np.array([0.2, 0.5]))
    return 0.7 * (p @ [0.6, 0.9])


NETWORK = eqx.nn.MLP(4, "scalar", 3, 1, jnp.tanh, key=jax.random.key(5))
GREY = Grey.network_of(3, 6)


def in_numpy(network, features):
    hidden, last = network.layers
    inner = np.tanh(np.asarray(hidden.weight) @ features + np.asarray(hidden.bias))
    return (np.asarray(last.weight) @ inner + np.asarray(last.bias))[0]


def neural():
    def rate(u, du, w, p):
        return in_numpy(NETWORK, np.array([1.0, w[0], u, du]))

    return flow(rate, W0, first)


def grey():
    def rate(u, du, w, p):
        known = 0.6 * du - 0.4 * w[0] * abs(du)
        return known + in_numpy(GREY, np.array([w[0], u]))

    return flow(rate, W0, first)


BESIDE = models.Hybrid(
    Duhem(0.4, 0.5, 0.25),
    eqx.nn.MLP(3, "scalar", 2, 1, jnp.tanh, key=jax.random.key(7)),
    centre=(0.1, -0.2),
    reach=(1.2, 0.9),
    speed=2.0,
)


def beside():
    def rate(u, du, w, p):
        law = (0.4 * u - 0.5 * w[0]) * abs(du) + 0.25 * du
        inputs = np.array([(u - 0.1) / 1.2, (w[0] + 0.2) / 0.9, du / 2.0])
        return law + 0.9 / 1.2 * abs(du) * in_numpy(BESIDE.network, inputs)

    return flow(rate, W0, first)


RADII, C = np.array([0.1, 0.3, 0.7]), np.array([0.5, -0.2, 0.8])


def generalised():
    p, out = np.zeros(3), []
    for u in U:
        low, high = np.tanh(0.9 * u - 0.1), 1.2 * np.tanh(0.8 * u + 0.1)
        p = np.clip(p, low - RADII, high + RADII)
        out.append(p @ C)
    return np.array(out)


LEVELS = np.array([-0.9, -0.2, 0.4, 1.1])
RELAYS = np.array([0.5, 0.2, 0.9, 0.4, 0.3, 0.7])
ROOTS = 0.4 + 0.1 * np.arange(9.0).reshape(3, 3)


def relays():
    row, column = np.tril_indices(3)
    up, down = LEVELS[row + 1], LEVELS[column]
    m, out = up + down < 0.2 - 1e-9, []
    for u in U:
        m = np.where(u >= up, True, np.where(u <= down, False, m))
        out.append(0.1 + np.where(m, 1.0, -1.0) @ RELAYS)
    return np.array(out)


def everett():
    """Each play's part is a table, linear in between."""
    heights = np.c_[np.zeros(3), np.cumsum(ROOTS**2, axis=1)]
    heights = heights - heights[:, -1:] / 2
    parts = zip(by_hand.plays(U, RADII).T, heights, strict=True)
    return 0.1 + sum(np.interp(p, LEVELS, table) for p, table in parts)


CURVE_OF_STOPS = (0.7, 0.4, -0.2)


def everett_of_stops():
    """Each spring, and the curve, is a table, linear in between and beyond."""

    def table(heights, at):
        """By slopes of the pieces that lie below."""
        edges = np.r_[-np.inf, LEVELS[1:-1], np.inf]
        slopes = heights / np.diff(LEVELS)
        zero = LEVELS[0]
        parts = (
            slope * (np.clip(at, low, high) - np.clip(zero, low, high))
            for slope, low, high in zip(slopes, edges[:-1], edges[1:], strict=True)
        )
        return sum(parts)

    curve = np.array(CURVE_OF_STOPS)
    total = 0.1 + table(curve, U) - np.sum(curve) / 2
    for heights, p in zip(ROOTS**2, by_hand.plays(U, RADII).T, strict=True):
        total = total + table(heights, U) - table(heights, p)
    return total


def creep():
    taus = np.array([0.3, 2.0])
    return flow(
        lambda u, du, z, p: (u - z) / taus,
        [U[0], U[0]],
        lambda u, du, z, p: 0.5 * z[0] + 0.8 * z[1],
    )


def feedthrough():
    return flow(
        lambda u, du, z, p: u - z / 0.7,
        W0 - 0.3 * U[0] - 0.05 * RATES[0],
        lambda u, du, z, p: z[0] + 0.3 * u + 0.05 * du,
    )


def fast_and_slow():
    def rate(u, du, x, p):
        fast = du - 0.6 * x[0] * abs(du)
        return [fast, 0.5 * (u - x[1]), 2.0 * (u - x[2])]

    return flow(rate, [W0, 0.0, 0.0], lambda u, du, x, p: x[0] + x[1] ** 2 + x[2] ** 2)


def behind_backlash(radius=0.25):
    """Dahl's friction over a play: its rate is that of the input where it is pulled."""
    friction = by_hand.dahl(3.0, 0.8, 1)

    def rate(u, du, x, p):
        pulled_along = np.sign(du) * (u - p) >= radius - 1e-12
        return friction(p, du if pulled_along else 0.0, x)

    start = pulled(0.0, U[0], radius)
    return flow(rate, W0, first, start, lambda p, u: pulled(p, u, radius))


def behind_lag(tau=0.3, fine=2000):
    """Plays of a lag, which is known in between: it turns inside of intervals."""
    share, lag = np.arange(1, fine + 1) / fine, [np.array([U[0]])]
    for u, slope in zip(U[:-1], SLOPES, strict=True):
        behind = u - slope * tau
        decay = (lag[-1][-1] - behind) * np.exp(-share * STEP / tau)
        lag.append(behind + slope * share * STEP + decay)
    every = np.concatenate(lag)
    return (by_hand.plays(every, RADII) @ C + 0.3)[::fine]


def yielding():
    return by_hand.masing(U, *YIELDS)


def slipping():
    return by_hand.slips(U, *map(np.array, SLIPS))


def by_rate(rate, force=None, start=W0):
    """Outputs of a rate by hand, and of a force where the state is not the output."""

    def output(u, du, x, p):
        return x[0] if force is None else force(u, du, x)

    return lambda: flow(lambda u, du, x, p: rate(u, du, x), start, output)


# Where a clamp ends, inside of a step, depends on the input too: no method ends a step
# there, and those of fixed order are of second order at it.
CLAMPED = 2e-6
FERROMAGNET = (8e5, 0.4, 0.5, 2e-7, 0.2)
MAJOR = (1.2, 0.3, 0.5, 0.05)
CURVE = (1.1, 0.5, 0.05, 1.5, 0.3)
BRISTLES = (5.0, 0.2, 0.1, 0.6, 0.9, 0.7)
SPRING = (0.2, 3.0, 1.5, 0.8, 1.5)
PINCHED = (0.2, 3.0, 1.5, 0.8, 1.5, 0.05, 0.04, 0.6, 0.1, 0.5, 0.3, 0.02, 0.4)
YIELDS = (3.0, 1.1, 4.0)
SLIPS = ([1.0, 0.6, 0.3], [0.1, 0.4, 0.9])
Z0 = (W0 - 0.2 * 3.0 * U[0]) / (0.8 * 3.0)  # of the spring with the first output


class Case(NamedTuple):
    model: AbstractModel
    equations: Callable[[], np.ndarray]
    swept: str  # a parameter
    missing: str = ""  # what an export says that it cannot do
    tolerance: float = 1e-7  # of simulations, over the output's size


DUHEM = Duhem(0.4, 0.5, 0.25)
SUM = "no sum of terms"
CASES = {
    "Duhem": Case(DUHEM, duhem_output, "beta"),
    "Duhem, polynomials": Case(
        Duhem((0.1, 0.4, -0.05), 0.5, (0.25, 0.1)),
        lambda: flow(polynomial, W0, first),
        "alpha[1]",
    ),
    "BoucWen, n = 1": Case(
        BoucWen(1.0, 0.5, 0.2),
        lambda: flow(lambda u, du, w, p: bouc_wen(du, w, 1.0), W0, first),
        "beta",
    ),
    "BoucWen, n = 1.5": Case(
        BoucWen(1.0, 0.5, 0.2, 1.5),
        lambda: flow(lambda u, du, w, p: bouc_wen(du, w, 1.5), W0, first),
        "n",
    ),
    "law of the rate": Case(
        SparseModel.from_terms(
            {"1": -0.1, "u": 0.5, "w": -1.2, "du": 0.3, "u*|du|": 0.2, "w*|w|": -0.3}
        ),
        lambda: flow(sparse, W0, first),
        "w",
    ),
    "law of the rate that remembers": Case(
        SparseModel.from_terms(
            {"play(u,0.25)": 1.0, "lag(u,0.5)": 0.5, "w": -1.5, "du": 0.2}
        ),
        remembering,
        "play(u,0.25).radius",
    ),
    "law of the value": Case(
        SparseModel.from_terms(
            {"u": 0.3, "play(u,0.2)": 0.5, "play(u,0.6)": 0.4, "lag(u,0.8)": 0.7},
            target="value",
        ),
        values,
        "lag(u,0.8).time",
    ),
    "BoucWenOscillator": Case(
        BoucWenOscillator(1.5, 0.8, 4.0, 1.0, 0.5, 0.2), oscillator, "stiffness", SUM
    ),
    "Oscillator, an end that slides": Case(
        Oscillator(0.3, 0.2, 1.0, models.MaxwellSlip([2.0], [0.1])),
        on_slider,
        "limits[0]",
        SUM,
    ),
    "Butterfly": Case(Butterfly(DUHEM, -0.3, 0.1), butterfly, "beta", SUM),
    "Instrumented": Case(
        Instrumented(DUHEM, **GAINS, output_offset=-0.2),
        instrumented,
        "output_gain",
        SUM,
    ),
    "Instrumented, late": Case(
        Instrumented(DUHEM, delay=2 * STEP), delayed, "delay", SUM
    ),
    "Instrumented, of plays": Case(
        Instrumented(
            SparseModel.from_terms(
                {"play(u,0.2)": 0.6, "play(u,0.5)": 0.9}, target="value"
            ),
            **GAINS,
        ),
        instrumented_plays,
        "input_gain",
        SUM,
    ),
    "Behind, a backlash": Case(
        Behind(models.Dahl(3.0, 0.8), "play(u,0.25)"),
        behind_backlash,
        "play.radius",
        SUM,
    ),
    "Behind, a lag": Case(
        Behind(PrandtlIshlinskii(RADII, C, 0.3), "lag(u,0.3)"),
        behind_lag,
        "lag.time",
        SUM,
    ),
    "NeuralLaw": Case(
        NeuralLaw(Polynomial(1, ("w", "u", "du")), NETWORK), neural, "p0", SUM
    ),
    "a law and a network": Case(Grey(0.6, 0.4, GREY), grey, "b", SUM),
    "Hybrid": Case(BESIDE, beside, "beta", SUM),
    "plays as one array": Case(
        Stack(Plays(jnp.asarray(RADII)), jnp.asarray(C)),
        lambda: by_hand.plays(U, RADII) @ C,
        "plays.radii[1]",
        SUM,
    ),
    "PrandtlIshlinskii": Case(
        PrandtlIshlinskii(RADII, C, 0.3),
        lambda: by_hand.plays(U, RADII) @ C + 0.3,
        "radii[1]",
    ),
    "PrandtlIshlinskii, generalised": Case(
        PrandtlIshlinskii(
            RADII, C, rising=Envelope(1.0, 0.9, -0.1), falling=Envelope(1.2, 0.8, 0.1)
        ),
        generalised,
        "rising.slope",
        SUM,
    ),
    "Preisach": Case(Preisach(LEVELS, RELAYS, 0.1), relays, "weights[2]", SUM),
    "Everett": Case(Everett(RADII, LEVELS, ROOTS, 0.1), everett, "radii[1]", SUM),
    "Everett, of stops": Case(
        Everett(RADII, LEVELS, ROOTS, 0.1, -1, CURVE_OF_STOPS),
        everett_of_stops,
        "curve[1]",
        SUM,
    ),
    "creep as one array": Case(
        Creep(jnp.array([0.3, 2.0]), jnp.array([0.5, 0.8])), creep, "taus[0]", SUM
    ),
    "feedthrough": Case(
        Feedthrough(*map(jnp.asarray, (0.7, 0.3, 0.05))), feedthrough, "b", SUM
    ),
    "a state by name": Case(
        FastAndSlow(jnp.asarray(0.6), jnp.array([0.5, 2.0])), fast_and_slow, "k", SUM
    ),
    "JilesAtherton": Case(
        models.JilesAtherton(*FERROMAGNET),
        by_rate(by_hand.jiles_atherton(*FERROMAGNET)),
        "pinning",
        SUM,
        CLAMPED,
    ),
    "InverseJilesAtherton": Case(
        models.InverseJilesAtherton(models.JilesAtherton(2e6, *FERROMAGNET[1:])),
        by_rate(by_hand.inverse_jiles_atherton(2e6, *FERROMAGNET[1:])),
        "device.width",
        SUM,
        CLAMPED,
    ),
    "Tellinen": Case(
        models.Tellinen(*MAJOR), by_rate(by_hand.tellinen(*MAJOR)), "coercive", SUM
    ),
    "ColemanHodgdon": Case(
        models.ColemanHodgdon(*CURVE),
        by_rate(by_hand.coleman_hodgdon(*CURVE)),
        "pull",
        SUM,
    ),
    "Dahl": Case(models.Dahl(3.0, 0.8), by_rate(by_hand.dahl(3.0, 0.8, 1)), "coulomb"),
    "Dahl, exponent": Case(
        models.Dahl(3.0, 0.8, 1.5),
        by_rate(by_hand.dahl(3.0, 0.8, 1.5)),
        "exponent",
        SUM,
    ),
    "LuGre": Case(
        models.LuGre(*BRISTLES),
        by_rate(*by_hand.lugre(*BRISTLES), 0.0),
        "stribeck",
        SUM,
    ),
    "MaxwellSlip": Case(models.MaxwellSlip(*SLIPS), slipping, "limits[1]"),
    "BoucWenForce": Case(
        models.BoucWenForce(*SPRING),
        by_rate(*by_hand.bouc_wen_force(*SPRING), Z0),
        "alpha",
        SUM,
    ),
    "BoucWenBaberNoori": Case(
        models.BoucWenBaberNoori(*PINCHED),
        by_rate(*by_hand.baber_noori(*PINCHED), [0.0, 0.0]),
        "p",
        SUM,
    ),
    "RambergOsgood": Case(models.RambergOsgood(*YIELDS), yielding, "n", SUM),
}
# Of classical models, the plain ones differ in their rate only.
PLAIN = (
    "Tellinen",
    "ColemanHodgdon",
    "Dahl, exponent",
    "BoucWenForce",
    "JilesAtherton",
)
each_case = pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if n in PLAIN else ()) for n in CASES],
)
# What compiles for seconds does so for one model of each sort, for more by `make slow`,
# and for all by `make thorough`, which also does what compiles longest. Derivatives
# behind a backlash are also those of differences in `test_series.py`, at a third of the
# price.
SORTS = ("Instrumented, late", "Instrumented, of plays", "Behind, a backlash")
SORTS += tuple(
    n for n, case in CASES.items() if type(case.model).__module__ == __name__
)
MORE = (
    "Duhem, polynomials",
    "law of the rate that remembers",
    "law of the value",
    "Oscillator, an end that slides",
    "Butterfly",
    "Hybrid",
    "PrandtlIshlinskii, generalised",
    "Preisach",
    "InverseJilesAtherton",
    "LuGre",
    "BoucWenBaberNoori",
    "RambergOsgood",
)


def all_cases(**others):
    """All cases: thorough but for `SORTS`, and some have other marks."""
    marks = dict.fromkeys(CASES, pytest.mark.thorough)
    marks |= dict.fromkeys(SORTS, ()) | others
    named = [pytest.param(name, marks=marks[name]) for name in CASES]
    return pytest.mark.parametrize("name", named)


each_sort = all_cases(**dict.fromkeys(MORE, pytest.mark.slow))
each_in_depth = all_cases()
RECORD = hj.Recording(T, U, np.full_like(T, W0))  # of which the first output is used
# Many steps, for laws with |w| and plays, which have kinks within an interval.
METHODS = (FixedStep(128), Automatic(), Adaptive(rtol=1e-11))


@functools.cache
def recorded(name) -> hj.Recording:
    """What the case's own device gives, by as many steps as are then fitted with."""
    w = hj.simulate(CASES[name].model, RECORD, method=FixedStep(2)).w
    return hj.Recording(T, U, w)


# ------------------------------------------------------------------------- simulation


@each_sort
def test_all_ways_to_simulate_agree_with_equations_by_hand(name):
    case = CASES[name]
    expected = case.equations()
    size = np.max(np.abs(expected))
    for method in METHODS:
        ran = hj.simulate(case.model, RECORD, method=method)
        np.testing.assert_allclose(
            ran.w, expected, rtol=0, atol=case.tolerance * size, err_msg=repr(method)
        )


def output(model, record):
    """A number that depends on all of a simulation but its very start."""
    w = hj.simulate(model, record, method=FixedStep(2)).w
    return jnp.sum(jnp.cos(0.3 * jnp.arange(len(T) - 10)) * w[10:])


@all_cases(**{"Behind, a backlash": pytest.mark.slow})
def test_simulations_are_compiled_batched_and_differentiated(name):
    model = CASES[name].model
    names = tuple(model.parameters())
    values = jnp.stack(list(model.parameters().values()))
    rng = np.random.default_rng(3)
    direction = jnp.asarray(rng.normal(size=len(names)))

    def of(values):
        named = dict(zip(names, values, strict=True))
        return output(model.with_parameters(named), RECORD)

    plain = of(values)
    compiled = jax.jit(of)
    # Wherever it was compiled, the same operations may be fused otherwise.
    np.testing.assert_allclose(compiled(values), plain, rtol=1e-12)

    shifts = values + jnp.outer(jnp.array([-1.0, 0.0, 1.0]), 1e-2 * direction)
    models = [
        model.with_parameters(dict(zip(names, row, strict=True))) for row in shifts
    ]
    batch = jax.tree.map(
        lambda *leaves: jnp.stack(leaves) if eqx.is_array(leaves[0]) else leaves[0],
        *models,
    )
    together = eqx.filter_vmap(output, in_axes=(eqx.if_array(0), None))(batch, RECORD)
    np.testing.assert_allclose(together, [compiled(row) for row in shifts], rtol=1e-10)

    forward = jax.jit(lambda v: jax.jvp(of, (v,), (direction,))[1])(values)
    reverse = jax.jit(jax.grad(of))(values) @ direction
    h = 1e-6
    ends = compiled(values + h * direction), compiled(values - h * direction)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(forward, (ends[0] - ends[1]) / (2 * h), rtol=1e-5)


@each_in_depth
def test_sweeps_take_every_model(name):
    model, parameter = CASES[name].model, CASES[name].swept
    nominal = float(model.parameters()[parameter])
    grid = hj.sweeping.Grid(value=nominal * jnp.array([0.9, 1.0]))

    def lane(value, record):
        changed = model.with_parameters({parameter: value})
        return hj.simulate(changed, record, method=FixedStep(2), throw=False)

    found = hj.sweep(lane, grid, shared={"record": RECORD})
    assert np.all(found["result"] == "successful")
    np.testing.assert_allclose(found["w"][1], recorded(name).w, rtol=0, atol=1e-10)
    assert np.max(np.abs(found["w"][0] - found["w"][1])) > 1e-6


# ------------------------------------------------------------------------- refinement


@each_sort
def test_refinement_stays_at_the_truth(name):
    model = CASES[name].model
    solution = hj.refine(model, recorded(name), substeps=2)
    assert bool(solution.result == hj.RESULTS.successful)
    before, after = model.parameters(), solution.value.parameters()
    assert len(before) == len(after)
    np.testing.assert_allclose(
        list(map(float, after.values())), list(map(float, before.values())), atol=1e-6
    )
    assert float(solution.stats["rmse"][0]) < 1e-9


@pytest.mark.parametrize("free_start", [False, True])
def test_refinement_starts_where_the_model_says(free_start):
    """Not at an input of zero: z = u at the first sample, which here is 0.3."""
    truth = CASES["creep as one array"].model
    start = Creep(jnp.array([0.35, 1.8]), jnp.array([0.5, 0.8]))
    record = recorded("creep as one array")
    solution = hj.refine(start, record, substeps=2, free_start=free_start)
    for found, expected in zip(
        jax.tree.leaves(solution.value.fitted_on(None)),
        jax.tree.leaves(truth),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert float(solution.stats["w0"][0]) == pytest.approx(1.3 * U[0], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "shooting"),
    [
        ("creep as one array", hj.refinement.Nudging()),
        ("a state by name", hj.refinement.SingleShooting()),
        pytest.param(
            "a state by name",
            hj.refinement.MultipleShooting(4),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_states_of_arrays_are_refined_by_every_way(name, shooting):
    model = CASES[name].model
    names = list(model.parameters())
    off = {key: 1.1 * value for key, value in model.parameters().items()}
    solution = hj.refine(
        model.with_parameters(off), recorded(name), substeps=2, shooting=shooting
    )
    found, truth = solution.value.parameters(), model.parameters()
    for key in names:
        assert float(found[key]) == pytest.approx(float(truth[key]), rel=1e-4), key


# ------------------------------------------------------------- files, reports, figures


def bits(model):
    return [
        (np.asarray(leaf).dtype, np.asarray(leaf).tobytes())
        for leaf in jax.tree.leaves(eqx.filter(model, eqx.is_array))
    ]


@each_case
def test_models_come_back_from_files_bit_for_bit(name, tmp_path):
    model = CASES[name].model
    hj.save(tmp_path / "model.json", model)
    back = hj.load(tmp_path / "model.json")
    assert jax.tree.structure(back) == jax.tree.structure(model)
    assert bits(back) == bits(model)
    again = hj.simulate(back, RECORD, method=FixedStep(2)).w
    np.testing.assert_array_equal(again, recorded(name).w)


@each_case
def test_reports_figures_and_exports(name, tmp_path, monkeypatch):
    case, record, save = CASES[name], recorded(name), hj.report._saved

    def saved(path, figure):
        """The overview if it has a formula: all others are alike."""
        alike = case.missing or path.stem != "overview"
        return path if alike and name not in SORTS else save(path, figure)

    monkeypatch.setattr(hj.report, "_saved", saved)
    judgement = hj.judge(case.model, record, method=FixedStep(2))
    assert judgement.succeeded and float(judgement.errors["nrmse"]) < 1e-9
    path = hj.report.write(tmp_path, case.model, {"fitted": judgement})
    text = path.read_text()
    listed = re.findall(r"^\| `([^`]*)` \|", text, re.MULTILINE)
    expected = case.model.numbers()
    assert [each.replace("\\", "") for each in listed] == list(expected)
    assert hj.export.to_text(case.model) in text
    assert (tmp_path / "law.json").is_file()
    loop = hj.plot.loop(record, judgement.trajectory)
    assert loop.axes
    plt.close("all")
    for export in (hj.export.to_latex, hj.export.to_sympy, hj.export.to_python):
        if case.missing:
            with pytest.raises(InputError, match=case.missing):
                export(case.model)
        else:
            assert export(case.model)


def test_models_print_themselves():
    model = CASES["creep as one array"].model
    assert str(model) == "Creep(taus[0] = 0.3, taus[1] = 2, c[0] = 0.5, c[1] = 0.8)"
    many: Any = Creep(jnp.ones(20), jnp.ones(20))
    assert str(many) == "Creep(40 numbers)"
    inside = Butterfly(model, 0.5)
    assert str(inside).startswith("w = y^2 + 0.5, y of Creep(taus[0] = 0.3")
