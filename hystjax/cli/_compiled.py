"""Programs compiled once are kept for the next process."""

import os

import jax

from .._files import user_cache

_CACHE = "jax_compilation_cache_dir"


def keep() -> None:
    """Let JAX keep what it compiles in the user's cache, unless its own settings, such
    as `JAX_COMPILATION_CACHE_DIR`, say where; without a word where that cannot be."""
    if jax.config.values[_CACHE] is not None:
        return
    folder = user_cache() / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update(_CACHE, str(folder))
        # Many small programs are half of the time.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
