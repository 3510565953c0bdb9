"""Networks beside laws: what they add, and whether they are kept."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fits import fit_of

import hystjax as hj
from hystjax.discovery import _complete
from hystjax.discovery._layout import weighted_error
from hystjax.library import Library, Term
from hystjax.models import Hybrid, SparseModel
from hystjax.reproduce import _hybrid
from hystjax.signals import Signals
from hystjax.simulation import FixedStep

KEY = jax.random.key(3)
LAW = SparseModel.from_terms({"u*|du|": 0.4, "w*|du|": -0.5, "du": 0.25})
MORE = {"u^2*du": 0.1}  # that the law misses
T = np.linspace(0, 12, 361)
U = 1.5 * np.sin(1.7 * T) * np.exp(-0.03 * T) + 0.5 * np.sin(4.1 * T)


def recorded(more=(), noise=0.02):
    law = SparseModel.from_terms(LAW.terms() | dict(more))
    w = np.asarray(hj.simulate(law, hj.Recording(T, U, 0 * T), method=FixedStep(2)).w)
    error = np.random.default_rng(1).normal(size=len(T)) * noise * np.std(w)
    return hj.Recording(T, U, w + error, names=("a", "b"), units=("V", "µm"))


def trained(speed=2.0, seed=0):
    """A model of which both parts do something."""
    network = eqx.nn.MLP(3, "scalar", 4, 1, jnp.tanh, key=jax.random.key(seed))
    return Hybrid(LAW, network, (0.1, 0.2), (1.5, 0.8), speed)


# ------------------------------------------------------------------------------ model


def test_an_untrained_network_leaves_the_law_as_it_is():
    record = recorded()
    hybrid = Hybrid.untrained(LAW, record, width=2, key=KEY)
    assert (hybrid.names, hybrid.units) == (record.names, record.units)
    law, both = (
        hj.simulate(model, record, method=FixedStep()).w for model in (LAW, hybrid)
    )
    np.testing.assert_allclose(both, law, rtol=0, atol=1e-15 * float(jnp.max(law)))
    np.testing.assert_allclose(
        hybrid.centre, [np.ptp(x) / 2 + min(x) for x in (U, record.w)]
    )
    np.testing.assert_allclose(hybrid.reach, [np.ptp(x) / 2 for x in (U, record.w)])
    assert hybrid.size == 3 + 2 * 5 + 1


@pytest.mark.parametrize("speed", [None, 2.0])
def test_a_resting_input_is_left_to_the_law(speed):
    hybrid = trained(speed)
    added = jax.jit(lambda du: hybrid.added(jnp.array(0.3), jnp.array(0.7), du))
    assert float(added(0.0)) == 0 and float(added(0.4)) != 0


def test_without_a_speed_only_the_way_counts():
    hybrid = trained(None)
    assert hybrid.rate_independent and not trained().rate_independent
    added = jax.jit(lambda du: hybrid.added(jnp.array(0.2), jnp.array(0.5), du))
    for du in (0.3, -0.3):
        assert float(added(4 * du)) == pytest.approx(4 * float(added(du)), rel=1e-14)
    assert float(added(0.3)) != -float(added(-0.3))
    rated = SparseModel.from_terms({"w": -1.0, "u": 1.0})
    assert Hybrid.untrained(LAW, recorded(), key=KEY).speed is None
    assert float(Hybrid.untrained(rated, recorded(), key=KEY).speed) == pytest.approx(
        np.sqrt(np.mean((np.diff(U) / np.diff(T)) ** 2))
    )


def test_parameters_are_those_of_both_and_are_put_back():
    hybrid = trained()
    values = hybrid.parameters()
    assert set(LAW.parameters()) < set(values)
    assert "network.layers.0.weight[3,2]" in values
    changed = hybrid.with_parameters({name: 2 * x for name, x in values.items()})
    for name, x in changed.parameters().items():
        assert float(x) == 2 * float(values[name])
    assert changed.numbers() == {name: 2 * x for name, x in LAW.terms().items()}
    known = hj.models.FittedRange.of([recorded()])
    assert eqx.tree_equal(hybrid.fitted_on(known).fitted_range, known)
    measured = Hybrid(LAW, hybrid.network, units=("V", "µm")).number_units()
    assert measured == {"u*|du|": "µm V^-2", "w*|du|": "V^-1", "du": "µm V^-1"}
    assert "times a network 3-4-1 of u, w and u'" in str(hybrid)


def test_derivatives_are_those_of_differences():
    hybrid = trained()
    names = list(hybrid.parameters())
    at = jnp.stack([*hybrid.parameters().values(), jnp.array(0.3)])
    now = Signals(*map(jnp.array, (0.0, 0.5, -1.1)))

    def rate(values):
        model = hybrid.with_parameters(dict(zip(names, values, strict=False)))
        return model.rate(values[-1], (), now)

    @jax.jit
    def both(step):
        ends = jax.vmap(lambda h: rate(at + h) - rate(at - h))(step * jnp.eye(len(at)))
        return jax.grad(rate)(at), ends / (2 * step)

    np.testing.assert_allclose(*both(1e-6), atol=1e-9)


def test_slips_are_named(unchecked):
    value = SparseModel.from_terms({"u": 1.0}, target="value")
    network = trained().network
    wide = eqx.nn.MLP(2, "scalar", 4, 1, key=KEY)
    for arguments, said in (
        ((value, network), "law of the rate"),
        ((LAW, wide), "got one from 2 to scalar"),
        ((LAW, eqx.nn.Linear(3, "scalar", key=KEY)), "`MLP`.*got a Linear"),
        ((LAW, network, (0.0, 0.0), (1.0, -1.0)), "`reach` must be positive"),
        ((LAW, network, (0.0, 0.0), 2.0), r"`reach` must hold two.*shape \(\)"),
        ((LAW, network, "middle"), "must be real numbers.*got the text 'middle'"),
        ((LAW, network, (0.0, np.nan)), r"and not NaN; got nan at \[1\]"),
        ((LAW, network, np.zeros(3)), r"`centre` must hold two.*shape \(3,\)"),
    ):
        with pytest.raises(hj.InputError, match=said):
            Hybrid(*arguments)
    for arguments, said in (
        ((LAW, []), "`recordings` is empty"),
        ((LAW, 3), "`recordings` must be a `Recording`, got the number 3"),
        ((3, recorded()), "law of the rate.*got the number 3"),
    ):
        with pytest.raises(hj.InputError, match=said):
            Hybrid.untrained(*arguments, key=KEY)
    with pytest.raises(hj.InputError, match=r"law of the rate.*a SparseModel"):
        hj.complete(value, recorded(), key=KEY)
    short = recorded().window(0, 50)
    with pytest.raises(hj.InputError, match="too short to leave out blocks"):
        hj.complete(fit_of(LAW).solution(), short, key=KEY)


# --------------------------------------------------------------------------- complete


def fitted(errors, keeps=0.0, beyond=1.0):
    return _complete._Fitted(None, {}, np.array(errors), keeps, beyond)


@pytest.mark.parametrize(
    ("errors", "more", "kept", "said"),
    [
        ([1.0, 1.1, 1.2], {}, True, "which is kept"),
        # By more than one standard error, though the blocks differ by more.
        ([2.0, 1.75, 1.0], {}, True, "which is kept"),
        # Better on the whole, but not by more than the blocks differ.
        ([0.1, 2.1, 2.1], {}, False, "only learned noise"),
        ([2.1, 2.1, 2.1], {}, False, "only learned noise"),
        # Squares fall by 0.3 in the mean of three, whose standard error is 0.35.
        (np.sqrt([4.1, 4.0, 3.0]), {}, False, "only learned noise"),
        ([1.0, 1.1, 1.2], {"keeps": 0.2}, False, "does not forget"),
        ([1.0, 1.1, 1.2], {"beyond": np.inf}, False, "runs away"),
        ([1.0, 1.1, 1.2], {"beyond": 3.2}, False, "runs away"),
    ],
)
def test_blocks_left_out_decide(errors, more, kept, said):
    law, network = fitted([2.0, 2.0, 2.0]), fitted(errors, **more)
    decided, why = _complete._verdict(law, network, 0.1, "µm")
    assert decided == kept and said in why and "2 µm" in why
    assert _complete._verdict(law, network, 0.0, "µm")[0] == (kept or "keeps" in more)


def test_where_a_run_is_lost_no_network_is_kept():
    whole, lost = fitted([2.0, 2.0, 2.0]), fitted([1.0, 1.1, np.inf])
    for law, network, said in (
        (whole, lost, "with the network the free run is lost"),
        (lost, whole, "free run of the law alone is lost"),
    ):
        kept, why = _complete._verdict(law, network, 0.1, "µm")
        assert not kept and said in why


def test_what_a_network_adds_is_told_in_the_same_terms_in_all_units():
    model, record = trained(), recorded()
    library = hj.library.Polynomial(3)
    plain = _complete._offers(model, (record,), library, 2)
    a, b = 1e6, 1e-9  # input and output in other units
    terms = {"u*|du|": 0.4 * b / a**2, "w*|du|": -0.5 / a, "du": 0.25 * b / a}
    law = SparseModel.from_terms(terms)
    centre, reach = (np.array(x) * (a, b) for x in (model.centre, model.reach))
    same = Hybrid(law, model.network, centre, reach, model.speed * a)
    scaled = hj.Recording(T, a * record.u, b * record.w)
    other = _complete._offers(same, (scaled,), library, 2)
    assert len(plain) == len(other) > 1
    for ours, theirs in zip(other, plain, strict=True):
        assert ours.terms.keys() == theirs.terms.keys()
        within = SparseModel.from_terms(theirs.terms).library
        units = within(*jnp.array([b, a, a]), {}) / within(*jnp.ones(3), {})
        expected = np.array([theirs.terms[name] for name in within.names]) * b / units
        found = [ours.terms[name] for name in within.names]
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        assert ours.share == pytest.approx(theirs.share, rel=1e-9)


def test_an_offer_is_what_least_squares_along_the_free_run_leave_less():
    """Than the law's own terms alone do; and the law with both is their sum."""
    model, record = trained(), recorded()
    run = hj.simulate(model, record, method=FixedStep(2))
    u, du = record.path.samples()
    added = np.asarray(jax.vmap(model.added)(run.w, u, du))

    def left(names):
        library = SparseModel.from_terms(dict.fromkeys(names, 1.0)).library
        columns = np.asarray(library(run.w, u, du, {}))
        columns = columns / np.linalg.norm(columns, axis=0)
        return np.sum((added - columns @ np.linalg.lstsq(columns, added)[0]) ** 2)

    own = model.law.terms()
    for offer in _complete._offers(model, (record,), hj.library.Polynomial(3), 2):
        share = 1 - left(offer.terms) / left(own)
        assert offer.share == pytest.approx(share, abs=1e-6)
        sums = {name: own.get(name, 0.0) + x for name, x in offer.terms.items()}
        assert offer.law.terms() == pytest.approx(sums, rel=1e-12)


