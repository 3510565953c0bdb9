"""What the timings were taken on."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp

import hystjax

_PACKAGES = (
    "jax",
    "diffrax",
    "equinox",
    "pysindy",
    "scikit-learn",
    "joblib",
    "scipy",
    "numpy",
)
_SETTINGS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "XLA_FLAGS",
    "JAX_PLATFORMS",
    "NPROC",
)


def machine() -> dict[str, str | int]:
    """Processor, cores, JAX device, precision, versions, and settings of threads."""
    device = jax.devices()[0]
    described: dict[str, str | int] = {
        "processor": _processor(),
        "cores": cores(),
        "device": f"{device.platform} ({device.device_kind})",
        "precision": str(jnp.result_type(float)),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "hystjax": hystjax.__version__,
    }
    described |= {name: version(name) for name in _PACKAGES}
    return described | {k: os.environ[k] for k in _SETTINGS if k in os.environ}


def cores() -> int:
    """Those that this process may use, where the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _processor() -> str:
    """Its name as Linux tells it, or what Python knows elsewhere."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text().splitlines() if listing.is_file() else []
    names = [line.partition(":")[2] for line in lines if line.startswith("model name")]
    return names[0].strip() if names else platform.processor()
