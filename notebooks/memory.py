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
# # Which memory does my device have?
#
# A law w' = f(w, u, u') remembers no more than its output shows. Many devices remember
# more: where the input turned, and what it was seconds ago. This notebook asks three
# measured devices, a piezo manipulator, a friction damper and a sliding contact, by
# fitting one family of models after the other and judging all by the same free runs.
#
# All records are loaded from `HYSTJAX_DATA_DIR`, the user's cache, or their source.

# %%
import warnings

import jax
import numpy as np
from IPython.display import display

jax.config.update("jax_enable_x64", True)
import hystjax as hj

# %% [markdown]
# ## A piezo
#
# `piezo_yan9a` starts from rest and is driven for 40 s. Families are compared on the
# first half; no fit sees the second, on which they are judged.

# %%
record = hj.datasets.load("piezo_yan9a")
first, second = record.split(0.5)
hj.plot.record(first)

# %% [markdown]
# Each family is fitted once without each of six blocks and simulated through it.

# %%
families = ["curve", "plays", "plays and creep", "plays behind a lag", "law"]
found = hj.compare(first, families=families)
for *cells, _ in found.table():  # all but the seconds
    print("  ".join(cell.split(" ±")[0].ljust(20) for cell in cells).rstrip())

# %%
hj.plot.comparison(found, first)

# %% [markdown]
# A curve without memory misses most. Plays, which remember where the input turned, take
# it down by an order of magnitude; slow lags beside them help a little, and one fast
# lag behind them more than anything else: what follows the plays is not instant. The
# best law of first order lies between.
#
# Blocks of one record are near each other in time, and errors on them a little small.
# On the half that none of the families has seen:

# %%
span = float(np.ptp(record.w))
rows = [["family", "blocks of the first half, µm", "second half, µm"]]
for row in found.rows:
    run = hj.simulate(row.model, second)
    unseen = float(hj.metrics.rmse(second.w, run.w))
    blocks = row.error * float(np.ptp(first.w))
    rows.append([row.family, f"{blocks:.3f}", f"{unseen:.3f}"])
print(hj.report.plain_table(rows))

# %% [markdown]
# The first is still the first; the law and the plays with creep have changed places,
# closer together than their blocks said.
#
# The start of the record is left out where a family cannot follow it: what the device
# did before is not known, and stacks of plays start as if nothing had been.

# %%
for row in found.rows:
    if row.note and row.family != "law":
        print(f"{row.family}: {row.note}")
best = found.best.model
run = hj.simulate(best, second)
hj.plot.error(second, run, labels=[found.best.family])

# %% [markdown]
# ## A friction damper
#
# Two recordings at an amplitude of 0.5 in, at 0.5 and 1 Hz, are fitted; two of 1 in are
# not. With two recordings the blocks are stretches of both, and say nothing about other
# amplitudes: that is what the recordings kept from the comparison are for. (They go
# farther than what was fitted; of that `simulate` warns, and `judge` does not.)

# %%
name = "friction_damper"
records = {each: hj.datasets.load(name, each) for each in hj.datasets.records(name)}
small = [each for key, each in records.items() if key.endswith("0.5in")]
large = [each for key, each in records.items() if not key.endswith("0.5in")]
families = ["curve", "plays", "stops", "two stops", "Dahl", "BoucWenForce"]
damper = hj.compare(small, families=families)
rows = [["family", "blocks, %", "1 in, not fitted, %"]]
for row in damper.rows:
    errors = [100 * float(hj.judge(row.model, each).errors["nrmse"]) for each in large]
    rows.append([row.family, f"{100 * row.error:.2f}", f"{np.mean(errors):.2f}"])
print(hj.report.plain_table(rows))

# %% [markdown]
# Two springs that slide, each with a static curve, are best in both: their radii are
# refined, where stacks have theirs on a grid. Else what is good on blocks of the same
# amplitude need not be beyond it. A stack of plays has a weight for each radius that
# the input has reached, and its cubic leaves fast: second here, it is far off there.

# %%
with warnings.catch_warnings():  # of going beyond what was fitted, as is asked here
    warnings.simplefilter("ignore")
    display(hj.plot.comparison(damper, large[0]))

# %% [markdown]
# ## A contact that slides
#
# `friction_pin` goes 50 times back and forth over the same 0.24 mm. The first cycles
# are fitted, and others are kept.

# %%
record = hj.datasets.load("friction_pin")
first, second = record.split(0.5)
families = ["curve", "plays", "stops", "Dahl", "Everett"]
contact = hj.compare(first, families=families)
rows = [["family", "blocks of the first half, %", "second half, %", "numbers"]]
for row in contact.rows:
    error = 100 * float(hj.judge(row.model, second).errors["nrmse"])
    rows.append(
        [row.family, f"{100 * row.error:.2f}", f"{error:.2f}", str(row.numbers)]
    )
print(hj.report.plain_table(rows))

# %%
hj.plot.comparison(contact, second)

# %% [markdown]
# A force over a position leads it. `Everett` then is springs that slide, with another
# stiffness at each place of the track: the contact does not grip everywhere alike, and
# stops, whose loops are the same everywhere, and Dahl's three numbers cannot know it.
# That is a memory of this track, and of no other.
