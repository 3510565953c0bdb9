import classical_equations as by_hand
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exported import MORE as OTHERS

import hystjax as hj
from hystjax import RESULTS, InputError, models
from hystjax._core.compiling import depends
from hystjax.inversion import _follow, _invert
from hystjax.reproduce import reproduce
from hystjax.simulation import FixedStep

LAW = models.SparseModel.from_terms
T = np.linspace(0, 20, 401)
SMOOTH = 0.2 + np.exp(-T / 15) * np.sin(2.5 * T)
TRIANGLES = 2 * np.abs((0.37 * T) % 1 * 2 - 1) - 1
STEPS = FixedStep(1)

DUHEM = LAW({"du": 0.25, "u*|du|": 0.05, "w*|du|": -0.1, "1": 0.01})
STACK = models.PrandtlIshlinskii([0.0, 0.1, 0.25, 0.5], [0.3, 0.4, 0.3, 0.2], 0.7)
MAGNET = models.JilesAtherton(1.2 / models._jiles_atherton.MU0, 0.4, 0.5, 1e-7, 0.2)
EVERETT = models.Everett(
    [0.0, 0.2, 0.4], [-1.2, -0.5, 0.0, 0.5, 1.2], np.full((3, 4), 0.5)
)
CREEP = {"du": 0.3, "w": -0.2, "u": 0.1, "play(u,0.1)": 0.2, "lag(u,0.5)": 0.1}
MORE = {
    "everett": EVERETT,
    "creep": LAW(CREEP),
    "magnet": MAGNET,
    "tellinen": models.Tellinen(1.2, 0.3, 0.5, 0.05),
    "boucwen": models.BoucWen(1.0, 0.5, 0.2, 1.5),
    "dahl": models.Dahl(3.0, 3.1),
    "force": models.BoucWenForce(0.2, 3.0, 0.8, 0.4, 1.5),
    "pinched": models.BoucWenBaberNoori(
        0.2, 3.0, 1.5, 0.8, 1.5, 0.05, 0.04, 0.6, 0.1, 0.5, 0.3, 0.02, 0.4
    ),
    "masing": models.RambergOsgood(3.0, 1.1, 4.0),
    "lugre": models.LuGre(5.0, 0.2, 0.1, 0.6, 0.9, 0.7),
    "slip": models.MaxwellSlip([1.0, 0.6, 0.3, 0.2], [0.1, 0.4, 0.9, 9.0]),
    "coleman": OTHERS["coleman"],
    "duhem": models.Duhem(0.1, 0.1, 0.25),
    "inverse": OTHERS["inverse"],
    "gauged": models.Instrumented(models.Duhem(0.1, 0.1, 0.25), 1.1, 0.1, 2.0, 0.3),
    "envelopes": OTHERS["envelopes"],
    "started": OTHERS["started"],
    "value": LAW({"u": 0.5, "play(u,0.2)": 0.1, "lag(u,0.5)": 0.3}, target="value"),
}


def driven(model, u):
    """A record of what the model does, within its reach for that."""
    record = hj.Recording(T, u, np.full_like(T, 0.2))
    return hj.Recording(T, u, hj.simulate(model, record, method=STEPS).w)


def follows(model, tolerance=1e-9):
    for u in (SMOOTH, TRIANGLES):
        record = driven(model, u)
        found = hj.invert(model, record, method=STEPS)
        assert found.result == RESULTS.successful
        again = hj.Recording(T, found.value.u, record.w)
        off = hj.simulate(model, again, method=STEPS).w - record.w
        size = np.ptp(record.w)
        # The last output is not made by an input where it sees the derivative.
        assert np.max(np.abs(off[:-1])) < tolerance * size
        assert np.max(np.abs(found.value.error[:-1])) < tolerance * size


def test_the_output_follows():
    follows(DUHEM)


SLOW = ["everett", "magnet", "lugre", "boucwen", "value"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_the_output_of_other_families_follows(name):
    follows(MORE[name])


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(MORE.keys() - {*SLOW}))
def test_the_output_of_all_families_follows(name):
    follows(MORE[name])


@pytest.mark.parametrize("sign", [1, -1])
def test_plays_in_parallel_are_inverted_exactly(sign):
    stack = models.PrandtlIshlinskii(STACK.radii, sign * STACK.weights, 0.7)
    follows(stack, 1e-12)
    for u in (SMOOTH, TRIANGLES):
        found = hj.invert(stack, driven(stack, u))
        np.testing.assert_allclose(found.value.u, u, rtol=0, atol=1e-12)
        assert np.all(found.stats["margin"] == 0.3)


