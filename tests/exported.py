"""Devices that are written in other languages, and the C compiler for them."""

import ctypes
import functools
import shutil
import subprocess

import jax.numpy as jnp
import numpy as np

import hystjax as hj
from hystjax import models
from hystjax.simulation import FixedStep

LAW = models.SparseModel.from_terms
HIDDEN = {
    "du": 0.25,
    "w": -0.5,
    "lag(u,2.0)": 0.3,
    "play(u,0.1)": 0.2,
    "lag(play(u,0.1),0.5)": 0.1,
    "u*stop(play(u,0.05),0.1)": 0.1,
}
FERROMAGNET = models.JilesAtherton(
    1.5 / models._jiles_atherton.MU0, 0.4, 0.5, 1e-7, 0.2
)


class Fading(models.AbstractModel):
    """A device that sees the time."""

    gain: float

    def start(self, m, now, seen):
        return ()

    def rate(self, x, m, now):
        return ()

    def output(self, x, m, now):
        return self.gain * jnp.exp(-now.t / 10) * now.u

    def along(self, t, u):
        """Its outputs, by NumPy."""
        return self.gain * np.exp(-t / 10) * u


DEVICES = {
    "rate": LAW({"du": 0.25, "w*|du|": -0.5, "1": -0.01, "w*|w|^0.5": -0.2}),
    "sines": LAW({"u^3": 0.1, "sin(2.0*u)": 0.1, "cos(0.5*|du|)": -0.2}),
    "memory": LAW(HIDDEN),
    "creeping": LAW({"u": 0.2, "creep(play(u,0.2),0.1,100.0)": 0.1}, target="value"),
    "value": LAW({"u": 0.2, "u*play(u,0.2)": 0.1, "lag(u,0.5)": 0.3}, target="value"),
    "lugre": models.LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7),
    "magnet": FERROMAGNET,
    "oscillator": models.BoucWenOscillator(2.0, 1.0, 5.0, 3.0, 1.0, 0.5, 1.5),
    "stack": models.PrandtlIshlinskii([0.0, 0.1, 0.25], [0.3, 0.4, 0.3], 0.1),
    "preisach": models.Preisach(
        np.linspace(-1.3, 1.3, 9), np.random.default_rng(0).random(36)
    ),
}
MORE = {
    "duhem": models.Duhem((0.1, 0.4, -0.05), 0.5, (0.25, 0.1)),
    "boucwen": models.BoucWen(1.0, 0.5, 0.2, 1.5),
    "dahl": models.Dahl(3.0, 1.1, 1.5),
    "coleman": models.ColemanHodgdon(1.1, 0.5, 0.05, 1.5, 0.3),
    "tellinen": models.Tellinen(1.2, 0.3, 0.5, 0.05),
    "inverse": models.InverseJilesAtherton(FERROMAGNET),
    "uniaxial": models.JilesAtherton(
        1.0, 0.4, 0.5, 1e-7, 0.2, models.Uniaxial(2.0, 0.5)
    ),
    "force": models.BoucWenForce(0.2, 3.0, 1.5, 0.8, 1.5),
    "pinched": models.BoucWenBaberNoori(
        0.2, 3.0, 1.5, 0.8, 1.5, 0.05, 0.04, 0.6, 0.1, 0.5, 0.3, 0.02, 0.4
    ),
    "envelopes": models.PrandtlIshlinskii(
        [0.0, 0.1, 0.25],
        [0.3, 0.4, 0.3],
        0.0,
        models.Envelope(1.0, 1.0, -0.1),
        models.Envelope(1.0, 1.0, 0.1),
    ),
    "everett": models.Everett(
        [0.0, 0.2, 0.4], [-1.0, -0.5, 0.0, 0.5, 1.0], np.full((3, 4), 0.5)
    ),
    "everett_of_stops": models.Everett(
        [0.1, 0.2, 0.4],
        [-1.0, -0.5, 0.0, 0.5, 1.0],
        np.full((3, 4), 0.5),
        sign=-1,
        curve=[0.3, 0.1, -0.2, 0.4],
    ),
    "slip": models.MaxwellSlip([1.0, 0.6, 0.3], [0.1, 0.4, 0.9]),
    "masing": models.RambergOsgood(3.0, 1.1, 4.0),
    "butterfly": models.Butterfly(models.Duhem(0.4, 0.5, 0.25), 0.2, 0.1),
    "gauged": models.Instrumented(models.Duhem(0.4, 0.5, 0.25), 1.1, 0.1, 2.0, 0.3),
    "backlash": models.Behind(
        models.MaxwellSlip([1.0, 0.6], [0.1, 0.4]), "play(u,0.1)"
    ),
    "slow": models.Behind(
        LAW({"u": 0.4, "u^3": 0.1, "play(u,0.2)": 0.3}, target="value"), "lag(u,0.3)"
    ),
    "started": models.Started(
        models.PrandtlIshlinskii([0.1, 0.25], [0.4, 0.3]), jnp.array([0.05, 0.1])
    ),
}

