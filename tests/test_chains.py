"""Signals of signals: plays, stops and lags behind one another, exactly."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play
from scipy.integrate import solve_ivp

import hystjax as hj
from hystjax import InputError
from hystjax.library import AbstractMemory, Lag, Play, Stop, Term
from hystjax.models import SparseModel
from hystjax.regression.formulation import Direct
from hystjax.signals import Cubic
from hystjax.simulation import Adaptive, FixedStep

RNG = np.random.default_rng(8)
T = np.linspace(0.0, 12.0, 241)
U = np.sin(2 * T) * np.exp(-T / 15) + 0.3 * np.sin(0.7 * T)
RECORD = hj.Recording(T, U, U + T)


def value_law(**terms):
    named = {name.replace(" ", ""): c for name, c in terms.items()}
    return SparseModel.from_terms(named, target="value")


CHAINS = {
    "stop(u,0.3)": lambda u: u - play(u, 0.3),
    "play(play(u,0.1),0.3)": lambda u: play(play(u, 0.1), 0.3),
    "stop(play(u,0.2),0.25)": lambda u: play(u, 0.2) - play(play(u, 0.2), 0.25),
    "play(stop(u,0.5),0.2)": lambda u: play(u - play(u, 0.5), 0.2),
    "stop(stop(play(u,0.05),0.6),0.2)": lambda u: (lambda s: s - play(s, 0.2))(
        play(u, 0.05) - play(play(u, 0.05), 0.6)
    ),
}


@pytest.mark.parametrize("method", [FixedStep(1), Adaptive()], ids=repr)
def test_plays_and_stops_behind_one_another_are_exact(method):
    """A law of all of them, and of a static curve behind one."""
    names = list(CHAINS)
    coefficients = dict(zip(names, [1.0, 0.5, -0.7, 0.3, 2.0], strict=True))
    law = value_law(**coefficients, **{"stop(u,0.3)^3": 0.4})
    expected = sum(c * CHAINS[name](U) for name, c in coefficients.items())
    expected = expected + 0.4 * CHAINS["stop(u,0.3)"](U) ** 3
    ran = hj.simulate(law, RECORD, method=method)
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=1e-13)


def test_the_short_way_is_the_long_one_behind_others_too():
    u = np.sin(np.linspace(0, 30, 1500)) * np.exp(-np.linspace(0, 1, 1500))
    path = hj.Recording(None, u, u).path
    library = Play([0.1, 0.2], of="play(u,0.1)") + Stop([0.3], of="stop(u,0.4)")
    for name, found in jax.jit(lambda path: library.signals(path))(path).items():
        expected = {
            "play(u,0.1)": play(u, 0.1),
            "stop(u,0.4)": u - play(u, 0.4),
            "play(play(u,0.1),0.1)": play(play(u, 0.1), 0.1),
            "play(play(u,0.1),0.2)": play(play(u, 0.1), 0.2),
            "stop(stop(u,0.4),0.3)": (lambda s: s - play(s, 0.3))(u - play(u, 0.4)),
        }[name]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14, err_msg=name)


def lagged(signal, tau, ends, fine=4000):
    """z of tau z' = signal - z by SciPy over a fine grid, on which the signal is
    straight; `ends` are times."""
    t = np.unique(np.r_[np.linspace(ends[0], ends[-1], fine), ends])
    x = signal(t)
    ran = solve_ivp(
        lambda t_, z: (np.interp(t_, t, x) - z) / tau,
        (t[0], t[-1]),
        [x[0]],
        "LSODA",
        t_eval=ends,
        rtol=1e-10,
        atol=1e-11,
        max_step=t[1] - t[0],
    )
    return ran.y[0]


@pytest.mark.parametrize(
    ("inner", "shape"),
    [
        ("stop(play(u,0.2),0.3)", "straight"),
        ("play(u,0.2)", "smooth"),
        ("stop(u,0.4)", "smooth"),
    ],
)
def test_lags_of_them_are_exact_where_they_start_and_stop_within_a_step(inner, shape):
    """Against SciPy; with a few samples a cycle, so that starts and stops are all
    inside of steps."""
    t = T[:121:6]
    if shape == "straight":
        record = hj.Recording(t, U[:121:6], t)
        u = lambda x: np.interp(x, t, U[:121:6])  # noqa: E731
    else:
        record = hj.Recording(t, U[:121:6], t, interpolation=Cubic())
        u = lambda x: np.asarray(record.path.at(jnp.asarray(x))[0])  # noqa: E731
    law = value_law(**{f"lag({inner},0.4)": 1.0})
    ran = hj.simulate(law, record, method=FixedStep(2))
    chain = {
        "play(u,0.2)": lambda u: play(u, 0.2),
        "stop(u,0.4)": lambda u: u - play(u, 0.4),
        "stop(play(u,0.2),0.3)": lambda u: play(u, 0.2) - play(play(u, 0.2), 0.3),
    }[inner]
    expected = lagged(lambda x: chain(u(x)), 0.4, t)
    # The fine grid of the reference misses where they start by half of a step.
    np.testing.assert_allclose(ran.w, expected, rtol=0, atol=2e-6)


@pytest.mark.slow
def test_their_derivatives_are_differences():
    names = ("play(u,0.1).radius", "lag(play(u,0.1),0.5).time")
    law = value_law(**{"lag(play(u,0.1),0.5)": 1.0, "stop(play(u,0.1),0.3)": 0.7})

    def output(radius, time):
        changed = law.with_parameters(dict(zip(names, (radius, time), strict=True)))
        w = hj.simulate(changed, RECORD, method=FixedStep(1)).w
        return jnp.sum(jnp.cos(jnp.arange(len(T))) * w)

    point, h = (jnp.asarray(0.1), jnp.asarray(0.5)), 1e-7
    output = jax.jit(output)
    found = jax.jit(jax.jacfwd(output, (0, 1)))(*point)
    for i in range(2):
        ends = [
            output(*(x + (i == j) * s * h for j, x in enumerate(point)))
            for s in (1, -1)
        ]
        np.testing.assert_allclose(found[i], (ends[0] - ends[1]) / (2 * h), rtol=1e-5)


def test_names_are_read_back_and_files_too(tmp_path):
    for name in (*CHAINS, "lag(stop(play(u,0.1),0.3),0.5)", "u*stop(u,0.3)^2"):
        assert Term.parse(name).name == name
    for bad in ("play(lag(u,0.5),0.1)", "lag(lag(u,0.5),1.0)", "stop(w,0.1)"):
        with pytest.raises(InputError, match=r"in the term .* is neither a variable"):
            Term.parse(bad)
    with pytest.raises(InputError, match="lag of a lag"):
        Lag([0.5], of="lag(u,0.1)")
    law = value_law(**dict.fromkeys(CHAINS, 1.0))
    hj.save(tmp_path / "law.json", law)
    back = hj.load(tmp_path / "law.json")
    assert isinstance(back, SparseModel) and back.terms() == law.terms()
    moved = law.with_parameters({"play(u,0.1).radius": jnp.asarray(0.15)}).settled()
    assert "play(play(u,0.15),0.3)" in moved.terms()
    with pytest.raises(InputError, match="signals of other signals"):
        hj.export.to_python(law)
    assert "stop" in hj.export.to_latex(law)


@pytest.mark.slow
def test_a_law_behind_a_backlash_is_identified_and_refined():
    """A spring that slides, behind a play, with a static curve; radii are found from a
    guess near them."""
    inner = play(U, 0.1)
    stop = inner - play(inner, 0.3)
    w = 2.0 * stop - 1.5 * stop**3 + 0.1 * U
    record = hj.Recording(T, U, w + 1e-4 * RNG.normal(size=len(T)))
    behind = Stop([0.25], of="play(u,0.12)")
    library = behind + behind * behind * behind + hj.library.Polynomial(1, ("u",))
    law = hj.identify(
        record, library, hj.regression.LeastSquares(), formulation=Direct()
    )
    found = hj.refine(law.value, record).value
    numbers = found.parameters()
    for name, value in numbers.items():
        if name.endswith("radius"):
            expected = 0.1 if name.startswith("play") else 0.3
            assert float(value) == pytest.approx(expected, abs=2e-3), name
    ran = hj.simulate(found, record).w
    assert float(hj.metrics.nrmse(w, ran)) < 1e-3


@pytest.mark.parametrize("interpolation", [hj.interpolation.Linear(), Cubic()])
def test_all_steps_at_once_are_one_step_after_the_other(interpolation):
    """Decays are passed on from step to step, and all else is done side by side."""
    record = hj.Recording(T, U, U + T, interpolation=interpolation)
    names = ("lag(u,0.4)", "lag(play(u,0.1),2.0)", "lag(stop(play(u,0.2),0.25),0.3)")
    memory = hj.library.Library([Term.parse(name) for name in names]).memory
    grid, first = record.path.grid(2), memory.first(record.path)
    together = eqx.filter_jit(memory.along)(first, grid)
    stepped = eqx.filter_jit(AbstractMemory.along)(memory, first, grid)
    for fast, slow in zip(*map(jax.tree.leaves, (together, stepped)), strict=True):
        np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-14)