@pytest.mark.parametrize(
    "how", [pytest.param(lambda f: f, marks=pytest.mark.slow), jax.jit]
)
def test_of_several_inputs_that_would_do_the_near_one_is_found(how):
    """Close to saturation two steps an interval have another root far above; beyond it
    they have some too, where the device has none."""
    law = LAW({"du": 1.0, "w*|du|": -0.8, "w": -0.2})
    t = np.linspace(0, 12, 361)
    u = 3 * np.sin(1.7 * t) * np.exp(-0.03 * t) + np.sin(4.1 * t)
    rest = hj.Recording(t, u, np.zeros(361))
    w = hj.simulate(law, rest, method=FixedStep(8)).w

    def inverse(w):
        found = hj.invert(law, w, t=t)
        return found.value.u, found.stats["reached"]

    run = how(inverse)
    found, reached = run(w)
    np.testing.assert_allclose(found, u, atol=1e-4)
    assert np.all(reached)
    # Twice as much it has for some samples: none more than 1 / 0.8.
    _, reached = run(2 * w)
    most = np.argmax(np.abs(2 * w) > 1.25)
    assert most > 2 and np.all(reached[: most - 1]) and not np.any(reached[most:])


@pytest.mark.slow
def test_windows_remember_what_was_before():
    record = driven(STACK, SMOOTH)
    later = record.window(150, 401)
    np.testing.assert_allclose(
        hj.invert(STACK, later).value.u, SMOOTH[150:], rtol=0, atol=1e-12
    )


def test_stops_are_plays_too():
    law = LAW({"u": 0.4, "stop(u,0.1)": 0.3, "stop(u,0.3)": 0.2}, target="value")
    found = hj.invert(law, driven(law, SMOOTH))
    np.testing.assert_allclose(found.value.u, SMOOTH, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("terms", "radii", "weights", "margin"),
    [
        ({"u": 1.0, "play(u,0.2)": -1.5}, [0.0, 0.2], [1.0, -1.5], -0.5),
        ({"u": -1.0, "play(u,0.2)": 0.4}, [0.0, 0.2], [-1.0, 0.4], 0.6),
        (
            {"u": 0.3, "play(u,0.2)": -0.1, "play(u,0.1)": -0.2},
            *([0.0, 0.1, 0.2], [0.3, -0.2, -0.1], 0.0),
        ),
        (
            {"stop(u,0.2)": 0.25, "stop(u,0.5)": -0.1, "play(u,0.2)": 0.4, "u": 0.5},
            *([0.0, 0.2, 0.5], [0.65, 0.15, 0.1], 0.65),
        ),
    ],
)
def test_what_is_a_stack_of_plays(terms, radii, weights, margin):
    """A stop is the input less a play; those of one radius are one."""
    law = LAW({**terms, "1": 0.7}, target="value")
    stack = _invert.stack_of(law)
    assert stack is not None and stack.offset == 0.7
    np.testing.assert_array_equal(stack.radii, radii)
    np.testing.assert_allclose(stack.slopes, np.cumsum(weights), atol=1e-15)
    assert stack.margin == pytest.approx(margin) and (stack.margin == 0) == (
        margin == 0
    )


@pytest.mark.parametrize(
    "term", ["u^2", "u*play(u,0.1)", "play(play(u,0.1),0.2)", "lag(u,0.5)"]
)
def test_what_is_none(term):
    assert _invert.stack_of(LAW({"u": 1.0, term: 0.1}, target="value")) is None
    assert _invert.stack_of(LAW({"u": 1.0, "play(u,0.1)": 0.1})) is None


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stack_goes_on_from_where_its_plays_were(sign):
    weights = sign * np.array([0.3, 0.4, -0.1, 0.2])
    radii = np.array([0.0, 0.1, 0.25, 0.5])
    turned = 103 + np.argmax(SMOOTH[100:150])  # where no play is at its edge
    before = by_hand.plays(SMOOTH[: turned + 1], radii)[-1]
    u = SMOOTH[turned:]
    w = by_hand.plays(u, radii, before) @ weights + 0.7
    stack = _invert.Stack(radii, np.cumsum(weights), 0.7)
    found = _invert.unstacked(stack, *map(jnp.asarray, (before, T[turned:], w)))
    np.testing.assert_allclose(found, (u, w), rtol=0, atol=1e-12)


