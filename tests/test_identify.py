import dataclasses
import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pysindy
import pytest
from scipy.integrate import odeint

import hystjax as hj
from hystjax import RESULTS, ComputationError, InputError, Recording
from hystjax.library import BoucWen, Duhem, Library, Polynomial, Term
from hystjax.regression import (
    STLSQ,
    AbstractRegression,
    LeastSquares,
    NonNegative,
    Ridge,
)
from hystjax.regression.differentiation import (
    AbstractDifferentiation,
    FiniteDifference,
    SavitzkyGolay,
    SmoothingSpline,
)
from hystjax.regression.formulation import AbstractFormulation, Direct

DUHEM = {"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25}
BOUC_WEN = {"du": 5.0, "w*|du|": -0.25, "du*|w|": -0.5}


def bouc_wen(n):
    return lambda w, u, du: (
        5 * du - 0.25 * abs(du) * w * abs(w) ** (n - 1) - 0.5 * du * abs(w) ** n
    )


def duhem(w, u, du):
    return 0.4 * abs(du) * u - 0.5 * abs(du) * w + 0.25 * du


def growing(t):
    return t * np.sin(t), np.sin(t) + t * np.cos(t)


def sine(t):
    return np.sin(t), np.cos(t)


def two_sines(t):
    slow, fast = 0.31 * t, 1.7 * t
    return (
        2 * np.sin(slow) + np.sin(fast),
        0.62 * np.cos(slow) + 1.7 * np.cos(fast),
    )


def simulated(law, excitation, t, w0=0.0):
    """A record by SciPy, from the exact input and its exact derivative."""
    w = odeint(
        lambda w, s: law(w, *excitation(s)), w0, t, rtol=1e-11, atol=1e-12, hmax=0.01
    )
    return Recording(t, excitation(t)[0], w[:, 0])


@pytest.fixture(scope="module")
def duhem_record():
    return simulated(duhem, growing, np.linspace(0, 7 * np.pi, 1000))


@pytest.fixture(scope="module")
def rich_record():
    return simulated(duhem, two_sines, np.linspace(0, 40, 4001), 0.2)


# ---------------------------------------------------------------------------- PySINDy


def by_pysindy(recording, library, threshold, ridge):
    """Coefficients of `pysindy.SINDy.fit` with w as target and the rest as controls."""
    t, u, w = map(np.asarray, (recording.t, recording.u, recording.w))
    du = pysindy.FiniteDifference(order=2)._differentiate(u[:, None], t)[:, 0]
    columns = {"u": u, "du": du, "|du|": np.abs(du), "|w|": np.abs(w)}
    controls = [columns[name] for name in ("u", "du", "|du|", "|w|") if name in library]
    model = pysindy.SINDy(
        optimizer=pysindy.STLSQ(threshold=threshold, alpha=ridge),
        feature_library=pysindy.PolynomialLibrary(degree=2),
        differentiation_method=pysindy.FiniteDifference(order=2),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(w[:, None], t=t, u=np.stack(controls, axis=1))
    return model.coefficients()[0]


EXPERIMENTS = {
    "1 Duhem": (
        (duhem, growing, np.linspace(0, 7 * np.pi, 1000)),
        ("w", "u", "du", "|du|"),
        {"u*|du|": 0.400, "w*|du|": -0.500, "du": 0.251},
    ),
    "2 Bouc-Wen": (
        (bouc_wen(1), sine, np.linspace(0, 10 * np.pi, 1000)),
        ("w", "u", "du", "|du|", "|w|"),
        {"du": 4.999, "w*|du|": -0.250, "du*|w|": -0.499},
    ),
}


@pytest.mark.parametrize("record, names, rerun", EXPERIMENTS.values(), ids=EXPERIMENTS)
@pytest.mark.parametrize("threshold, ridge", [(0.1, 0.05), (0.05, 1.0), (0.02, 1e-3)])
def test_identify_equals_pysindy(record, names, rerun, threshold, ridge):
    recording, library = simulated(*record), Polynomial(2, names)
    method = STLSQ(jnp.array(threshold), jnp.array(ridge), normalise=False)
    ours = hj.identify(recording, library, method).value
    expected = by_pysindy(recording, names, threshold, ridge)
    np.testing.assert_array_equal(ours.support, expected != 0)
    np.testing.assert_allclose(ours.coefficients, expected, rtol=1e-8, atol=1e-10)
    if threshold == 0.1:  # the paper's setting, and the figures of its scripts
        assert ours.terms() == pytest.approx(rerun, abs=6e-4)


# ------------------------------------------------------------------------------ truth


@pytest.mark.parametrize(
    "law, excitation, library, truth",
    [
        (duhem, growing, Polynomial(2), DUHEM),
        (duhem, two_sines, Polynomial(2), DUHEM),
        (duhem, two_sines, Duhem(2) + Polynomial(1), DUHEM),
        (bouc_wen(1), two_sines, Polynomial(2), BOUC_WEN),
        (bouc_wen(1), sine, BoucWen(1), BOUC_WEN),
        (
            bouc_wen(2),
            two_sines,
            Polynomial(3),
            {"du": 5.0, "w*|du|*|w|": -0.25, "w^2*du": -0.5},  # w^2 is |w|^2, and first
        ),
    ],
    ids=["Duhem", "Duhem 2", "Duhem 3", "Bouc-Wen", "Bouc-Wen 2", "Bouc-Wen, n = 2"],
)
def test_exact_laws_are_recovered(law, excitation, library, truth):
    """With the default regression, thresholds in shares of the derivative."""
    recording = simulated(law, excitation, np.linspace(0, 40, 8001), 0.2)
    solution = hj.identify(recording, library)
    assert solution.result == RESULTS.successful
    assert solution.value.terms() == pytest.approx(truth, rel=5e-3)
    assert solution.stats["residual"] < 0.01


# ------------------------------------------------------------------ regressors by hand


def by_hand(recordings, library, estimate):
    rows, targets = [], []
    for r in recordings:
        t, u, w = map(np.asarray, (r.t, r.u, r.w))
        (w, dw), (u, du) = estimate(t, w), estimate(t, u)
        rows.append(np.asarray(library(*map(jnp.asarray, (w, u, du)))))
        targets.append(dw)
    return np.concatenate(rows), np.concatenate(targets)


def gradient(t, y):
    return y, np.gradient(y, t, edge_order=2)


def test_several_recordings_are_one_problem(rich_record):
    other = simulated(
        duhem, growing, np.sort(np.random.default_rng(0).uniform(0, 9, 700))
    )
    library = Duhem() + Polynomial(1)
    recordings = [rich_record.window(100, 900), other, rich_record.window(2000, 3500)]
    solution = hj.identify(recordings, library, LeastSquares())
    regressors, target = by_hand(recordings, library, gradient)
    expected, *_ = np.linalg.lstsq(regressors, target)
    np.testing.assert_allclose(solution.value.coefficients, expected, rtol=1e-8)
    misfit = np.linalg.norm(regressors @ expected - target) / np.linalg.norm(target)
    np.testing.assert_allclose(solution.stats["residual"], misfit, rtol=1e-8)
    for i in range(len(library)):
        before, column = regressors[:, :i], regressors[:, i]
        left = column - before @ np.linalg.lstsq(before, column)[0] if i else column
        share = np.linalg.norm(left) / np.linalg.norm(column)
        np.testing.assert_allclose(solution.stats["novelty"][i], share, rtol=1e-6)


@pytest.mark.parametrize(
    "method", [SavitzkyGolay(11, 3), SmoothingSpline(1e-5)], ids=repr
)
def test_output_and_input_are_smoothed_alike(rich_record, method):
    recording, library = rich_record.window(0, 1500), Duhem()
    ours = hj.identify(recording, library, LeastSquares(), differentiation=method)

    def estimate(t, y):
        return map(np.asarray, method.estimate(jnp.asarray(t), jnp.asarray(y)))

    expected, *_ = np.linalg.lstsq(*by_hand([recording], library, estimate))
    np.testing.assert_allclose(ours.value.coefficients, expected, rtol=1e-8)


def test_weights_that_leave_no_equation_are_refused(rich_record):
    recording = rich_record.window(0, 1500)
    weights = np.where(np.arange(1500) % 3 == 1, 0.0, 1.0)  # each looks at three
    with pytest.raises(hj.InputError, match="`weights` leave 0 equations for 4 terms"):
        hj.identify(recording, Duhem(), weights=[weights])


class Trapezoids(AbstractFormulation):
    """The change of the output over each sample interval: one equation less."""

    def count(self, samples):
        return samples - 1

    def equations(self, library, path, w):
        u, du = path.samples()
        terms = library(w, u, du, library.signals(path))
        return (terms[1:] + terms[:-1]) / 2 * jnp.diff(path.t)[:, None], jnp.diff(w)


class Fitting(AbstractRegression):
    answer: Any = eqx.field(static=True)

    def fit(self, problem):
        return self.answer(problem.target)


class Estimating(AbstractDifferentiation):
    answer: Any = eqx.field(static=True)

    def estimate(self, t, y):
        return self.answer(y)


@pytest.mark.parametrize(
    "own, message",
    [
        (
            {"formulation": Trapezoids(), "weights": [np.ones(41)]},
            "`Trapezoids` makes 40 equations .* tells 41: override `weights` in Trap",
        ),
        (
            {"regression": Fitting(np.sin)},
            "`fit` of Fitting asks for .*`jax.numpy` for",
        ),
        (
            {"regression": Fitting(lambda y: y)},
            r"`fit` of Fitting must return a `regression.Fit`.*got an array of shape",
        ),
        ({"differentiation": Estimating(np.sin)}, "`estimate` of Estimating asks for"),
        (
            {"differentiation": Estimating(lambda y: y)},
            r"`estimate` of Est.*two arrays of shape \(41,\).*; got an array of shape",
        ),
        (
            {"differentiation": Estimating(lambda y: (y, y[1:]))},
            r"got an array of shape \(41,\) and an array of shape \(40,\)",
        ),
    ],
)
def test_a_piece_of_ones_own_that_answers_wrongly_is_named(unchecked, own, message):
    t = np.linspace(0, 4, 41)
    record = Recording(t, np.sin(t), np.cos(t))
    with pytest.raises(InputError, match=message):
        hj.identify(record, Duhem(), **own)


def test_smoothing_helps_with_noise(rich_record):
    noise = np.random.default_rng(1).normal(size=len(rich_record))
    noisy = eqx.tree_at(lambda r: r.w, rich_record, rich_record.w + 0.01 * noise)
    errors = {}
    for name, method in (
        ("plain", FiniteDifference()),
        ("smooth", SavitzkyGolay(41, 3)),
    ):
        found = hj.identify(noisy, Duhem(), LeastSquares(), differentiation=method)
        terms = found.value.terms()
        errors[name] = max(abs(terms[k] - DUHEM[k]) for k in DUHEM)
    assert errors["smooth"] < errors["plain"] / 2 and errors["smooth"] < 0.02


# ------------------------------------------------------------------- form of the answer


def test_the_model_carries_names_and_units(rich_record):
    named = Recording(
        rich_record.t,
        rich_record.u,
        rich_record.w,
        names=("voltage", "stroke"),
        units=("V", "µm"),
    )
    model = hj.identify(named, Duhem()).value
    assert (model.names, model.units) == (named.names, named.units)
    assert model.coefficient_units()["du"] == "µm V^-1"
    assert eqx.tree_equal(model.fitted_range, hj.models.FittedRange.of([named]))


def test_terms_are_those_of_degree_two_where_none_are_given(duhem_record):
    found = hj.identify(duhem_record).value
    assert found.library.names == Polynomial(2).names
    assert eqx.tree_equal(found, hj.identify(duhem_record, Polynomial(2)).value)


def test_stats(duhem_record):
    solution = hj.identify(duhem_record, Polynomial(2), STLSQ(0.05))
    assert set(solution.stats) == {"num_steps", "residual", "novelty", "problem"}
    assert 2 <= solution.stats["num_steps"] <= 21
    problem = solution.stats["problem"]
    again = STLSQ(0.05).fit(problem).coefficients
    np.testing.assert_allclose(again, solution.value.coefficients, rtol=1e-12)
    assert solution.stats["novelty"].shape == (21,)
    assert np.all((solution.stats["novelty"] >= 0) & (solution.stats["novelty"] <= 1))
    single = hj.identify(duhem_record, Duhem(), Ridge(1e-6))
    assert single.stats["num_steps"] == 1


def test_an_empty_support_is_reported(duhem_record):
    with pytest.raises(ComputationError, match="`threshold`: lower that") as caught:
        hj.identify(duhem_record, Duhem(), STLSQ(1e3))
    assert caught.value.result == RESULTS.empty_support
    quiet = hj.identify(duhem_record, Duhem(), STLSQ(1e3), throw=False)
    assert quiet.result == RESULTS.empty_support
    assert quiet.value.terms() == {} and str(quiet.value) == "w' = 0"


def test_of_a_device_that_falls_the_sign_is_to_be_turned():
    u = np.sin(np.linspace(0, 20, 400))
    library = hj.library.Play([0.1, 0.3]) + Library((Term.parse("u"),))
    arguments = library, NonNegative()
    how = {"formulation": Direct()}
    with pytest.raises(ComputationError, match="turn the sign"):
        hj.identify(Recording(None, u, -u), *arguments, **how)
    law = hj.identify(Recording(None, -u, -u), *arguments, **how).value
    np.testing.assert_allclose(law.coefficients, [0, 0, 1], atol=1e-9)


def test_candidates_that_are_not_finite_are_reported(duhem_record):
    """And not taken for an empty support: u is zero and less."""
    library = Polynomial(1) + hj.library.Custom({"log": lambda w, u, du: jnp.log(u)})
    with pytest.raises(ComputationError, match=r"NaN or inf.*log\(u\) at u = 0"):
        hj.identify(duhem_record, library)
    quiet = hj.identify(duhem_record, library, throw=False)
    assert quiet.result == RESULTS.not_finite
    with pytest.raises(hj.ComputationError, match=r"candidate term .* NaN or inf"):
        hj.aliases(duhem_record, library)

    def lane(scale):
        recording = Recording(duhem_record.t, duhem_record.u, scale * duhem_record.w)
        return hj.identify(recording, Duhem(), throw=False).result

    # Under `vmap` sizes cannot be looked at before: squares of one lane overflow.
    result = jax.vmap(lane)(jnp.array([1.0, 1e200]))
    lost = jax.vmap(lambda one: one == RESULTS.not_finite)(result)
    np.testing.assert_array_equal(lost, [False, True])


@pytest.mark.parametrize("power", [-160, -100, 100, 160])
@pytest.mark.parametrize("which", ["t", "u", "w"])
def test_numbers_whose_squares_do_not_exist_are_refused(duhem_record, which, power):
    """Of u, |u| and products with the library's degree of two, from 1e77 on."""
    scales = {name: 10.0**power if name == which else 1.0 for name in "tuw"}
    columns = [scales[name] * np.asarray(getattr(duhem_record, name)) for name in "tuw"]
    for record in (Recording(*columns), hj.LongRecording(*columns)):
        with pytest.raises(InputError, match=f"`{which}`.*choose another unit"):
            hj.identify(record, Polynomial(2))


@pytest.mark.parametrize(
    "scales", [(1e-60, 1, 1), (1, 1e70, 1), (1, 1, 1e-70), (1e-9, 1e-70, 1e60)], ids=str
)
def test_numbers_whose_squares_exist_give_the_law(duhem_record, scales):
    _, u, w = scales
    columns = duhem_record.t, duhem_record.u, duhem_record.w
    record = Recording(*(c * x for c, x in zip(scales, columns, strict=True)))
    units = {"du": w / u, "w*|du|": 1 / u, "u*|du|": w / u**2}
    expected = hj.identify(duhem_record, Polynomial(2)).value.terms()
    found = hj.identify(record, Polynomial(2)).value.terms()
    scaled = {name: value * units[name] for name, value in expected.items()}
    assert found == pytest.approx(scaled, rel=1e-6)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"units": ("mV", "µm")}, r"the units of recording 2 are \('mV', 'µm'\)"),
        ({"units": ("V", "")}, r"the units .* those of recording 0 \('V', 'µm'\)"),
        ({"names": ("coil", "x")}, r"the names .* \('coil', 'x'\).*dataclasses.repl"),
    ],
)
def test_recordings_of_several_units_are_not_one_problem(duhem_record, other, message):
    columns = duhem_record.t, duhem_record.u, duhem_record.w
    fields = {"names": ("voltage", "stroke"), "units": ("V", "µm")}
    first, second = (Recording(*columns, **{**fields, **o}) for o in ({}, other))
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    for verb in (
        lambda group: hj.identify(group, Duhem()),
        lambda group: hj.discover(group, Duhem()),
        lambda group: hj.refine(law, group),
    ):
        with pytest.raises(InputError, match=message):
            verb([first, first, second])
    cured = dataclasses.replace(second, **fields)
    both = hj.identify([first, cured], Duhem()).value
    alone = hj.identify(first, Duhem()).value
    np.testing.assert_allclose(both.coefficients, alone.coefficients, rtol=1e-9)


