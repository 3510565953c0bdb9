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
# # What a structural engineer reads off cyclic tests
#
# The table of a test report from raw recordings: energy and equivalent damping of each
# cycle, stiffness, degradation, backbones with their bilinear and equal-energy curves,
# and cycles counted where loops do not close. Then a spring that yields is fitted to
# one test of a damper, and its loops are set beside those of a test that it was not
# fitted to.
#
# Both records are measured, and are loaded from `HYSTJAX_DATA_DIR`, the user's cache,
# or their source.

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

jax.config.update("jax_enable_x64", True)
import hystjax as hj

ORANGE, BLUE, GREY = "#D55E00", "#0072B2", "#a9a9a9"
plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})

# %% [markdown]
# ## From a recording to cycles
#
# `friction_damper` is a band brake with some backlash, driven at two strokes and two
# frequencies; the stroke ramps up and down again. It was recorded in inches and kips:
# `in_si` makes metres and newtons of them, and we take millimetres and kilonewtons.

# %%


def damper(name):
    """A recording of the damper in mm and kN."""
    si = hj.loops.in_si(hj.datasets.load("friction_damper", name))
    return hj.Recording(
        si.t, 1e3 * si.u, 1e-3 * si.w, names=si.names, units=("mm", "kN")
    )


tests = {name: damper(name) for name in hj.datasets.records("friction_damper")}
test = tests["0.5Hz_1in"]
found = hj.loops.reversals(test, begin="zero")
print(found)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
left.plot(test.t, test.u, color=BLUE)
left.plot(test.t[found.rows], test.u[found.rows], "o", color=ORANGE, label="reversals")
left.set(xlabel="time (s)", ylabel="displacement (mm)", ylim=(-30, 36))
left.legend(frameon=False, loc="upper right")
cycles = hj.loops.cycles(test, found=found)
shades = plt.get_cmap("viridis")(np.linspace(0, 0.92, len(cycles)))
for number, (cycle, shade) in enumerate(zip(cycles, shades, strict=True), 1):
    right.plot(cycle.u, cycle.w, color=shade, linewidth=1.2, label=str(number))
