import functools
import importlib.metadata
import io
import json
import os
import re
import subprocess
import sys

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
import xarray

import hystjax as hj
from hystjax._core.files import write_text
from hystjax._core.show import Progress
from hystjax._core.solution import names_by_code
from hystjax.sweeping import (
    Axis,
    Grid,
    LogUniform,
    Samples,
    Uniform,
    _lanes,
    _sweep,
)
from hystjax.sweeping._lanes import Variable, variables

T = np.linspace(0, 20, 401)
LAW = hj.models.Duhem(0.4, 0.5, 0.25)
PATH = hj.interpolation.Linear().path(jnp.asarray(T), jnp.asarray(np.sin(T)))
STEP = hj.simulation.FixedStep()


@functools.cache
def clean():
    with jax.ensure_compile_time_eval():
        return np.asarray(hj.simulate(LAW, PATH, w0=0.0).w)


def noisy(level, seed):
    noise = level * jax.random.normal(jax.random.key(seed), T.shape)
    return hj.Recording(T, np.sin(T), clean() + noise)


def identified(level, threshold, seed=0):
    settings = hj.regression.STLSQ(threshold)
    library = hj.library.Duhem()
    return hj.identify(noisy(level, seed), library, settings, throw=False)


def refined(level, seed):
    start = hj.models.Duhem(0.5, 0.6, 0.2)
    return hj.refine(start, noisy(level, seed), throw=False)


def simulated(alpha, w0):
    law = hj.models.Duhem(alpha, 0.5, 0.25)
    return hj.simulate(law, PATH, w0=w0, method=STEP, throw=False)


def ranked(level, seed):
    """The inner step of `discover`: the best supports of three terms, by weak form."""
    record, library = noisy(level, seed), hj.library.Polynomial(2, ("w", "u", "du"))
    equations = hj.formulation.WeakForm(20).equations(library, record.path, record.w)
    problem = hj.regression.compress(*equations)
    best = hj.search.ranking(problem, hj.search.supports(len(library), 3), 5)
    return {"rows": best.rows, "residuals": best.residuals}


def test_lanes_are_what_single_calls_give():
    levels, thresholds = np.array([0.0, 0.01, 0.05]), np.array([0.02, 0.1])
    found = hj.sweep(identified, Grid(level=levels, threshold=thresholds))
    assert found["coefficients"].dims == ("level", "threshold", "term")
    assert tuple(found["term"].values) == hj.library.Duhem().names
    for level in levels:
        for threshold in thresholds:
            lane = found.sel(level=level, threshold=threshold)
            alone = identified(level, threshold)
            model = alone.value
            np.testing.assert_allclose(lane.coefficients, model.coefficients, 1e-9)
            np.testing.assert_array_equal(lane.support, model.support)
            assert lane.num_steps == alone.stats["num_steps"]
            assert lane.result == "successful"


def test_the_inner_step_of_discover():
    dims = {"rows": ("rank", "term"), "residuals": ("rank",)}
    found = hj.sweep(ranked, Grid(level=[0.01, 0.1], seed=range(3)), dims=dims)
    alone = ranked(0.1, 2)
    lane = found.sel(level=0.1, seed=2)
    np.testing.assert_array_equal(lane["rows"], alone["rows"])
    np.testing.assert_allclose(lane["residuals"], alone["residuals"], rtol=1e-9)


@pytest.mark.slow
def test_parameters_of_refined_models_and_their_errors():
    found = hj.sweep(refined, Grid(level=[0.01, 0.02], seed=range(3)))
    alone = refined(0.02, 2)
    lane = found.sel(level=0.02, seed=2)
    for name, value in alone.value.parameters().items():
        np.testing.assert_allclose(lane[name], value, 1e-6)
        error = alone.stats["standard_errors"][name]
        np.testing.assert_allclose(lane[f"standard_errors.{name}"], error, 1e-6)
    assert "residuals" not in found  # a row of samples for every lane


def test_trajectories_have_an_axis_with_a_name_of_choice():
    dims = {"t": "time", "u": ["time"], "w": ("time",)}
    space = Grid(alpha=[0.3, 0.4], w0=[0.0, 0.1])
    found = hj.sweep(simulated, space, dims=dims, coords={"time": T})
    assert all(found[name].dims == ("alpha", "w0", "time") for name in dims)
    alone = simulated(0.4, 0.1).w
    np.testing.assert_allclose(found["w"].sel(alpha=0.4, w0=0.1), alone, 1e-12)
    np.testing.assert_array_equal(found["w"]["time"], T)