def test_batches_of_noisy_outputs_and_of_thresholds(duhem_record):
    t, u, w = duhem_record.t, duhem_record.u, duhem_record.w
    noise = np.random.default_rng(2).normal(size=(4, len(t)))
    noisy = w + 0.05 * noise
    thresholds = jnp.array([0.01, 0.05, 0.1, 1e3])

    def lane(w, threshold):
        recording = Recording(t, u, w)
        method = STLSQ(threshold, 1e-6)
        return hj.identify(recording, Polynomial(2), method, throw=False)

    batch = jax.jit(jax.vmap(lane))(noisy, thresholds)
    for i in range(4):
        alone = lane(noisy[i], thresholds[i])
        np.testing.assert_array_equal(batch.value.support[i], alone.value.support)
        np.testing.assert_allclose(
            batch.value.coefficients[i], alone.value.coefficients, rtol=1e-8, atol=1e-10
        )
        lane_result = jax.tree.map(lambda leaf, i=i: leaf[i], batch.result)
        assert lane_result == alone.result
    assert alone.result == RESULTS.empty_support


def test_coefficients_are_differentiable_in_the_recording(rich_record):
    """Through differentiation, library and regression, against differences."""
    t, u, w = (x[:800] for x in (rich_record.t, rich_record.u, rich_record.w))
    towards = jnp.cos(3 * t)

    def coefficients(w):
        recording = Recording(t, u, w)
        return hj.identify(
            recording, Duhem(), LeastSquares(), throw=False
        ).value.coefficients

    step = 1e-5
    ahead, behind = coefficients(w + step * towards), coefficients(w - step * towards)
    _, change = jax.jvp(coefficients, (w,), (towards,))
    np.testing.assert_allclose(change, (ahead - behind) / (2 * step), rtol=1e-5)
    backwards = jax.jacrev(coefficients)(w) @ towards
    np.testing.assert_allclose(backwards, change, rtol=1e-8)


