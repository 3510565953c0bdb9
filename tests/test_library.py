import math

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pysindy
import pytest
import sympy
from hypothesis import given

from hystjax import InputError
from hystjax.library import (
    VARIABLES,
    BoucWen,
    Custom,
    Duhem,
    Fourier,
    Kind,
    Lag,
    Library,
    Play,
    Plays,
    Polynomial,
    Staircase,
    Stop,
    Term,
    kind,
)
from hystjax.signals import Linear

RNG = np.random.default_rng(4)
W, U, DU = (jnp.asarray(RNG.normal(size=30)) for _ in range(3))
COLUMNS = np.stack([W, U, DU, np.abs(DU), np.abs(W)], axis=1)
PLAIN = [Term.parse(name).factors[0][0] for name in VARIABLES]


def test_the_library_of_the_paper():
    degree_2 = (
        "1 w u du |du| |w| w^2 w*u w*du w*|du| w*|w| u^2 u*du u*|du| u*|w| du^2 "
        "du*|du| du*|w| |du|^2 |du|*|w| |w|^2"
    )
    assert Polynomial(2).names == tuple(degree_2.split())
    assert Polynomial(3).names[:21] == Polynomial(2).names


@pytest.mark.parametrize("constant", [True, False])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
@pytest.mark.parametrize(
    "variables", [VARIABLES, ("w", "u", "du", "|du|"), ("u",)], ids=len
)
def test_polynomials_equal_pysindy(variables, degree, constant):
    library = Polynomial(degree, variables, constant=constant)
    chosen = COLUMNS[:, [VARIABLES.index(name) for name in variables]]
    reference = pysindy.PolynomialLibrary(degree=degree, include_bias=constant)
    expected = np.asarray(reference.fit_transform(chosen))
    assert len(library) == math.comb(len(variables) + degree, degree) - (not constant)
    np.testing.assert_allclose(library(W, U, DU), expected, rtol=1e-13)
    shown = [
        "*".join(name.split()) for name in reference.get_feature_names(list(variables))
    ]
    assert list(library.names) == shown


def test_the_order_of_variables_is_fixed():
    assert Polynomial(2, ("du", "w")) == Polynomial(2, ("w", "du"))


@pytest.mark.parametrize(
    "library, names",
    [
        (Duhem(), "du |du| w*|du| u*|du|"),
        (
            Duhem(2),
            "du |du| w*|du| u*|du| w^2*|du| w*u*|du| u^2*|du|",
        ),
        (BoucWen(), "du w*|du| du*|w|"),
        (BoucWen(2), "du w*|du|*|w| du*|w|^2"),
        (BoucWen(3), "du w*|du|*|w|^2 du*|w|^3"),
        (Fourier((1, 0.5)), "sin(1.0*u) cos(1.0*u) sin(0.5*u) cos(0.5*u)"),
        (Fourier((2,), "|du|"), "sin(2.0*|du|) cos(2.0*|du|)"),
        # A union holds each term once, a product each product once.
        (BoucWen() + Duhem(), "du w*|du| du*|w| |du| u*|du|"),
        (Polynomial(1, ("w", "u")) * Polynomial(1, ("w", "u")), "1 w u w^2 w*u u^2"),
        (
            Fourier((1,)) * Polynomial(1, ("w",), constant=False),
            "w*sin(1.0*u) w*cos(1.0*u)",
        ),
        (
            Fourier((1,)) * Fourier((1,)),
            "sin(1.0*u)^2 cos(1.0*u)*sin(1.0*u) cos(1.0*u)^2",
        ),
    ],
)
def test_term_sets(library, names):
    assert library.names == tuple(names.split())


def test_columns_of_other_libraries():
    library = Fourier((2, 0.5), "w") + Custom(
        {"tanh": lambda w, u, du: jnp.tanh(u), "swing": lambda w, u, du: w * du}
    )
    library = library * Polynomial(1, ("du",))
    bases = [np.sin(2 * W), np.cos(2 * W), np.sin(W / 2), np.cos(W / 2)]
    bases += [np.tanh(U), W * DU]
    expected = np.stack([b * c for b in bases for c in (np.ones(30), DU)], axis=1)
    np.testing.assert_allclose(library(W, U, DU), expected, rtol=1e-13)
    assert library.names[-2:] == ("swing", "du*swing")
    jitted = eqx.filter_jit(library)(W, U, DU)
    np.testing.assert_array_equal(jitted, library(W, U, DU))


