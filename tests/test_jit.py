"""A jit that compiles quickly, wherever it is called; and verbs that it is not for."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hystjax as hj
import hystjax._core.compiling as module
from hystjax._core import uncollected
from hystjax._core.compiling import jit, largest, run_once, side_by_side
from hystjax._core.solution import if_sorted


@jit
def square(x):
    return x**2


def at(x):
    return {
        "alone": lambda: square(x),
        "jit": lambda: jax.jit(lambda x: square(x) + 0 * square(3.0))(x),
        "vmap": lambda: jax.vmap(lambda y: square(y) + 0 * square(x))(x[None])[0],
        "scan": lambda: jax.lax.scan(lambda _, y: (0, square(y)), 0, x[None])[1][0],
        "cond": lambda: jax.lax.cond(True, square, square, x),
        "eval": lambda: jnp.full(jax.eval_shape(square, x).shape, x**2),
        "forward": lambda: jax.jvp(square, (x,), (x,))[1] / 2,
        "reverse": lambda: jax.grad(lambda x: jnp.sum(square(x)))(x) * x / 2,
        "linear": lambda: jax.linearize(square, x)[1](x) / 2,
        "reverse of vmap": lambda: (
            jax.grad(lambda x: jnp.sum(jax.vmap(square)(x)))(x) * x / 2
        ),
        "vmap of reverse": lambda: jax.vmap(jax.grad(square))(x) * x / 2,
        "jit of reverse": lambda: jax.jit(jax.vmap(jax.grad(square)))(x) * x / 2,
        "second": lambda: (
            jnp.diag(jax.hessian(lambda x: jnp.sum(square(x)))(x)) / 2 * x**2
        ),
    }


@pytest.mark.parametrize("where", at(jnp.ones(1)))
def test_is_a_jit_wherever_it_is_called(where):
    x = jnp.arange(1.0, 4.0)
    np.testing.assert_allclose(at(x)[where](), x**2, rtol=1e-12)


@pytest.mark.parametrize(
    "counts, most",
    [
        (np.array([3, 7, 5], np.int32), 7),
        (np.array([False, True]), True),
        (np.array([False, False]), False),
    ],
)
def test_the_largest_of_a_batch_is_one_for_all_of_it(counts, most):
    found = jax.vmap(largest)(counts)
    assert found.tolist() == [most] * len(counts) and found.dtype == counts.dtype


@pytest.mark.parametrize("kind", [bool, np.int32])
def test_of_a_batch_of_none_nothing_is_the_largest(kind):
    found = jax.vmap(largest)(np.zeros(0, kind))
    assert found.shape == (0,) and found.dtype == kind


def test_compiles_without_options_that_xla_does_not_have(monkeypatch):
    of_another_age = ("xla_of_another_age", True)
    monkeypatch.setattr(module, "_QUICKER", of_another_age)
    with run_once(1):
        assert float(jit(lambda x: x + 1)(2.0)) == 3.0
    assert not module._known(of_another_age)
    assert module._known(module._UNOPTIMISED)


def test_what_runs_once_through_few_samples_has_a_program_of_its_own():
    traced = []

    @jit
    def doubled(x):
        traced.append(x)
        return 2 * x

    one = jnp.ones(3)
    doubled(one)
    with run_once(10**6):
        doubled(one)
    assert len(traced) == 1
    with run_once(10):
        assert doubled(one).tolist() == [2.0, 2.0, 2.0]
        ((_, result),) = side_by_side(doubled, [one])
    assert result.tolist() == [2.0, 2.0, 2.0]
    doubled(one)
    assert len(traced) == 2


def test_what_a_thread_has_set_holds_side_by_side():
    device = jax.devices()[0]

    def seen(_):
        return jax.config.jax_default_device, jnp.ones(1).dtype

    with jax.default_device(device), jax.enable_x64(False):
        ((_, inside),) = side_by_side(seen, [0])
    assert inside == (device, jnp.float32)
    ((_, outside),) = side_by_side(seen, [0])
    assert outside == (None, jnp.float64)


def test_a_law_and_its_run_are_what_they_are_without_optimisation():
    t = np.linspace(0, 20, 400)
    record = hj.Recording(t, np.sin(t), np.sin(t - 0.3))

    def ran():
        law = hj.identify(record, hj.library.Polynomial(2)).value
        return law.coefficients, hj.judge(law, record).trajectory.w

    for optimised, plain in zip(ran(), once(ran), strict=True):
        np.testing.assert_allclose(plain, optimised, rtol=1e-9, atol=1e-12)


def once(call):
    with run_once(1):
        return call()


@pytest.mark.parametrize("setting", ["enable", "disable"])
def test_garbage_is_collected_after_import_as_it_was_before(setting):
    code = (
        f"import gc; gc.{setting}(); import hystjax; "
        "print(gc.isenabled(), gc.get_freeze_count())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == [str(setting == "enable"), "0"]


def test_devices_can_be_chosen_after_import():
    """As they can until JAX has made its first array, in `jax.distributed` too."""
    code = (
        "import hystjax, jax; jax.config.update('jax_num_cpu_devices', 3); "
        "print(jax.device_count())"
    )
    environment = {**os.environ, "XLA_FLAGS": "", "JAX_PLATFORMS": "cpu"}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    assert (run.stdout, run.returncode) == ("3\n", 0), run.stderr


def test_what_others_have_frozen_stays_so():
    gc.freeze()
    frozen = gc.get_freeze_count()
    with uncollected():
        assert not gc.isenabled()
    assert gc.isenabled() and gc.get_freeze_count() >= 0.9 * frozen > 0


def products(jaxpr):
    for equation in jaxpr.eqns:
        if equation.primitive is jax.lax.dot_general_p:
            yield equation.params["precision"]
        for inner in jax.tree.leaves(list(equation.params.values())):
            if hasattr(inner, "eqns"):
                yield from products(inner)


@pytest.mark.parametrize("verb", ["identify", "refine"])
def test_products_of_float32_are_taken_in_float32(verb):
    terms = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
    with jax.enable_x64(False):
        law = hj.models.SparseModel.from_terms(terms)
        call = {
            "identify": lambda record: hj.identify(record, hj.library.Duhem(2)),
            "refine": lambda record: hj.refine(law, record, throw=False),
        }[verb]
        t = np.linspace(0, 20, 100, dtype=np.float32)
        record = hj.Recording(t, np.sin(t), np.cos(t))
        taken = list(products(jax.make_jaxpr(lambda r: call(r).value)(record).jaxpr))
    best = jax.lax.Precision.HIGHEST
    assert taken and all(each == (best, best) for each in taken)


def test_is_a_method_too():
    class Scale:
        factor = 3.0

        @jit
        def times(self, x):
            return self.factor * x

    assert float(Scale().times(2.0)) == 6.0


# ------------------------------------------------------- verbs that look at values

T = np.linspace(0, 10, 200)
SMALL = hj.library.Polynomial(1)


def verbs(record):
    """Calls that need values, of which none runs as far as to need time."""
    key, grid = jax.random.key(0), hj.sweeping.Grid(a=np.arange(3.0))
    law = hj.models.Duhem(0.4, 0.5, 0.25)
    scale, found = record.w[1], hj.Solution(law, hj.RESULTS.successful, {})
    return {
        "discover": lambda: hj.discover(record, SMALL),
        "aliases": lambda: hj.aliases(record, SMALL),
        "suggest_excitation": lambda: hj.suggest_excitation(law, record, SMALL),
        "inclusion": lambda: hj.inclusion(found, record, key=key),
        "sweep": lambda: hj.sweep(jnp.multiply, grid, shared={"b": scale}),
        "stability` without a `formulation": lambda: hj.stability(
            record, SMALL, key=key
        ),
    }


@pytest.mark.parametrize("transformation", [jax.jit, jax.vmap, jax.grad, "constant"])
@pytest.mark.parametrize("verb", verbs(hj.Recording(T, np.sin(T), np.cos(T))))
def test_verbs_that_look_at_values_say_so_where_there_are_none(verb, transformation):
    def call(scale):
        verbs(hj.Recording(T, np.sin(T), scale * np.cos(T)))[verb]()
        return scale

    if transformation == "constant":  # under `jit` nothing has a value
        still = verbs(hj.Recording(T, np.sin(T), np.cos(T)))[verb]
        transformation, call = jax.jit, lambda _: still()
    argument = jnp.ones(2) if transformation is jax.vmap else 1.0
    with pytest.raises(hj.InputError, match=f"^`{verb}` looks at the values") as caught:
        transformation(call)(argument)
    assert "Call it outside" in str(caught.value)


def verbs_by_hand(record):
    """Calls that read numbers off a record as NumPy does, and write."""
    law, judged = hj.models.Duhem(record.w[1], 0.5, 0.25), hj.Judgement
    terms = hj.models.SparseModel.from_terms({"du": 1.0, "w": -0.5})
    terms = terms.with_parameters({"du": record.w[1]})
    run = hj.Trajectory(record.t, record.u, record.w, hj.RESULTS.successful, {})
    judgements = {"fitted": judged(record, run, {"nrmse": record.w[1]})}
    return {
        "compare": lambda: hj.compare(record),
        "steady": lambda: hj.steady(record, 50),
        "summary": lambda: hj.loops.summary(record),
        "core_loss": lambda: hj.loops.core_loss(record),
        "creep": lambda: hj.loops.creep(record),
        "without_slope": lambda: hj.loops.without_slope(record),
        "a known slope": lambda: hj.loops.without_slope(record, 0.5),
        "separate": lambda: hj.loops.separate(record.t[1:], record.w[1:]),
        "steinmetz": lambda: hj.loops.steinmetz(*[record.w] * 3),
        "Curves": lambda: hj.loops.Curves([(record.u, record.w)] * 5),
        "in_si": lambda: hj.loops.in_si(record),
        "forc": lambda: hj.loops.forc([record, record], smoothing=2),
        "guess": lambda: hj.models.Dahl.guess(record),
        "between": lambda: record.between(1.0, 5.0),
        "save": lambda: hj.save("law.json", law),
        "to_c": lambda: hj.export.to_c(law),
        "to_text": lambda: hj.export.to_text(terms),
        "to_python": lambda: hj.export.to_python(terms),
        "write": lambda: hj.report.write("report", law, judgements),
        "error_table": lambda: hj.report.error_table(judgements),
        "plot.loop": lambda: hj.plot.loop(record),
        "plot.fit": lambda: hj.plot.fit(record, run),
    }


@pytest.mark.parametrize("verb", verbs_by_hand(hj.Recording(T, np.sin(T), np.cos(T))))
def test_verbs_that_need_numbers_say_so_in_hystjax_s_words(verb):
    def call(scale):
        verbs_by_hand(hj.Recording(T, np.sin(T), scale * np.cos(T)))[verb]()

    with pytest.raises(hj.InputError, match=r"looks at the values|is being traced"):
        jax.eval_shape(call, 1.0)


@pytest.mark.parametrize("verb", ["generate", "judge", "invert", "outliers"])
def test_verbs_of_numbers_are_traced(verb):
    def call(scale):
        record = hj.Recording(T, np.sin(T), scale * np.cos(T))
        law = hj.models.Duhem(0.4 * scale, 0.5, 0.25)
        sine, key = hj.excitation.Sine(scale, 0.3), jax.random.key(0)
        each = {
            "generate": lambda: hj.generate(law, sine, T, additive=0.1, key=key).w,
            "judge": lambda: hj.judge(law, record).trajectory.w,
            "invert": lambda: hj.invert(law, record).value.u,
            "outliers": lambda: hj.outliers(record).mask,
        }
        return each[verb]()

    assert jax.eval_shape(call, 1.0).shape == T.shape


def test_the_page_of_calls_lists_which_are_traced():
    page = Path(__file__).parents[1] / "docs" / "verbs.md"
    traced, _, others = (
        page.read_text(encoding="utf-8")
        .partition("Under `jit`")[2]
        .partition("Those that look at")
    )
    for verb in ("generate", "judge", "invert", "outliers", "control", "bootstrap"):
        assert f"`{verb}`" in traced and f"`{verb}`" not in others
    record = hj.Recording(T, np.sin(T), np.cos(T))
    refused = {"compare", "complete", "bridged", "steady", "guess", *verbs(record)}
    for verb in refused - {"stability` without a `formulation"}:
        assert f"`{verb}`" in others and f"`{verb}`" not in traced


def test_a_known_stack_is_inverted_by_plays_under_jit_too():
    stack = hj.models.PrandtlIshlinskii([0.1, 0.3], [0.5, 0.4])
    reference = np.sin(T)

    def inverted():
        return hj.invert(stack, reference, T).value.u

    np.testing.assert_allclose(jax.jit(inverted)(), inverted(), rtol=0, atol=1e-14)


def test_a_record_on_disk_is_not_read_under_jit():
    long = hj.LongRecording(T, np.sin(T), np.cos(T))
    with pytest.raises(hj.InputError, match="`identify` of a `LongRecording` looks at"):
        jax.jit(lambda: hj.identify(long, SMALL).value)()


def test_times_that_do_not_increase_are_a_result():
    """For verbs, which under `jit` see recordings that could not be checked."""
    lanes = jnp.array([[0.0, 1, 2], [0, 2, 1], [2, 1, 0], [0, 0, 1], [0, 1, jnp.nan]])
    done = hj.RESULTS.successful

    def lane(t):
        result = if_sorted(done, lanes[0], t)
        return result == done, result == hj.RESULTS.unsorted_time

    good, unsorted = jax.jit(jax.vmap(lane))(lanes)
    assert good.tolist() == [True, False, False, False, False]
    assert unsorted.tolist() == [False, True, True, True, True]
    known = [if_sorted(done, lanes[0], t) == hj.RESULTS.unsorted_time for t in lanes]
    assert known == unsorted.tolist()
    assert if_sorted(hj.RESULTS.diverged, lanes[0]) == hj.RESULTS.diverged