def test_a_device_is_where_its_past_or_the_first_input_left_it():
    later = driven(STACK, SMOOTH).window(150, 401)
    past = by_hand.plays(SMOOTH[:151], np.asarray(STACK.radii))[-1]
    task = _invert.task_of(STACK, later, None, None, None, None)
    np.testing.assert_allclose(task.m, past, rtol=0, atol=1e-15)
    task = _invert.task_of(STACK, later, None, 0.3, None, None)
    started = np.clip(0.0, 0.3 - STACK.radii, 0.3 + STACK.radii)
    np.testing.assert_allclose(task.m, started, rtol=0, atol=1e-15)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("immediate", [False, True])
def test_what_is_missed_is_more_than_rounding(unit, immediate):
    """The last output is nobody's where the output sees the derivative."""
    reference = unit * np.sin(T)
    off = np.zeros(401)
    off[[3, 7, 11, 400]] = unit * np.array([1e-12, -1e-6, 1e-6, 1.0])
    task = _invert.task_of(STACK, reference, T, None, None, None)
    run = _follow.Followed(*map(jnp.asarray, (SMOOTH, reference + off, SMOOTH)))
    found = _invert._ended(task, run, immediate)
    np.testing.assert_array_equal(np.flatnonzero(~found.reached), [7, 11, 400])
    assert found.first_missed == T[7] and found.result == RESULTS.unreachable
    off[[7, 11]] = 0.0
    last = _invert._ended(task, run._replace(w=jnp.asarray(reference + off)), immediate)
    assert (last.result == RESULTS.successful) == immediate
    assert np.isnan(last.first_missed) == immediate and not last.reached[400]
    nothing = _invert._ended(task, run._replace(w=task.reference), immediate)
    assert np.isnan(nothing.first_missed) and nothing.result == RESULTS.successful


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_what_is_missed_of_nothing_is_rounding_of_what_was_before(unit):
    """A stack that is let go from far out, and its closed form at zero."""
    terms = {"u": 5e-2, "u^2": 1e-4, "play(u,5)": 2e-2}
    law = LAW({name: unit * x for name, x in terms.items()}, target="value")
    found = hj.invert(law, np.zeros(40), T[:40], u0=100.0)
    # The play stands at u + 5: 0.07 u + 0.1 + 1e-4 u² = 0.
    u = (-0.07 + np.sqrt(0.07**2 - 4e-4 * 0.1)) / 2e-4
    np.testing.assert_allclose(found.value.u, u, rtol=1e-9)
    assert np.all(found.stats["reached"])


@pytest.mark.parametrize("way", [1, -1])
def test_the_margin_of_a_law_is_b_less_c(way):
    """Whether its output rises with the input or falls."""
    law = LAW({"du": 0.5 * way, "|du|": 0.2})
    found = hj.invert(law, driven(law, SMOOTH), method=STEPS)
    np.testing.assert_allclose(found.stats["margin"], 0.3, rtol=1e-6)
    np.testing.assert_allclose(found.value.u, SMOOTH, rtol=0, atol=1e-9)
    both = LAW({"du": 0.2 * way, "|du|": 0.5})
    followed = hj.invert(both, driven(both, SMOOTH), method=STEPS)
    np.testing.assert_allclose(followed.stats["margin"], -0.3, rtol=1e-6)


def test_arrays_and_excitations_at_times():
    found = hj.invert(STACK, 0.7 + 0.5 * np.sin(T), T)
    np.testing.assert_allclose(found.value.w, 0.7 + 0.5 * np.sin(T), atol=1e-12)
    sine = hj.excitation.Sine(0.5, 1 / (2 * np.pi))
    same = hj.invert(STACK, sine, T)
    reference = jax.vmap(sine)(jnp.asarray(T))
    np.testing.assert_allclose(same.value.w, reference, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e9, 1e-9])
@pytest.mark.parametrize(
    "device",
    [OTHERS["envelopes"], models.MaxwellSlip([1.0, 0.6, 0.3], [0.1, 0.4, 0.9])],
    ids=["envelopes", "slip"],
)
def test_inputs_are_found_in_any_unit(device, unit):
    """Where no record tells how large inputs are."""
    w = driven(device, 0.8 * np.sin(2.5 * T)).w
    found = hj.invert(models.Instrumented(device, 1 / unit), w, T, method=STEPS)
    assert found.result == RESULTS.successful
    known = hj.invert(device, w, T, method=STEPS).value.u
    np.testing.assert_allclose(found.value.u / unit, known, rtol=0, atol=1e-9)