def test_lists_are_columns():
    """One row a sample: 1, u and u'; and the product of the last two."""
    w, u, du = [0.0, 0.0], [1.0, 2.0], [3.0, 5.0]
    columns = Polynomial(1, ("u", "du"))(w, u, du)
    np.testing.assert_array_equal(columns, [[1, 1, 3], [1, 2, 5]])
    np.testing.assert_array_equal(Term.parse("u*du")(w, u, du), [3, 10])


# ----------------------------------------------------------------------------- memory

PATH = Linear().path(jnp.arange(5.0), jnp.array([0.0, 1.0, -1.0, 0.5, 0.5]))


def test_signals_at_times_in_a_list():
    """A play of radius 0.25: pulled up until 1, then down from 1 - 2 * 0.25."""
    times, expected = [0.0, 0.5, 1.0, 1.125, 1.5], [0.0, 0.25, 0.75, 0.75, 0.25]
    (found,) = Play([0.25]).signals(PATH, times).values()
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_plays_and_staircases_take_lists():
    """A play of radius 0.25, and how many of the levels 0, 1 are below the highest
    input since it was last at -1, or at 0."""
    plays = Plays([0.25]).at_samples(PATH)
    np.testing.assert_array_equal(plays[:, 0], [0, 0.75, -0.75, 0.25, 0.25])
    heights = Staircase([-1, 0, 1], "down").at_samples(PATH)
    expected = [[1, 0], [2, 2], [0, 0], [1, 1], [1, 1]]
    np.testing.assert_array_equal(heights, expected)


@pytest.mark.parametrize("of", ["u", "play(u,0.25)"])
def test_a_lag_of_no_time_is_what_it_is_of(of):
    library = Lag([0.5], of=of).with_numbers({f"lag({of},0.5).time": 0.0})
    found = library.signals(PATH)[f"lag({of},0.5)"]
    expected = PATH.signals().u if of == "u" else Plays([0.25]).at_samples(PATH)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)
    assert library.settled().names == (f"play({of},0.0)",)


# ------------------------------------------------------------------------------ terms

whole = st.integers(0, 9)
magnitude = whole | st.floats(-3, 9)
sines = Fourier((1, -0.25, 1e-7), "du") + Fourier((3,))
factors = st.sampled_from([term.factors[0] for term in sines.terms])
powers = st.tuples(whole, whole, whole, magnitude, magnitude)
# Arguments of Term: type checks use random numbers, which strategies must not.
terms = st.tuples(
    powers.map(lambda each: list(zip(PLAIN, each, strict=True))),
    st.lists(factors, max_size=2),
).map(lambda both: both[0] + both[1])


@given(terms)
def test_names_read_back(term):
    term = Term(term)
    assert Term.parse(term.name) == term
    assert Term.parse(term.name).name == term.name


@given(terms, terms)
def test_products_commute_and_multiply(a, b):
    a, b = Term(a), Term(b)
    assert a * b == b * a
    assert (a * b).degree == pytest.approx(a.degree + b.degree)
    arguments = jnp.array([0.7]), jnp.array([1.1]), jnp.array([0.9])
    product = a(*arguments) * b(*arguments)
    np.testing.assert_allclose((a * b)(*arguments), product, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "degree"),
    [
        ("1", 0),
        ("sin(2.0*u)", 1),
        ("w*sin(2.0*u)", 2),
        ("u^2*cos(0.5*w)*sin(1.0*u)", 4),
        ("w*|w|^0.5*f", 2.5),
        ("f", 1),
    ],
)
def test_every_factor_counts_as_one_in_the_degree(name, degree):
    """By which terms are searched, and laws hardly told apart are chosen."""
    assert Term.parse(name, {"f": lambda w, u, du: jnp.exp(u)}).degree == degree


values = st.floats(-3, 3).filter(lambda x: abs(x) > 1e-2)


@given(terms, values, values, values)
def test_symbols_say_what_is_computed(term, w, u, du):
    """SymPy's value of the symbol is the value of the term."""
    term = Term(term)
    expression = term.sympy()
    symbols = sympy.symbols("w u du", real=True)
    expected = sympy.lambdify(symbols, expression, "numpy")(w, u, du)
    ours = term(jnp.array(w), jnp.array(u), jnp.array(du))
    np.testing.assert_allclose(ours, expected, rtol=1e-9)


