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
# # What a piezo engineer reads off a stroke
#
# Hysteresis in per cent of the stroke, phase lag at the drive's frequency, asymmetry
# and creep a decade, of two measured actuators; a law of five terms, judged on cycles
# that it was not fitted to; then the law turned round: the voltage that makes the
# actuator go where you say, by how much it is off, and the C of it.
#
# Both records are measured, and are loaded from `HYSTJAX_DATA_DIR`, the user's cache,
# or their source.

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

jax.config.update("jax_enable_x64", True)
import hystjax as hj

ORANGE, BLUE = "#D55E00", "#0072B2"
plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})

# %% [markdown]
# ## Two actuators
#
# `piezo_ayala` is a cantilever under a bipolar sine. It rests, is thrown to the start
# of the sine, rings, and then cycles. `piezo_yan9a` is a flexure stage under a unipolar
# command, cycling from rest.

# %%
cantilever = hj.datasets.load("piezo_ayala")
stage = hj.datasets.load("piezo_yan9a")
hj.plot.record(cantilever)

# %% [markdown]
# ## The data sheet
#
# Numbers of whole cycles, without those at the start. `centred` puts zero half way
# between the tips, so that `squareness` is the hysteresis that data sheets print: the
# opening of the loop in mid-stroke, over the stroke. `lag` is that of the fundamental
# wave, and the stage's was recorded with a delay of one sample, which is not the
# actuator's: the third column is without it.

# %%
prompt = hj.Recording(
    stage.t[:-1], stage.u[:-1], stage.w[1:], names=stage.names, units=stage.units
)
records = {
    "cantilever": cantilever.window(17500, 50001),
    "stage": stage.window(200, len(stage)),
    "stage, no delay": prompt.window(200, len(prompt)),
}
sheets = {
    name: hj.loops.summary(hj.loops.centred(record)) for name, record in records.items()
}


def width(sheet, level):
    """The opening of the loop at a level between its tips, % of the drive."""
    return 100 * sheet["width"].sel(level=level) / (2 * sheet["amplitude"])


lines = {
    "drive, peak to peak (V)": lambda s: 2 * s["amplitude"],
    "stroke, peak to peak (µm)": lambda s: 2 * s["saturation"],
    "gain (µm/V)": lambda s: s["secant_stiffness"],
    "hysteresis (% of stroke)": lambda s: 100 * s["squareness"],
    "width at 1/4 of stroke (% of drive)": lambda s: width(s, 0.25),
    "width at 1/2 of stroke (% of drive)": lambda s: width(s, 0.5),
    "width at 3/4 of stroke (% of drive)": lambda s: width(s, 0.75),
    "bow in mid-drive (% of stroke)": lambda s: 50 * s["w_bias"] / s["saturation"],
    "lag (°)": lambda s: np.degrees(s["lag"]),
    "lag (ms)": lambda s: 1e3 * s["lag"] * s["period"] / (2 * np.pi),
}
rows = [["mean over cycles", *sheets]]
for label, of in lines.items():
    means = (float(of(sheet).mean()) for sheet in sheets.values())
    rows.append([label, *(f"{mean:.4g}" for mean in means)])
print(hj.report.plain_table(rows))

# %% [markdown]
# A sample's delay at the frequency of the drive widens the loop as hysteresis does:
# take it off before a law is fitted. What is left of the lag is not a time, either.
# Plays lag by the same angle at every frequency; one frequency cannot tell how much of
# it is theirs.
#
# Both loops are about as wide at a quarter as at three quarters of the stroke. They
# differ in their bow: by how much the middle of the two branches is off the line from
# tip to tip. The cantilever's is small. Its stroke is bipolar, and has an asymmetry of
# the reach too: by how much the strokes to both sides differ, of a half stroke.

# %%
loops = hj.loops.summary(records["cantilever"])
asymmetry, error = loops["asymmetry"].mean(), loops["asymmetry_error"].mean()
print(f"asymmetry {100 * float(asymmetry):.2f} ± {100 * float(error):.2f} % a cycle")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.6), layout="constrained")
hj.plot.cycles(records["cantilever"], ax=left)
hj.plot.cycles(hj.loops.centred(records["stage, no delay"]), ax=right)
plt.show()