T = np.linspace(0, 1, 30)
BAD = {
    "constant input": (
        lambda: hj.identify(Recording(T, 0 * T + 2, T**2), Duhem()),
        r"`u` is constant \(2.0\); without change there is no hysteresis",
    ),
    "constant output": (
        lambda: hj.identify(Recording(T, T**2, 0 * T), Duhem()),
        r"`w` is constant \(0.0\); there is no derivative to explain",
    ),
    "too few samples": (
        lambda: hj.identify(
            Recording(T, T**2, T**3).window(0, 21), Polynomial(2), LeastSquares()
        ),
        r"library of 21 terms needs at least 22 samples, got 21",
    ),
    "no recordings": (lambda: hj.identify([], Duhem()), r"`recordings` is empty"),
    "window too wide": (
        lambda: hj.identify(
            Recording(T, T**2, T**3), Duhem(), differentiation=SavitzkyGolay(31, 3)
        ),
        r"needs at least 31 samples, got 30",
    ),
}


@pytest.mark.parametrize("call, message", BAD.values(), ids=BAD)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_long_records_are_factored_by_rows_as_a_whole_is():
    """Of which the last are fewer than the others, and behind a short one."""
    t = np.linspace(0, 70, 2**16 + 77)
    u = np.sin(t) + 0.3 * np.sin(3.3 * t)
    long = hj.Recording(t, u, np.cos(t) * u + 0.1 * np.sin(5 * t))
    group = (long.window(0, 99), long)
    library = hj.library.Duhem() + hj.library.Play([0.2, 0.5])
    found = hj.identify(group, library, hj.regression.LeastSquares())
    how = hj.formulation.Pointwise(hj.differentiation.FiniteDifference())
    parts = [how.equations(library, each.path, each.w) for each in group]
    rows, target = (np.concatenate(x) for x in zip(*parts, strict=True))
    expected, left, *_ = np.linalg.lstsq(rows, target)
    np.testing.assert_allclose(found.value.coefficients, expected, rtol=1e-8)
    share = np.sqrt(left[0]) / np.linalg.norm(target)
    assert found.stats["residual"] == pytest.approx(share, rel=1e-8)
    assert found.stats["problem"].rows == 2**16 + 77 + 99


