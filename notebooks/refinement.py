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
# # Refinement: accurate, and certain of how much
#
# Regression explains the *derivative* of the output, and the derivative of a noisy
# record is mostly noise. Refinement explains the output itself: it runs the law from
# the first sample on, compares, and changes the coefficients (Levenberg–Marquardt,
# through the simulation) until the free run follows the record as closely as it can.
# With independent Gaussian noise that is the maximum-likelihood estimate, and its
# Jacobian says how certain each number is.
#
# First on a simulated record, where the truth is known; then on a measured one.

# %%
import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import hystjax as hj

ORANGE, BLUE = "#D55E00", "#0072B2"
plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})

# %% [markdown]
# ## A noisy record of a known device
#
# The Duhem law of experiment 4 of Chandra et al. (2023), under a sine, with additive
# noise of 20 % of the output's standard deviation.

# %%
truth = hj.models.Duhem(0.4, 0.5, 0.25)
t = jnp.linspace(0, 20 * jnp.pi, 1000)
sine = hj.excitation.Sine(1.0, 1 / (2 * jnp.pi))
clean = hj.generate(truth, sine, t)
noisy = hj.generate(truth, sine, t, additive=0.2, key=jax.random.key(29))

start = hj.identify(noisy, hj.library.Duhem(), hj.regression.LeastSquares()).value
solution = hj.refine(start, noisy)
law, errors = solution.value, solution.stats["standard_errors"]

print("truth:    ", truth)
print("regressed:", start)
print("refined:  ", law)
for name, error in errors.items():
    print(f"  {name:>6}  {law.terms()[name]:+.4f} ± {error:.4f}")
for name, model in (("regressed", start), ("refined", law)):
    run = hj.simulate(model, clean, w0=clean.w[0])
    print(f"{name}: {100 * hj.metrics.nrmse(clean.w, run.w):.3f} % off the clean truth")

# %% [markdown]
# The library here has a constant times $|\dot u|$ too, `|du|`, which the truth has not:
# its coefficient is zero within its standard error. Regression, here on plain finite
# differences, is misled by noise that sits in its regressors too. Before and after, in
# pictures: the errors over time; the residuals with the band in which the simulated
# output lies; how the residuals are correlated with each other (they should not be) and
# the coefficients among themselves.

# %%
before = hj.simulate(start, noisy)
after = hj.simulate(law, noisy, w0=solution.stats["w0"][0])
hj.plot.refinement(noisy, before, after, solution)

# %% [markdown]
# ## Are the standard errors right?
#
# Measure the device two hundred times and see. All fits are one `vmap`. Below, the
# estimates of one coefficient, and the normal distribution that a single record
# promises; then how often the interval of ±1.96 standard errors holds the truth.

# %%
model = hj.models.SparseModel.from_terms(truth.terms())


@jax.jit
@jax.vmap
def repeated(key):
    noise = 0.2 * jnp.std(clean.w) * jax.random.normal(key, clean.w.shape)
    record = eqx.tree_at(lambda r: r.w, clean, clean.w + noise)
    fit = hj.refine(model, record, throw=False)
    return fit.value.parameters(), fit.stats["standard_errors"]


estimates, promised = repeated(jax.random.split(jax.random.key(1), 200))
single = hj.refine(model, noisy).stats["standard_errors"]

figure, panels = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for ax, (name, values) in zip(panels, estimates.items(), strict=True):
    centre, width = truth.terms()[name], float(single[name])
    axis = np.linspace(centre - 4 * width, centre + 4 * width, 200)
    normal = np.exp(-(((axis - centre) / width) ** 2) / 2) / (
        width * np.sqrt(2 * np.pi)
    )
    ax.hist(np.asarray(values), 20, density=True, color="0.8", label="200 records")
    ax.plot(axis, normal, color=ORANGE, label="promised by one")
    ax.axvline(centre, color="k", lw=0.8, label="truth")
    ax.set(xlabel=f"coefficient of {name}", yticks=[])
    ax.locator_params(axis="x", nbins=4)
panels[0].set_ylabel("density")
figure.legend(
    *panels[0].get_legend_handles_labels(),
    frameon=False,
    loc="outside upper center",
    ncols=3,
)
plt.show()
for name, values in estimates.items():
    inside = jnp.abs(values - truth.terms()[name]) < 1.96 * promised[name]
    print(f"{name:>6}: the interval holds the truth in {100 * inside.mean():.1f} %")