@pytest.mark.parametrize("unit", [1e9, 1e-9])
def test_a_first_difference_is_the_least_power_of_two_that_moves_the_output(unit):
    """By a thousandth of the range of the reference, or of a constant one's size."""
    device = models.Instrumented(LAW({"u": 1.0}, target="value"), 1 / unit)
    for reference, range_ in ((np.sin(T), np.ptp(np.sin(T))), (3 + 0 * T, 3.0)):
        task = _invert.task_of(device, reference, T, None, None, None)
        assert task.guess is None
        found = _follow.sized(device, task, _follow.Way(1, False)).guess
        assert found == 2.0 ** np.ceil(np.log2(1e-3 * range_ * unit))


def test_limits_are_kept_and_said():
    record = driven(STACK, SMOOTH)
    found = hj.invert(STACK, record, limits=(-0.4, 0.6), speed=1.5)
    u = np.asarray(found.value.u)
    assert found.result == RESULTS.unreachable
    assert u.min() >= -0.4 and u.max() <= 0.6
    assert np.max(np.abs(np.diff(u) / np.diff(T))) < 1.5 + 1e-9
    reached = np.asarray(found.stats["reached"])
    off = np.abs(found.value.error) > 1e-6
    np.testing.assert_array_equal(reached, ~off)
    assert found.stats["first_missed"] == T[~reached][0]