def test_a_failing_lane_tells_why_and_leaves_the_others_alone():
    def explodes(beta):
        law = hj.models.Duhem(0.4, beta, 0.25)
        return hj.simulate(law, PATH, w0=0.0, method=STEP, throw=False)

    good, bad = np.array([0.4, 0.5]), np.array([0.4, -1e4, 0.5, np.nan])
    few = hj.sweep(explodes, Grid(beta=good), batch=2)
    all_ = hj.sweep(explodes, Grid(beta=bad), batch=2)
    assert list(all_.result.values) == ["successful", "diverged"] * 2
    assert list(all_.result.attrs) == ["diverged"]
    assert "did not stay finite" in all_.result.attrs["diverged"]
    kept = all_.where(all_.result == "successful", drop=True)
    np.testing.assert_array_equal(kept["w"], few["w"])


def test_of_what_a_solution_tells_numbers_and_vectors_are_kept():
    stats = {
        "loss": jnp.array(2.0),
        "errors": {"du": jnp.ones(3)},
        "covariance": jnp.eye(3),
        "why": "none",
    }
    solution = hj.Solution(LAW, hj.RESULTS.successful, stats)
    found = variables(solution)
    assert found.keys() == {*LAW.parameters(), "loss", "errors.du", "result"}
    assert found["loss"].values == 2 and found["errors.du"].values.shape == (3,)


def test_a_number_of_a_model_is_not_taken_for_one_that_a_verb_tells():
    class Lossy(hj.models.AbstractLaw):
        loss: jax.Array

        def rate(self, x, m, now):
            return -self.loss * x

    def told(x, names):
        model = Lossy(x, units=("", ""))
        stats = {"score": 2.0, "count": 3, **dict.fromkeys(names, x)}
        return hj.Solution(model, hj.RESULTS.successful, stats)

    x = jnp.array([1.0, 2.0])
    found = hj.sweep(lambda x: told(x, ()), Grid(x=x))
    np.testing.assert_array_equal(found["score"], [2.0, 2.0])
    np.testing.assert_array_equal(found["count"], [3, 3])
    with pytest.raises(hj.InputError, match="are both called 'loss'"):
        hj.sweep(lambda x: told(x, ("loss",)), Grid(x=x))


def test_a_function_without_a_result_fails_where_it_is_not_finite():
    found = hj.sweep(lambda x: {"y": 1 / x, "n": jnp.arange(2)}, Grid(x=[0.0, 1.0]))
    assert list(found.result.values) == ["nonfinite", "successful"]
    assert found["n"].dims == ("x", "n_0")


@pytest.mark.parametrize(
    "output, ended",
    [
        # Only of what is inside of a part its own `result` tells how that ended.
        ({"fit": hj.RESULTS.successful, "fit_error": np.inf}, "nonfinite"),
        ({"fit": {"result": hj.RESULTS.successful, "error": np.inf}}, "successful"),
        # Solvers count their results in a way of their own.
        ([optx.RESULTS.nonlinear_max_steps_reached], "nonlinear_max_steps_reached"),
        ([diffrax.RESULTS.dt_min_reached], "dt_min_reached"),
    ],
)
def test_how_a_lane_ended_is_told_by_what_says_so(output, ended):
    code = int(variables(output)["result"].values)
    assert names_by_code()[code] == ended


def test_a_lane_ends_as_the_first_failure_of_what_is_in_it():
    def fits(threshold):
        each = [identified(0.0, x) for x in (0.01, threshold)]
        others = each[1].result, 1 / (threshold - 0.01)
        return {"first": each[0].result, "others": others}

    found = hj.sweep(fits, Grid(threshold=[0.02, 0.01, 10.0]))
    assert list(found.result.values) == ["successful", "nonfinite", "empty_support"]
    assert list(found["first"].values) == ["successful"] * 3
    assert list(found["others.0"].values) == ["successful"] * 2 + ["empty_support"]
    assert found.result.attrs.keys() == {"nonfinite", "empty_support"}

    record = noisy(0.0, 0)

    def runs(rate):
        law = hj.models.Duhem(0.4, rate, 0.25)
        return [hj.judge(law, record, method=STEP).trajectory, rate]

    found = hj.sweep(runs, Grid(rate=[0.5, -1e4]))
    assert list(found.result.values) == ["successful", "diverged"]
    assert list(found["0.result"].values) == ["successful", "diverged"]


def test_what_is_infinite_in_a_part_that_says_how_it_ended_is_no_failure():
    record = noisy(0.0, 0)
    law = hj.models.Duhem(0.4, 0.5, 0.25).fitted_to([record])

    def judged(rate):  # no input leaves the fitted range: from t = inf on
        return hj.judge(law.with_parameters({"beta": rate}), record, method=STEP)

    found = hj.sweep(judged, Grid(rate=[0.5, -1e4]))
    assert list(found.result.values) == ["successful", "diverged"]
    assert np.all(np.isinf(found["trajectory.stats.beyond.since"]))
    beside = hj.sweep(lambda rate: (judged(0.5), 1 / rate), Grid(rate=[1.0, 0.0]))
    assert list(beside.result.values) == ["successful", "nonfinite"]


