# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From a record to a law
#
# A piezo actuator was driven with a voltage $u(t)$ and its displacement $w(t)$ was
# measured. The displacement depends on where the voltage has been, not only on where it
# is: hysteresis. This notebook turns the record into a law
#
# $$\dot w = \sum_i c_i\, \theta_i(w, u, \dot u, |\dot u|, |w|)$$
#
# with few terms, runs that law from its first sample alone, and judges it on cycles
# that it was not fitted on.

# %%
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Math, display
from matplotlib.ticker import LogLocator, NullLocator

import hystjax as hj

COLOURS = {"fitted": "#D55E00", "unseen": "#0072B2"}
plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})

# %% [markdown]
# ## The record
#
# `hystjax data fetch piezo_ayala` downloads the record once. Any text file works the
# same way: `hj.Recording.from_csv("mine.csv", time="t", input="V", output="x")`.

# %%
try:
    hj.datasets.path("piezo_ayala")
except hj.InputError:
    print(
        "The piezo record is not on this disk: a simulated device with noise takes its "
        "place, and the figures are not those of the text."
    )
    law = hj.models.Duhem(
        0.4, 0.5, 0.25, names=("voltage", "displacement"), units=("V", "µm")
    )
    excitation = hj.excitation.ModulatedSine(2.0, 0.5, 0.3, 0.11)
    key = jax.random.key(0)
    record = hj.generate(
        law, excitation, jnp.linspace(0, 20, 2001), additive=0.002, key=key
    )
    rows, threshold = {"fitted": (0, 1000), "unseen": (1000, 2001)}, 0.05
    noise = 0.002 * np.std(record.w)
else:
    record = hj.datasets.load("piezo_ayala")
    rows, threshold = {"fitted": (35001, 45001), "unseen": (17500, 35000)}, 0.01
    noise = np.std(record.between(0.0, 3.2).w)  # the device is at rest

fitted, unseen = record.window(*rows["fitted"]), record.window(*rows["unseen"])
figure = hj.plot.record(record)
for name, part in (("fitted", fitted), ("unseen", unseen)):
    for ax in figure.axes:
        ax.axvspan(part.t[0], part.t[-1], color=COLOURS[name], alpha=0.15, lw=0)
    top = figure.axes[0]
    centre = (part.t[0] + part.t[-1]) / 2
    top.text(centre, 1.03, name, ha="center", transform=top.get_xaxis_transform())
display(figure)

# %% [markdown]
# The actuator rests, jumps to −87 V and rings, and then follows a sine of 150 V at
# 1 Hz. The two shaded stretches are all we use.

# %% [markdown]
# ## The input path
#
# Every law of hysteresis asks for the direction of the input. A recording therefore
# knows its input *between* samples, as an input path: $u$, its one-sided derivative,
# its total variation and its turning points. Regression and simulation use the same
# one.
#
# The output's derivative is what we shall explain, and here it is mostly noise: between
# samples 0.2 ms apart the device moves less than the sensor errs. Least squares over
# ten thousand of them still finds what they have in common.

# %%
path = fitted.path
turning_times, turning_inputs = path.turning_points()
turning_outputs = np.interp(turning_times, fitted.t, fitted.w)

differences = hj.differentiation.FiniteDifference()
smoother = hj.differentiation.SavitzkyGolay(window=301)
_, dw = differences.estimate(fitted.t, fitted.w)
_, dw_smooth = smoother.estimate(fitted.t, fitted.w)

figure, (left, right) = plt.subplots(
    1, 2, figsize=(10, 4), layout="constrained", width_ratios=(1, 1.4)
)
_, du = path.samples()
for rising, colour, label in (
    (True, "#009E73", "rising"),
    (False, "#CC79A7", "falling"),
):
    branch = np.where((du > 0) == rising, fitted.w, np.nan)
    left.plot(fitted.u, branch, color=colour, label=label)
left.plot(turning_inputs, turning_outputs, "ko", ms=5, label="turning points")
left.set(xlabel="voltage (V)", ylabel="displacement (µm)")
left.legend(frameon=False)
right.plot(fitted.t, dw, color="0.75", lw=0.5, label="differences")
right.plot(fitted.t, dw_smooth, color="k", label="Savitzky–Golay, 301 samples")
right.set(xlabel="time (s)", ylabel="derivative of the output (µm/s)")
right.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
plt.show()
print(f"noise {np.std(dw - dw_smooth):.0f}, signal {np.std(dw_smooth):.0f} µm/s (rms)")

