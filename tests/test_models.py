import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
from hystjax import InputError
from hystjax._core.compiling import changed
from hystjax.library import Custom, Library, Polynomial, Term
from hystjax.models import (
    BoucWen,
    BoucWenOscillator,
    Dahl,
    Duhem,
    MaxwellSlip,
    SparseModel,
    equation,
)
from hystjax.signals import Signals

RNG = np.random.default_rng(20)
W, U, DU = (jnp.asarray(RNG.normal(size=40)) for _ in range(3))

NOW = Signals(jnp.zeros(40), U, DU)

FIVE = {"1": -0.176, "w": -2.383, "u": 0.58, "du": 0.119, "w*|w|": -0.076}

MODELS = {
    "Duhem": (
        Duhem(0.4, 0.5, 0.25),
        lambda w, u, du: 0.4 * abs(du) * u - 0.5 * abs(du) * w + 0.25 * du,
        {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5},
        "w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|",
    ),
    "Bouc-Wen": (
        BoucWen(5, 0.25, 0.5),
        lambda w, u, du: 5 * du - 0.25 * abs(du) * w - 0.5 * du * abs(w),
        {"du": 5.0, "w*|du|": -0.25, "du*|w|": -0.5},
        "w' = 5 u' - 0.25 w |u'| - 0.5 u' |w|",
    ),
    "Bouc-Wen, n = 1.5": (
        BoucWen(1.0, 0.5, -2.0, 1.5),
        lambda w, u, du: (
            du - 0.5 * abs(du) * w * abs(w) ** 0.5 + 2 * du * abs(w) ** 1.5
        ),
        {"du": 1.0, "w*|du|*|w|^0.5": -0.5, "du*|w|^1.5": 2.0},
        "w' = 1 u' - 0.5 w |u'| |w|^0.5 + 2 u' |w|^1.5",
    ),
    "Bouc-Wen, n = 0.5": (
        BoucWen(1.0, 0.5, 2.0, 0.5),
        lambda w, u, du: (
            du - 0.5 * abs(du) * np.sign(w) * abs(w) ** 0.5 - 2 * du * abs(w) ** 0.5
        ),
        {"du": 1.0, "w*|du|*|w|^-0.5": -0.5, "du*|w|^0.5": -2.0},
        "w' = 1 u' - 0.5 w |u'| |w|^-0.5 - 2 u' |w|^0.5",
    ),
    "sparse": (
        SparseModel.from_terms(FIVE),
        lambda w, u, du: (
            -0.176 - 2.383 * w + 0.58 * u + 0.119 * du - 0.076 * w * abs(w)
        ),
        FIVE,
        "w' = -0.176 - 2.383 w + 0.58 u + 0.119 u' - 0.076 w |w|",
    ),
}


def rates(law):
    """The rate of a law without memory where the signals are these."""
    return jax.vmap(law.rate)(W, (), NOW)


@pytest.mark.parametrize("model, rate, terms, text", MODELS.values(), ids=MODELS)
def test_laws_say_what_they_compute(model, rate, terms, text):
    expected = rate(*map(np.asarray, (W, U, DU)))
    np.testing.assert_allclose(rates(model), expected, rtol=1e-12, atol=1e-14)
    assert model.terms() == terms
    assert str(model) == text
    # The sum of its terms is the law, written with the same equation.
    again = SparseModel.from_terms(model.terms())
    np.testing.assert_allclose(rates(again), expected, rtol=1e-12, atol=1e-14)
    assert str(again) == text


@pytest.mark.parametrize("model, rate, terms, text", MODELS.values(), ids=MODELS)
def test_parameters_are_read_and_replaced(model, rate, terms, text):
    values = model.parameters()
    doubled = model.with_parameters({name: 2 * v for name, v in values.items()})
    assert {n: float(v) for n, v in doubled.parameters().items()} == {
        n: 2 * float(v) for n, v in values.items()
    }
    back = doubled.with_parameters(values)
    np.testing.assert_array_equal(rates(back), rates(model))
    assert str(model) == text  # untouched