def test_an_axis_may_be_of_records_or_of_keys():
    records = [noisy(0.0, 0), noisy(0.02, 1), noisy(0.04, 2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)
    space = Grid(
        record=Axis(stacked, labels=("a", "b", "c")),
        key=jax.random.split(jax.random.key(0), 2),
        share=Axis([0.1, 0.2], units="%"),
    )

    def spread(record, key, share):
        return jnp.std(record.w) + share * jax.random.normal(key)

    found = hj.sweep(spread, space)["value"]
    assert list(Axis(np.ones((3, 2))).coordinate) == [0, 1, 2]
    assert list(found["record"].values) == ["a", "b", "c"]
    assert list(found["key"].values) == [0, 1]
    assert found["share"].attrs == {"units": "%"}
    # Not in the order of the alphabet, as a dictionary would have it under `jit`.
    assert found.dims == ("record", "key", "share")
    draw = jax.random.normal(jax.random.split(jax.random.key(0), 2)[1])
    expected = np.std(records[1].w) + 0.2 * draw
    np.testing.assert_allclose(found.sel(record="b", key=1, share=0.2), expected)


def test_samples_are_drawn_from_every_part_of_each_range():
    space = Samples.drawn(50, seed=3, a=Uniform(-1, 3), b=LogUniform(1e-3, 10))
    found = hj.sweep(lambda a, b: a * b, space)
    assert found["value"].dims == ("sample",)
    a, b = found["a"].values, found["b"].values
    np.testing.assert_allclose(found["value"], a * b)
    parts = (a + 1) / 4, np.log10(b / 1e-3) / 4
    for part in parts:
        assert sorted(np.floor(50 * part).astype(int)) == list(range(50))
    again, other = (Samples.drawn(50, seed=i, a=Uniform(-1, 3)) for i in (3, 4))
    assert np.all(np.sort(again.axes["a"].values) != np.sort(other.axes["a"].values))
    assert eqx.tree_equal(again, Samples.drawn(50, seed=3, a=Uniform(-1, 3)))


@pytest.mark.parametrize("chunk, batch", [(None, None), (7, 3), (1, 1), (40, 4)])
def test_results_do_not_depend_on_how_lanes_are_cut(chunk, batch):
    def lane(a, b, table):
        return {"x": table[b] * a, "place": b}

    table = np.linspace(0, 1, 5)
    space = Grid(a=[1.0, -2.0, 3.0], b=range(5))
    found = hj.sweep(lane, space, shared={"table": table}, chunk=chunk, batch=batch)
    np.testing.assert_array_equal(found["x"], np.outer([1.0, -2.0, 3.0], table))
    np.testing.assert_array_equal(found["place"], np.tile(np.arange(5), (3, 1)))


def test_lanes_keep_within_the_memory():
    def lane(a):
        big = jnp.sin(a * jnp.arange(20_000.0))
        return jnp.sort(big)[:10]

    space, memory = Grid(a=np.arange(64.0)), 4 * 2**20
    given = _sweep.Lane(lane, space, {}), jax.local_devices()
    free = _sweep.planned(*given, 2**30, None, None)
    kept = _sweep.planned(*given, memory, None, None)
    assert free.bytes > memory >= kept.bytes > memory / 2
    assert kept.batch < free.batch
    assert free.chunk == free.batch  # of 64 lanes a 64th, in whole batches
    whole = hj.sweep(lane, space)
    xarray.testing.assert_allclose(hj.sweep(lane, space, memory=memory), whole, 1e-12)
    with pytest.raises(hj.InputError, match="more than the `memory`"):
        hj.sweep(lane, space, memory=2**16)


def products(a, b, factor):
    return factor * a * b


GRID = Grid(a=np.arange(6.0), b=np.arange(5.0))


def sweep_products(out, factor=2.0, **options):
    options = {"chunk": 4, "shared": {"factor": jnp.array(factor)}} | options
    return hj.sweep(products, options.pop("space", GRID), out=out, **options)


class Stopped(Exception):
    """The machine went down."""


@pytest.fixture
def calls(monkeypatch):
    """Lanes that are run; the list `limit` may hold how many chunks at most."""
    ran, run = [], _sweep.Program.__call__

    class Calls:
        limit = None

        @property
        def lanes(self):
            return [int(lane) for lanes in ran for lane in lanes]

        clear = ran.clear

    def counted(self, lanes):
        if len(ran) == Calls.limit:
            raise Stopped
        ran.append(lanes)
        return run(self, lanes)

    monkeypatch.setattr(_sweep.Program, "__call__", counted)
    return Calls()


def test_a_stopped_sweep_goes_on_without_losing_or_repeating_a_lane(
    tmp_path, calls, monkeypatch
):
    begun = []
    monkeypatch.setattr(
        _sweep, "Progress", lambda *known: begun.append(known) or Progress(*known)
    )
    type(calls).limit = 3
    with pytest.raises(Stopped):
        sweep_products(tmp_path / "kept")
    (tmp_path / "kept" / ".hystjax-0123.tmp").write_bytes(b"half a chunk")
    type(calls).limit = None
    found = sweep_products(tmp_path / "kept")
    assert calls.lanes == list(range(30))
    assert begun == [("lanes", 30, 0), ("lanes", 30, 12)]
    again = sweep_products(tmp_path / "kept", chunk=None)
    assert len(calls.lanes) == 30
    assert not list((tmp_path / "kept").glob(".*"))
    xarray.testing.assert_identical(found, again)
    xarray.testing.assert_identical(found, sweep_products(None))
    np.testing.assert_array_equal(found["value"], 2 * np.outer(range(6), range(5)))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"space": Grid(a=np.arange(6.0), b=np.arange(5.0) + 1)}, "another space"),
        ({"space": Grid(a=np.arange(6.0), b=Axis(np.arange(5.0), "V"))}, "space"),
        ({"factor": 3.0}, "another shared arguments"),
        ({"chunk": 5}, "chunks of 4 lanes, and `chunk` is 5"),
    ],
)
def test_a_folder_of_another_sweep_is_refused(tmp_path, change, message):
    sweep_products(tmp_path)
    with pytest.raises(hj.InputError, match=message):
        sweep_products(tmp_path, **change)