T = np.linspace(0, 12, 601)
U = np.exp(-T / 15) * np.sin(2 * T) + 0.3 * np.sin(7.1 * T)
W0 = 0.3
RECORD = hj.Recording(T, U, np.full_like(T, W0))


def free_run(model):
    """What the device does along the record."""
    return np.asarray(hj.simulate(model, RECORD, w0=W0, method=FixedStep(1)).w)


@functools.cache
def expected(name):
    """What a device of a name does along the record, and how large that is."""
    w = free_run((DEVICES | MORE)[name])
    return w, np.max(np.abs(w))


GCC = shutil.which("gcc")
STRICT = [
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Werror",
]

# What a sample's output is made with is the derivative after it, as in hystjax.
DRIVER = """
void {0}_run(int n, const double *t, const double *u, double w, double *out);
void {0}_run(int n, const double *t, const double *u, double w, double *out)
{{
    {0}_state s;
    {0}_init(&s, ({0}_real)u[0], ({0}_real)w);
    for (int i = 0; i < n; i++) {{
        const int j = (i < n - 1) ? i : n - 2;
        const double h = t[j + 1] - t[j];
        out[i] = (double){0}_output(&s, ({0}_real)((u[j + 1] - u[j]) / h));
        if (i < n - 1 && !{0}_step(&s, ({0}_real)u[j + 1], ({0}_real)h)) {{
            out[i] = NAN;
        }}
    }}
}}
void {0}_back(int n, const double *t, const double *w, double u, double *out);
void {0}_back(int n, const double *t, const double *w, double u, double *out)
{{
    {0}_state s;
    {0}_init(&s, ({0}_real)u, ({0}_real)w[0]);
    out[0] = u;
    for (int i = 1; i < n; i++) {{
        const double h = t[i] - t[i - 1];
        const bool good = {0}_follow(&s, ({0}_real)w[i], ({0}_real)h, ({0}_real)-2,
                                     ({0}_real)2, ({0}_real)1e-14);
        out[i] = good || isfinite(s.u) ? (double)s.u : NAN;
    }}
}}
"""


def compiled(devices, folder, *flags):
    """By the name of the device, functions of a way: what comes out along the record
    (`run`), and the input that brings out others from its first input on (`back`)."""
    source = "\n".join(
        hj.export.to_c(model, name=name) + DRIVER.format(name)
        for name, model in devices.items()
    )
    (folder / "all.c").write_text(source, encoding="utf-8")
    command = [GCC, *STRICT, "-ffp-contract=off", *flags, "-shared", "-fPIC"]
    subprocess.run([*command, "all.c", "-o", "all.so", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "all.so"))

    def runner(name):
        def run(way="run", along=U, first=W0):
            out = np.empty_like(T)
            pointers = (x.ctypes.data_as(ctypes.c_void_p) for x in (T, along))
            function = getattr(library, f"{name}_{way}")
            first, place = ctypes.c_double(first), out.ctypes.data_as(ctypes.c_void_p)
            function(len(T), *pointers, first, place)
            return out

        return run

    return {name: runner(name) for name in devices}