# %% [markdown]
# ## Candidates
#
# A library holds the terms that the law may be made of: here every product of up to two
# of $w, u, \dot u, |\dot u|, |w|$.

# %%
library = hj.library.Polynomial(2, ("w", "u", "du", "|du|", "|w|"))
print(len(library), "terms:", ", ".join(library.names))

# %% [markdown]
# ## Which threshold?
#
# Sequentially thresholded least squares (STLSQ) drops terms with small coefficients,
# fits the rest again, and goes on until nothing drops. What is small is for us to say.
# The problem is factored once, from ten thousand rows to a triangle of 21; after that a
# threshold costs next to nothing, and `jax.vmap` takes three hundred at a time.

# %%
_, du = differences.estimate(
    fitted.t, fitted.u
)  # as for w: the same bias on both sides
problem = hj.regression.compress(library(fitted.w, fitted.u, du), dw)


def thresholded(value):
    return hj.regression.STLSQ(value, ridge=0.05, normalise=False).fit(problem)


thresholds = jnp.geomspace(1e-4, 1, 300)
fits = jax.jit(jax.vmap(thresholded))(thresholds)
hj.plot.coefficient_path(thresholds, fits.coefficients, library.names)

# %% [markdown]
# Which of these laws is worth having? The misfit of the derivative does not say: it is
# noise, and always less with more terms. A *free run* says. It starts at the first
# sample and sees nothing of the output after that, so that errors add up as they would
# in use. Again all laws at a time, on fitted and on unseen rows:

# %%
chosen = slice(None, None, 5)
kernel = hj.simulation.FixedStep(substeps=2)  # the fast way to simulate


def free_run_error(recording, coefficients, support):
    model = hj.models.SparseModel(library, coefficients, support)
    run = hj.simulate(model, recording, method=kernel, throw=False)
    return hj.metrics.nrmse(recording.w, run.w)


over_laws = jax.jit(jax.vmap(free_run_error, in_axes=(None, 0, 0)))
laws = fits.coefficients[chosen], fits.support[chosen]
floor = noise / np.ptp(fitted.w)

figure, (top, bottom) = plt.subplots(
    2, 1, figsize=(8, 5), sharex=True, layout="constrained", height_ratios=(2, 1)
)
for name, part in (("fitted", fitted), ("unseen", unseen)):
    errors = 100 * over_laws(part, *laws)
    top.loglog(thresholds[chosen], errors, ".-", color=COLOURS[name], label=name)
top.axhline(100 * floor, color="0.5", ls="--", label="measurement noise")
top.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
top.yaxis.set_major_formatter("{x:g}")
top.yaxis.set_minor_locator(NullLocator())
top.set(ylabel="NRMSE of the free run (%)")
top.legend(frameon=False)
bottom.plot(thresholds[chosen], jnp.sum(laws[1], axis=1), "k", drawstyle="steps-mid")
bottom.set(xlabel="threshold", ylabel="terms", ylim=(0, None))
for ax in (top, bottom):
    ax.axvline(threshold, color="0.85", lw=6, zorder=0)
plt.show()

# %% [markdown]
# Sixteen terms follow their own cycles no better than five, and others worse; with
# twelve terms the two errors are an order of magnitude apart. Then comes a stretch,
# marked in grey, where five terms do as well on unseen cycles as on their own. With
# fewer the error more than doubles.

# %% [markdown]
# ## The law
#
# One verb does the steps above.

# %%
regression = hj.regression.STLSQ(threshold, ridge=0.05, normalise=False)
law = hj.identify(fitted, library, regression).value
for name, unit in law.coefficient_units().items():
    print(f"{name:>8} {law.terms()[name]:+.4f} {unit}")
Math(hj.export.to_latex(law))

# %%
judgements = {"fitted": hj.judge(law, fitted), "unseen": hj.judge(law, unseen)}
print(hj.report.plain_table(hj.report.error_table(judgements)))
print(f"measurement noise: {100 * floor:.3f} % of the range")
runs = [(j.recording, j.trajectory) for j in judgements.values()]
hj.plot.overview(*runs[0], *runs[1], model=law)

# %% [markdown]
# The errors are small but not white: they repeat from cycle to cycle, and together are
# twice the noise. Something of the device is not in this law yet.
#
# ## What this excitation cannot tell
#
# The voltage was one sine, so $\dot u^2 = \omega^2 (A^2 - u^2)$ throughout the record:
# no amount of such data tells these terms apart, and a law that holds one of them has
# rivals that hold the others. Ask before you read physics into a term.