@pytest.mark.parametrize(
    "model",
    [
        BoucWen(1.0, 0.5, 0.2, 1.0),
        Dahl(1.0, 2.0),
        SparseModel.from_terms({"du": 0.5, "w*|du|": -1.0}),
        BoucWenOscillator(1.0, 0.1, 1.0, 0.5, 0.5, 0.1),
        MaxwellSlip([600, 400], [1, 2]),  # of whole numbers
    ],
    ids=lambda model: type(model).__name__,
)
def test_numbers_are_given_by_name_as_any_numbers(model):
    names = list(model.parameters())
    assert names
    changed = model.with_parameters({names[0]: 3})
    assert list(changed.parameters()) == names
    assert changed.parameters()[names[0]] == 3.0
    with pytest.raises(InputError, match=r"no parameter 'dampng'.*parameters are"):
        model.with_parameters({"dampng": 1.0})


def test_rates_batch_and_compile():
    law = Duhem(0.4, 0.5, 0.25)
    one = jax.tree.map(lambda leaf: leaf[0], NOW)
    expected = law.rate(W, (), NOW)
    compiled = eqx.filter_jit(law.rate)(W, (), NOW)
    np.testing.assert_allclose(compiled, expected, rtol=1e-14)
    np.testing.assert_allclose(rates(law), expected, rtol=1e-14)
    batch = jax.vmap(lambda beta: Duhem(0.4, beta, 0.25).rate(W[0], (), one))
    slopes = batch(jnp.array([0.0, 1.0])) - batch(jnp.array([1.0, 2.0]))
    np.testing.assert_allclose(slopes, W[0] * abs(DU[0]), rtol=1e-12)


@pytest.mark.parametrize("n", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("written_as", ["Bouc-Wen", "terms"])
def test_bouc_wen_has_a_gradient_at_zero(n, written_as):
    """d(rate)/dw at w = 0 is 0 for n > 1; n = 1 has a corner, with slopes to its sides
    of -(beta |du| + gamma du) and -(beta |du| - gamma du)."""
    law = BoucWen(5.0, 0.25, 0.5, n)
    if written_as == "terms":
        law = SparseModel.from_terms(law.terms())
    zero, du = jnp.array(0.0), jnp.array(2.0)
    now = Signals(zero, zero, du)
    slope = jax.grad(law.rate)(zero, (), now)
    if n > 1:
        assert slope == 0
    else:
        assert -(0.25 + 0.5) * 2 <= slope <= -(0.25 - 0.5) * 2
    gradients = eqx.filter_grad(lambda law: law.rate(zero, (), now))(law)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradients))


@pytest.mark.parametrize("du", [2.0, -2.0])
def test_where_a_law_is_smooth_in_its_output_it_has_its_slope_at_zero(du):
    """w |w|^(n-1) is w for n = 1, and (1 - s w / coulomb)^1 a straight line: their
    slopes by hand, where signs of what is zero are none."""
    now = Signals(jnp.array(0.0), jnp.array(0.0), jnp.array(du))
    law = BoucWen(5.0, 0.25, 0.0)
    assert jax.grad(law.rate)(jnp.array(0.0), (), now) == -0.25 * abs(du)
    friction, slides = Dahl(3.0, 1.5), jnp.array(1.5 * np.sign(du))
    assert jax.grad(friction.rate)(slides, (), now) == -3.0 / 1.5 * abs(du)
    for n in (1.0, 1.5):  # nothing of its slope in n is lost
        by_n = jax.grad(
            lambda n: BoucWen(5.0, 0.25, 0.0, n).rate(jnp.array(0.4), (), now)
        )
        wanted = -0.25 * abs(du) * 0.4**n * np.log(0.4)
        np.testing.assert_allclose(by_n(jnp.array(n)), wanted, rtol=1e-12)