def test_keys_of_other_seeds_have_other_fingerprints():
    one, again, other = (_sweep._digest(jax.random.key(i)) for i in (0, 0, 1))
    assert one == again != other


@pytest.mark.parametrize("batch", [None, 1])
def test_what_a_function_closes_over_is_taken_as_it_is_at_the_call(batch):
    factor = 2.0

    def scaled(a):
        return factor * a

    grid = Grid(a=[1.0, 3.0])
    np.testing.assert_array_equal(hj.sweep(scaled, grid, batch=batch).value, [2, 6])
    factor = 5.0
    np.testing.assert_array_equal(hj.sweep(scaled, grid, batch=batch).value, [5, 15])


def test_a_method_reads_its_object_and_a_part_what_it_holds():
    class Gain:
        factor = np.array(2.0)

        def of(self, a):
            return self.factor * a

    gain, grid = Gain(), Grid(a=[1.0, 3.0])
    gain.factor = np.array(2.0)
    np.testing.assert_array_equal(hj.sweep(gain.of, grid).value, [2, 6])
    gain.factor *= 3
    np.testing.assert_array_equal(hj.sweep(gain.of, grid).value, [6, 18])
    part = functools.partial(lambda factor, a: factor * a, gain.factor)
    np.testing.assert_array_equal(hj.sweep(part, grid).value, [6, 18])


_FACTOR = 2.0


def _helped(a):
    return _FACTOR * a


def test_globals_of_functions_that_a_function_calls_are_looked_up(monkeypatch):
    grid = Grid(a=[1.0, 3.0])

    def told(a):
        return _helped(a)

    np.testing.assert_array_equal(hj.sweep(told, grid).value, [2, 6])
    monkeypatch.setattr(sys.modules[__name__], "_FACTOR", 5.0)
    np.testing.assert_array_equal(hj.sweep(told, grid).value, [5, 15])


def test_a_program_is_traced_no_more_for_more_chunks():
    traces = []

    def told(a):
        traces.append(a)
        return a

    counts = []
    for chunk in (6, 2):
        hj.sweep(told, Grid(a=np.arange(6.0)), chunk=chunk, batch=2)
        counts.append(len(traces))
        traces.clear()
    assert counts[0] == counts[1] > 0
    hj.sweep(told, Grid(a=np.arange(6.0)), chunk=2, batch=2)
    assert not traces  # nothing that it reads has changed


def test_whole_numbers_of_numpy_cut_lanes(tmp_path, unchecked):
    two = np.int64(2)
    cut = {"chunk": two, "batch": two, "out": tmp_path}
    found = hj.sweep(lambda a: 2 * a, Grid(a=[1.0, 2.0, 3.0]), **cut)
    np.testing.assert_array_equal(found["value"], [2, 4, 6])
    assert len(list(tmp_path.glob("chunk-*.npz"))) == 2


APART = """
import jax, jax.numpy as jnp, hystjax as hj, sys
one, two, three, _ = jax.devices()
grid = hj.sweeping.Grid(a=jax.device_put(jnp.array([1.0, 2.0, 3.0]), two))
shared = {"b": jax.device_put(jnp.array([2.0, 5.0]), three)}
product = lambda a, b: a * jnp.sum(b)
for devices in (None, one):
    found = hj.sweep(product, grid, shared=shared, devices=devices, out=sys.argv[1])
    assert found.value.values.tolist() == [7, 14, 21]
"""


