"""Jobs that grow: a fit, and many fits, simulations or refinements."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj

from . import _multisine, _numpy, _problem, refine, refinements
from ._agreement import relative_difference
from ._curves import Climb
from ._parallel import JOBLIB, in_parallel
from ._timing import Contestant, Timing

_THRESHOLD, _NOISE, _SAMPLES = 0.1, 1e-4, 1000
_ROWS = 10_000  # of the fits whose library grows
_STLSQ = {"threshold": _THRESHOLD, "ridge": _problem.RIDGE}
_CLOSED = "SciPy knows that u is a sine, the others interpolate its samples"


def one_fit(over: str, title: str, problem: Callable[[int], tuple[int, int]]) -> Climb:
    """A fit of as many samples and of the degree that `problem` says for a size."""

    def contestants(size: int) -> Mapping[str, Contestant]:
        samples, degree = problem(size)
        record = _multisine.recording(samples)
        data, library = _problem.columns(record), hj.library.Polynomial(degree)
        columns = data.t, data.controls[:, 0], data.w[:, 0]
        settings = hj.regression.STLSQ(**_STLSQ, normalise=False)

        def ours(device):
            placed = jax.device_put(record, device)
            return lambda: hj.identify(placed, library, settings).value.coefficients

        return {
            **_on_devices("hystjax.identify", ours),
            "NumPy by hand": Contestant(
                lambda: _numpy.identified(*columns, degree, **_STLSQ)
            ),
            "PySINDy": Contestant(lambda: _sindy(data, degree)),
        }

    return Climb(title, over, contestants, _apart, ("coefficients", 1e-6))


def over_samples() -> Climb:
    """Ever more samples, and a library of 21 terms."""
    return one_fit("samples", "One STLSQ fit, 21 terms", lambda n: (n, 2))


def over_terms() -> Climb:
    """Ever larger libraries, and 10 000 samples."""
    degrees = {len(hj.library.Polynomial(degree)): degree for degree in range(1, 6)}
    title = "One STLSQ fit, 10 000 samples"
    return one_fit("terms of the library", title, lambda n: (_ROWS, degrees[n]))


def many_fits() -> Climb:
    """Fits of records that differ by their noise."""

    def contestants(count: int) -> Mapping[str, Contestant]:
        records = _noisy_columns(count)

        def by_hand():
            u = records[0].controls[:, 0]
            return [_numpy.identified(d.t, u, d.w[:, 0], 2, **_STLSQ) for d in records]

        return {
            **_on_devices(
                "hystjax.sweep", lambda device: partial(fits, count, [device])
            ),
            "NumPy by hand": Contestant(by_hand),
            "PySINDy": Contestant(lambda: [_sindy(d, 2) for d in records]),
            f"PySINDy, {JOBLIB}": Contestant(
                in_parallel(_sindy, [(d, 2) for d in records])
            ),
        }

    return Climb(
        "STLSQ fits of 1000 samples each, 21 terms",
        "fits",
        contestants,
        _apart,
        ("coefficients", 1e-6),
        ("hystjax draws the noise too, the others get it ready",),
    )


def many_simulations() -> Climb:
    """The area that a Duhem law's output goes round, for many of its coefficients."""

    def contestants(count: int) -> Mapping[str, Contestant]:
        gains = _gains(count)
        return {
            **_on_devices(
                "hystjax.sweep", lambda device: partial(areas, count, [device])
            ),
            "NumPy by hand, all at once": Contestant(lambda: _areas_by_hand(gains)),
            "SciPy odeint": Contestant(lambda: [_area_by_scipy(g) for g in gains]),
            f"SciPy odeint, {JOBLIB}": Contestant(
                in_parallel(_area_by_scipy, [(g,) for g in gains])
            ),
        }

    return Climb(
        "Simulations of 1000 samples each",
        "simulations",
        contestants,
        _apart,
        ("areas of the loops", 1e-3),
        (_CLOSED,),
    )


