"""Set-up shared by all tests; it runs before any of them imports hystjax."""

import gc
import os
from pathlib import Path

import jax
import jaxtyping
import matplotlib
import pytest
from hypothesis import settings

# From here on every annotated array of hystjax is checked for shape and type; as
# elsewhere in Python, a whole number may stand for a float.
jaxtyping.install_import_hook(
    "hystjax",
    "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))",
)
jax.config.update("jax_enable_x64", True)
# The command line would keep compiled programs in the user's cache.
jax.config.update("jax_enable_compilation_cache", False)
matplotlib.use("Agg")

# Compilation makes first examples slow, and a failure must come back when run again.
settings.register_profile("hystjax", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("hystjax")

_MAPPINGS = 12_000  # Linux lets a process have 65 530

# Absolute, so that tests may change directory and start processes elsewhere.
if os.environ.get("HYSTJAX_DATA_DIR"):
    data_dir = Path(os.environ["HYSTJAX_DATA_DIR"]).expanduser().resolve()
    os.environ["HYSTJAX_DATA_DIR"] = str(data_dir)


def pytest_collection_finish() -> None:
    """Leave what is imported out of every later garbage collection, and collect less
    often: what JAX traces is much, and collecting it a twentieth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.fixture(scope="module", autouse=True)
def _fresh_compiler():
    """Forget compiled programs once they are many: those of the whole suite take
    gigabytes, and more memory mappings than Linux lets a process have."""
    yield
    mappings = Path("/proc/self/maps")
    if not mappings.exists() or len(mappings.read_bytes().splitlines()) > _MAPPINGS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def unchecked():
    """Without run-time type checks, to see the messages that users see."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def missing_recordings() -> str | None:
    """Why the measured recordings cannot be read; None when they can."""
    folder = os.environ.get("HYSTJAX_DATA_DIR")
    if not folder:
        return "HYSTJAX_DATA_DIR is not set: the measured recordings are not here"
    recording = Path(folder, "piezo_ayala", "hysteresis_v_150_1hz.csv")
    if not recording.is_file():
        return f"HYSTJAX_DATA_DIR is {folder}, which has no {recording.name}"
    return None


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests of the recordings without them, or fail where they are required."""
    if item.get_closest_marker("recordings") is None:
        return
    reason = missing_recordings()
    if reason is None:
        return
    if os.environ.get("HYSTJAX_REQUIRE_DATA"):
        pytest.fail(f"{reason}, and HYSTJAX_REQUIRE_DATA is set", pytrace=False)
    pytest.skip(reason)