def test_arrays_may_lie_on_any_of_several_devices(tmp_path):
    flags = "--xla_force_host_platform_device_count=4"
    environment = {**os.environ, "XLA_FLAGS": flags}
    command = [sys.executable, "-c", APART, str(tmp_path)]
    subprocess.run(command, env=environment, check=True)


def test_a_changed_function_is_refused(tmp_path):
    offset = jnp.linspace(0.0, 1.0, 1000)

    def moved(by):
        return hj.sweep(lambda a: a + (offset + by)[500], Grid(a=[1.0]), out=tmp_path)

    first = moved(0.0)
    xarray.testing.assert_identical(moved(0.0), first)
    with pytest.raises(hj.InputError, match="another function"):
        moved(1.0)


def on_host(factor):
    """A function that calls Python code, which closes over a number."""

    def times(a):
        return np.asarray(factor * a)

    def lane(a):
        shape = jax.ShapeDtypeStruct((), a.dtype)
        return jax.pure_callback(times, shape, a, vmap_method="sequential")

    return lane


def looped(function):
    return lambda a: jax.lax.map(function, a[None])[0]


def branched(function):
    return lambda a: jax.lax.cond(a > 0, eqx.filter_jit(function), lambda a: a, a)


@pytest.mark.parametrize("within", [lambda f: f, jax.jit, looped, branched])
def test_code_on_the_host_is_swept_into_a_folder_by_its_version(tmp_path, within):
    grid, old, new = Grid(a=[1.0, 2.0]), within(on_host(2.0)), within(on_host(3.0))
    with pytest.raises(hj.InputError, match=r"on_host\.<locals>\.times.*`version`"):
        hj.sweep(old, grid, out=tmp_path)
    assert not list(tmp_path.iterdir())
    for _ in range(2):
        found = hj.sweep(old, grid, out=tmp_path, version="1")
        np.testing.assert_array_equal(found["value"], [2, 4])
    with pytest.raises(hj.InputError, match="another version"):
        hj.sweep(new, grid, out=tmp_path, version="2")
    np.testing.assert_array_equal(hj.sweep(new, grid)["value"], [3, 6])


def test_code_of_a_package_called_like_hystjax_needs_a_version():
    def own(x):
        return x

    own.__module__ = "hystjax_mine.code"
    with pytest.raises(hj.InputError, match="whose changes no fingerprint sees"):
        _sweep._named(own, None)


def test_hystjax_and_equinox_on_the_host_need_no_version(tmp_path, monkeypatch):
    def distribution(name):
        if name == "hystjax":  # on a path, but not installed
            raise importlib.metadata.PackageNotFoundError(name)
        return found(name)

    found = importlib.metadata.distribution
    monkeypatch.setattr(importlib.metadata, "distribution", distribution)

    def kept(differentiation):
        def derivative(level):
            record = noisy(level, 0)
            _, slope = differentiation.estimate(record.t, record.w)
            return eqx.error_if(slope[200], level < 0, "no such level")

        return hj.sweep(derivative, Grid(level=[0.01]), out=tmp_path)

    first = kept(hj.differentiation.TotalVariation(1e-3))
    again = kept(hj.differentiation.TotalVariation(1e-3))
    xarray.testing.assert_identical(first, again)
    for other in (
        hj.differentiation.TotalVariation(2e-3),
        hj.differentiation.SmoothingSpline(1e-3),
        hj.differentiation.SmoothingSpline(),
    ):
        with pytest.raises(hj.InputError, match="another function"):
            kept(other)


def test_a_chunk_in_the_place_of_another_is_refused(tmp_path, calls):
    expected = sweep_products(tmp_path / "this")
    sweep_products(tmp_path / "other", factor=3.0)
    second = tmp_path / "this" / "chunk-000001.npz"
    for source, message in [
        ("this/chunk-000002.npz", "holds chunk 2 of this sweep"),
        ("other/chunk-000001.npz", "holds chunk 1 of another sweep"),
    ]:
        second.write_bytes((tmp_path / source).read_bytes())
        with pytest.raises(hj.InputError, match=f"{second} {message}.*Move it away"):
            sweep_products(tmp_path / "this")
    second.unlink()
    calls.clear()
    xarray.testing.assert_identical(sweep_products(tmp_path / "this"), expected)
    assert calls.lanes == [4, 5, 6, 7]


def spoilt(content):
    """What a crash, a full disk or a bad one makes of a file."""
    yield b""
    for share in (0.1, 0.5, 0.9, 0.999):
        yield content[: int(share * len(content))]
    yield bytes(len(content))
    yield b"PK\x03\x04 nonsense"
    yield b"\x80\x04K\x01."  # a pickle