def test_a_start_outside_of_the_limits_comes_back_as_fast_as_it_may():
    found = hj.invert(DUHEM, 0 * T, T, u0=-3.0, limits=(-1, 1), speed=2, method=STEPS)
    u = np.asarray(found.value.u)
    inside = np.argmax(u >= -1)
    assert u[0] == -3 and inside > 10 and np.all(np.abs(u[inside:]) <= 1)
    np.testing.assert_allclose(np.diff(u[:inside]) / np.diff(T[:inside]), 2.0)
    assert np.max(np.abs(np.diff(u) / np.diff(T))) < 2 + 1e-9


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1.7, 1e9])
def test_relays_within_limits_come_as_close_as_any_level(unit):
    """Whatever the unit of the input: at a jump, the better side of it."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 10, 60))
    wanted = 0.5 * np.sin(2 * t) * (1 - t / 20)
    weights = np.random.default_rng(3).uniform(0.01, 0.05, 36)
    relays = models.Preisach(np.linspace(-1, 1, 9) * unit, weights)
    found = hj.invert(relays, wanted, t, limits=(-5 * unit, 5 * unit))
    # By brute force: of the middles between levels, each time the closest.
    middles = unit * np.linspace(-1.125, 1.125, 10)
    path, best = [0.0, 0.0], []

    def last(inputs):
        # It rests at the end, for one number of samples is one program.
        rows = np.append(path, np.full(20 - len(path), inputs))
        return float(hj.simulate(relays, hj.Recording(None, rows, rows)).w[-1])

    for target in wanted[:12]:
        outputs = [last(x) for x in (path[-1], *middles)]
        row = int(np.argmin(np.abs(np.subtract(outputs, target))))
        best.append(abs(outputs[row] - target))
        if row:
            path.append(middles[row - 1])
    np.testing.assert_allclose(np.abs(found.value.error[1:12]), best[1:], atol=1e-9)


def test_the_last_output_that_sees_the_rate_is_nobodys():
    record = driven(MORE["lugre"], SMOOTH)
    moved = hj.Recording(T, record.u, record.w.at[-1].add(1.0))
    found = hj.invert(MORE["lugre"], moved, method=STEPS)
    assert found.result == RESULTS.successful
    assert np.isnan(found.stats["first_missed"])
    assert abs(found.value.error[-1]) > 0.1
    assert np.all(found.stats["reached"][:-1]) and not found.stats["reached"][-1]


def test_a_speed_needs_a_clock():
    record = driven(STACK, SMOOTH)
    clockless = hj.Recording(None, record.u, record.w)
    with pytest.raises(InputError, match=r"`speed` is the change.*no clock"):
        hj.invert(STACK, clockless, speed=1.0)


def test_limits_hold_a_start_that_nobody_gave():
    with pytest.raises(InputError, match=r"`limits` \(0\.3, 2\) do not hold 0.*`u0`"):
        hj.invert(STACK, 0.5 + 0 * T, T, limits=(0.3, 2))
    assert hj.invert(STACK, 0.5 + 0 * T, T, u0=0.3, limits=(0.3, 2)).value.u[0] >= 0.3


@pytest.mark.parametrize("sign", [1, -1])
def test_a_backlash_is_crossed_as_fast_as_the_input_may(sign):
    """Within one step of the way across it nothing answers."""
    t = np.linspace(0, 8, 401)
    wanted = np.interp(t, [0, 1, 3, 4, 6, 8], [0, 0.5, -0.5, -0.5, 0.4, 0.1])
    radius, speed = 0.2, 0.8
    device = models.Behind(LAW({"u": sign}, target="value"), f"play(u,{radius})")
    found = hj.invert(device, sign * wanted, t, speed=speed)
    u = w = 0.0
    inputs, outputs = [u], [w]
    for target, h in zip(wanted[1:], np.diff(t), strict=True):
        aim = target + radius * np.sign(target - w) if abs(target - w) > 1e-9 else u
        u += np.clip(aim - u, -speed * h, speed * h)
        w = np.clip(w, u - radius, u + radius)
        inputs.append(u)
        outputs.append(w)
    np.testing.assert_allclose(found.value.u, inputs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.value.w, np.multiply(sign, outputs), atol=1e-9)
    assert 0.1 < np.mean(found.stats["reached"]) < 0.9


def test_a_backlash_is_crossed_from_a_limit_as_from_elsewhere():
    """Where the input may go in one direction only, and no faster."""
    t = np.linspace(0, 1, 51)
    device = models.Behind(LAW({"u": 1.0}, target="value"), "play(u,0.2)")
    free, kept = (
        hj.invert(device, t / 2, t, speed=0.8, limits=limits).value.u
        for limits in (None, (0.0, 2.0))
    )
    assert kept[-1] > 0.6
    np.testing.assert_allclose(kept, free, rtol=0, atol=1e-12)


def test_a_saturated_device_is_not_driven_further_out():
    """Where no input would do better, a slow one stays where it is, too."""
    levels = np.linspace(-1, 1, 9)
    device = models.Preisach(levels, np.ones(36))
    wanted = 50 * np.sin(T)
    found = hj.invert(device, wanted, T, speed=1.0)
    assert np.max(np.abs(found.value.u)) < 1.1
    assert np.max(np.abs(np.diff(found.value.u) / np.diff(T))) < 1 + 1e-9
    assert np.max(found.value.w) == 36 and np.min(found.value.w) == -36


def led_by_hand(preisach, reference):
    """The output of relays, one by one, whose input goes from level to level, as long
    as that brings them closer to a reference on the way that it goes."""
    i, j = np.tril_indices(len(preisach.levels) - 1)
    levels, weights = np.asarray(preisach.levels), np.asarray(preisach.weights)
    stand = np.where(levels[i + 1] + levels[j] < -1e-9, 1, -1)
    sign = np.sign(weights.sum())
    k, out, before = int(np.argmin(np.abs(levels))), [], weights @ stand
    for target in reference:
        way = int(sign * np.sign(target - before))
        before = target
        while way and 0 <= k + way < len(levels):
            u = levels[k + way]
            moved = np.where(u >= levels[i + 1], 1, np.where(u <= levels[j], -1, stand))
            if abs(weights @ moved - target) >= abs(weights @ stand - target):
                break
            stand, k = moved, k + way
        out.append(weights @ stand)
    return np.array(out)


@pytest.mark.parametrize("sign", [1, -1])
def test_relays_come_as_close_to_a_reference_as_they_can(sign):
    rng = np.random.default_rng(5)
    preisach = models.Preisach(np.linspace(-1, 1, 9), sign * rng.random(36))
    size = np.sum(np.abs(preisach.weights))
    # One that seldom turns, and one that does all the time.
    t = np.linspace(0, 20, 1201)
    slow = size * np.exp(-t / 15) * np.sin(2.5 * t)
    restless = 0.4 * np.cumsum(rng.standard_normal(1201))
    for reference in (slow, restless):
        found = hj.invert(preisach, reference, t, u0=0.0)
        np.testing.assert_allclose(
            found.value.w, led_by_hand(preisach, reference), rtol=0, atol=1e-12
        )
        again = hj.simulate(preisach, hj.Recording(t, found.value.u, reference))
        np.testing.assert_allclose(again.w, found.value.w, rtol=0, atol=1e-12)
        assert found.result == RESULTS.unreachable
        back = hj.invert(preisach, found.value.w, t, u0=0.0)
        assert back.result == RESULTS.successful
        np.testing.assert_array_equal(found.stats["margin"], 0)


def test_relays_are_led_no_farther_than_it_takes():
    """One that weighs, up at 1 and down at 0: what is below changes nothing."""
    preisach = models.Preisach([-1.0, 0.0, 1.0], [0.0, 0.0, 1.0], initial="up")
    reference = np.array([1.0, -1.0, -2.0, 1.0])
    found = hj.invert(preisach, reference, np.arange(4.0), u0=1.0)
    np.testing.assert_array_equal(found.value.u, [1.0, 0.0, 0.0, 1.0])
    np.testing.assert_array_equal(found.value.w, [1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize("one, rise", [(3.0, True), (-3.0, False)])
def test_whether_outputs_rise_with_the_levels_is_told(one, rise):
    """On the first way up, at each level a row of relays turns: one has a sum below 0
    or none has."""
    weights = np.array([1.0, one, 1.0, 1.0, 1.0, 2.5])
    preisach = models.Preisach(np.linspace(-1, 1, 4), weights, initial="down")
    assert np.all(np.sum(np.asarray(preisach.plane()), axis=1) > 0) == rise
    reference = np.linspace(-1, 1, len(T)) * np.sum(weights)
    task = _invert.task_of(preisach, reference, T, -1.0, None, None)
    *_, one_way = eqx.filter_jit(_invert.switched)(preisach, preisach.memory, task)
    assert bool(one_way) == rise


@pytest.mark.slow
def test_relays_of_both_signs_are_led_by_intervals():
    preisach = models.Preisach(np.linspace(-1, 1, 5), np.tile([1.0, -0.2], 5))
    record = driven(preisach, SMOOTH)
    found = hj.invert(preisach, record, method=STEPS)
    again = hj.Recording(T, found.value.u, record.w)
    w = hj.simulate(preisach, again, method=STEPS).w
    np.testing.assert_allclose(found.value.w, w, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.stats["reached"], np.abs(w - record.w) < 1e-9)


@pytest.mark.slow
def test_derivatives_and_batches_are_those_of_the_roots():
    record = driven(DUHEM, SMOOTH)
    name = "u*|du|"

    def inputs(number, scale=1.0):
        law = DUHEM.with_parameters({name: number})
        scaled = hj.Recording(T, record.u, record.w * scale)
        return hj.invert(law, scaled, method=STEPS).value.u

    here = jnp.asarray(0.05)
    _, change = jax.jvp(inputs, (here,), (jnp.ones(()),))
    step = 1e-5
    expected = (inputs(here + step) - inputs(here - step)) / (2 * step)
    np.testing.assert_allclose(change, expected, rtol=1e-5, atol=1e-6)
    scales = jnp.array([0.9, 1.0, 1.1])
    every = jax.vmap(lambda scale: inputs(here, scale))(scales)
    for scale, each in zip(scales, every, strict=True):
        np.testing.assert_allclose(each, inputs(here, scale), rtol=0, atol=1e-8)


@pytest.mark.slow
def test_second_derivatives_are_those_of_a_closed_form():
    """Of a sum of squares, in which products of first derivatives have a part."""
    t, stiffness, coulomb = np.linspace(0.0, 1.0, 5), 2.0, 5.0

    def cost(stiffness):
        force = models.Dahl(stiffness, coulomb)
        found = hj.invert(force, hj.Recording(t, 0 * t, t), method=STEPS)
        return jnp.sum(found.value.u**2)

    # The inputs go with 1 over the stiffness.
    inputs = -coulomb / stiffness * np.log(1 - t / coulomb)
    expected = 6 * np.sum(inputs**2) / stiffness**2
    found = jax.jacfwd(jax.jacfwd(cost))(stiffness)
    assert found == pytest.approx(expected, rel=1e-6)


def test_derivatives_hold_where_the_input_stands_still():
    law = LAW({"du": 0.25, "u*w": 0.05, "w": -0.02, "1": 0.004})  # |u'| has none there
    rests = np.clip(1.5 * SMOOTH, -0.3, 0.3)
    record = driven(law, rests)

    def inputs(number):
        changed = law.with_parameters({"1": number})
        return hj.invert(changed, record, method=STEPS).value.u

    here, step = jnp.asarray(0.004), 1e-6
    _, change = jax.jvp(inputs, (here,), (jnp.ones(()),))
    expected = (inputs(here + step) - inputs(here - step)) / (2 * step)
    np.testing.assert_allclose(change, expected, rtol=1e-4, atol=1e-4)


def test_inputs_of_a_stack_move_with_its_offset_where_they_rest_too():
    """By roots, and by the stack's own inverse with what it is to follow."""
    reference, times = jnp.array([0.1, 0.5, 0.5, 0.5, 0.2, 0.2]), jnp.arange(6.0)

    def inputs(offset, reference=reference):
        stack = models.PrandtlIshlinskii([0.0, 0.2, 0.5], [0.5, 0.3, 0.2], offset)
        return hj.invert(stack, reference, times).value.u

    expected = (inputs(0.1 + 1e-6) - inputs(0.1 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.jacfwd(inputs)(0.1), expected, rtol=1e-6)
    # An offset is as good as another reference.
    by_reference = jax.jacfwd(lambda each: inputs(0.1, each))(reference)
    np.testing.assert_allclose(-by_reference.sum(axis=1), expected, rtol=1e-6)


@pytest.mark.slow
def test_inputs_at_a_limit_move_with_it_and_times_have_derivatives():
    times, reference = jnp.linspace(0, 4, 41), 0.4 * jnp.sin(jnp.linspace(0, 4, 41))
    stack = models.PrandtlIshlinskii([0.05, 0.15, 0.4], [0.2, 0.3, 0.4], 0.1)

    def inputs(limit, times):
        limits = (-0.3, limit)
        return hj.invert(stack, reference, times, u0=0.0, limits=limits).value.u

    found = inputs(0.25, times)
    by_limit, by_times = jax.jacfwd(inputs, (0, 1))(0.25, times)
    at_limit = np.asarray(found) == 0.25
    assert 10 < np.sum(at_limit) < 41
    np.testing.assert_allclose(np.asarray(by_limit)[at_limit], 1.0)
    np.testing.assert_array_equal(by_times, 0.0)  # of a stack, whatever the clock


@pytest.mark.slow
def test_an_oscillator_says_that_it_cannot_be_led_sample_by_sample():
    oscillator = models.BoucWenOscillator(2.0, 1.0, 5.0, 3.0, 1.0, 0.5)
    found = hj.invert(oscillator, driven(oscillator, SMOOTH), method=STEPS)
    assert found.result == RESULTS.unreachable
    assert 0 < found.stats["first_missed"] < T[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("model", "known"), [(DUHEM, ()), (STACK, ("radii[0]",))])
def test_inputs_are_as_uncertain_as_the_numbers_of_a_fit(model, known):
    record = driven(model, SMOOTH)
    noise = 0.01 * np.random.default_rng(0).normal(size=len(T))
    noisy = hj.Recording(T, record.u, record.w + noise)
    fitted = hj.refine(model, noisy, fixed=known)
    found = hj.invert(fitted, record, method=STEPS)
    own = fitted.value.parameters()
    free = [name for name in own if name in fitted.stats["standard_errors"]]

    def apart(name):
        size = 1e-5
        ends = (
            fitted.value.with_parameters(own | {name: own[name] + sign * size})
            for sign in (1, -1)
        )
        up, down = (hj.invert(end, record, method=STEPS).value.u for end in ends)
        return (up - down) / (2 * size)

    slopes = np.stack([apart(name) for name in free], axis=1)
    covariance = fitted.stats["covariance"][: len(free), : len(free)]
    expected = np.sqrt(np.einsum("np,pq,nq->n", slopes, covariance, slopes))
    errors = found.stats["u_standard_errors"]
    np.testing.assert_allclose(errors, expected, rtol=1e-3, atol=1e-3 * expected.max())
    assert "u_standard_errors" not in hj.invert(fitted.value, record).stats


@pytest.mark.recordings
@pytest.mark.slow
def test_measured_piezos_tell_their_voltages():
    rows = {(row.device, row.model): row for row in reproduce("voltages").rows}
    names = "law", "law, refined", "cubic law, refined", "plays and lags"
    law, better, best, plays = (rows["piezo_ayala", name] for name in names)
    assert law.off < 0.27 and better.off < 0.25 and best.off < 0.2
    assert law.smoothed < 0.25 and better.smoothed < 0.2 and plays.smoothed < 0.15
    assert 0 < better.band < 0.01
    assert rows["piezo_yan9a", "plays"].off < 1
    assert min(rows[device, "line"].off for device, _ in rows) > 4


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((0.5 * np.sin(T),), "`t`, the times of the reference, is needed"),
        ((np.sin(T), T[:-1]), "Lengths differ"),
        ((np.full_like(T, np.nan), T), "NaN or inf"),
    ],
)
def test_references_that_are_none(given, message):
    with pytest.raises(InputError, match=message):
        hj.invert(STACK, *given)


