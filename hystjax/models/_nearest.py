"""Of many models that may be a device the one whose free run is nearest to a record: a
first guess of what cannot be read off a loop."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._core.compiling import jit
from ..recording import Recording
from ..signals import Signals
from ._base import AbstractModel
from ._numbers import arrays, stretches, widest

_ROWS = 1001  # of a record that are followed: always as many, for one program
_STRETCHES = 9  # in which these are
_FAR = 100.0  # times the output, beyond which a run has run away
_FACTORS = (0.2, 5.0)  # by which outputs are made larger at once

Build = Callable[..., AbstractModel]
Columns = Float[np.ndarray, "k m"]


def course(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Some of a record of a device whose state is its output, which may begin anywhere:
    stretches from the one before the first wide one on."""
    u, w = arrays(recording)
    parts = stretches(u)
    wide, _, _ = widest(parts)
    begin = max(min(map(parts.index, wide)) - 1, 0)
    seen = parts[begin : begin + _STRETCHES]
    rows = slice(seen[0].rows.start, seen[-1].rows.stop)
    return thinned(u[rows], w[rows])


def thinned(u: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Input and output at points that are evenly spaced along the way of the input."""
    way = np.append(0.0, np.cumsum(np.abs(np.diff(u))))
    way, moved = np.unique(way, return_index=True)
    points = np.linspace(0, way[-1], _ROWS)
    return np.interp(points, way, u[moved]), np.interp(points, way, w[moved])


def scaled(
    build: Build,
    columns: Columns,
    powers: Sequence[int],
    course: tuple[np.ndarray, np.ndarray],
) -> Columns:
    """Numbers of models, a column each, with outputs as large as the recorded ones by
    least squares: each number times that scale to its power."""
    _, w = course
    outputs = _outputs(build, columns, course)
    factor = np.clip(outputs @ w / np.sum(outputs**2, axis=1), *_FACTORS)
    return columns * factor ** np.array(powers)[:, None]


def nearest(
    build: Build, columns: Columns, course: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, " k"]:
    """The numbers, of several columns, of the model that is nearest."""
    missed = _outputs(build, columns, course) - course[1]
    return columns[:, int(np.argmin(np.sum(missed**2, axis=1)))]


def _outputs(build: Build, columns: Columns, course) -> Float[np.ndarray, "m n"]:
    """Their free runs; that of a model that runs away is far off."""
    models = jax.vmap(build)(*map(jnp.asarray, columns))
    outputs = np.asarray(_runs(models, *map(jnp.asarray, course)))
    far = _FAR * np.max(np.abs(course[1]))
    return np.clip(np.nan_to_num(outputs, nan=far), -far, far)


@jit
def _runs(
    models: AbstractModel, u: Float[Array, " n"], w: Float[Array, " n"]
) -> Float[Array, "m n"]:
    """Free runs of models that are rate independent and have no memory but their state,
    from the first output, by the rule of the midpoint: a step lasts as long as any."""

    def run(model):
        def step(x, ends):
            start, end = ends
            du = end - start

            def on(x, at, share):
                rate = model.rate(x, (), Signals(jnp.zeros_like(du), at, du))
                return jax.tree.map(lambda each, by: each + share * by, first, rate)

            first = x
            x = on(on(x, start, 0.5), start + du / 2, 1.0)
            return x, model.output(x, (), Signals(jnp.zeros_like(du), end, du))

        begun = Signals(jnp.zeros_like(u[0]), u[0], u[1] - u[0])
        x = model.start((), begun, w[0])
        _, outputs = jax.lax.scan(step, x, (u[:-1], u[1:]))
        return jnp.append(model.output(x, (), begun), outputs)

    return jax.vmap(run)(models)