def test_custom_functions_have_symbols():
    term = Custom({"tanh_u": lambda w, u, du: jnp.tanh(u)}).terms[0] * Term.parse("w")
    symbols = sympy.symbols("w u du", real=True)
    modules = [{"tanh_u": lambda w, u, du: np.tanh(u)}, "numpy"]
    evaluate = sympy.lambdify(symbols, term.sympy(), modules)
    np.testing.assert_allclose(term(W, U, DU), evaluate(W, U, DU), rtol=1e-13)
    function = term.factors[1][0].function
    assert Term.parse("w*tanh_u", {"tanh_u": function}) == term


@pytest.mark.parametrize(
    "name, text, latex",
    [
        ("1", "1", "1"),
        ("w*|du|", "w |u'|", r"w\,|\dot{u}|"),
        ("u^2*du", "u^2 u'", r"u^{2}\,\dot{u}"),
        ("du*|w|^1.5", "u' |w|^1.5", r"\dot{u}\,|w|^{1.5}"),
        ("w*sin(0.5*u)", "w sin(0.5 u)", r"w\,\sin(0.5\,u)"),
        ("cos(2.0*|du|)", "cos(2 |u'|)", r"\cos(2\,|\dot{u}|)"),
    ],
)
def test_how_terms_are_written(name, text, latex):
    term = Term.parse(name)
    assert (term.name, term.text, term.latex) == (name, text, latex)


@pytest.mark.parametrize(
    "loose, canonical",
    [
        ("|w|*w", "w*|w|"),
        ("w*w", "w^2"),
        ("1*u", "u"),
        ("u^0", "1"),
        ("sin(2*u)*w", "w*sin(2.0*u)"),
        ("sin(2*u)^2", "sin(2.0*u)^2"),
        ("sin(2*u)*sin(2.0*u)", "sin(2.0*u)^2"),
        ("|w|^2.0", "|w|^2"),
    ],
)
def test_names_are_made_canonical(loose, canonical):
    assert Term.parse(loose).name == canonical


def test_factors_of_one_kind_keep_their_order_and_make_equal_terms():
    """A fit changes the numbers in names: sorted by these, its states and numbers would
    change places."""
    names = "play(u,0.3)*play(u,0.16)", "play(u,0.16)*play(u,0.3)"
    one, other = map(Term.parse, names)
    assert (one.name, other.name) == names
    assert one == other and hash(one) == hash(other)
    assert Term.parse("lag(u,0.5)*play(u,0.1)").name == "play(u,0.1)*lag(u,0.5)"
    moved = one.with_numbers({"play(u,0.3).radius": 0.1})
    assert moved.name == "play(u,0.1)*play(u,0.16)"
    waves = "sin(9.0*u)*sin(10.0*u)", "sin(10.0*u)*sin(9.0*u)"
    assert tuple(Term.parse(name).name for name in waves) == waves


@pytest.mark.parametrize("power", [0.25, 0.5, 1.0, 1.5, -0.5])
def test_terms_with_a_root_have_a_derivative_at_zero(power):
    """d/dw of w |w|^p at w = 0: 0 for every p > 0; the term is 0 there for p > -1."""
    w, *_, magnitude = PLAIN
    term = Term([(w, 1), (magnitude, power)])
    value, slope = jax.value_and_grad(lambda w: term(w, w, w))(jnp.array(0.0))
    assert (value, slope) == (0, 0)


@pytest.mark.parametrize(
    "name",
    [
        "", "*", "w*", "x", "W", "w * u", "w^", "w^-1", "w^0.5", "w^²", "^2", "|w|^x",
        "sin(u)", "sin(2*x)", "sin(nan*u)", "sin(a*u)", "tan(2*u)", "sin(2*u)^0.5",
        "__import__('os').system('touch evil')", "w*(lambda: 1)()", "exec('1')", "2",
    ],
)  # fmt: skip
def test_names_are_never_evaluated(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="in the term"):
        Term.parse(name)
    assert not list(tmp_path.iterdir())