def test_functions_of_ones_own_are_offered_beside_those_of_a_law():
    """As the terms that they are, which their names do not tell."""
    damp = hj.library.Custom({"damp": lambda w, u, du: w * jnp.abs(du)})
    cube = hj.library.Custom({"cube": lambda w, u, du: u**2 * du})
    own = damp + Library((Term.parse("du"),))
    law = SparseModel(own, jnp.array([-0.5, 0.25]), np.ones(2, bool))
    model = Hybrid(law, trained().network, (0.1, 0.2), (1.5, 0.8), 2.0)
    (offer,) = _complete._offers(model, (recorded(),), cube, 2)
    assert offer.law.library.terms == (*own.terms, *cube.terms)
    sums = {name: law.terms().get(name, 0.0) + x for name, x in offer.terms.items()}
    assert offer.law.terms() == pytest.approx(sums, rel=1e-12)


def test_errors_on_blocks_are_in_the_unit_of_the_output():
    """Whatever the scale of the weights, and of those that have some."""
    residuals = jnp.array([[1.0, -2.0, jnp.inf, 3.0]])
    for scale in (1.0, 100.0):
        weight = scale * jnp.array([[1.0, 3.0, 0.0, 0.0]])
        weighted = jnp.sqrt(weight) * jnp.array([[1.0, -2.0, 0.0, 3.0]])
        error = weighted_error(weighted, weight)
        assert float(error) == pytest.approx(np.sqrt((1 + 3 * 4) / 4), rel=1e-12)
    assert weighted_error(residuals, jnp.zeros((1, 4))) == 0
    assert weighted_error(residuals, jnp.ones((1, 4))) == jnp.inf


