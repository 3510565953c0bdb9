"""Equations of classical models by hand, for SciPy and for plain Python.

Rates are functions of the input, its derivative and the state, a list of numbers.
"""

import functools
import itertools

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

MU0 = 4e-7 * np.pi


def langevin(h):
    return h / 3 - h**3 / 45 if abs(h) < 1e-4 else 1 / np.tanh(h) - 1 / h


def langevin_slope(h):
    return 1 / 3 - h**2 / 15 if abs(h) < 1e-3 else 1 / h**2 - 1 / np.sinh(h) ** 2


def susceptibility(ms, a, k, alpha, c):
    """dM/dH of Mirr and Man, as they are defined, not as they are eliminated."""

    def chi(h, m, way):
        he = h + alpha * m
        level, slope = ms * langevin(he / a), ms / a * langevin_slope(he / a)
        irreversible = (m - c * level) / (1 - c)
        pinned = max(0.0, way * (level - irreversible) / k)  # dMirr/dHe
        per_effective = (1 - c) * pinned + c * slope
        # dM = per_effective dHe, dHe = dH + alpha dM
        return per_effective / (1 - alpha * per_effective)

    return chi


def jiles_atherton(*numbers):
    chi = susceptibility(*numbers)

    def rate(h, dh, x):
        return MU0 * (1 + chi(h, x[0] / MU0 - h, np.sign(dh))) * dh

    return rate


def inverse_jiles_atherton(*numbers):
    chi = susceptibility(*numbers)

    def rate(b, db, x):
        return db / MU0 / (1 + chi(x[0], b / MU0 - x[0], np.sign(db)))

    return rate


def tellinen(saturation, coercive, width, far):
    def branch(u, way):
        bend = np.arctan((u - way * coercive) / width)
        return far * u + 2 / np.pi * saturation * bend

    def steep(u, way):
        bend = 1 / (1 + ((u - way * coercive) / width) ** 2)
        return far + 2 / np.pi * saturation / width * bend

    def rate(u, du, x):
        way = np.sign(du)
        share = (branch(u, -way) - x[0]) / (branch(u, -way) - branch(u, way))
        return (far + share * (steep(u, way) - far)) * du

    return rate


def coleman_hodgdon(saturation, width, far, pull, following):
    def rate(u, du, x):
        f = far * u + saturation * np.tanh(u / width)
        g = far + following * saturation / width / np.cosh(u / width) ** 2
        return pull * abs(du) * (f - x[0]) + g * du

    return rate


def dahl(stiffness, coulomb, exponent):
    def rate(u, du, x):
        left = 1 - np.sign(du) * x[0] / coulomb
        return stiffness * abs(left) ** exponent * np.sign(left) * du

    return rate


def lugre(sigma0, sigma1, sigma2, coulomb, static, stribeck):
    """The rate of the bend of the bristles, and the force."""

    def rate(u, du, x):
        g = coulomb + (static - coulomb) * np.exp(-((du / stribeck) ** 2))
        return du - sigma0 * abs(du) / g * x[0]

    def force(u, du, x):
        return sigma0 * x[0] + sigma1 * rate(u, du, x) + sigma2 * du

    return rate, force


def bend(du, z, beta, gamma, n):
    return beta * abs(du) * abs(z) ** (n - 1) * z + gamma * du * abs(z) ** n


def bouc_wen_force(alpha, k, *numbers):
    """The rate of z, and the force."""

    def rate(u, du, x):
        return du - bend(du, x[0], *numbers)

    def force(u, du, x):
        return alpha * k * u + (1 - alpha) * k * x[0]

    return rate, force