BAD = {
    "degree 0": (
        lambda: Polynomial(0),
        "`degree` must be at least 1, got 0",
    ),
    "degree 60": (lambda: Polynomial(60), "has 8259888 terms, and at most 100000"),
    "degree 1.5": (lambda: Polynomial(1.5), "whole number, got the number 1.5"),
    "unknown variable": (lambda: Polynomial(2, ("w", "x")), r"names out of w, u, du"),
    "one string": (lambda: Polynomial(2, "wu"), "must be a tuple of names, got 'wu'"),
    "no variables": (lambda: Polynomial(2, ()), "different names"),
    "variable twice": (lambda: Polynomial(2, ("w", "w")), "different names"),
    "Bouc-Wen exponent": (lambda: BoucWen(1.5), "whole number, got the number 1.5"),
    "Duhem degree": (lambda: Duhem(0), "at least 1, got 0"),
    "no multiples": (lambda: Fourier(()), "`multiples` is empty"),
    "multiple twice": (lambda: Fourier((1, 1)), r"got twice: \['cos\(1.0\*u\)"),
    "Fourier variable": (lambda: Fourier((1,), "x"), "names out of w, u, du"),
    "custom variable": (
        lambda: Custom({"u": jnp.sin}),
        "the name 'u' of a custom term",
    ),
    "custom expression": (lambda: Custom({"u + 1": jnp.sin}), "Python identifier"),
    "no terms": (lambda: Library(()), "at least one term, got none"),
    "term twice": (lambda: Library((Term(), Term())), r"got twice: \['1'\]"),
    "negative power": (lambda: Term([(PLAIN[0], -1)]), "w must be a whole number from"),
    "root of w": (lambda: Term([(PLAIN[0], 0.5)]), "whole number from 0, got 0.5"),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("call, message", BAD.values(), ids=BAD)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("du", Kind.MEMORYLESS),
        ("du u*du sin(2.0*u)*du", Kind.MEMORYLESS),
        ("w u", Kind.LINEAR),
        ("1 w u du", Kind.LINEAR),
        ("du u*|du| w*|du|", Kind.RATE_INDEPENDENT),
        ("du w*|du| du*|w|", Kind.RATE_INDEPENDENT),
        ("|du|", Kind.RATE_INDEPENDENT),
        ("du*sin(2.0*w)", Kind.RATE_INDEPENDENT),
        ("w u |w|", Kind.RATE_DEPENDENT),
        ("w u du*|du|", Kind.RATE_DEPENDENT),
        ("du w*|du| w", Kind.RATE_DEPENDENT),
        ("du*sin(2.0*du)", Kind.RATE_DEPENDENT),
        ("du du^2", Kind.RATE_DEPENDENT),
    ],
)
def test_kinds_of_laws(names, expected):
    """By their definitions: a law of degree one in the rate takes the same course twice
    as fast; one without memory is the slope of an output that u alone decides; a linear
    one has the superposition of two courses."""
    terms = tuple(map(Term.parse, names.split()))
    assert kind(terms) is kind(terms[::-1]) is expected
    law = Library(terms)

    def rate(w, u, du):
        return jnp.sum(law(w, u, du), axis=-1)

    independent = jnp.allclose(rate(W, U, 2 * DU), 2 * rate(W, U, DU))
    forwards_and_back = rate(W, U, DU) + rate(W + 1, U, -DU)
    memoryless = bool(independent) and jnp.allclose(forwards_and_back, 0)
    still = rate(0 * W, 0 * U, 0 * DU)
    sums = rate(W + U, U + DU, DU + W), rate(W, U, DU) + rate(U, DU, W) - still
    assert memoryless == (expected is Kind.MEMORYLESS)
    assert (independent and not memoryless) == (expected is Kind.RATE_INDEPENDENT)
    if not independent:
        assert jnp.allclose(*sums) == (expected is Kind.LINEAR)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("1 u u^2 sin(2.0*u)", Kind.MEMORYLESS),
        ("u play(u,0.1)", Kind.RATE_INDEPENDENT),
        ("u lag(u,0.1)", Kind.LINEAR),
        ("u^2 lag(u,0.1)", Kind.RATE_DEPENDENT),
    ],
)
def test_kinds_of_laws_of_the_value(names, expected):
    """A function of the input has no memory, plays have one that no rate changes."""
    assert kind(map(Term.parse, names.split()), of_rate=False) is expected


def test_of_functions_of_ones_own_nothing_is_known():
    library = Custom({"f": lambda w, u, du: u**2})
    assert kind(library.terms) is Kind.RATE_DEPENDENT


@pytest.mark.parametrize(
    "made",
    [
        lambda: Play([0.1]) + Lag([2.0]),
        lambda: Lag([5.0, 20.0]),
        lambda: Play([2.0, 10.0]) + Stop([0.3]),
        lambda: Fourier([2.0, 10.0]),
    ],
)
def test_numbers_have_one_order_inside_of_programs_and_outside(made):
    library = made()
    inside = jax.tree.map(lambda x: x, library)
    assert list(library.numbers) == list(inside.numbers)
    moved = library.with_numbers(dict.fromkeys(reversed(library.numbers), 3.0))
    assert list(moved.numbers) == list(library.numbers)