def many_refinements() -> Climb:
    """Refinements of records that differ by their noise."""

    def contestants(count: int) -> Mapping[str, Contestant]:
        records = refinements.noisy(count)

        def ours(device):
            return lambda: refinements.swept(count, devices=[device])["rmse"].values[
                :, 0
            ]

        return {
            **_on_devices("hystjax.sweep", ours),
            "SciPy least_squares": Contestant(
                lambda: [refinements.by_scipy(w) for w in records]
            ),
            f"SciPy least_squares, {JOBLIB}": Contestant(
                in_parallel(refinements.by_scipy, [(w,) for w in records])
            ),
        }

    return Climb(
        "Refinements, 3 coefficients, 1000 samples",
        "refinements",
        contestants,
        _apart,
        ("root mean square residuals", 1e-4),
        (_CLOSED, "hystjax also gives standard errors"),
    )


def fits(count: int, devices: list[Any] | None = None) -> np.ndarray:
    """Coefficients of so many fits by `hj.sweep`, shape (count, 21)."""
    clean = _multisine.recording(_SAMPLES)
    space = hj.sweeping.Grid(seed=range(count))
    found = hj.sweep(_fit, space, shared={"clean": clean}, devices=devices)
    return found["coefficients"].values


def _fit(seed, clean: hj.Recording) -> hj.Solution:
    noisy = hj.Recording(clean.t, clean.u, _noisy(seed, clean.w))
    settings = hj.regression.STLSQ(**_STLSQ, normalise=False)
    found = hj.identify(noisy, _problem.LIBRARY, settings, throw=False)
    return hj.Solution(found.value, found.result, {})


def _noisy(seed, w):
    return w + _NOISE * jax.random.normal(jax.random.key(seed), w.shape)


def _noisy_columns(count: int) -> list[_problem.Columns]:
    """The records of the first lanes, as PySINDy takes them."""
    clean = _multisine.recording(_SAMPLES)
    data = _problem.columns(clean)
    outputs = np.asarray(jax.vmap(_noisy, (0, None))(jnp.arange(count), clean.w))
    driven = data.controls[:, :3]
    return [
        _problem.Columns(data.t, w[:, None], np.column_stack([driven, np.abs(w)]))
        for w in outputs
    ]


def _sindy(data: _problem.Columns, degree: int) -> np.ndarray:
    model = _problem.sindy(_THRESHOLD, degree)
    return model.fit(data.w, data.t, u=data.controls).coefficients()[0]


def areas(count: int, devices: list[Any] | None = None) -> np.ndarray:
    """Areas of so many loops by `hj.sweep`."""
    t = refinements.times(_SAMPLES)
    space, shared = hj.sweeping.Grid(gain=_gains(count)), {"t": t, "u": np.sin(t)}
    return hj.sweep(_area, space, shared=shared, devices=devices)["area"].values


def _gains(count: int) -> np.ndarray:
    return np.linspace(0.2, 0.6, count)


def _area(gain, t, u) -> dict[str, jax.Array]:
    law = hj.models.Duhem(gain, 0.5, 0.25)
    path = hj.interpolation.Linear().path(t, u)
    method = hj.simulation.FixedStep(1)
    w = hj.simulate(law, path, w0=0.0, method=method, throw=False).w
    return {"area": jnp.trapezoid(w, u)}


def _areas_by_hand(gains: np.ndarray) -> np.ndarray:
    t = refinements.times(_SAMPLES)
    u = np.sin(t)

    def rate(w, u, du):
        return 0.25 * du + (gains * u - 0.5 * w) * abs(du)

    return np.trapezoid(_numpy.marched(rate, t, u, np.zeros(len(gains))), u, axis=0)


def _area_by_scipy(gain: float) -> float:
    t = refinements.times(_SAMPLES)
    w = refine.duhem([0.25, gain, -0.5, 0.0], t, tolerance=None)
    return float(np.trapezoid(w, np.sin(t)))


def _on_devices(name: str, ours: Callable[[Any], Callable]) -> dict[str, Contestant]:
    """hystjax on JAX's default device, and on the processor where that is another."""
    devices = {device.platform: device for device in jax.devices()[:1]}
    with suppress(RuntimeError):  # JAX may be told to leave the processor alone
        devices |= {"cpu": jax.devices("cpu")[0]}

    def placed(device):
        with jax.default_device(device):
            call = ours(device)

        def on_device():
            with jax.default_device(device):
                return call()

        return on_device

    return {f"{name} ({p})": Contestant(placed(d)) for p, d in devices.items()}


def _apart(timings: Mapping[str, Timing]) -> float:
    """The largest difference from the first contestant's result."""
    first, *others = (timing.result for timing in timings.values())
    return max((relative_difference(each, first) for each in others), default=0.0)