@pytest.mark.usefixtures("unchecked")
def test_radii_and_times_stay_those_of_the_law_beside_a_network(monkeypatch):
    """In the fit before, and in those that the network is judged by."""
    law, fixed = SparseModel.from_terms({"play(u,0.3)": 0.4, "lag(u,2)": 0.1}), []

    class Enough(Exception):
        pass

    def refined(law, group, **options):
        fixed.append(set(options["fixed"]))
        fitted = [name for name in law.parameters() if name not in options["fixed"]]
        return fit_of(law, fitted).solution()

    def fitted(laid_out, model, names, *_):
        fixed.append(set(names))
        raise Enough

    monkeypatch.setattr(_complete, "refine", refined)
    monkeypatch.setattr(_complete, "_fitted", fitted)
    monkeypatch.setattr(_complete, "layout", lambda *_: SimpleNamespace(count=6))
    with pytest.raises(Enough):
        hj.complete(law, hj.Recording(T, U, U), key=KEY, width=2)
    assert len(law.library.numbers) == 2
    assert fixed == [set(law.library.numbers)] * 2


@pytest.mark.usefixtures("unchecked")
def test_what_a_fit_was_told_of_stays_beside_a_network(monkeypatch):
    """Numbers that were fixed, tied or known have no error."""
    held = []

    class Enough(Exception):
        pass

    def fitted(laid_out, model, names, *_):
        held.extend(names)
        raise Enough

    monkeypatch.setattr(_complete, "_fitted", fitted)
    monkeypatch.setattr(_complete, "layout", lambda *_: SimpleNamespace(count=6))
    first, *others = LAW.parameters()
    with pytest.raises(Enough):
        hj.complete(fit_of(LAW, [first]).solution(), recorded(), key=KEY, width=2)
    assert held == others


