import re

import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj

T = np.linspace(0, 6, 601)
U = np.sin(T)
SLOWED = hj.models.SparseModel.from_terms({"u": 1.0})  # w' = sin t


def recording(w):
    # The derivative of an exact input is no matter here; the law sees u alone.
    return hj.Recording(T, U, w).with_input(jnp.sin)


def test_errors_are_those_of_the_closed_form():
    noise = 0.01 * np.random.default_rng(0).normal(size=T.size)
    noise[0] = 0  # the free run starts from here
    w = 2 - np.cos(T) + noise
    judgement = hj.judge(SLOWED, recording(w))
    assert judgement.succeeded
    np.testing.assert_allclose(judgement.trajectory.w, 2 - np.cos(T), atol=1e-7)
    rms = np.sqrt(np.mean(noise**2))
    expected = {
        "rmse": rms,
        "nrmse": rms / np.ptp(w),
        "relative_error": np.linalg.norm(noise) / np.linalg.norm(w),
        "relative_squared_error": np.sum(noise**2) / np.sum(w**2),
        "r2": 1 - np.mean(noise**2) / np.var(w),
        "max_error": np.max(np.abs(noise)),
    }
    errors = {name: float(value) for name, value in judgement.errors.items()}
    assert errors == pytest.approx(expected, rel=1e-4)


def test_start_and_method_are_passed_on():
    w = 1 - np.cos(T)
    for method in (hj.simulation.Adaptive(), hj.simulation.FixedStep()):
        judgement = hj.judge(SLOWED, recording(w), w0=0.5, method=method)
        assert float(judgement.errors["rmse"]) == pytest.approx(0.5, rel=1e-6)
        assert float(judgement.errors["max_error"]) == pytest.approx(0.5, rel=1e-6)


def test_a_lead_in_is_simulated_and_not_judged():
    w = 1 - np.cos(T)
    w[:300] += 0.2  # where the run starts it is off, but for the start itself
    w[0] -= 0.2
    record = recording(w + 0.1 * (T > 5))
    judgement = hj.judge(SLOWED, record, lead_in=300)
    kept = np.where(T[300:] > 5, 0.1, 0.0)
    rms = np.sqrt(np.mean(kept**2))
    assert float(judgement.errors["rmse"]) == pytest.approx(rms, rel=1e-5)
    assert float(judgement.errors["max_error"]) == pytest.approx(0.1, rel=1e-5)
    np.testing.assert_array_equal(judgement.recording.t, T[300:])
    np.testing.assert_array_equal(judgement.trajectory.t, T[300:])
    # The input leaves this range in the lead-in only, and comes to -1 after it.
    known = hj.models.FittedRange(-1.0, U[300])
    within = hj.judge(SLOWED.fitted_on(known), record, lead_in=300)
    assert float(within.trajectory.stats["beyond"].input) == 0
    with pytest.raises(hj.InputError, match="after its lead-in"):
        hj.judge(SLOWED, record, lead_in=599)


def test_law_that_diverges_is_judged_not_raised():
    explosive = hj.models.SparseModel.from_terms({"w^2": 1.0})  # 1 / (1 - t)
    judgement = hj.judge(explosive, recording(np.ones_like(T)))
    assert not judgement.succeeded
    assert not any(np.isfinite(error) for error in judgement.errors.values())
    before, w = T < 0.95, np.asarray(judgement.trajectory.w)
    np.testing.assert_allclose(w[before], 1 / (1 - T[before]), rtol=1e-5)
    assert not np.isfinite(w[T > 1.05]).any()


def test_an_output_that_stands_still_leaves_ratios_undefined():
    """As of a device at rest: nothing has diverged, and errors in units are known."""
    for level, relative in ((0.0, "undefined"), (-4.0, "25 %")):
        rest = hj.Recording(T, U, np.full_like(T, level)).with_input(jnp.zeros_like)
        told = hj.judge(SLOWED, rest, w0=level + 1)  # and stays there
        assert str(told).startswith("Judgement of 601 samples: NRMSE undefined")
        headings, cells = hj.report.error_table({"rest": told})
        row = dict(zip(headings, cells, strict=True))
        assert row["NRMSE"] == row["R²"] == "undefined"
        assert (row["relative error"], row["largest error"]) == (relative, "1")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("V", "µm"), None),
        (("V", "um"), None),
        (("", "μm"), None),
        (("mV", "µm"), "an input in V, and the recording's is in mV"),
        (("", "nm"), "an output in µm, and the recording's is in nm"),
        (("µm", "V"), "an input in V, .*in µm, and an output in µm, .*in V"),
    ],
)
def test_a_recording_in_other_units_than_the_law_is_told_of(given, said, recwarn):
    law = hj.models.SparseModel.from_terms({"u": 1.0}, units=("V", "µm"))
    record = hj.Recording(T, U, 1 - np.cos(T), units=given)
    calls = (
        lambda: hj.simulate(law, record),
        lambda: hj.judge(law, record),
        lambda: hj.refine(law, record, max_steps=2, throw=False),
    )
    for call in calls:
        recwarn.clear()
        call()
        told = [x for x in recwarn if "No number is converted" in str(x.message)]
        assert len(told) == (said is not None)
        for each in told:
            assert re.search(said, str(each.message))