# %% [markdown]
# ## Creep
#
# `hj.loops.creep` fits the logarithm of time to a rest of the input. Before its drive
# the cantilever rests, and next to nothing creeps:

# %%
rest = hj.loops.creep(cantilever.between(0.0, 3.2))
rate, error = (1e3 * x["rate"] for x in (rest.value, rest.error))
print(f"cantilever, at rest: {rate:.1f} ± {error:.1f} nm a decade")
print(f"noise of its sensor: {1e3 * rest.rmse:.0f} nm rms")

# %% [markdown]
# The stage never rests. Looked at once a period, at the same voltage, it does: its tips
# are a record of a constant input.

# %%
turns = hj.loops.reversals(stage)
stroke = 2 * float(sheets["stage"]["saturation"].mean())
figure, panels = plt.subplots(
    2, 1, figsize=(6.6, 4.6), sharex=True, layout="constrained"
)
for ax, upper, colour in zip(panels, (True, False), (ORANGE, BLUE), strict=True):
    rows = turns.rows[turns.upper == upper]
    tips = hj.Recording(stage.t[rows], stage.u[rows], stage.w[rows])
    fit = hj.loops.creep(tips)
    name = "upper" if upper else "lower"
    rate, error = (x["rate"] for x in (fit.value, fit.error))
    print(
        f"{name} tips: {rate:.2f} ± {error:.2f} µm a decade, "
        f"{100 * rate / stroke:.2f} % of the stroke"
    )
    since = np.asarray(tips.t[1:] - tips.t[0])
    line = fit.value["start"] + rate * np.log10(since / since[0])
    ax.plot(since, tips.w[1:], "o", color=colour, markersize=3, label=f"{name} tips")
    ax.plot(since, line, color="black", linewidth=1, label="fit")
    ax.set(ylabel="displacement (µm)", xscale="log")
    ax.legend(frameon=False, loc="upper left")
seconds = (1, 2, 5, 10, 20, 40)
panels[1].set(xlabel="time since the first tip (s)", xticks=seconds)
panels[1].set_xticklabels(map(str, seconds))
plt.show()

# %% [markdown]
# Both ends of the stroke creep the same way, the lower one more: the stroke shrinks a
# little. Such a drift is no part of a law w' = f(w, u, u'); slow lags beside plays are
# made for it: `hj.compare(record, families=["plays and creep"])`.
#
# ## A law
#
# Two cycles of the cantilever are fitted; those before them are for judging. `identify`
# regresses the five terms of Chandra et al. (2023), and `refine` moves their
# coefficients until a free run follows the two cycles.

# %%
fitted, unseen = cantilever.window(35001, 45001), cantilever.window(17500, 35000)
settings = hj.regression.STLSQ(threshold=0.01, ridge=0.05, normalise=False)
first = hj.identify(fitted, hj.library.Polynomial(2), settings)
found = hj.refine(first, fitted)
law = found.value
print(law)
constant = hj.identify(
    fitted,
    hj.library.Polynomial(1, ("u",)),
    hj.regression.LeastSquares(),
    formulation=hj.formulation.Direct(),
).value
models = {"constant gain": constant, "regressed": first.value, "refined": law}
judged = {
    f"{name}, {which}": hj.judge(model, rows)
    for name, model in models.items()
    for which, rows in {"fitted": fitted, "not fitted": unseen}.items()
}
print(hj.report.plain_table(hj.report.error_table(judged)))

# %%
runs = {"fitted": judged["refined, fitted"], "unseen": judged["refined, not fitted"]}
hj.plot.overview(
    fitted, runs["fitted"].trajectory, unseen, runs["unseen"].trajectory, model=law
)

# %% [markdown]
# What is left repeats with every cycle: it is the law's form, and no noise, and the
# standard errors of the coefficients, which count every sample as news, are too small.

# %%
for statement in hj.refinement.statements(found):
    print("-", statement)

# %% [markdown]
# ## Its loops, beside the measured ones
#
# On the cycles that were not fitted:

# %%
trajectories = {
    name: judged[f"{name}, not fitted"].trajectory for name in ("regressed", "refined")
}
both = hj.loops.side_by_side(unseen, trajectories)
shown = ["energy", "lag", "remanence", "coercivity", "saturation", "asymmetry"]
print(hj.report.plain_table(hj.loops.table(both, shown)))

# %% [markdown]
# ## The voltage that makes it go where you say
#
# The measured displacement of the cycles that were not fitted is taken for a reference.
# The law's inverse says which voltage leads there; which one did is in the record. A
# constant gain, which is what an open loop has without a law, says so less well.

# %%
found = hj.invert(law, unseen)
span = float(np.ptp(unseen.u))
offset, gain = constant.terms()["1"], constant.terms()["u"]
drives = {"constant gain": (unseen.w - offset) / gain, "law": found.value.u}
rows = [["inverse by", "rms (V)", "rms (% of drive)", "largest (V)"]]
for name, drive in drives.items():
    off = np.asarray(drive - unseen.u)
    rms = np.sqrt(np.mean(off**2))
    rows.append(
        [name, f"{rms:.3f}", f"{100 * rms / span:.3f}", f"{abs(off).max():.2f}"]
    )
print(hj.report.plain_table(rows))

# %%
figure, (top, bottom) = plt.subplots(
    2, 1, figsize=(7, 4.6), sharex=True, height_ratios=(1.6, 1), layout="constrained"
)
top.plot(unseen.t, unseen.u, color="#a9a9a9", linewidth=3.2, label="applied")
for (name, drive), colour in zip(drives.items(), (BLUE, ORANGE), strict=True):
    top.plot(unseen.t, drive, color=colour, linewidth=1, label=f"by the {name}")
    bottom.plot(unseen.t, drive - unseen.u, color=colour, linewidth=0.8)
top.set(ylabel="voltage (V)")
top.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
bottom.set(xlabel="time (s)", ylabel="error (V)")
plt.show()

# %% [markdown]
# ## A scan
#
# A reference of your own has no record to be held against. A twin stands in for the
# actuator: a stack of plays, which is no law of five terms, made of the cycles that the
# law was not fitted to. A triangle at the drive's frequency, once over nearly the whole
# stroke and once over half of it:

# %%
twin = hj.models.PrandtlIshlinskii.guess(unseen)
t = 0.001 * np.arange(4000)
triangle = 1 - 4 * np.abs((t + 0.25) % 1 - 0.5)
rows = [["scan", "feedforward", "rms (% of stroke)", "largest (% of stroke)"]]
tracked = {}
for half in (19.0, 9.5):  # µm
    for name, model in {"constant gain": constant, "law": law}.items():
        run = hj.control(twin, half * triangle, t, feedforward=model)
        tracked[name, half] = run
        settled = 100 * np.asarray(run.value.error)[t >= 1] / (2 * half)
        rms, largest = np.sqrt(np.mean(settled**2)), abs(settled).max()
        rows.append([f"± {half:g} µm", name, f"{rms:.2f}", f"{largest:.2f}"])
print(hj.report.plain_table(rows))

# %%
shown = {name: run for (name, half), run in tracked.items() if half == 19.0}
hj.plot.tracking(shown)

# %% [markdown]
# Over the whole stroke the law takes most of the hysteresis out. Over half of it, it is
# worse than a constant gain: a law in w, u and u' has no memory of where the drive
# turned, and cycles of one amplitude say nothing about smaller loops, not of the
# actuator nor of its twin. Record the amplitudes that you will scan
# (`hj.suggest_excitation` says what else tells terms apart), and fit plays, which close
# small loops inside of large ones.
#
# ## On the controller
#
# The law and its inverse are one file of C without a library; `piezo_follow` returns
# the voltage for the next target, within the limits of the amplifier.

# %%
source = hj.export.to_c(law, name="piezo", record=fitted)
start = source.index("bool piezo_follow")
print(f"{len(source.splitlines())} lines of C")
print(source[start : source.index(";", start) + 1])
