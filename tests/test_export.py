import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy
from matplotlib.mathtext import MathTextParser

import hystjax as hj
from hystjax import InputError
from hystjax.export import to_latex, to_python, to_sympy, to_text
from hystjax.library import Custom, Fourier, Polynomial
from hystjax.models import BoucWen, Duhem, SparseModel
from hystjax.signals import Signals

PIEZO = {"1": -0.176, "w": -2.388, "u": 0.5807588971580465, "w*|w|": -7.5e-20}


def every_second(library):
    k = len(library)
    coefficients = jnp.asarray(np.random.default_rng(k).normal(size=k))
    return SparseModel(library, coefficients, jnp.arange(k) % 2 == 0)


MODELS = {
    "piezo": SparseModel.from_terms(PIEZO, units=("V", "µm")),
    "cubic": every_second(Polynomial(3)),
    "Fourier": every_second(Fourier((0.5, -2)) * Fourier((1 / 3,), "|du|")),
    "constant": SparseModel.from_terms({"1": 0.3}),
    "nothing": SparseModel.from_terms({"w": 0.0}),
    "Duhem": Duhem(0.4, 0.5, 0.25),
    "BoucWen": BoucWen(1.0, 0.5, -0.2),
    "BoucWen, n = 3": BoucWen(1.0, 0.5, 0.2, 3),
    "BoucWen, n = 1.7": BoucWen(1.0, 0.5, 0.2, 1.7),
    "BoucWen, n = 0.5": BoucWen(1.0, 0.5, 0.2, 0.5),
    # Negative powers of 0 count as 0.
    "roots": SparseModel.from_terms(
        {"|w|^-0.5": 1.0, "u*|w|^-2": 0.5, "|du|^-0.5": 2.0, "w*|w|^-1": 0.7}
    ),
    "another frequency": SparseModel.from_terms({"sin(2.0*u)": 1.0}).with_parameters(
        {"sin(2.0*u).multiple": jnp.asarray(1 / 3)}
    ),
}
SOME = np.random.default_rng(0).normal(size=(3, 200))
ZEROS = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 0.0, -3.0]])
POINTS = np.concatenate([SOME, ZEROS], axis=1)


def rates(model, points):
    """The rate of a law where output, input and its derivative are these."""
    w, u, du = jnp.asarray(points)
    return jax.vmap(model.rate)(w, (), Signals(jnp.zeros_like(u), u, du))


def rate_from(source):
    namespace = {}
    exec(source, namespace)
    return namespace["rate"]


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_exported_python_computes_the_law(model):
    rate = rate_from(to_python(model))
    expected = rates(model, POINTS)
    np.testing.assert_allclose(rate(*POINTS), expected, rtol=1e-13, atol=1e-14)
    assert rate(*POINTS).shape == expected.shape
    np.testing.assert_allclose(rate(*SOME[:, 0]), expected[0], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_sympy_expression_is_the_law(model):
    symbols = sympy.symbols("w u du", real=True)
    expression = to_sympy(model)
    assert expression.free_symbols <= set(symbols)
    function = sympy.lambdify(symbols, expression, "numpy")
    with np.errstate(divide="ignore"):  # NumPy computes all branches
        found = function(*POINTS)
    np.testing.assert_allclose(found, rates(model, POINTS), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("export", [hj.export.to_c, hj.export.to_numpy])
def test_a_run_that_blows_up_is_no_test(export):
    """Though its numbers are finite: one step a sample is far too long."""
    bristles = hj.models.LuGre(100.0, 0.1, 4e-4, 1.0, 1.5, 10.0)
    t = np.linspace(0, 2, 501)
    record = hj.Recording(t, 2 * np.sin(2 * np.pi * t), 0 * t)
    record = hj.Recording(t, record.u, hj.simulate(bristles, record).w)
    once = hj.simulate(bristles, record, method=hj.simulation.FixedStep(1), throw=False)
    assert 1e9 < np.max(np.abs(once.w[:400])) < np.inf
    with pytest.raises(InputError, match="sampled more finely"):
        export(bristles, record=record)


def test_exported_python_documents_names_and_units():
    names, units = ("drive", "stroke"), ("V", "µm")
    source = to_python(Duhem(0.1, 0.2, 1 / 3, names=names, units=units))
    documentation = rate_from(source).__doc__
    assert "w' = 0.3333 u' + 0.1 u |u'| - 0.2 w |u'|" in documentation
    assert "w: stroke, in µm." in documentation
    assert "u: drive, in V." in documentation
    assert "in µm per second" in documentation
    assert "0.3333333333333333 * du" in source  # full precision, not as printed


def test_hostile_names_stay_text():
    hostile = 'x"""\nraise SystemExit\n"""\\'
    rate = rate_from(to_python(Duhem(1.0, 2.0, 3.0, names=(hostile, "{law}\0"))))
    assert rate(1.0, 1.0, 1.0) == 2.0
    assert 'u: x""" raise SystemExit """\\.' in rate.__doc__


def test_text_and_latex():
    model = Duhem(0.4, 1 / 3, 1.25e-7)
    assert to_text(model) == "w' = 1.25e-07 u' + 0.4 u |u'| - 0.3333 w |u'|"
    assert to_text(model, digits=2).endswith("- 0.33 w |u'|")
    assert to_latex(model) == (
        r"\dot{w} = 1.25 \times 10^{-7}\,\dot{u} + 0.4\,u\,|\dot{u}|"
        r" - 0.3333\,w\,|\dot{u}|"
    )
    assert to_latex(model, digits=1).endswith(r"- 0.3\,w\,|\dot{u}|")
    assert to_latex(MODELS["nothing"]) == r"\dot{w} = 0"
    assert to_latex(SparseModel.from_terms({"1": -1e6, "u^2": 1})) == (
        r"\dot{w} = -1 \times 10^{6} + 1\,u^{2}"
    )


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_latex_is_mathematics(model):
    MathTextParser("path").parse(f"${to_latex(model)}$")  # raises when it is not


@pytest.mark.parametrize("export", [to_text, to_latex])
def test_digits_must_be_positive(export):
    with pytest.raises(InputError, match="`digits` must be at least 1, got 0"):
        export(MODELS["Duhem"], digits=0)


@pytest.mark.parametrize("export", [to_text, to_latex, to_sympy, to_python])
def test_what_is_no_model_is_told_of_by_the_call(export):
    nothing = hj.Solution(None, hj.RESULTS.successful, {})
    with pytest.raises(InputError, match=rf"`{export.__name__}\(model\)`"):
        export(nothing)


@pytest.mark.parametrize("radius", [0.30000000000000004, 0.10002015038739072, 0.3])
def test_numbers_inside_of_operators_are_exact_in_sympy(radius):
    expression = to_sympy(SparseModel.from_terms({f"play(u,{radius})": 1.0}))
    (play,) = expression.atoms(sympy.Function)
    assert float(play.args[1]) == radius


def test_functions_of_your_own():
    library = Custom({"knee": lambda w, u, du: jnp.tanh(w)}) + Polynomial(1, ("u",))
    model = SparseModel(library, jnp.array([2.0, 0.0, 3.0]), jnp.ones(3, bool))
    w, u, du = sympy.symbols("w u du", real=True)
    assert to_sympy(model) == 2.0 * sympy.Function("knee")(w, u, du) + 3.0 * u
    with pytest.raises(InputError, match=r"'knee'.*by hand.*hystjax\.save"):
        to_python(model)


@pytest.mark.parametrize(
    "one",
    [
        MODELS["piezo"],
        hj.models.PrandtlIshlinskii([0.0, 0.1], [1.0, 1.0]),
        hj.models.MaxwellSlip([1.0, 2.0], [0.1, 0.4]),
        hj.models.BoucWen(0.8, 0.5, 0.4),
        hj.models.JilesAtherton(1.0, 0.3, 0.6, 0.1, 0.2),
    ],
    ids=lambda one: type(one).__name__,
)
def test_a_batch_is_refused(one):
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf] * 4), one)
    exports = to_text, to_latex, to_sympy, to_python, hj.export.to_numpy, hj.export.to_c
    for export in exports:
        with pytest.raises(InputError, match=r"one device .* batch"):
            export(batch)


