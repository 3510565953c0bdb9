"""What a fit would return, without one."""

import jax.numpy as jnp

import hystjax as hj
from hystjax.refinement import Certainty, Refined


def fit_of(value, names=(), covariance=None, recordings=1, **known):
    """The `Refined` of recordings of one sample, with these parameters and their
    covariance; nothing is wrong with it, and all that is not given is zero."""
    q, zero = len(names) + 1, jnp.zeros(())  # and a start
    every = jnp.zeros((q, q)) if covariance is None else jnp.asarray(covariance)
    row, table = jnp.zeros(recordings), jnp.zeros((recordings, 1))
    names = (*names, "start[0]")
    certainty = Certainty(names, every, jnp.zeros(q), jnp.zeros((q, q)), table, zero)
    fields = {
        **dict.fromkeys(("loss", "step_error", "spread"), zero),
        **dict.fromkeys(("losses", "rmse", "w0", "w0_standard_errors"), row),
        **dict.fromkeys(("residuals", "autocorrelation"), table),
        "num_steps": jnp.array(0),
        "standard_errors": dict.fromkeys(names[:-1], zero),
        "covariance": every,
        "certainty": certainty,
        "whiteness": jnp.ones(recordings),
        "substeps": 1,
    }
    return Refined(value, hj.RESULTS.successful, **(fields | known))