# %% [markdown]
# ## What the data leave open
#
# Certainty is not only a matter of noise. Seen through an amplifier of unknown gain,
# the scale of the law and the gain are one number, and no record tells them apart. The
# singular values of the Jacobian show it, and the direction is named.

# %%
seen = hj.models.Instrumented(model, output_gain=1.0, output_offset=0.0)
certainty = hj.refine(seen, noisy, throw=False).stats["certainty"]
for size, parts in certainty.undetermined():
    mixed = ", ".join(f"{part:+.2f} {name}" for name, part in parts.items())
    print(f"1 : {1 / size:.0e}   {mixed}")
known = hj.refine(seen, noisy, fixed=["output_gain"])
offset = float(known.value.output_offset)
error = float(known.stats["standard_errors"]["output_offset"])
print(f"with the gain known, the offset is {offset:+.4f} ± {error:.4f}")

# %% [markdown]
# ## A measured piezo
#
# The paper's law of a piezo actuator has five terms. Refinement keeps the terms and
# makes the best of their coefficients; a sixth term, $\dot u|\dot u|$, then brings the
# error close to what the sensor itself does at rest. Spikes in this recording call for
# a robust loss: Huber's, with its usual threshold of 1.345 times the scale of the
# noise, which is taken from the median at rest, since spikes inflate its standard
# deviation.

# %%
record = hj.datasets.load("piezo_ayala")
fitted, unseen = record.window(35000, 45000), record.window(17500, 35000)
rest = np.asarray(record.between(0.0, 3.2).w)  # before the sine
noise, scale = rest.std(), 1.4826 * np.median(np.abs(rest - np.median(rest)))

# As rounded in the paper's script; the digits that the paper prints are fewer.
rounded = {"1": -0.176, "w": -2.388, "u": 0.581, "du": 0.119, "w*|w|": -0.076}
five = hj.models.SparseModel.from_terms(rounded, units=record.units)
six = hj.models.SparseModel.from_terms(rounded | {"du*|du|": 0}, units=record.units)
refined = {
    "five terms": hj.refine(five, fitted),
    "six terms": hj.refine(six, fitted, loss=hj.refinement.Huber(1.345 * scale)),
}


def nrmse(model, part, w0=None):
    run = hj.simulate(model, part, w0=w0, method=hj.simulation.FixedStep(1))
    return 100 * float(hj.metrics.nrmse(part.w, run.w))


print("NRMSE of the free run, %        own rows   unseen rows")
rows = [("five terms, as rounded", nrmse(five, fitted), nrmse(five, unseen))]
for name, fit in refined.items():
    own = nrmse(fit.value, fitted, fit.stats["w0"][0])
    rows.append((f"{name}, refined", own, nrmse(fit.value, unseen)))
rows.append(("the sensor at rest", 100 * noise / float(jnp.ptp(fitted.w)), np.nan))
for name, own, other in rows:
    print(f"{name:<28} {own:11.4f} {other:13.4f}")
print(refined["six terms"].value)

# %% [markdown]
# Residuals of the five-term law repeat with every cycle: their autocorrelation says so,
# and that standard errors, which count every sample as news, are too small. The plot
# for six terms shows what is left.

# %%
best = refined["six terms"]
after = hj.simulate(best.value, fitted, w0=best.stats["w0"][0])
hj.plot.refinement(fitted, hj.simulate(five, fitted), after, best)

# %%
for statement in hj.refinement.statements(best):
    print("-", statement)

# %% [markdown]
# A bootstrap over blocks of residuals, each longer than they remember, gives standard
# errors that stand. It refines again and again, all fits side by side.

# %%
thinned = fitted.resample(fitted.t[::10])
short = hj.refine(refined["five terms"].value, thinned)
again = hj.bootstrap(
    short.value, thinned, key=jax.random.key(0), samples=100, block=250
)
print("standard errors      from the Jacobian    bootstrap over blocks of half a cycle")
for name, error in short.stats["standard_errors"].items():
    boot = float(again.standard_errors[name])
    print(
        f"{name:>8} {short.value.terms()[name]:+9.4f} {float(error):14.2e} {boot:20.2e}"
    )