@pytest.mark.slow
@pytest.mark.parametrize("weighting", [hj.weighting.Even(), hj.weighting.Bisquare()])
def test_derivatives_by_weights_and_of_weights_are_those_of_differences(weighting):
    """Some weights are 0, given or found."""
    rng = np.random.default_rng(5)
    t = np.linspace(0, 20, 600)
    u = (1 - 0.03 * t) * np.sin(t)
    law = hj.models.SparseModel.from_terms(DUHEM)
    w = np.asarray(hj.simulate(law, hj.Recording(t, u, 0 * u)).w)
    w = w + 1e-4 * rng.normal(size=600)
    w[300] += 1.0  # which Bisquare has no use for
    weight = 0.5 + rng.random(600)
    weight[100:110] = 0
    library = Library([Term.parse(name) for name in ("w", *DUHEM)])

    def coefficient(step):
        record = hj.Recording(t, u, w + step * change)
        weights = [weight + step * np.where(weight > 0, change, 0)]
        how = {"weights": weights, "weighting": weighting}
        found = hj.identify(record, library, LeastSquares(), **how)
        return found.value.coefficients[2]

    change = 1e-2 * rng.normal(size=600)
    h = 1e-7
    expected = (coefficient(h) - coefficient(-h)) / (2 * h)
    assert abs(expected) > 1e-4
    for derivative in (jax.grad, jax.jacfwd):
        assert derivative(coefficient)(0.0) == pytest.approx(float(expected), rel=1e-4)
