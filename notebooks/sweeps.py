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
# # Sweeps: many fits, many devices, one call
#
# A sweep takes a function of one case, calls it with every combination of values, all
# of them in one compiled program, and returns a labelled `xarray` dataset. Three of
# them here: a map of where regression finds the right terms, an atlas of Bouc–Wen loops
# over their exponent, and how long a fit takes when it is one of many.

# %%
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import xarray

import hystjax as hj

ORANGE, BLUE = "#D55E00", "#0072B2"
plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})

# %% [markdown]
# ## Where are the right terms found?
#
# The device is the Duhem law of experiment 4 of Chandra et al. (2023); its input is a
# multisine, which tells all 15 candidates apart but one (`|du|^2` is `du^2`). A case is
# a strength of the noise, in standard deviations of the output, a seed, and a
# threshold; derivatives are smoothed over 1.3 s. Its law is right when it has exactly
# the three true terms.
#
# How many samples there are is a matter of shapes, which are fixed in a program: hence
# one sweep for each number of samples, and `xarray` puts them together.

# %%
truth = hj.models.Duhem(0.4, 0.5, 0.25)
library = hj.library.Polynomial(2, ("w", "u", "du", "|du|"))
grid = hj.sweeping.Grid(
    noise=np.geomspace(0.01, 1, 13),
    threshold=np.geomspace(0.01, 1, 13),
    seed=range(10),
)


