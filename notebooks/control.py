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
# # Make it go where you say
#
# An actuator with hysteresis does not go where a constant gain says. This notebook fits
# a law to a noisy record of one, inverts it, and leads the actuator along a reference:
# by the inverse alone, with a loop around it, and by learning from one repetition to
# the next.
#
# The actuator is a twin, a model of another family than the law: what is left is what a
# law misses that is not the device.

# %%
import jax
import numpy as np

jax.config.update("jax_enable_x64", True)
import hystjax as hj
from hystjax.simulation import FixedStep

# %% [markdown]
# ## The device
#
# A smooth density on the Preisach plane, relays of half width r about a centre. It is
# recorded once: an input that dies away, the output with noise of 1 % of its range.

# %%
radii = np.linspace(0, 1, 32, endpoint=False)
centres = np.linspace(-1.2, 1.2, 25)
middles = (centres[1:] + centres[:-1]) / 2
density = np.exp(-(((radii[:, None] - 0.35) / 0.2) ** 2 + (middles / 0.45) ** 2) / 2)
density[0] += 0.4 * np.exp(-((middles / 0.7) ** 2) / 2)  # what follows at once
named = {"names": ("voltage", "stroke"), "units": ("V", "µm")}
roots = np.sqrt(density / density.sum())
device = hj.models.Everett(radii, centres, roots, **named)

t = np.arange(0, 20, 0.002)
voltage = (1 - 0.9 * t / 20) * np.sin(np.pi * t)
still = hj.Recording(t, voltage, 0 * t, **named)
stroke = np.asarray(hj.simulate(device, still, method=FixedStep(1)).w)
noise = 0.01 * np.ptp(stroke) * np.random.default_rng(7).normal(size=len(t))
record = hj.Recording(t, voltage, stroke + noise, **named)
hj.plot.loop(record)

# %% [markdown]
# ## The law
#
# Nothing but the record is known from here on. Plays with their squares and cubes,
# beside a cubic of the input, are one linear fit; a straight line is what one has
# without them.

# %%
library = hj.library.Polynomial(3, ("u",))
for radius in (0.05, 0.12, 0.2, 0.32, 0.44, 0.6, 0.8):
    play = hj.library.Play([radius])
    library = library + play + play * play + play * play * play


def fitted(candidates):
    how = hj.formulation.Direct()
    return hj.identify(
        record, candidates, hj.regression.LeastSquares(), formulation=how
    ).value


law = fitted(library)
line = fitted(hj.library.Polynomial(1, ("u",)))
stack = hj.models.PrandtlIshlinskii.guess(record)
rows = [["fitted to the noisy record", "numbers", "off the true output, % of range"]]
for name, model in {"line": line, "plays": stack, "powers of plays": law}.items():
    run = hj.simulate(model, record, method=FixedStep(1))
    off = 100 * float(hj.metrics.nrmse(stroke, run.w))
    rows.append([name, str(len(model.numbers())), f"{off:.2f}"])
print(hj.report.plain_table(rows))

# %% [markdown]
# ## The inverse
#
# The reference: random steps, smoothed, which the record has nothing of. Where the
# least slope of the law's branches is below zero, if only by rounding or noise, another
# input would do too.

# %%
h = 0.001
time = h * np.arange(8000)
levels = np.random.default_rng(3).uniform(-0.3, 0.3, 10)
levels[0] = 0.0
steps = np.repeat(levels, 800)
bell = np.exp(-((np.arange(-240, 241) * h / 0.08) ** 2) / 2)
wanted = np.convolve(np.pad(steps, 240, mode="edge"), bell / bell.sum(), "valid")
found = hj.invert(law, wanted, time, method=FixedStep(1))
print(f"from {found.value.u.min():.2f} V to {found.value.u.max():.2f} V")
print(f"least slope {found.stats['margin'].min():.3f} µm/V")

# %% [markdown]
# ## With feedback, and with learning
#
# The sensor is as noisy as the record: 1 % of the stroke. A loop with an integral sees
# the error through that noise: the faster it is, the sooner it corrects, and the more
# of the noise it makes the device follow. Learning runs the reference again and
# corrects the feedforward by the smoothed error of the time before.

# %%
slope = np.ptp(stroke) / np.ptp(voltage)
loop = hj.compensation.PID(ki=50 / slope)
lessons = hj.compensation.Learning(0.35 / slope, smoothing=0.02, repetitions=20)
schemes = {
    "straight line": {"feedforward": line},
    "loop alone": {"feedforward": line, "feedback": loop},
    "inverse": {"feedforward": found},
    "inverse and loop": {"feedforward": found, "feedback": loop},
    "inverse, learned": {"feedforward": found, "learning": lessons},
}
sensor = {"noise": 0.01 * float(np.ptp(wanted)), "key": jax.random.key(0)}
runs = {
    name: hj.control(device, wanted, time, **scheme, **sensor)
    for name, scheme in schemes.items()
}
rows = [["scheme", "rms, % of stroke", "largest"]]
for name, run in runs.items():
    rows.append([name, f"{run.stats['rms']:.2f}", f"{run.stats['largest']:.2f}"])
print(hj.report.plain_table(rows))

# %%
shown = ("straight line", "inverse", "inverse and loop", "inverse, learned")
hj.plot.tracking({name: runs[name] for name in shown})

# %% [markdown]
# The errors of the repetitions, in %: they fall until they are what learning keeps of
# the noise.

# %%
print(np.round(np.asarray(runs["inverse, learned"].stats["repetitions"]), 2))

# %% [markdown]
# ## How fast should the loop be?
#
# Seeds and gains side by side, in one program. The best is in between.

# %%
speeds = np.array([5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 400.0])
keys = jax.random.split(jax.random.key(1), 20)


def error(speed, key):
    loop = hj.compensation.PID(ki=speed / slope)
    options = {"noise": sensor["noise"], "key": key, "feedback": loop}
    run = hj.control(device, wanted, time, feedforward=found, **options)
    return run.stats["rms"]


many = jax.vmap(jax.vmap(error, (None, 0)), (0, None))(speeds, keys)
rows = [["rad/s", "rms, % of stroke: mean", "worst of 20"]]
for speed, each in zip(speeds, np.asarray(many), strict=True):
    rows.append([f"{speed:.0f}", f"{each.mean():.2f}", f"{each.max():.2f}"])
print(hj.report.plain_table(rows))
