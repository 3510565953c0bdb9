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
# # A force that nobody measures
#
# A mass hangs on a spring and a damper. Something hysteretic pulls at it too, and that
# force has no sensor: what is recorded is the force on the mass, and where it went.
# This notebook goes from such a file to the law of the force. The file is the Bouc–Wen
# benchmark of Noël and Schoukens (2016, doi 10.4121/12967592), which was simulated, so
# that the end can be held against the truth. Nothing of that is used before.
#
# It is loaded from `HYSTJAX_DATA_DIR`, the user's cache, or its source; a file of your
# own by `hj.Recording.from_mat` or `from_csv`.

# %%
import jax

jax.config.update("jax_enable_x64", True)
import numpy as np

import hystjax as hj

record = hj.datasets.load("boucwen_benchmark")
print(record)

# %% [markdown]
# ## A look at the record
#
# The force is a sum of sines that repeats itself every 8192 samples, four times, and
# the mass had settled before the first. Here is the beginning.

# %%
hj.plot.record(record.window(0, 300))

# %% [markdown]
# What is not the same in all four periods is noise. It is small, and not quite white:
# neighbouring samples share some of it, as a filter before the sampling leaves it.

# %%
period = 8192
periods = np.asarray(record.w).reshape(4, period)
noise = np.sqrt(np.mean(np.var(periods, axis=0, ddof=1)))
apart = periods[0] - periods[1]
shared = np.mean(apart[1:] * apart[:-1]) / np.mean(apart**2)
print(f"noise: {1e6 * noise:.2f} µm rms, {100 * noise / np.std(periods):.2f} % of w")
print(f"correlation of the noise of neighbouring samples: {shared:.2f}")

# %% [markdown]
# Three periods are fitted, and the fourth is kept. Their mean has less noise and takes
# less time; `steady` puts half a period without weight in front of it, in which models
# settle.

# %%
fitted, weight = hj.steady(record.window(0, 3 * period), period)
print(len(fitted), "samples, of which", int(weight.sum()), "count")

# %% [markdown]
# ## Is there anything hysteretic?
#
# A mass on a spring and a damper alone has three numbers. The best that they can do
# leaves many times the noise, so there is something left to be found. (The spring
# beside them, z = y, is one with the stiffness, and changes nothing.) The fit starts
# from what the figure shows: the position swings once in some 0.03 s.

# %%
nothing = hj.models.SparseModel.from_terms({"u": 1.0}, target="value")
named = {"names": record.names, "units": record.units}
stiffness = (2 * np.pi / 0.03) ** 2  # of 1 kg that swings so
linear = hj.refine(
    hj.models.Oscillator(1.0, 10.0, stiffness, nothing, **named),
    fitted,
    fixed=["u"],
    weights=[weight],
    shooting=hj.refinement.Nudging(),
)
left = 1e6 * float(linear.stats["rmse"][0])
print(linear.value)
print(f"leaves {left:.1f} µm rms; noise of the mean {1e6 * noise / np.sqrt(3):.2f} µm")

# %% [markdown]
# ## The law
#
# All that `discover` is told: mass y'' + damping y' + stiffness y + z = u, and z' is a
# sum of a few products of z, y' and their sizes. In the library `w` stands for z, `u`
# for the position that drives it, and `du` for the velocity. Of the mass, the damping
# and the stiffness ones are as good as any guess.

# %%
library = hj.library.Polynomial(2, ("w", "du", "|du|", "|w|"))


def around(law):
    return hj.models.Oscillator(1.0, 1.0, 1.0, law, **named)


found = hj.discover(fitted, library, around=around, weights=[weight])
print(len(library), "candidate terms")
print(found.value)
print(found.stats["why"])

# %% [markdown]
# What else was tried? The best law of each number of terms, and the next best with as
# many terms as the one chosen. A difference of criteria of 2 is worth no more than a
# bare mention; here the wrong three terms leave many times as much, and a fourth term
# nothing less.

# %%
candidates, best = found.stats["candidates"], found.stats["candidates"][0]
size = len(best.terms)
second = [trial for trial in candidates if len(trial.terms) == size][1]
trials = sorted([*found.stats["frontier"].values(), second], key=lambda t: len(t.terms))
rows = [["terms", "rms, µm", "criterion over the best"]]
for trial in trials:
    over = trial.criterion - best.criterion
    rows.append([", ".join(trial.terms), f"{1e6 * trial.rmse:.2f}", f"{over:.0f}"])
print(hj.report.plain_table(rows))
print(len(found.stats["alike"]), "laws are hardly told from the best")
hj.plot.frontier(found)