right.set(xlabel="displacement (mm)", ylabel="friction force (kN)")
right.legend(title="cycle", frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
plt.show()

# %% [markdown]
# After each reversal the force goes to zero, stays there for a few millimetres, which
# is the backlash, and then rises to the slip force. The band rings as it begins to
# slip.
#
# ## The table
#
# A row a cycle as it was programmed, from zero to zero: `begin="zero"`. (From tip to
# tip, as loops are read otherwise, the cycles of the ramp would have an amplitude of
# each of two steps.) `secant_stiffness` is from tip to tip, `peak_stiffness` takes the
# largest and the least force wherever they are: with the ringing. Pinching compares a
# loop's height in the middle with its largest one; it is no number (`–`) where the
# ramp comes down, and the branch back ends short of the middle.

# %%
numbers = hj.loops.summary(test, found=found)
shown = ["amplitude", "energy", "damping", "secant_stiffness", "peak_stiffness"]
print(hj.report.plain_table(hj.loops.table(numbers, shown)))

# %%
shown = ["cumulative_energy", "pinching", "strength_degradation"]
print(hj.report.plain_table(hj.loops.table(numbers, [*shown, "stiffness_degradation"])))

# %% [markdown]
# The standard errors (±) are for white noise, of which there is next to none here. They
# do not have the ringing in them, and none of the calibration of load cell and
# transducer.
#
# Degradation is counted from the first cycle of the same amplitude, within a few per
# cent. The last cycle is the stronger one because the first begins at zero: much of a
# swing that is half as long goes by in the backlash. The flat piece of each branch
# moves with the reversal: backlash of this kind is not pinched at the origin, as
# slipping bolts and cracked walls are.
#
# ## Friction, or viscous?
#
# The cycles at full stroke of all four recordings. Were the damper viscous, its
# energy a cycle would double with the frequency.

# %%
tables = {name: hj.loops.summary(each, begin="zero") for name, each in tests.items()}
shown = ["amplitude", "energy", "damping", "secant_stiffness"]
full = {}
rows = [["mean at full stroke", "mm", "kN·mm", "damping", "kN/mm"]]
for name, every in tables.items():
    largest = every["amplitude"] > 0.99 * every["amplitude"].max()
    full[name] = every.isel(cycle=np.flatnonzero(largest)).mean("cycle")
    rows.append([name, *(f"{float(full[name][number]):.4g}" for number in shown)])
print(hj.report.plain_table(rows))

# %% [markdown]
# It hardly changes: this is friction. A slip force $F$ over an amplitude $a$ dissipates
# $4F(a - a_0)$, where $a_0$ is half of the travel that backlash and elasticity take
# after each reversal; two amplitudes tell both.

# %%
for frequency in ("0.5Hz", "1Hz"):
    small, large = (full[f"{frequency}_{stroke}"] for stroke in ("0.5in", "1in"))
    more = float(large.energy - small.energy)
    slip = more / float(large.amplitude - small.amplitude) / 4
    lost = float(small.amplitude) - float(small.energy) / slip / 4
    print(f"{frequency}: slip force {slip:.2f} kN, lost at a turn {2 * lost:.2f} mm")

# %% [markdown]
# ## Cumulative energy
#
# What the damper has taken in, over the path that it has gone (circles: ends of
# cycles). The slope is a force: below the slip force by what the backlash costs, which
# is more at small strokes.

# %%
figure, ax = plt.subplots(figsize=(6.6, 3.9), layout="constrained")
looks = zip(tests.items(), (ORANGE, ORANGE, BLUE, BLUE), "-:-:", strict=True)
for (name, each), colour, dashes in looks:
    path = np.append(0, np.cumsum(np.abs(np.diff(each.u))))
    work = np.append(0, np.cumsum((each.w[1:] + each.w[:-1]) / 2 * np.diff(each.u)))
    label = name.replace("_", ", ")
    ax.plot(path / 1e3, work / 1e3, dashes, color=colour, linewidth=1.4, label=label)
    ends, energy = tables[name]["stop"].values, tables[name]["cumulative_energy"]
    ax.plot(path[ends] / 1e3, energy / 1e3, "o", color=colour, markersize=4)
ax.set(xlabel="cumulative travel (m)", ylabel="cumulative energy (kN·m)")
ax.legend(frameon=False)
plt.show()

# %% [markdown]
# ## A steel coupon
#
# `steel_coupon` was pulled and pushed to strains of two per cent, without a clock. Here
# is true stress over true strain, so that energies are per volume. Steel does the
# opposite of degrading: it hardens, most in the first cycle, and degradation is
# negative.

# %%
coupon = hj.datasets.load("steel_coupon", "1")
numbers = hj.loops.summary(coupon)
shown = ["amplitude", "energy", "damping", "cumulative_energy", "strength_degradation"]
print(hj.report.plain_table(hj.loops.table(numbers[shown], shown)))

# %% [markdown]
# Standard errors are left out on purpose: they are told from how samples scatter about
# smooth curves. With a dozen different strains a branch, in uneven steps, the curve
# itself counts as noise, and they come out far too wide.

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
cycles = hj.loops.cycles(coupon)
shades = plt.get_cmap("viridis")(np.linspace(0, 0.92, len(cycles)))
for number, (cycle, shade) in enumerate(zip(cycles, shades, strict=True), 1):
    label = f"cycle {number}" if number in (1, 2, len(cycles)) else None
    left.plot(cycle.u, cycle.w, color=shade, linewidth=1.2, label=label)
left.set(xlabel="true strain (1)", ylabel="true stress (MPa)")
left.locator_params(axis="x", nbins=5)
left.legend(frameon=False, loc="center", bbox_to_anchor=(0.68, 0.45))
right.plot(numbers["cycle"], numbers["saturation"], "o-", color=ORANGE)
right.set(xlabel="cycle", ylabel="stress amplitude (MPa)", xticks=numbers["cycle"])
plt.show()

# %% [markdown]
# ## Backbones
#
# The envelope has all rows that lie further out than any before; `kind="first"` has the
# tips of the first cycle of each amplitude. For the damper it has to be the tips: its
# envelope rings, and the equal-energy curve (EEEP), which ends where the force falls
# below 80 % of its peak for good, would have the ringing's peak. The steel
# gets the envelope of its first cycle: later ones reach a hair further out, and would
# put hardened steel at its end. A second coupon, which was only pulled, tells how far
# to believe it.

# %%
pulled = hj.datasets.load("steel_coupon", "3")
backbones = {
    "damper": hj.loops.backbone(test, kind="first"),
    "coupon": hj.loops.backbone(coupon.window(0, int(numbers["stop"][0]) + 1)),
    "pulled": hj.loops.backbone(pulled.window(0, int(np.argmax(pulled.u > 0.02)))),
}
sides = {}
for name, side in backbones.items():
    sides[f"{name} +"] = (side.u, side.w)
    if len(side.u_negative) > 3:
        sides[f"{name} -"] = (side.u_negative, side.w_negative)
heads = ["elastic", "yield", "hardening", "EEEP elastic", "EEEP yield", "ductility"]
rows = [["side", *heads]]
fits = {}
for name, points in sides.items():
    two, equal = hj.loops.bilinear(*points), hj.loops.eeep(*points)
    fits[name] = {"bilinear": two, "equal energy": equal}
    values = (two.elastic, two.w_yield, two.hardening)
    values += (equal.elastic, equal.w_yield, equal.ductility)
    rows.append([name, *(f"{value:.4g}" for value in values)])
print(hj.report.plain_table(rows))
print("stiffness in kN/mm or MPa, yield in kN or MPa")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.3), layout="constrained")
for ax, record, name in ((left, test, "damper"), (right, coupon, "coupon")):
    shown = {f"{what}, +": fit for what, fit in fits[f"{name} +"].items()}
    hj.plot.backbone(record, backbones[name], shown, ax=ax)
