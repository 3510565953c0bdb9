"""What a law costs on a controller: a step of it in C, and its inverse."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hystjax as hj
from hystjax.simulation import FixedStep

from . import _problem
from ._agreement import Disagreement, agreed
from ._results import Table
from ._timing import QUICK, Contestant, Effort, race

_C = "C99, hystjax.export.to_c"
_FORWARD = "simulate"
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
_DRIVER = """
void run(int n, const double *t, const double *u, double w, double *out);
void run(int n, const double *t, const double *u, double w, double *out)
{
    law_state s;
    law_init(&s, u[0], w);
    out[0] = w;
    for (int i = 1; i < n; i++) {
        const double h = t[i] - t[i - 1];
        law_step(&s, u[i], h);
        out[i] = law_output(&s, (u[i] - u[i - 1]) / h);
    }
}
"""


def run(effort: Effort) -> tuple[Table, ...]:
    """A step in C beside others, and inverses beside what the devices do."""
    samples = 10_000 if effort == QUICK else 100_000
    return _step(effort), *(
        _inverse(name, model, samples, effort) for name, model in _devices().items()
    )


def _step(effort: Effort) -> Table:
    record = _problem.recording()
    data = _problem.columns(record)
    law = _problem.identified(record).value
    terms = law.terms()
    coefficients = [terms[name] for name in _problem.TERMS]
    start, times = data.w[0, 0], data.t
    method = FixedStep(1)
    with tempfile.TemporaryDirectory() as folder:
        in_c = _compiled(hj.export.to_c(law), Path(folder), record)
    calls = {
        _C: in_c,
        "hystjax.simulate, FixedStep(1)": lambda: (
            hj.simulate(law, record, method=method).w
        ),
        "scipy odeint, u a sine": lambda: _problem.integrated(
            coefficients, start, times, _problem.sine
        ),
    }
    contestants = {
        name: Contestant(call, pieces=len(record) - 1) for name, call in calls.items()
    }
    timings = race(contestants, effort)
    c, ours, theirs = (timing.result for timing in timings.values())
    size = np.max(np.abs(ours))
    notes = (
        agreed(
            "outputs of both kinds of steps", float(np.max(abs(c - ours)) / size), 1e-12
        ),
        agreed("theirs (NRMSE)", float(hj.metrics.nrmse(ours, theirs)), 1e-3),
        f"times are of one of {len(record) - 1} steps of the law {law}",
    )
    return Table("A step of the piezo's law", _C, timings, notes)


def _compiled(
    source: str, folder: Path, record: hj.Recording
) -> Callable[[], np.ndarray]:
    """The free run along a record, by the compiler of this machine."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise Disagreement("there is no C compiler (cc or gcc) to compare with")
    (folder / "law.c").write_text(source + _DRIVER, encoding="utf-8")
    command = [compiler, *_FLAGS, "law.c", "-o", "law.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    function = ctypes.CDLL(str(folder / "law.so")).run
    t, u = (np.ascontiguousarray(x, float) for x in (record.t, record.u))
    out = np.empty_like(t)
    places = [x.ctypes.data_as(ctypes.c_void_p) for x in (t, u)]
    w0 = ctypes.c_double(float(record.w[0]))

    def along() -> np.ndarray:
        function(len(t), *places, w0, out.ctypes.data_as(ctypes.c_void_p))
        return out

    return along


def _devices():
    """A law, a stack of plays, and a plane of relays."""
    law = hj.models.SparseModel.from_terms(
        {"du": 1.0, "u*|du|": 0.2, "w*|du|": -0.3, "w": -0.02}
    )
    radii = np.linspace(0, 1.5, 16)
    stack = hj.models.PrandtlIshlinskii(radii, np.linspace(0.3, 0.05, 16))
    lines = np.linspace(-2.2, 2.2, 33)
    weights = np.random.default_rng(0).random(32 * 33 // 2)
    preisach = hj.models.Preisach(lines, weights / weights.sum())
    return {"law of four terms": law, "16 plays": stack, "528 relays": preisach}


def _inverse(name: str, model, samples: int, effort: Effort) -> Table:
    """From a model's own run back to the input, and that of many references at once."""
    t = jnp.linspace(0, samples / 500, samples)
    u = jnp.sin(2 * t) * (1 + 0.5 * jnp.sin(0.31 * t))
    record = hj.Recording(t, u, jnp.zeros_like(t))
    method = FixedStep(1)
    w = hj.simulate(model, record, w0=0.0, method=method).w
    reference = hj.Recording(t, u, w)

    lanes = 100 if effort == QUICK else 1000
    few = samples // lanes
    several = jnp.linspace(0.5, 1, lanes)[:, None] * w[:few]

    def forward(record):
        return hj.simulate(model, record, w0=0.0, method=method).w

    def back():
        return hj.invert(model, reference, method=method).value.u

    @eqx.filter_jit
    def many(references):
        def one(w):
            return hj.invert(model, w, t[:few], method=method).value.u

        return jax.vmap(one)(references)

    timings = race(
        {
            _FORWARD: Contestant(lambda: forward(record), pieces=samples),
            "invert": Contestant(back, pieces=samples),
            f"invert, {lanes} references of {few} samples, vmap": Contestant(
                lambda: many(several), pieces=several.size
            ),
        },
        effort,
    )
    found = jnp.max(jnp.abs(timings["invert"].result - u)) / jnp.ptp(u)
    again = forward(hj.Recording(t, timings["invert"].result, w))
    missed = float(jnp.max(jnp.abs(again - w)) / jnp.ptp(w))
    notes = (
        agreed("outputs under the inverse's input, of the range,", missed, 1e-9),
        f"inputs differ by {float(found):.1g} of their range",
        f"times are of a sample; the record has {samples}",
    )
    return Table(f"The inverse of a device: {name}", _FORWARD, timings, notes)
