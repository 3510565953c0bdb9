"""What `hystjax identify` does, as one writes it with PySINDy, SciPy and Matplotlib.

`python pysindy_script.py FILE FOLDER [--sine]`. It stands alone and is no part of any
package; with --sine it knows u in closed form instead of interpolating it.
"""

import sys
from pathlib import Path

import numpy as np
import pysindy as ps
from matplotlib.figure import Figure
from scipy.integrate import odeint

FITTED, UNSEEN = slice(35001, 45001), slice(17500, 35000)
TERMS = ("1", "x0", "u0", "u1", "x0 u3")
SHOWN = ("1", "w", "u", "u'", "w |w|")


def fit(t, u, w):
    """Coefficients of PySINDy's law by term."""
    du = np.asarray(ps.FiniteDifference()(u[:, None], t))[:, 0]
    controls = np.column_stack([u, du, np.abs(du), np.abs(w)])
    model = ps.SINDy(
        optimizer=ps.STLSQ(threshold=0.01, alpha=0.05),
        feature_library=ps.PolynomialLibrary(degree=2),
    )
    model.fit(w[:, None], t, u=controls)
    law = dict(zip(model.get_feature_names(), model.coefficients()[0], strict=True))
    return {term: float(law[term]) for term in TERMS}


def simulate(law, t, u, w0, sine):
    """The law's free run."""
    constant, of_w, of_u, of_du, of_ww = law.values()
    du = np.gradient(u, t)

    def rate_of_recorded(w, time):
        now, slope = np.interp(time, t, u), np.interp(time, t, du)
        return constant + of_w * w + of_u * now + of_du * slope + of_ww * w * abs(w)

    def rate_of_sine(w, time):
        angle = 6.28318530724 * time - 46.2178545458
        now, slope = 150 * np.sin(angle), 942.477796086 * np.cos(angle)
        return constant + of_w * w + of_u * now + of_du * slope + of_ww * w * abs(w)

    return odeint(rate_of_sine if sine else rate_of_recorded, w0, t)[:, 0]


def nrmse(w, simulated):
    """In per cent of the output's range."""
    return 100 * np.sqrt(np.mean((simulated - w) ** 2)) / np.ptp(w)


def draw_output(top, bottom, t, w, simulated):
    """Measured and simulated output, and the error below."""
    top.plot(t, w, color="0.66", linewidth=3.2, label="measured")
    top.plot(t, simulated, linewidth=1.2, label="law")
    top.set_ylabel("displacement (µm)")
    bottom.plot(t, simulated - w, linewidth=0.6)
    bottom.axhline(0, color="black", linewidth=0.8)
    bottom.set_xlabel("time (s)")
    bottom.set_ylabel("error (µm)")
    for axes in (top, bottom):
        axes.grid(color="0.92")


def draw_overview(title, parts):
    """Loop, outputs and errors of fitted and unseen rows."""
    figure = Figure(figsize=(10.8, 4.8), layout="constrained")
    panels = figure.subplot_mosaic(
        [["loop", *parts], ["loop", *(f"{name} error" for name in parts)]],
        height_ratios=(2.2, 1),
    )
    for name, (t, _, w, simulated) in parts.items():
        draw_output(panels[name], panels[f"{name} error"], t, w, simulated)
        panels[name].set_title(f"{name}: NRMSE {nrmse(w, simulated):.3g} %")
    _, u, w, simulated = parts["unseen"]
    panels["loop"].plot(u, w, color="0.66", linewidth=3.2, label="measured")
    panels["loop"].plot(u, simulated, linewidth=1.2, label="law")
    panels["loop"].set_xlabel("voltage (V)")
    panels["loop"].set_ylabel("displacement (µm)")
    panels["loop"].grid(color="0.92")
    lines = panels["loop"].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=2)
    figure.suptitle(title)
    return figure


def draw_fit(t, u, w, simulated):
    """Output and error of some rows."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    draw_output(top, bottom, t, w, simulated)
    top.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure


def main(file, folder, *options):
    """Read, fit, simulate, print and draw."""
    t, w, u = np.loadtxt(file, delimiter=",", usecols=(1, 2, 3), unpack=True)
    law = fit(t[FITTED], u[FITTED], w[FITTED])
    shown = zip(law.values(), SHOWN, strict=True)
    title = "w' = " + " ".join(f"{value:+.4g} {term}" for value, term in shown)
    print(title)
    parts = {}
    for name, rows in (("fitted", FITTED), ("unseen", UNSEEN)):
        simulated = simulate(law, t[rows], u[rows], w[rows][0], "--sine" in options)
        parts[name] = t[rows], u[rows], w[rows], simulated
        print(f"{name}: NRMSE {nrmse(w[rows], simulated):.5f} %")
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    draw_overview(title, parts).savefig(place / "overview.png", dpi=200)
    for name, part in parts.items():
        draw_fit(*part).savefig(place / f"{name}.png", dpi=200)


if __name__ == "__main__":
    main(*sys.argv[1:])