right.locator_params(axis="x", nbins=5)
plt.show()

# %% [markdown]
# The elastic stiffness of both coupons is near that of steel, and they yield within
# some per cent of each other. The negative side had been pulled before: it has no
# plateau. Of the damper's backbone the stiffness is that of the whole ramp with its
# backlash, and not the slope with which a loop unloads; nor are its two sides quite
# alike.
#
# ## Cycles where loops do not close
#
# In the ramps no cycle comes back to where it began. Rainflow counting finds what
# closes inside of what is larger, and counts the rest by halves.

# %%
counted = hj.loops.rainflow(test)
edges = np.arange(0, 70, 10)
sizes, _ = np.histogram(counted.range, edges, weights=counted.count)
for low, high, count in zip(edges, edges[1:], sizes, strict=False):
    print(f"ranges of {low:2} to {high:2} mm: {count:g}")
print(f"{counted.count.sum():g} in all, of which {sum(counted.count == 1)} closes")

# %% [markdown]
# What they amount to, in cycles of the largest range: a lining wears with the travel, a
# range counts by itself; in low-cycle fatigue of steel it counts about by its square
# (an exponent of -1/2 in the law of Manson and Coffin).

# %%
strains = hj.loops.rainflow(coupon)
for name, count, power in (("damper", counted, 1), ("coupon", strains, 2)):
    share = count.range / count.range.max()
    print(f"{name}: {count.count @ share**power:.1f} cycles of the largest range")

# %% [markdown]
# ## A model for the analysis
#
# One recording is fitted: half a hertz, one inch. Two models of the force: Bouc and
# Wen's spring that yields, five numbers, and springs that slide side by side, each with
# a cubic so that it may be soft in the middle, as backlash makes it; their travels are
# read off the loops above. The band's ringing is beyond either, and every eighth row is
# enough.

# %%
fitted = test.resample(test.t[::8])
spring = hj.refine(hj.models.BoucWenForce.guess(fitted), fitted)
library = hj.library.Polynomial(1, ("u",))
for travel in (1.5, 3.0, 6.0):  # mm
    stop = hj.library.Stop([travel])
    library = library + stop + stop * stop * stop
sliding = hj.identify(
    fitted,
    library,
    hj.regression.LeastSquares(),
    formulation=hj.formulation.Direct(),
)
models = {"Bouc–Wen": spring.value, "sliding springs": sliding.value}
print(spring.value)
total = float(spring.value.beta + spring.value.gamma)
force = float(spring.value.k) * total ** (-1 / float(spring.value.n))
print(f"it slips at {(1 - float(spring.value.alpha)) * force:.2f} kN")

# %% [markdown]
# Judged on all rows of the recording that was fitted, and on the three that were not,
# by free runs from the first measured force on. NRMSE is over the range of the force.

# %%
rows = [["NRMSE, %", *models]]
for name, each in tests.items():
    errors = [hj.judge(model, each).errors["nrmse"] for model in models.values()]
    label = f"{name}, {'fitted' if each is test else 'not fitted'}"
    rows.append([label, *(f"{100 * float(error):.2f}" for error in errors)])
print(hj.report.plain_table(rows))

# %% [markdown]
# The recording farthest from the fitted one has half its stroke and twice its
# frequency. There the numbers of the table say more than an error does:

# %%
unseen = tests["1Hz_0.5in"]
runs = {name: hj.simulate(model, unseen) for name, model in models.items()}
both = hj.loops.side_by_side(unseen, runs, begin="zero")
shown = ["energy", "damping", "saturation", "secant_stiffness", "peak_stiffness"]
print(hj.report.plain_table(hj.loops.table(both, [*shown, "tangent_stiffness"])))

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.3), layout="constrained")
hj.plot.loop(unseen, *runs.values(), labels=list(runs), ax=left)
wide = {"recorded": (GREY, -0.27), "Bouc–Wen": (ORANGE, 0.0)}
for name, (colour, aside) in (wide | {"sliding springs": (BLUE, 0.27)}).items():
    place = both["cycle"].values + aside
    right.bar(place, both["energy"].sel(source=name), 0.25, color=colour, label=name)
right.set(xlabel="cycle", ylabel="energy (kN·mm)", xticks=both["cycle"])
right.legend(frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=3)
plt.show()

# %% [markdown]
# Energy, damping and secant stiffness, which a time-history analysis lives on, are
# there within some per cent. Peaks are not, since neither model rings: where forces are
# designed for, the overshoot has to be added. The slope just after a reversal tells the
# two apart. Bouc and Wen's spring has no backlash, and unloads too softly; the sliding
# springs have it, by cubics that wave where the force should be nil.
#
# `hj.export.to_c` and `hj.export.fmu` take either into your own solver.