def test_limits_that_are_none():
    with pytest.raises(InputError, match="`limits` must be two rising numbers"):
        hj.invert(STACK, np.sin(T), T, limits=(1.0, -1.0))
    with pytest.raises(InputError, match="`speed` must be positive"):
        hj.invert(STACK, np.sin(T), T, speed=0.0)
    late = models.Instrumented(STACK, delay=0.1)
    with pytest.raises(InputError, match=r"comes late.*`device`"):
        hj.invert(late, np.sin(T), T)


def test_what_a_loop_carries_is_seen():
    def output(du):
        def turn(carry, _):
            return (carry[0] + carry[1], 0.1 * du), None

        return jax.lax.scan(turn, (jnp.zeros(()), jnp.zeros(())), None, length=2)[0][0]

    assert depends(output, jnp.zeros(()))


@pytest.mark.parametrize("limits", [(1.0, 2.0, 3.0), (None, 1.0), (1.0,)])
def test_limits_are_two_numbers(unchecked, limits):
    law, t = models.Duhem(0.4, 0.5, 0.8), np.linspace(0, 1, 11)
    with pytest.raises(InputError, match="`limits` must be two rising numbers"):
        hj.invert(law, np.sin(t), t, limits=limits)


def test_one_time_is_no_reference():
    with pytest.raises(InputError, match="`invert` needs at least 2 samples"):
        hj.invert(
            models.Duhem(0.4, 0.5, 0.8), hj.excitation.Sine(1.0, 0.5), np.zeros(1)
        )


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_of_two_sides_with_a_root_that_counts_on_which_less_is_overshot(way):
    """x^2 + x / 5 = 3, from 0: at a distance of 2 either side is past the target, by
    0.6 and by 1.4."""

    def off(v):
        return v**2 + 0.2 * way * v - 3

    step = _follow.Step(
        *(jnp.asarray(x) for x in (0.0, -50.0, 50.0)), slopes=jnp.ones(2)
    )
    first = jnp.array(0.0), jnp.array(-3.0)
    bracket, best = _follow._bracketed(off, step, off(0.0), first, 1.0, 1e-9)
    np.testing.assert_allclose(bracket, [-way, -2.2, -2 * way, 0.6], atol=1e-12)
    np.testing.assert_allclose(best, [-2 * way, 0.6], atol=1e-12)
    # A root on one side is found there, as far as it is.
    bracket, _ = _follow._bracketed(lambda v: way * v - 3, step, -3.0, first, 1.0, 1e-9)
    np.testing.assert_allclose(bracket, [2 * way, -1, 4 * way, 1], atol=1e-12)


def test_a_spring_that_slides_is_drawn_no_farther_by_what_is_rounded():
    """Its force is 0.61 at most, 0.9 from where it rests; far out it is known to less
    digits, of which some come closer to the 0.7 that are asked for, or cross 0.61."""
    weights, radii = jnp.array([1.0, 0.6, 0.3]), jnp.array([0.1, 0.4, 0.9])
    step = _follow.Step(
        *(jnp.asarray(x) for x in (0.0, -1e18, 1e18)), slopes=jnp.ones(2)
    )
    for force in (0.7, 0.61 + 1e-11):

        def off(v, force=force):
            plays = jnp.clip(0.0, v - radii, v + radii)
            return jnp.sum(weights) * v - weights @ plays - force

        first = jnp.array(0.0), -jnp.asarray(force)
        bracket, best = _follow._bracketed(off, step, off(0.0), first, 0.3, 1e-12)
        np.testing.assert_array_equal(bracket, [0, -force, 0, -force])
        np.testing.assert_allclose(best, [1.2, 0.61 - force], atol=1e-12)