def test_a_damaged_chunk_is_made_again(tmp_path, calls):
    expected = sweep_products(tmp_path)
    chunk = tmp_path / "chunk-000003.npz"
    content = chunk.read_bytes()
    for bad in spoilt(content):
        chunk.write_bytes(bad)
        calls.clear()
        with pytest.warns(UserWarning, match=f"{chunk} is damaged"):
            xarray.testing.assert_identical(sweep_products(tmp_path), expected)
        assert calls.lanes == [12, 13, 14, 15]
        assert np.load(chunk)["number"] == 3


def test_a_chunk_with_a_flipped_bit_is_never_believed(tmp_path):
    arrays = {"x": np.linspace(0, 1, 3), "n": np.arange(3)}
    store = _sweep.opened(tmp_path, {"function": "f"}, 3, list(arrays))
    store.put(0, arrays)
    file = tmp_path / "chunk-000000.npz"
    content, noticed = file.read_bytes(), 0
    for place in range(0, len(content), 3):
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        file.write_bytes(changed)
        try:
            found = store.get(0)
        except hj.InputError as error:
            noticed += 1
            assert str(file) in str(error) and "will be made again" in str(error)
        else:  # a byte that says when the file was made, or the like
            for name, array in arrays.items():
                np.testing.assert_array_equal(found[name], array)
    assert noticed > 0.5 * len(range(0, len(content), 3))


def flipped(content):
    place = content.index(b'"chunk": 4') + len(b'"chunk": ')
    return content[:place] + b"5" + content[place + 1 :]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda content: b"",
        lambda content: content[:-20],
        lambda content: b"\xff\xfe" + content,
        lambda content: b"[" * 200_000,
        lambda content: content.replace(b'"names"', b'"namen"'),
        lambda content: content.replace(b'"space": "', b'"space": "0'),
        flipped,
    ],
)
def test_a_damaged_manifest_is_made_again_once_it_is_deleted(tmp_path, calls, spoil):
    expected = sweep_products(tmp_path)
    manifest = tmp_path / "sweep.json"
    content = manifest.read_bytes()
    manifest.write_bytes(spoil(content))
    with pytest.raises(hj.InputError, match=f"{manifest} is damaged. Delete it"):
        sweep_products(tmp_path)
    manifest.unlink()
    calls.clear()
    xarray.testing.assert_identical(sweep_products(tmp_path), expected)
    assert calls.lanes == [] and manifest.read_bytes() == content


class Broken:
    """An array that cannot be written."""

    def __array__(self, *_, **__):
        raise Stopped