# %%
for alias in hj.aliases(fitted, library):
    print(alias)

# %% [markdown]
# What should be measured next? Ask the same of an excitation before it is run, letting
# the law play the device. Under a decaying sine the derivatives are told apart. The
# squares of magnitudes are the squares themselves under every excitation, and $u^2$
# stays hard to tell as long as the loop is this slender.

# %%
amplitude = jnp.max(jnp.abs(record.u))
decaying = hj.excitation.DecayingSine(amplitude, frequency=1.0, time_constant=2.0)
planned = hj.generate(law, decaying, jnp.linspace(0, 6, 6001))
for alias in hj.aliases(planned, library):
    print(alias)

# %% [markdown]
# ## Keep it
#
# A saved law is readable JSON and loads again to the last bit. Exports need nothing of
# hystjax.

# %%
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "law.json"
    hj.save(file, law)
    print(file.read_text())
    assert hj.load(file).terms() == law.terms()

# %%
print(hj.export.to_latex(law), "\n")
print(hj.export.to_python(law))

# %% [markdown]
# ## Derivatives, through the simulation
#
# A simulation is a JAX function like any other. The gradient of the free run's error
# with respect to the coefficients says which of them matters, and which way to go.

# %%
compact = law.compact()


@jax.jit
def error(coefficients):
    model = eqx.tree_at(lambda m: m.coefficients, compact, coefficients)
    run = hj.simulate(model, fitted, method=kernel, throw=False)
    return hj.metrics.nrmse(fitted.w, run.w)


coefficients = jnp.asarray(compact.coefficients)
gradient = jax.jit(jax.grad(error))(coefficients)
step = 1e-6 * coefficients[1]
by_hand = (
    error(coefficients.at[1].add(step)) - error(coefficients.at[1].add(-step))
) / (2 * step)
print("change of the NRMSE, in percentage points, when a coefficient grows by 1 %:")
for name, value, slope in zip(
    compact.library.names, coefficients, gradient, strict=True
):
    print(f"{name:>8} {value * slope:+.4f}")
print(f"by reverse mode {gradient[1]:.6e}, by differences {by_hand:.6e}")

# %% [markdown]
# And `jax.vmap` over coefficients is a sweep: 1681 free runs over the fitted rows for a
# map of the error around the law.

# %%
names = compact.library.names
first, second = names[1], names[2]
scale = jnp.linspace(0.95, 1.05, 41)
grid = jnp.stack(jnp.meshgrid(scale, scale, indexing="ij"), axis=-1).reshape(-1, 2)


def scaled_error(factors):
    return error(coefficients.at[1:3].multiply(factors))


sweep = jax.jit(lambda g: jax.lax.map(scaled_error, g, batch_size=41))
surface = 100 * sweep(grid).reshape(41, 41)

figure, ax = plt.subplots(figsize=(6.4, 5), layout="constrained")
percent = 100 * (scale - 1)
levels = np.geomspace(surface.min(), surface.max(), 16)
contours = ax.contourf(percent, percent, surface.T, levels, cmap="cividis_r")
downhill = -(gradient * coefficients)[1:3]
tip = downhill / jnp.linalg.norm(downhill)
arrow = {"arrowstyle": "->", "color": COLOURS["fitted"], "lw": 2}
ax.annotate("", tip, (0, 0), arrowprops=arrow)
ax.plot(0, 0, "o", color=COLOURS["fitted"], label="the law, and downhill from it")
best = 100 * (grid[jnp.argmin(surface)] - 1)
ax.plot(*best, "*", color="white", mec="k", ms=12, label="best of the map")
ax.set(xlabel=f"change of the coefficient of {first} (%)", aspect="equal")
ax.set(ylabel=f"change of the coefficient of {second} (%)")
figure.colorbar(contours, label="NRMSE of the free run (%)", format="%.2f")
ax.legend(loc="lower right")
plt.show()
print(f"NRMSE: {100 * error(coefficients):.4f} % the law, {surface.min():.4f} % best")

# %% [markdown]
# A valley: across it one per cent is felt, along it five are not. These cycles fix the
# ratio of the two coefficients, the gain of the device, far better than either of them.
# `hj.refine` goes down such valleys by matching trajectories, and says how certain each
# coefficient is.