@pytest.mark.parametrize("told", [False, True])
def test_outputs_of_no_weight_do_not_scale_the_network(monkeypatch, told):
    """Whether weights are given, or told by the fit of the law, with those of what led
    in before them."""

    class Enough(Exception):
        pass

    def untrained(law, group, **_):
        raise Enough(*group)

    monkeypatch.setattr(Hybrid, "untrained", untrained)
    weights = np.where((T > 2) & (T < 3), 0.0, 1.0)
    record = hj.Recording(T, U, np.where(weights > 0, U, 1e6))
    before = np.concatenate([np.zeros_like(weights), weights])
    law = fit_of(LAW, weights=[before] if told else None).solution()
    given = None if told else [weights]
    with pytest.raises(Enough) as seen:
        hj.complete(law, record, key=KEY, width=2, weights=given)
    (given,) = seen.value.args
    np.testing.assert_allclose(given.w, np.interp(T, T[weights > 0], U[weights > 0]))


@pytest.mark.slow
def test_a_network_is_kept_for_what_a_law_misses_and_told_in_terms():
    found = hj.complete(LAW, recorded(MORE), key=KEY, width=4)
    assert found.stats["kept"] and isinstance(found.value, Hybrid)
    law, both = (
        np.sqrt(np.mean(found.stats[x] ** 2)) for x in ("law_errors", "errors")
    )
    assert both < 0.7 * law
    first, *_ = found.stats["offers"]
    assert set(first.terms) == set(LAW.terms()) | set(MORE)
    assert 0.5 < first.share <= 1  # four units make no parabola
    again = hj.refine(first.law, recorded(MORE)).value
    for name, x in (LAW.terms() | MORE).items():
        assert again.terms()[name] == pytest.approx(x, rel=0.1)


@pytest.mark.slow
def test_a_network_is_refused_where_a_law_misses_nothing():
    found = hj.complete(LAW, recorded(), key=KEY, width=4)
    assert not found.stats["kept"] and found.stats["offers"] == ()
    assert isinstance(found.value, SparseModel)
    assert "it only learned noise" in found.stats["why"]
    # Yet on what it was fitted to it follows better: that is what noise is learned by.
    fits = (
        float(hj.judge(model, recorded()).errors["rmse"])
        for model in (found.stats["trained"], found.value)
    )
    assert next(fits) < next(fits)


# -------------------------------------------------------------------------- the study


def test_the_table_has_a_line_for_each_device():
    row = _hybrid.Completed("a", "b", 45, 2.0, 3.0, 1.0, 4.0, False, "why", "")
    head, line = _hybrid.HybridTable("title", (row,)).cells()
    assert len(head) == len(line)
    assert line == ("a", "b", "45", "2", "3", "1", "4", "no")


@pytest.mark.thorough
def test_networks_beside_laws_that_miss_nothing_are_refused():
    assert sum(_hybrid.missing_nothing(range(20))) <= 1


@pytest.mark.recordings
@pytest.mark.thorough
def test_a_network_takes_the_law_of_the_piezo_to_its_noise():
    found = _hybrid.piezo()
    assert found.kept and found.numbers < 200
    assert found.own_with <= 0.126 and found.unseen_with <= 0.149