def test_a_chunk_is_there_whole_or_not_at_all(tmp_path):
    store = _sweep.opened(tmp_path, {"function": "f"}, 4, ["x", "y"])
    whole = {"x": np.zeros(4), "y": np.ones(4)}
    store.put(0, whole)
    for number in (0, 1):
        with pytest.raises(Stopped):
            store.put(number, {"x": np.ones(4), "y": Broken()})
    assert {file.name for file in tmp_path.iterdir()} == {
        "sweep.json",
        "chunk-000000.npz",
    }
    assert 1 not in store
    for name, array in store.get(0).items():
        np.testing.assert_array_equal(array, whole[name])


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    done, sync, move = [], os.fsync, os.replace

    def synced(handle):
        done.append((os.fstat(handle).st_ino, os.fstat(handle).st_size))
        sync(handle)

    def moved(source, target):
        done.append("moved")
        move(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", moved)
    file = tmp_path / "file"
    write_text(file, "twelve bytes")
    assert done[:2] == [(file.stat().st_ino, 12), "moved"]


def test_a_folder_of_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(hj.InputError, match=r"thesis\.tex"):
        sweep_products(tmp_path)
    for manifest, message in (
        ({"format": "others"}, "is not of a sweep"),
        ({"format": "hystjax sweep", "version": 99}, "has version 99"),
    ):
        (tmp_path / "sweep.json").write_text(json.dumps(manifest))
        with pytest.raises(hj.InputError, match=message):
            sweep_products(tmp_path)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(hj.InputError, match="not of a sweep"):
        sweep_products(tmp_path)


def test_a_function_that_raises_stops_the_sweep():
    def strict(a):
        return eqx.error_if(a, a > 1, "too large")

    with pytest.raises(hj.ComputationError, match="throw=False"):
        hj.sweep(strict, Grid(a=[0.0, 2.0]))


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: Grid(), "at least one parameter"),
        (lambda: Grid(a=[]), "at least one value"),
        (lambda: Grid(a=3.0), "at least one value"),
        (lambda: Axis([1.0, 2.0], labels=["one"]), "as many `labels`"),
        (lambda: Axis({"u": T, "w": T[1:]}), "got (401,), (400,)"),
        (lambda: Samples(a=[1.0], b=[1.0, 2.0]), "as many values"),
        (lambda: LogUniform(0.0, 1.0), "0 < low < high"),
        (lambda: Uniform(1.0, 0.0), "`Uniform(1.0, 0.0)` needs low < high"),
        (lambda: Uniform(0.0, np.inf), "`Uniform(0.0, inf)` needs low < high"),
        (lambda: Uniform(False, True), "`Uniform(False, True)` needs low < high"),
        (lambda: hj.sweep(lambda a: {"a": a}, Samples(a=[1.0])), "another name"),
        (lambda: hj.sweep(lambda a: {"sample": a}, Samples(a=[1.0])), "another name"),
        (
            lambda: hj.sweep(lambda a: a, Grid(a=[1.0]), dims={"value": ("x",)}),
            "names 1 axes of 'value'",
        ),
        (lambda: hj.sweep(lambda a: a, Grid(a=[1.0]), chunk=0), "`chunk`"),
        (
            lambda: hj.sweep(lambda a: a, Grid(a=[1.0]), devices=2 * jax.devices()[:1]),
            "one device or several, each once",
        ),
        (
            lambda: hj.sweep(lambda a: {"x": a, "law": "w' = u'"}, Grid(a=[1.0])),
            "returns 'law', \"w' = u'\" (str)",
        ),
        (
            lambda: hj.sweep(lambda a: {"k": jax.random.key(a)}, Grid(a=[1])),
            "returns 'k', a key of `jax.random`, and a dataset of lanes holds numbers: "
            "leave it out, or return `jax.random.key_data` of it",
        ),
        (lambda: hj.sweep(lambda a: None, Grid(a=[1.0])), "returns 'value', None"),
        (
            lambda: hj.sweep(lambda a: [a, {"b": None}], Grid(a=[1.0])),
            "returns '1.b', None",
        ),
        (
            lambda: hj.sweep(lambda a: np.array(["a", "b"]), Grid(a=[1.0])),
            "(ndarray), and a dataset of lanes holds numbers",
        ),
        (
            lambda: hj.sweep(lambda a: {"result": a}, Grid(a=[1.0])),
            "returns 'result', which in a sweep is how a lane ended",
        ),
        (
            lambda: hj.sweep(lambda a: {"p": {"q": a}, "p.q": a}, Grid(a=[1.0])),
            "two arrays that are called 'p.q'",
        ),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(hj.InputError, match=re.escape(message)):
        call()


@pytest.mark.parametrize(
    "function, whose",
    [
        (lambda a, b, c: a + float(b), "`b`"),
        (lambda a, b, c: np.zeros(int(b)).sum() + a, "`b`"),
        (lambda a, b, c: a if b > 1 else c, "`b`"),
        (lambda a, b, c: np.sin(a) + b, "`a`"),
        (lambda a, b, c: [a, a][c] * b, "`c`"),
        (lambda a, b, c: a + b if a > b else a, "one of its arguments"),
    ],
)
def test_whose_value_a_function_asks_for_is_said(function, whose):
    space, shared = Grid(a=[1.0, 2.0], b=[1, 2]), {"c": np.array(1)}
    with pytest.raises(hj.InputError, match=f"asks for the value of {whose}, as"):
        hj.sweep(function, space, shared=shared)


def test_one_device_is_taken_as_it_is(monkeypatch):
    """By the program too, some of whose ways depend on the kind of its device."""
    space, (device, *_) = Grid(a=[1.0, 2.0]), jax.local_devices()
    monkeypatch.setattr(jax, "local_devices", list)  # it is none of them
    told = []

    def doubled(a):
        told.append(jax.config.jax_default_device)
        return {"x": 2 * a}

    found = hj.sweep(doubled, space, devices=device)
    np.testing.assert_array_equal(found["x"], [2.0, 4.0])
    assert device in told


@pytest.mark.parametrize(
    "dims, coords, message",
    [
        ({"y": ("t",)}, {}, "`dims` names 'y', and no array .* are: 'result', 'x'"),
        ({"x": ("t",)}, {"s": [1, 2]}, "`coords` names 's', .* there are: 't'"),
        ({}, {"t": [1, 2]}, "`coords` names 't', .* there are: 'x_0'"),
        ({"x": ("t",)}, {"a": [1, 2]}, "`coords` names 'a', .* there are: 't'"),
        ({"x": ("t",)}, {"t": [1, 2]}, "do not fit .* size.* 't'"),
        ({"x": ("a",)}, {}, "an axis of 'x' has the name 'a', .* in `dims`"),
        ({"x": ("sample",)}, {}, "an axis of 'x' has the name 'sample'"),
    ],
)
def test_names_that_do_not_fit_are_refused_before_the_work(
    calls, dims, coords, message
):
    space = Samples(a=[1.0, 2.0])
    with pytest.raises(hj.InputError, match=message):
        hj.sweep(lambda a: {"x": a * jnp.ones(3)}, space, dims=dims, coords=coords)
    assert calls.lanes == []