def masked():
    """A law over the 21 terms, of which three take part."""
    library = Polynomial(2)
    values = dict.fromkeys(library.names, 7.0)
    values.update({"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5})
    support = np.isin(library.names, ["du", "u*|du|", "w*|du|"])
    return SparseModel(
        library,
        jnp.array(list(values.values())),
        jnp.asarray(support),
        names=("voltage", "stroke"),
        units=("V", "µm"),
    )


def test_only_the_support_takes_part():
    law, duhem = masked(), Duhem(0.4, 0.5, 0.25)
    assert law.terms() == duhem.terms()
    np.testing.assert_allclose(rates(law), rates(duhem), rtol=1e-12)
    assert law.rate_independent is True
    told = []

    @jax.jit
    def traced(support):
        masked_by = eqx.tree_at(lambda law: law.support, law, support)
        told.append(masked_by.rate_independent)
        return support

    traced(law.support)
    assert told == [None]  # what takes part is not known


def test_compact_is_the_same_law():
    law, small = masked(), masked().compact()
    assert small.library.names == ("du", "w*|du|", "u*|du|")
    assert small.terms() == law.terms() and str(small) == str(law)
    assert (small.names, small.units) == (law.names, law.units)
    np.testing.assert_allclose(rates(small), rates(law), rtol=1e-12)
    assert small.compact() is small
    empty = eqx.tree_at(lambda m: m.support, law, jnp.zeros(21, bool))
    assert empty.compact() is empty and str(empty) == "w' = 0"


def test_compact_under_a_gradient():
    """The support is known, the coefficients are being traced."""

    def score(coefficients):
        law = eqx.tree_at(lambda m: m.coefficients, masked(), coefficients)
        return jnp.sum(rates(law.compact()))

    gradient = jax.grad(score)(masked().coefficients)
    columns = Polynomial(2)(W, U, DU)
    expected = np.where(masked().support, np.sum(columns, axis=0), 0)
    np.testing.assert_allclose(gradient, expected, rtol=1e-12, atol=1e-12)


def test_units_of_coefficients():
    law = SparseModel.from_terms(
        {"1": 1.0, "w": 1.0, "u": 1.0, "du": 1.0, "w*|du|": 1.0, "u^2*|w|^1.5": 1.0},
        units=("V", "µm"),
    )
    assert law.coefficient_units() == {
        "1": "µm s^-1",
        "w": "s^-1",
        "u": "µm V^-1 s^-1",
        "du": "µm V^-1",
        "w*|du|": "V^-1",
        "u^2*|w|^1.5": "µm^-0.5 V^-2 s^-1",
    }
    unknown = SparseModel.from_terms({"w*|w|*|du|": 2.0, "w*du^2": 1.0})
    assert unknown.coefficient_units() == {
        "w*|du|*|w|": "[w]^-1 [u]^-1",
        "w*du^2": "s [u]^-2",
    }


OF_ALL_KINDS = {
    **dict.fromkeys(("du", "w*|du|", "u^2*|w|", "play(u,0.25)"), 0.3),
    **{"lag(u,0.5)": 0.4, "stop(u,0.4)*du": 0.2, "w": -1.5, "sin(2.0*u)*du": 0.1},
}
LAW = SparseModel.from_terms(OF_ALL_KINDS)
MEASURED = (
    Duhem((0.1, 0.4), 0.5, (0.25, 0.1)),
    Duhem(0.4, 0.5, 0.25),
    BoucWen(1.0, 0.5, 0.2, 1.4),
    LAW,
    hj.models.Tellinen(1.2, 0.3, 0.5, 0.05),
    hj.models.ColemanHodgdon(1.1, 0.5, 0.05, 1.5, 0.3),
    Dahl(3.0, 0.8, 1.5),
    hj.models.LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7),
    MaxwellSlip([1.0, 0.6], [0.1, 0.4]),
    hj.models.BoucWenForce(0.2, 3.0, 1.5, 0.8, 1.5),
    hj.models.BoucWenBaberNoori(
        *(0.2, 3.0, 1.5, 0.8, 1.5, 0.05, 0.04, 0.6, 0.1, 0.5, 0.3, 0.02, 0.4)
    ),
    hj.models.RambergOsgood(3.0, 1.1, 4.0),
    hj.models.PrandtlIshlinskii(
        [0.1, 0.3],
        [0.5, 0.4],
        0.2,
        rising=hj.models.Envelope(1.0, 0.9, -0.1, 0.1),
        falling=hj.models.Envelope(1.2, 0.8, 0.1, 0.2),
    ),
    hj.models.Preisach([-2.0, -0.5, 0.6, 2.0], 0.1 * np.arange(6), 0.1),
    hj.models.Everett([0.1, 0.5], [-1.0, 0.2, 1.5], [[0.3, 0.4], [0.2, 0.5]], 0.1),
    hj.models.Everett(
        [0.1, 0.5], [-1.0, 0.2, 1.5], [[0.3, 0.4], [0.2, 0.5]], 0.1, -1, [0.3, -0.1]
    ),
    BoucWenOscillator(1.5, 0.8, 4.0, 1.0, 0.5, 0.2, 1.4),
    hj.models.Oscillator(1.5, 0.8, 4.0, LAW),
    hj.models.Butterfly(LAW, -0.3, 0.1),
    hj.models.Behind(Dahl(3.0, 0.8), "play(u,0.2)"),
    hj.models.Behind(hj.models.RambergOsgood(3.0, 1.1, 4.0), "lag(u,0.3)"),
)


@pytest.mark.slow
@pytest.mark.parametrize("model", MEASURED, ids=lambda model: type(model).__name__)
def test_numbers_are_in_the_units_that_they_say(model):
    """In units of input, output and time that are 4, 1/8 and 2 times as large, numbers
    in those units make the same output."""
    t = 0.05 * np.arange(60)
    u = 0.3 + 1.1 * np.sin(2.1 * t) + 0.3 * np.sin(5.3 * t)
    by_unit = {"u": 4.0, "w": 1 / 8, "s": 2.0}
    model = changed(model, units=("u", "w"))
    told = model.number_units()
    assert set(told.values()) - {""}
    scaled = {
        name: float(value) / _size(told.get(name, ""), by_unit)
        for name, value in model.parameters().items()
    }
    other = hj.Recording(t / 2, u / 4, np.full(60, 8 * 0.2))
    kept = hj.Recording(t, u, np.full(60, 0.2))
    run, same = (
        hj.simulate(each, record, method=hj.simulation.FixedStep(2)).w
        for each, record in ((model, kept), (model.with_parameters(scaled), other))
    )
    assert np.ptp(run) > 0.1
    np.testing.assert_allclose(np.asarray(same) / 8, run, rtol=0, atol=1e-11)


def _size(unit, by_unit):
    """A unit in terms of others, such as `w u^-0.5`."""
    powers = (factor.partition("^") for factor in unit.split())
    sizes = (by_unit.get(symbol, 1.0) ** float(p or 1) for symbol, _, p in powers)
    return math.prod(sizes)


def test_units_of_ferromagnets_are_those_of_the_field():
    device = hj.models.JilesAtherton(8e5, 40.0, 50.0, 1e-4, 0.2, units=("A/m", "T"))
    inverse = hj.models.InverseJilesAtherton(device, units=("T", "A/m"))
    own = dict.fromkeys(("saturation", "width", "pinning"), "A/m")
    assert device.number_units() == own
    assert inverse.number_units() == {f"device.{name}": "A/m" for name in own}


def test_units_behind_instruments_are_those_of_the_device_where_it_has_some():
    spring = Dahl(3.0, 0.8, units=("mm", "N"))
    of_volts = {"units": ("V", "µm"), "input_gain": 2.0, "output_gain": 0.5}
    seen = hj.models.Instrumented(spring, **of_volts, input_offset=0.1, delay=0.01)
    assert seen.number_units() == {
        **{"stiffness": "N mm^-1", "coulomb": "N", "input_offset": "mm"},
        **{"input_gain": "mm V^-1", "output_gain": "µm N^-1", "delay": "s"},
    }
    begun = hj.models.Started(seen, (), units=("V", "µm"))
    assert begun.number_units() == seen.number_units()
    plain = hj.models.Instrumented(
        Dahl(3.0, 0.8), **of_volts, input_offset=0.1, output_offset=0.2, delay=0.01
    )
    assert plain.number_units() == {
        **{"stiffness": "µm V^-1", "coulomb": "µm", "input_offset": "V"},
        **{"input_gain": "", "output_gain": "", "output_offset": "µm", "delay": "s"},
    }


def test_a_device_behind_a_lag_of_no_time_is_the_device():
    """Its flow sees the rate of the input, too."""
    t = np.linspace(0.0, 6.0, 61)
    record = hj.Recording(t, np.sin(2 * t), 0 * t)
    device = hj.models.Dahl(3.0, 0.8)
    model = hj.models.Behind(device, "lag(u,0.3)").with_parameters({"lag.time": 0.0})
    method = hj.simulation.FixedStep(2)
    found, expected = (
        hj.simulate(each, record, method=method).w for each in (model, device)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_a_batch_of_laws_is_not_one_law():
    batch = jax.vmap(lambda c: SparseModel(Polynomial(1), c, jnp.ones(6, bool)))(
        jnp.ones((3, 6))
    )
    for call in (batch.addends, batch.terms):
        with pytest.raises(InputError, match=r"a batch of laws.*shape \(3, 6\)"):
            call()
    one = jax.tree.map(lambda leaf: leaf[1], batch)
    assert len(one.terms()) == 6


@pytest.mark.parametrize("laws", [2, 3])
def test_terms_of_a_batch_of_laws_are_changed_law_by_law(laws):
    """Not of other laws either, where there are as many as terms."""
    law = SparseModel.from_terms({"du": 0.5, "u*|du|": 0.2, "w*|du|": -0.6})
    values = jnp.arange(1.0, laws + 1)
    along = jax.vmap(lambda law, x: law.with_parameters({"du": x}), (None, 0))
    batch = along(law, values)
    expected = [[x, 0.2, -0.6] for x in values]
    np.testing.assert_array_equal(batch.coefficients, expected)
    again = jax.vmap(lambda law, x: law.with_parameters({"du": x}))(batch, 2 * values)
    np.testing.assert_array_equal(again.coefficients[:, 0], 2 * values)
    with pytest.raises(InputError, match=rf"a batch of laws.*shape \({laws}, 3\)"):
        batch.with_parameters({"du": values})


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("call", [hj.simulate, hj.judge, hj.invert, hj.control])
def test_a_batch_is_told_of_where_one_law_is_needed(call):
    batch = jax.vmap(lambda c: SparseModel(Polynomial(1), c, jnp.ones(6, bool)))(
        jnp.ones((3, 6))
    )
    t = np.linspace(0, 1, 9)
    with pytest.raises(InputError, match=r"a batch of (laws|models)"):
        call(batch, hj.Recording(t, np.sin(t), np.sin(t)))


@pytest.mark.parametrize(
    "one",
    [
        lambda x: hj.models.Dahl(x, 1.2),
        lambda x: BoucWen(x, 1.0, 0.5, 1.5),
        lambda x: hj.models.Oscillator(x, 0.4, 2.2, hj.models.Dahl(3.0, 1.2)),
        lambda x: hj.models.Instrumented(hj.models.Dahl(3.0, 1.2), delay=x),
        lambda x: hj.models.Started(
            hj.models.PrandtlIshlinskii([0.1, 0.4], [1.0, 1.0]), x * jnp.ones(2)
        ),
    ],
)
def test_a_batch_of_models_is_shown_by_its_arrays(one):
    batch = jax.vmap(one)(jnp.ones(3))
    assert "f64[3" in repr(batch) and repr(batch).startswith(type(batch).__name__)
    assert str(batch) == repr(batch)


def test_traced_laws_have_a_text():
    texts = []

    @jax.jit
    def trace(alpha):
        texts.append(str(Duhem(alpha, 0.5, 0.25)))
        return alpha

    trace(0.4)
    assert "Duhem" in texts[0]


@pytest.mark.parametrize(
    "terms, text",
    [
        ({"u": -1e-7}, "w' = -1e-07 u"),
        ({"1": 2.0, "w": 0.0, "u": 123456.0}, "w' = 2 + 1.235e+05 u"),
        ({"sin(0.5*u)": -1.5, "du": 1.0}, "w' = -1.5 sin(0.5 u) + 1 u'"),
    ],
)
def test_equations(terms, text):
    assert str(SparseModel.from_terms(terms)) == text


def test_equations_to_more_digits():
    law = SparseModel.from_terms({"u": 123456.0})
    assert equation(law, digits=6) == "w' = 123456 u"


def test_laws_with_custom_terms():
    library = Custom({"tanh_u": lambda w, u, du: jnp.tanh(u)})
    library = library + Library((Term.parse("w"),))
    law = SparseModel(library, jnp.array([2.0, -1.0]), jnp.ones(2, bool))
    np.testing.assert_allclose(rates(law), 2 * np.tanh(U) - W, rtol=1e-12)
    assert str(law) == "w' = 2 tanh_u - 1 w"
    assert law.coefficient_units() == {"tanh_u": "?", "w": "s^-1"}


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: SparseModel.from_terms({}), "at least one term"),
        (lambda: SparseModel.from_terms({"z": 1.0}), "'z' in the term 'z'"),
        (lambda: SparseModel.from_terms({"w*u": 1.0, "u*w": 2.0}), "got twice"),
        (
            lambda: BoucWen(1.0, 1.0, 1.0, -1),
            "`n` must be at least 0 and finite, got -1",
        ),
    ],
)
def test_errors(call, message):
    with pytest.raises(InputError, match=message):
        call()