def fit(noise, threshold, seed, clean):
    drawn = jax.random.normal(jax.random.key(seed), clean.w.shape)
    record = hj.Recording(clean.t, clean.u, clean.w + noise * jnp.std(clean.w) * drawn)
    law = hj.identify(
        record,
        library,
        hj.regression.STLSQ(threshold),
        differentiation=hj.differentiation.SavitzkyGolay(len(record) // 50 + 1),
        throw=False,
    )
    return hj.Solution(law.value, law.result, {})


def recording(samples):
    frequencies = np.array([3, 7, 11]) / (20 * np.pi)
    drive = hj.excitation.Multisine(frequencies, np.sqrt(0.5), key=jax.random.key(0))
    return hj.generate(truth, drive, np.linspace(0, 20 * np.pi, samples))


samples = [300, 1000, 3000]
swept = [hj.sweep(fit, grid, shared={"clean": recording(n)}) for n in samples]
found = xarray.concat(swept, dim=xarray.Variable("samples", samples))
true_terms = found["term"].isin(list(truth.terms()))
right = (found["support"] == true_terms).all("term").mean("seed")
print(f"{found.sizes['samples'] * found.attrs['lanes']} fits")
for n in samples:
    print(f"{n:5} samples: right in {100 * float(right.sel(samples=n).mean()):.1f} %")

# %%
hj.plot.heat_map(right, "share with exactly the right terms", limits=(0, 1))

# %% [markdown]
# Too low a threshold keeps what noise has made up, too high a one drops the smallest
# true term, and the window between them closes as noise grows. More samples keep it
# open for longer. What the best threshold can do, for each noise and number of samples:

# %%
best = right.max("threshold")
figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
for n, colour in zip(samples, ("0.6", BLUE, ORANGE), strict=True):
    ax.plot(100 * best["noise"], 100 * best.sel(samples=n), "o-", color=colour, label=n)
ax.set(
    xscale="log", xlabel="noise (% of the output's deviation)", ylabel="right laws (%)"
)
ax.legend(title="samples", frameon=False)
plt.show()

# %% [markdown]
# A lane that fails says why, and no other lane minds. Here a threshold may leave
# nothing:

# %%
for reason, count in zip(*np.unique(found["result"], return_counts=True), strict=True):
    print(f"{reason:>15}: {count}")

# %% [markdown]
# ## An atlas of Bouc–Wen loops
#
# The law $w' = u' - \tfrac12 |u'|\, w |w|^{n-1} - \tfrac12 u' |w|^n$ yields at an
# output of 1; its exponent $n$ says how abruptly. Swept are the exponent and the
# amplitude of the input. Of each loop, in its fifth cycle, the sweep keeps the output
# and the energy that the loop dissipates, $\oint w\,\mathrm{d}u$.

# %%
turns, per_cycle = 5, 400
times = np.linspace(0, turns, turns * per_cycle + 1)
space = hj.sweeping.Grid(n=np.geomspace(1, 32, 21), amplitude=np.linspace(0.25, 3, 45))


def loop(n, amplitude, t):
    device = hj.models.BoucWen(1.0, 0.5, 0.5, n)
    path = hj.interpolation.Linear().path(t, amplitude * jnp.sin(2 * jnp.pi * t))
    method = hj.simulation.FixedStep(2)
    run = hj.simulate(device, path, w0=0.0, method=method, throw=False)
    u, w = run.u[-per_cycle - 1 :], run.w[-per_cycle - 1 :]
    return {"u": u, "w": w, "energy": jnp.trapezoid(w, u)}


axes = {"u": ("phase",), "w": ("phase",)}
loops = hj.sweep(loop, space, shared={"t": times}, dims=axes)
print(f"{loops.attrs['lanes']} loops")

# %%
figure, panels = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
shades = plt.get_cmap("viridis")
for ax, amplitude in zip(panels, (0.75, 1.5, 3.0), strict=True):
    for n in (1, 2, 4, 8, 32):
        one = loops.sel(n=n, amplitude=amplitude, method="nearest")
        shade = shades(0.9 * np.log(n) / np.log(32))
        ax.plot(one["u"], one["w"], color=shade, label=f"n = {n}")
    ax.set(xlabel="input u", title=f"amplitude {amplitude}")
panels[0].set_ylabel("output w")
figure.legend(
    *panels[0].get_legend_handles_labels(),
    frameon=False,
    loc="outside lower center",
    ncols=5,
)
plt.show()

# %% [markdown]
# With $n \to \infty$ the device becomes elastic and perfectly plastic: below an
# amplitude $U$ of 1 it is a spring, which dissipates nothing; above, a loop takes
# $4(U - 1)$. The exponent thus draws a line at $U = 1$: below, the energy vanishes, and
# above it settles at its limit (dashed).

# %%
figure, (left, right_) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
relative = loops["energy"] / (4 * loops["amplitude"])
hj.plot.heat_map(relative.transpose("amplitude", "n"), "energy / 4U", ax=left)
left.set_ylabel("amplitude U")
for i, amplitude in enumerate((0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0)):
    energy = loops["energy"].sel(amplitude=amplitude, method="nearest")
    shade = shades(i / 7)
    right_.plot(loops["n"], energy, color=shade, label=f"U = {amplitude:g}")
    if amplitude > 1:
        right_.axhline(4 * (amplitude - 1), color=shade, lw=0.8, ls="--")
right_.set(xscale="log", yscale="log", ylim=(1e-3, 20))
right_.set(xlabel="exponent n", ylabel="energy a cycle, ∮ w du")
right_.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
plt.show()
most = loops.sel(n=32, method="nearest")["energy"]
plastic = 4 * (most["amplitude"] - 1).clip(min=0)
print(f"n = 32: at most {float(abs(most - plastic).max()):.3f} from the limit")

# %% [markdown]
# ## How long does a fit take?
#
# The fit from above, of 1000 samples, for more and more seeds. A call has a cost of its
# own, which the lanes share; the time is that of the second call, since the first
# compiles.

# %%
clean = recording(1000)


def seconds_a_fit(lanes):
    seeds = hj.sweeping.Grid(noise=[0.01], threshold=[0.1], seed=range(lanes))
    hj.sweep(fit, seeds, shared={"clean": clean})
    start = time.perf_counter()
    hj.sweep(fit, seeds, shared={"clean": clean})
    return (time.perf_counter() - start) / lanes


counts = [1, 32, 1024]
figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
ax.plot(counts, [1e3 * seconds_a_fit(n) for n in counts], "o-", color=ORANGE)
ax.set(xscale="log", yscale="log", xlabel="fits in one call", ylabel="time a fit (ms)")
plt.show()