def test_what_a_model_or_a_recording_has_beside_numbers_is_no_result():
    def judged(alpha):
        law = hj.models.Duhem(alpha, 0.5, 0.25)
        return hj.judge(law, noisy(0.0, 0), method=STEP), law

    found = hj.sweep(judged, Grid(alpha=[0.4]))
    assert found["0.recording.w"].shape == (1, 401) and found["0.errors.nrmse"] < 1e-3


class Terminal(io.StringIO):
    def isatty(self):
        return True


Notebook = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})


@pytest.mark.parametrize(
    "stream, asked, shown",
    [
        (Terminal, None, True),
        (Terminal, True, True),
        (Terminal, False, False),
        (Notebook, None, False),
        (Notebook, True, True),
        (io.StringIO, True, False),
    ],
)
def test_progress_is_shown_where_people_watch(monkeypatch, stream, asked, shown):
    monkeypatch.setattr(sys, "stderr", stream())
    with Progress("lanes", 8000, 100, asked) as progress:
        progress.show(200)
        progress.show(8000, 9000, best="0.1 um")
    said = sys.stderr.getvalue()
    assert bool(said) == shown
    if shown:  # how many of all, the time left, how fast, and the best
        last = said.split("\r")[-1]
        assert re.search(r"8000/9000 \[.*<.* lanes/s, best 0\.1 um\]", last)


def test_a_module_is_another_function_with_other_arrays(tmp_path):
    """Its arrays are given to the program, whose text then is the same."""

    class Doubled(eqx.Module):
        by: jax.Array

        def __call__(self, x):
            return {"y": self.by * x}

    grid = Grid(x=np.array([1.0, 2.0]))
    one, other = Doubled(jnp.array(2.0)), Doubled(jnp.array(3.0))
    np.testing.assert_array_equal(hj.sweep(one, grid, out=tmp_path / "s").y, [2, 4])
    np.testing.assert_array_equal(hj.sweep(one, grid, out=tmp_path / "s").y, [2, 4])
    with pytest.raises(hj.InputError, match="another function"):
        hj.sweep(other, grid, out=tmp_path / "s")


def test_labels_of_ones_own_come_before_those_of_terms():
    """As where a law is told in other units than its terms are."""
    found = {"coefficients": np.array([[1.0, 2.0], [3.0, 4.0]])}
    law = Variable(jnp.zeros(2), dims=("term",), labels=("u", "w"))
    about = {"coefficients": law}
    for coords, labels in (({}, ["u", "w"]), ({"term": ["V", "um"]}, ["V", "um"])):
        told = _lanes.dataset(Grid(a=[5, 6]), found, about, {}, coords)
        assert told["term"].values.tolist() == labels
        np.testing.assert_array_equal(told["coefficients"].sel(a=6), [3.0, 4.0])


def test_a_folder_is_begun_by_the_first_of_several_processes(tmp_path, monkeypatch):
    """A wrong one is an error of all, before they wait for each other."""
    lane, waits = _sweep.Lane(lambda a: {"x": a}, Grid(a=[1.0, 2.0]), {}), []
    monkeypatch.setattr(jax, "process_index", lambda: 1)
    out = tmp_path / "sweep"

    def first_comes(what):
        waits.append(what)
        assert not out.exists()
        with monkeypatch.context() as patched:
            patched.setattr(jax, "process_index", lambda: 0)
            patched.setattr(_sweep, "_wait_for_all", lambda _: None)
            _sweep._store(out, lane, None, 1, ("x",))

    monkeypatch.setattr(_sweep, "_wait_for_all", first_comes)
    store = _sweep._store(out, lane, None, 1, ("x",))
    store.put(0, {"x": np.array([1.0])})
    assert waits == ["opened"] and 0 in store
    other = _sweep.Lane(lambda a: {"x": a}, Grid(a=[1.0, 3.0]), {})
    with pytest.raises(hj.InputError, match="holds a sweep with another space"):
        _sweep._store(out, other, None, 1, ("x",))
    assert waits == ["opened"]


@pytest.mark.parametrize(
    ("spread", "ends"),
    [
        (LogUniform(1e-200, 1e200), (1e-200, 1e200)),
        (Uniform(-1e308, 1e308), (-1e308, 1e308)),
    ],
)
def test_ranges_whose_size_is_infinite_have_an_inside(spread, ends):
    values = spread.at(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    np.testing.assert_allclose(values[[0, -1]], ends, rtol=1e-6)
    assert np.all(np.isfinite(values)) and np.all(np.diff(values) > 0)
