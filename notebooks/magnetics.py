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
# # What a magnetician reads off loops
#
# Coercivity, remanence and loss of an electrical steel, with standard errors; the same
# numbers of a law beside them; then the first-order reversal curves of a marine
# sediment: the diagram, what in it is more than noise, and a Preisach model that is
# judged on curves it has not seen.
#
# Both records are measured, and are loaded from `HYSTJAX_DATA_DIR`, the user's cache,
# or their source.

# %%
import jax
import numpy as np

jax.config.update("jax_enable_x64", True)
import hystjax as hj

# %% [markdown]
# ## Three loops of one steel
#
# `steel_m130_27s` was measured so slowly that the rate does not matter; it has no
# clock. `core_loss` finds which column is which by the units. The density makes losses
# per mass, and a frequency would make powers.

# %%
names = ("0.43T", "0.95T", "1.50T")
loops = {name: hj.datasets.load("steel_m130_27s", name) for name in names}
rows = [["loop", "H max (A/m)", "Hc (A/m)", "Br (T)", "loss (J/m³)", "loss (mJ/kg)"]]
for name, loop in loops.items():
    loss = hj.loops.core_loss(loop, density=7650.0).isel(cycle=0)
    rows.append(
        [
            name,
            f"{float(loss.field):.1f}",
            f"{float(loss.coercivity):.2f} ± {float(loss.coercivity_error):.1g}",
            f"{float(loss.remanence):.3f} ± {float(loss.remanence_error):.1g}",
            f"{float(loss.energy):.2f} ± {float(loss.energy_error):.1g}",
            f"{1e3 * float(loss.specific_energy):.2f}",
        ]
    )
print(hj.report.plain_table(rows))

# %% [markdown]
# The standard errors are of the noise alone, which is small; what the instrument's
# calibration adds is not in the record. The static loss grows by a power of the flux
# density, Steinmetz's exponent. (His law has a frequency too; here one is as good as
# another, and only the exponent is read.)

# %%
flux = np.array([float(hj.loops.core_loss(each).flux[0]) for each in loops.values()])
energy = np.array(
    [float(hj.loops.core_loss(each).energy[0]) for each in loops.values()]
)
exponent, _ = np.polyfit(np.log(flux), np.log(energy), 1)
print(f"static loss grows as the flux density to the power of {exponent:.2f}")

# %% [markdown]
# The largest loop with its marks:

# %%
hj.plot.cycles(loops["1.50T"])

# %% [markdown]
# ## A law beside the record
#
# Jiles and Atherton's model of the largest loop, first as guessed from it, then
# refined. The error of a free run says little to a magnetician; what the law makes of
# coercivity, remanence and loss says more.

# %%
largest = loops["1.50T"]
guessed = hj.models.JilesAtherton.guess(largest)
refined = hj.refine(guessed, largest).value
runs = {
    label: hj.simulate(law, largest, w0=largest.w[0])
    for label, law in {"guessed": guessed, "refined": refined}.items()
}
both = hj.loops.side_by_side(largest, runs)
shown = ["saturation", "energy", "remanence", "coercivity", "squareness"]
print(hj.report.plain_table(hj.loops.table(both, shown)))

# %% [markdown]
# ## First-order reversal curves
#
# A MicroMag file in hybrid SI: fields are µ0 H in T. Between the curves the instrument
# measured single points in a strong field, by which drift is divided out
# (`drift=False` leaves it).

# %%
curves = hj.loops.read_forc(hj.datasets.path("forc_md00") / "MD00-2361")
diagram = hj.loops.forc(curves)
print(f"{len(curves)} curves, {len(curves.field)} points")
print(diagram)

# %% [markdown]
# How smooth? Points are left out one by one, and predicted by the surface through their
# neighbours. The smoothest that is hardly worse than the best was taken:

# %%
for smoothing, error in diagram.compared.items():
    mark = " <" if smoothing == np.nanmax(diagram.smoothing) else ""
    print(f"smoothing {smoothing:g}: {1e9 * error:.2f} nA m²{mark}")

# %%
hj.plot.forc(diagram)

# %% [markdown]
# A ridge along Hu = 0 reaches out to 90 mT: single-domain grains that do not interact,
# such as those of magnetotactic bacteria. Along the left edge is what is reversible. A
# smoothing that grows with Hc along Hc, and with |Hu| along Hu, clears the background,
# and keeps the ridge sharp:

# %%
hj.plot.forc(hj.loops.forc(curves, smoothing=hj.loops.Varying()))

# %% [markdown]
# ## A Preisach model of the curves
#
# Its relays are the mixed differences of the moments. It is made of nine curves in ten,
# and predicts the tenth:

# %%
print(f"NRMSE on curves left out: {100 * hj.loops.left_out(curves):.2f} %")

# %% [markdown]
# With all curves it is a model like any other: it simulates, inverts and saves. Here is
# what this sediment does under a field that swings between 40 mT and less and less; the
# steps are the levels at which relays turn, 250 of them.

# %%
model = hj.loops.preisach(curves)
swings = 0.04 * np.cos(np.linspace(0, 8 * np.pi, 1600)) * np.linspace(1, 0.2, 1600)
field = np.append(0.12, swings)  # from saturation
moment = np.asarray(hj.simulate(model, hj.Recording(None, field, field)).w)
shown = hj.Recording(
    None,
    1e3 * field[1:],
    1e6 * moment[1:],
    names=model.names,
    units=("mT", "µA m²"),
)
hj.plot.cycles(shown)