# %% [markdown]
# ## The numbers
#
# The law has been refined by trajectory matching already, and brings standard errors.
# Only now the truth: the benchmark's oscillator is a Bouc–Wen spring, with alpha for
# `du`, and beta and gamma with a minus for the other two terms.

# %%
truth = hj.models.BoucWenOscillator(
    mass=2.0, damping=10.0, stiffness=5e4, alpha=5e4, beta=800.0, gamma=-1100.0, **named
)
spring = {"du": 5e4, "w*|du|": -800.0, "du*|w|": 1100.0}
true = {"mass": 2.0, "damping": 10.0, "stiffness": 5e4, **spring}
errors = found.stats["standard_errors"]
rows = [["", "found", "standard error", "true"]]
for name, value in found.value.parameters().items():
    if name in errors:
        numbers = f"{float(value):.6g}", f"{float(errors[name]):.2g}", f"{true[name]:g}"
        rows.append([name, *numbers])
print(hj.report.plain_table(rows))
for said in hj.refinement.statements(found):
    print("-", said)

# %% [markdown]
# That the residuals are correlated is what the record said of its noise. `discover`
# knows that instruments correlate it over a sample or two, and took this for white; the
# test of the residuals does not. Nothing of the law is missing, but standard errors are
# a little too small.
#
# ## What cannot be known
#
# - The scale of a hidden quantity is often a convention. Not here: z is a force that
#   adds to the others, so the unit of u gives it one. The benchmark writes its law with
#   a product of two numbers in front of two of the terms; the products are found, and
#   nothing tells the factors.
# - A force in proportion to the position is one with the stiffness, and z begins as
#   one. Only where the hysteretic spring yields are the two told apart. So `stiffness`
#   and `du` are less certain than their sum, and what one has too much the other has
#   too little.

# %%
names = found.stats["certainty"].names
covariance = np.asarray(found.stats["covariance"])
pair = [names.index("stiffness"), names.index("du")]
part = covariance[np.ix_(pair, pair)]
for name, variance in zip(("stiffness", "du"), np.diag(part), strict=True):
    print(f"{name}: ± {np.sqrt(variance):.1f} N/m")
print(f"their sum: ± {np.sqrt(part.sum()):.1f} N/m")
print(f"their correlation: {part[0, 1] / np.sqrt(np.prod(np.diag(part))):.2f}")

# %% [markdown]
# ## The fourth period
#
# A free run from rest, through the forces of the first three periods, is judged on the
# fourth, which nothing was fitted to. It leaves what the true oscillator leaves, the
# noise; and from the run of the true oscillator it is many times closer than the noise
# would let anybody see. Its first moments:

# %%
ours, ideal = (
    hj.judge(model, record, w0=0.0, lead_in=3 * period) for model in (found, truth)
)
distance = hj.metrics.rmse(ideal.trajectory.w, ours.trajectory.w)
print(f"found, less what was measured: {1e6 * float(ours.errors['rmse']):.3f} µm rms")
print(f"true,  less what was measured: {1e6 * float(ideal.errors['rmse']):.3f} µm rms")
print(f"found, less true:              {1e6 * float(distance):.3f} µm rms")

until = 3 * period + 225
shown = hj.judge(found, record.window(0, until), w0=0.0, lead_in=3 * period)
hj.plot.fit(shown.recording, shown.trajectory)

# %% [markdown]
# ## What was hidden
#
# The force itself, over time and over the position, in the same moments. The model and
# the true oscillator go through the three periods before. Their lines cannot be told
# apart at this scale, nor can the band be seen in which the covariance of the numbers
# leaves the force. Below is what is left of both: the band, and what the true force
# differs by.

# %%
moments = record.window(3 * period, until)
hj.plot.hidden(moments, found, truth, labels=["found", "true"], settled=True)

# %% [markdown]
# ## Another input
#
# A law, unlike a table of answers, should hold elsewhere. The force is now one sine
# whose frequency rises through the resonance, as in the second test of the benchmark,
# here within twenty seconds.

# %%
sweep = hj.excitation.Chirp(40.0, 20.0, 50.0, 20.0).path(np.arange(15_000) / 750)
swept = [hj.simulate(model, sweep, w0=0.0).w for model in (truth, found.value)]
distance = float(hj.metrics.rmse(*swept))
share = 100 * distance / float(np.std(swept[0]))
print(f"found, less true: {1e6 * distance:.3f} µm rms, {share:.3f} % of the position")

# %% [markdown]
# ## What others found
#
# Published models of this benchmark are black boxes: state spaces with polynomials,
# networks, Koopman operators, of many more numbers. The table in [laws of what nobody
# measures](../docs/hidden.md#the-benchmark) has their errors and sources, and says what
# keeps them from being compared by the per cent. None of them gives the law.