class ByIf(hj.models.AbstractLaw):
    def rate(self, x, m, now):
        return x if now.du > 0 else -x


@pytest.mark.parametrize("export", [to_text, to_python, hj.export.to_c])
def test_a_law_that_is_not_written_in_jax_is_no_batch(export):
    with pytest.raises(InputError, match=r"^`rate` of ByIf asks for .*`if x > 0:`"):
        export(ByIf())


@pytest.mark.parametrize("export", [to_latex, to_sympy, to_python, hj.export.to_c])
def test_a_number_that_is_none_is_named(export):
    lost = MODELS["Duhem"].with_parameters({"beta": np.nan})
    with pytest.raises(InputError, match="`beta` of this Duhem is NaN"):
        export(lost)


def test_a_law_of_the_value_may_hold_the_rate_of_the_input():
    law = SparseModel.from_terms({"u": 1.0, "u*|du|": 0.5}, target="value")
    namespace = {}
    exec(to_python(law), namespace)
    u, du = np.array([1.0, -2.0]), np.array([-3.0, 0.5])
    np.testing.assert_allclose(namespace["value"](u, du), u + 0.5 * u * np.abs(du))


def test_numbers_in_terms_are_shown_as_they_are():
    law = SparseModel.from_terms({"u": 1.0, "play(u,0.1)": 1.0}, target="value")
    moved = law.with_parameters({"play(u,0.1).radius": 0.25})
    assert str(moved) == to_text(moved) == "w = 1 u + 1 play(u, 0.25)"
    two = SparseModel.from_terms(
        {"play(u,0.1)": 1.0, "play(u,0.2)": 1.0}, target="value"
    )
    one = two.with_parameters({"play(u,0.2).radius": 0.1})  # no library holds it twice
    assert str(one) == "w = 2 play(u, 0.1)"


def test_a_power_of_creep_is_one_of_all_that_it_is_a_product_of():
    law = SparseModel.from_terms({"creep(u,0.1,10.0)^2": 1.0}, target="value")
    namespace = {}
    exec(to_python(law), namespace)
    # Far out lags have settled: each decade has crept by one step of the input.
    memory = namespace["after"](namespace["start"](0.0), 0.0, 3.0, 1e-9)
    for _ in range(2):
        memory = namespace["after"](memory, 3.0, 3.0, 1e3)
    np.testing.assert_allclose(namespace["value"](3.0, memory), (2 * 3.0) ** 2)