def baber_noori(alpha, k, beta, gamma, n, d_nu, d_eta, zeta_s, q, p, psi, d_psi, lam):
    """The rates of z and of the energy, and the force."""

    def rate(u, du, x):
        z, e = x
        nu, eta = 1 + d_nu * e, 1 + d_eta * e
        last = (1 / (nu * (beta + gamma))) ** (1 / n)
        depth = zeta_s * (1 - np.exp(-p * e))
        width = (psi + d_psi * e) * (lam + depth)
        h = 1 - depth * np.exp(-((z * np.sign(du) - q * last) ** 2) / width**2)
        return [
            h / eta * (du - nu * bend(du, z, beta, gamma, n)),
            (1 - alpha) * k * z * du,
        ]

    def force(u, du, x):
        return alpha * k * u + (1 - alpha) * k * x[0]

    return rate, force


def plays(u, radii, first=0.0):
    """Plays along an input, one a column, from states before its first sample."""
    p, found = np.full(len(radii), first), []
    for each in u:
        p = np.clip(p, each - radii, each + radii)
        found.append(p)
    return np.array(found)


def play(u, radius, first=0.0):
    """One play along an input."""
    return plays(u, np.array([radius]), first)[:, 0]


def slips(u, stiffnesses, limits):
    """Forces of springs that slip, slack at 0."""
    stretch, found = np.zeros(len(limits)), []
    for step in np.diff(u, prepend=0.0):
        stretch = np.clip(stretch + step, -limits, limits)
        found.append(stiffnesses @ stretch)
    return np.array(found)


def sliding(t, u, mass, damping, stiffness, gain, radius, y):
    """Positions at times t of a mass under a force u(t), on a spring and a damper, and
    on a spring of a gain whose other end slides where it is stretched by more than a
    radius: from rest at y, phase by phase, each up to the event that ends it."""
    end, way = float(np.clip(0.0, y - radius, y + radius)), 0
    x, found = np.array([y, 0.0]), [y]

    def sticking(time, x, way=0):
        stretch = x[0] - end if way == 0 else way * radius
        force = u(time) - damping * x[1] - stiffness * x[0] - gain * stretch
        return x[1], force / mass

    def ends(way):
        """What ends a phase of sliding this way, or of sticking."""
        if way:
            return [(lambda time, x: x[1], -way, 0)]
        return [(lambda time, x, w=w: x[0] - end - w * radius, w, w) for w in (1, -1)]

    for start, stop in itertools.pairwise(t):
        while start < stop:
            events = []
            for function, direction, _ in ends(way):
                event = functools.partial(function)
                event.terminal, event.direction = True, direction
                events.append(event)
            rate = functools.partial(sticking, way=way)
            settings = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
            ran = solve_ivp(rate, (start, stop), x, events=events, **settings)
            start, x = ran.t[-1], ran.y[:, -1]
            if ran.status == 1:
                (which,) = np.flatnonzero([len(each) for each in ran.t_events])
                after = ends(way)[which][2]
                end = x[0] - way * radius if way else end
                way = after
        found.append(x[0])
    return np.array(found)


def skeleton(strain, k, y, n):
    """The stress of Ramberg and Osgood's curve."""

    def over(f):
        return f / k * (1 + 3 / 7 * abs(f / y) ** (n - 1)) - strain

    most = 1.1 * k * abs(strain) + 1e-300
    return brentq(over, -most, most, xtol=1e-25, rtol=1e-14)


def masing(u, k, y, n):
    """Stresses by Masing's rules, with a list of turning points that is popped."""
    points: list[tuple[float, float]] = []  # strain and stress, where it turned
    found, way, last = [], 0.0, 0.0

    def stress(strain):
        if not points:
            return skeleton(strain, k, y, n)
        u0, w0 = points[-1]
        return w0 + 2 * skeleton((strain - u0) / 2, k, y, n)

    for strain in u:
        if strain != last:
            if np.sign(strain - last) == -way:
                points.append((last, stress(last)))
            way = np.sign(strain - last)
        # Where an inner loop has closed, the branch before it goes on.
        while len(points) > 1 and way * (strain - points[-2][0]) >= 0:
            points = points[:-2]
        if len(points) == 1 and abs(strain) >= abs(points[0][0]):
            points = []
        last = strain
        found.append(stress(strain))
    return np.array(found)
