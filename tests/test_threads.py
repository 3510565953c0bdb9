"""Work side by side, as its caller would do it."""

import threading
import time

import jax
import jax.numpy as jnp
import pytest

from hystjax import InputError
from hystjax._core.compiling import in_order, side_by_side


def test_each_item_comes_with_its_own_result():
    done = dict(side_by_side(lambda x: x**2, range(20)))
    assert done == {x: x**2 for x in range(20)}


def test_in_order_who_is_done_early_waits():
    def slow(x):
        time.sleep(0.05 * (x == 0))
        return x**2

    items = (0, 1, 1, 2)
    assert list(in_order(slow, items)) == [(x, x**2) for x in items]


def test_settings_of_the_callers_thread_hold():
    def precision(_):
        return jnp.zeros(1).dtype, threading.current_thread()

    for wide, dtype in ((False, jnp.float32), (True, jnp.float64)):
        with jax.enable_x64(wide):
            ((_, (found, thread)),) = side_by_side(precision, [0])
        assert found == dtype
        assert thread is not threading.current_thread()


def test_what_one_raises_is_raised_and_the_rest_not_begun():
    begun = []

    def refuse(x):
        begun.append(x)
        time.sleep(0.01)
        raise InputError(f"not {x}")

    with pytest.raises(InputError, match="not"):
        list(side_by_side(refuse, range(1000)))
    assert len(begun) < 1000
