"""A jit that compiles quickly, wherever it is called."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax._jit as module
from hystjax._jit import jit


@jit
def square(x):
    return x**2


def at(x):
    return {
        "alone": lambda: square(x),
        "jit": lambda: jax.jit(lambda x: square(x) + 0 * square(3.0))(x),
        "vmap": lambda: jax.vmap(lambda y: square(y) + 0 * square(x))(x[None])[0],
        "scan": lambda: jax.lax.scan(lambda _, y: (0, square(y)), 0, x[None])[1][0],
        "cond": lambda: jax.lax.cond(True, square, square, x),
        "eval": lambda: jnp.full(jax.eval_shape(square, x).shape, x**2),
        "forward": lambda: jax.jvp(square, (x,), (x,))[1] / 2,
        "reverse": lambda: jax.grad(lambda x: jnp.sum(square(x)))(x) * x / 2,
        "linear": lambda: jax.linearize(square, x)[1](x) / 2,
        "reverse of vmap": lambda: (
            jax.grad(lambda x: jnp.sum(jax.vmap(square)(x)))(x) * x / 2
        ),
        "vmap of reverse": lambda: jax.vmap(jax.grad(square))(x) * x / 2,
        "jit of reverse": lambda: jax.jit(jax.vmap(jax.grad(square)))(x) * x / 2,
        "second": lambda: (
            jnp.diag(jax.hessian(lambda x: jnp.sum(square(x)))(x)) / 2 * x**2
        ),
    }


@pytest.mark.parametrize("where", at(jnp.ones(1)))
def test_is_a_jit_wherever_it_is_called(where):
    x = jnp.arange(1.0, 4.0)
    np.testing.assert_allclose(at(x)[where](), x**2, rtol=1e-12)


def test_compiles_without_options_that_xla_does_not_have(monkeypatch):
    monkeypatch.setattr(module, "_QUICKER", {"xla_of_another_age": True})
    module._known.cache_clear()
    try:
        assert float(jit(lambda x: x + 1)(2.0)) == 3.0
        assert not module._known()
    finally:
        module._known.cache_clear()


def test_is_a_method_too():
    class Scale:
        factor = 3.0

        @jit
        def times(self, x):
            return self.factor * x

    assert float(Scale().times(2.0)) == 6.0
