"""Programs in Python, MATLAB and Modelica. Neither MATLAB nor a compiler of Modelica
can be asked for here: both are read by parsers, and their statements run in Python."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import matlab
import modelica
import numpy as np
import pymoca.parser
import pytest
import tree_sitter
import tree_sitter_matlab
from exported import DEVICES, MORE, RECORD, W0, Fading, T, U, expected, free_run

import hystjax as hj
from hystjax import InputError, export, models
from hystjax.simulation import FixedStep

QUICK = ("rate", "value")
REST = sorted(DEVICES.keys() - {*QUICK}) + sorted(MORE)
EVERY = DEVICES | MORE
MATLAB = tree_sitter.Parser(tree_sitter.Language(tree_sitter_matlab.language()))
NAMES = ('drive */ "\n', "stroke\n#error")


def runs_as_hystjax_does(name):
    namespace = {"__name__": name}
    exec(export.to_numpy(EVERY[name]), namespace)
    w, size = expected(name)
    np.testing.assert_allclose(namespace["run"](T, U, W0), w, rtol=0, atol=1e-12 * size)
    several = namespace["run"](T, np.stack([U, U / 2], axis=1), W0)
    np.testing.assert_allclose(several[:, 0], w, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("name", QUICK)
def test_python_runs_as_hystjax_does(name):
    runs_as_hystjax_does(name)


@pytest.mark.thorough
@pytest.mark.parametrize("name", REST)
def test_python_of_all_other_families_runs_as_hystjax_does(name):
    runs_as_hystjax_does(name)


def test_whole_numbers_among_what_flows_keep_their_place():
    class Clock(models.AbstractModel):
        def start(self, m, now, seen):
            return {"clock": 0, "sum": seen}

        def rate(self, x, m, now):
            return {"clock": 1, "sum": now.u}

        def output(self, x, m, now):
            return x["sum"] + 3 * x["clock"]

    namespace = {}
    exec(export.to_numpy(Clock()), namespace)
    t = np.linspace(0, 2, 21)  # a straight input, whose integral is exact
    run = namespace["run"](t, 2 * t, 0.5)
    np.testing.assert_allclose(run, 0.5 + t**2 + 3 * t, rtol=1e-12)


def test_differences_and_quotients_of_each_other_are_grouped():
    def grouped(u):
        return u - (3 - (2 * u - (1 - u))) / (2 / (4 / (2 + u))) * (u / (2 * (u + 3)))

    class Grouped(models.AbstractModel):
        def start(self, m, now, seen):
            return ()

        def rate(self, x, m, now):
            return ()

        def output(self, x, m, now):
            return grouped(now.u)

    namespace = {}
    exec(export.to_numpy(Grouped()), namespace)
    run = namespace["run"](T, U, 0.0)
    np.testing.assert_allclose(run, grouped(U), rtol=1e-12)


def test_whole_numbers_beside_floats_in_a_memory_keep_their_place():
    relay = models.Preisach([-0.3, 0.4], [2.0])
    namespace = {}
    exec(export.to_numpy(models.Behind(relay, "play(u,0.1)")), namespace)
    run = namespace["run"](T, U, 0.0)
    play, expected = 0.0, np.zeros(len(U))
    for i, u in enumerate(U):
        play = np.clip(play, u - 0.1, u + 0.1)
        switched = 2.0 * ((play >= 0.4) - 1.0 * (play <= -0.3))
        expected[i] = switched or expected[i - 1]
    known = np.flatnonzero(expected)  # from the first time that it switches
    assert len({*expected[known]}) == 2
    np.testing.assert_array_equal(run[known], expected[known])


def test_sums_of_nothing_are_what_jax_has_for_them():
    class Empty(models.AbstractModel):
        def start(self, m, now, seen):
            return ()

        def rate(self, x, m, now):
            return ()

        def output(self, x, m, now):
            none = jnp.full((3, 0), now.u)
            sums, products = jnp.sum(none, axis=1), jnp.prod(none, axis=(0, 1))
            truth = jnp.where(jnp.all(none > 0) & ~jnp.any(none > 0), 4.0, 5.0)
            least = jnp.max(none, axis=0, initial=2.0).size
            return now.u + jnp.sum(sums) + 2 * products + truth + least

    masing = models.RambergOsgood(3.0, 1.1, 4.0, depth=1)  # no branch after the first
    for model, w in ((Empty(), U + 6), (masing, jax.vmap(masing.first)(U))):
        namespace = {}
        exec(export.to_numpy(model), namespace)
        np.testing.assert_allclose(namespace["run"](T, U), w, rtol=1e-12)


def test_python_tests_itself_without_hystjax(tmp_path):
    law = DEVICES["rate"]
    record = hj.Recording(T, U, expected("rate")[0])
    source = export.to_numpy(law, name="actuator", record=record)
    (tmp_path / "law.py").write_text(source, encoding="utf-8")
    (tmp_path / "wrong.py").write_text(source.replace("0.25 * du", "0.26 * du"))
    for file, code in (("law.py", 0), ("wrong.py", 1)):
        command = [sys.executable, "-I", file]
        run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert run.returncode == code, run.stderr
        assert run.stdout.startswith("actuator: off by ")


class Stiff(models.AbstractLaw):
    """A slow state that starts at what was seen, beside a stiff spring: the output at
    the first sample is another one, of which a run would start elsewhere."""

    def rate(self, x, m, now):
        return -x

    def output(self, x, m, now):
        return x + 3 * now.u


def test_own_tests_start_from_what_was_seen(tmp_path):
    record = hj.Recording(T, 1 + U, np.full_like(T, 0.7))
    python = export.to_numpy(Stiff(), record=record)
    run = {}
    exec(python, run)
    truth = 0.7 * np.exp(-T) + 3 * (1 + U)
    np.testing.assert_allclose(run["run"](T, 1 + U, 0.7), truth, rtol=1e-7)
    (tmp_path / "law.py").write_text(python, encoding="utf-8")
    subprocess.run([sys.executable, "-I", "law.py"], cwd=tmp_path, check=True)
    assert "law(t, u, 0.7)" in export.to_matlab(Stiff(), record=record)
    assert "start(u[1], 0.7, t[1])" in export.to_modelica(Stiff(), record=record)
    assert "(law_real)0.7);" in export.to_c(Stiff(), record=record)


def matlab_runs_as_hystjax_does(name):
    text = export.to_matlab(EVERY[name])
    law, start = (matlab.function(text, each) for each in ("law", "start"))
    with np.errstate(all="ignore"):
        first = start(U[0], W0, T[0])
        run, _ = law(matlab.column(T), matlab.column(U), W0, first)
    w, size = expected(name)
    np.testing.assert_allclose(run, w, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("name", QUICK)
def test_matlab_runs_as_hystjax_does_in_other_words(name):
    matlab_runs_as_hystjax_does(name)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name in REST if name != "masing"])
def test_matlab_of_all_other_families_runs_as_hystjax_does(name):
    matlab_runs_as_hystjax_does(name)


def modelica_runs_as_hystjax_does(name, samples=120):
    functions = modelica.functions(export.to_modelica(EVERY[name]), "law")
    state, run = functions["start"](U[0], W0, T[0]), []
    with np.errstate(all="ignore"):
        for i, h in enumerate(np.diff(T[: samples + 1])):
            run.append(functions["response"](state, (U[i + 1] - U[i]) / h))
            state = functions["step"](state, U[i + 1], h)
    w, size = expected(name)
    np.testing.assert_allclose(run, w[:samples], rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("name", QUICK)
def test_modelica_runs_as_hystjax_does_in_other_words(name):
    modelica_runs_as_hystjax_does(name)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name in REST if name != "masing"])
def test_modelica_of_all_other_families_runs_as_hystjax_does(name):
    modelica_runs_as_hystjax_does(name)


def test_the_time_begins_where_the_record_does():
    t, device = T + 5, Fading(2.0)
    record = hj.Recording(t, U, U)
    text = export.to_matlab(device, record=record)
    start = matlab.function(text, "start")
    run, _ = matlab.function(text, "law")(
        matlab.column(t), matlab.column(U), W0, start(U[0], W0, t[0])
    )
    np.testing.assert_allclose(run, device.along(t, U), rtol=1e-12, atol=0)
    assert "s = start(u(1), w0, t(1));" in text
    text = export.to_modelica(device, record=record)
    functions = modelica.functions(text, "law")
    state = functions["start"](U[0], W0, t[0])
    fades = device.along(t[0], U[0])
    np.testing.assert_allclose(functions["response"](state, 0.0), fades, rtol=1e-12)
    assert "s := start(u, w0, time);" in text and "start(u[1], 0.0, t[1])" in text


def assert_read(model, **how):
    text = export.to_matlab(model, **how)
    assert not MATLAB.parse(text.encode()).root_node.has_error
    pymoca.parser.parse(export.to_modelica(model, **how))


@pytest.mark.parametrize("name", ["rate", "preisach"])
def test_matlab_and_modelica_can_be_read(name):
    assert_read(EVERY[name], record=RECORD.window(0, 20))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["value", *REST])
def test_matlab_and_modelica_of_all_other_families_can_be_read(name):
    assert_read(EVERY[name])


def test_files_say_law_units_range_and_version():
    law = models.Duhem(0.4, 0.5, 0.25, names=NAMES, units=("V", "µm"))
    record = RECORD.window(0, 20)
    for write in (export.to_numpy, export.to_matlab, export.to_modelica, export.to_c):
        text = write(law, record=record)
        for told in (
            "w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|",
            "u: drive",
            "w: stroke #error, in µm",
            f"made by hystjax {hj.__version__}",
            "u from 0 to ",
        ):
            assert told in text, (write, told)
        if write is export.to_numpy:
            compile(text, "law", "exec")
    assert_read(law, record=record)


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (export.to_c, "a b"),
        (export.to_matlab, "rate"),
        (export.to_modelica, "package"),
    ],
)
def test_the_name_must_be_one(write, name):
    with pytest.raises(InputError, match="`name`"):
        write(DEVICES["rate"], name=name)


def test_what_is_infinite_cannot_be_written_in_modelica():
    law = models.SparseModel.from_terms({"du": 0.25})
    unbounded = models.Instrumented(law, jnp.inf)
    assert "INFINITY" in export.to_c(unbounded)
    with pytest.raises(InputError, match=r"inf, which Modelica cannot write.*`to_c`"):
        export.to_modelica(unbounded)


def batch():
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * 4), DEVICES["rate"])


class Loop(models.AbstractLaw):
    """w' by a loop of unknown length."""

    def rate(self, x, m, now):
        return jax.lax.while_loop(lambda y: y > 1, lambda y: y / 2, x)


class Bits(models.AbstractLaw):
    """w' by two bits of a count of steps: -17 & 3 is 3, and as truths 1."""

    def rate(self, x, m, now):
        return ((10 * now.u).astype(int) & 3) * now.du


class Network(models.AbstractSequenceModel):
    """A network stands here for all maps of sequences."""

    interval: jax.Array = eqx.field(converter=jnp.asarray)

    def response(self, u, w0):
        return jnp.tanh(u)

    def __str__(self):
        return "a network"


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: models.Instrumented(DEVICES["rate"], delay=0.1), "comes late.*device"),
        (batch, "batch"),
        (Loop, "loop whose length depends.*save"),
        (Bits, "`and` of bits of whole numbers.*save"),
        (lambda: Network(0.1), "no equations.*network"),
    ],
)
def test_what_has_no_equations_is_refused(model, message):
    with pytest.raises(InputError, match=message):
        export.to_c(model())


class Large(models.AbstractLaw):
    """It compares with a whole number that has more than 32 bits."""

    def rate(self, x, m, now):
        return jnp.minimum(now.u.astype(int), 7_000_000_000) * now.du


@pytest.mark.parametrize("write", [export.to_c, export.to_modelica])
def test_whole_numbers_that_would_be_cut_are_refused(write):
    with pytest.raises(InputError, match="whole number 7000000000, and 32 bits"):
        write(Large())
    assert "7000000000" in export.to_matlab(Large())


@pytest.mark.parametrize(
    ("write", "name"),
    [
        *((export.to_matlab, name) for name in ("elseif", "otherwise", "zeros")),
        *((export.to_matlab, name) for name in ("true", "NaN", "Inf")),
        *((export.to_matlab, name) for name in ("size", "atan2", "u", "endif")),
        *((export.to_modelica, name) for name in ("equation", "not", "protected")),
        *((export.to_modelica, name) for name in ("Real", "time", "sin", "sample")),
    ],
)
def test_words_of_a_language_are_no_names(write, name):
    with pytest.raises(InputError, match="means something else there"):
        write(models.Duhem(0.4, 0.5, 0.25), name=name)


def test_counts_of_a_converter_are_numbers():
    """Of 16 bits, whose differences are more than they hold."""
    space = {}
    exec(export.to_numpy(models.PrandtlIshlinskii([0.1, 0.3], [1.0, 2.0])), space)
    counts = np.array([0, 20000, -20000, 20000], np.int16)
    outputs = []
    for row in (counts, counts.astype(float)):
        state, told = space["start"](row[0]), []
        for u in row[1:]:
            state = space["step"](state, u, 1.0)
            told.append(space["output"](state, 0.0))
        outputs.append(told)
    np.testing.assert_array_equal(*outputs)


def test_a_test_in_matlab_fails_where_an_output_is_no_number():
    record = hj.Recording(RECORD.t, U, free_run(DEVICES["rate"]))
    text = export.to_matlab(DEVICES["rate"], record=record)
    tested = matlab.function(text[text.index("function off = tested") :], "tested")
    w = np.asarray(hj.simulate(DEVICES["rate"], record, method=FixedStep(1)).w)
    run = {"w": w}
    tested.__globals__["law"] = lambda t, *_: matlab.column(run["w"][: len(t)])
    assert tested() == 0
    run["w"] = np.where(np.arange(len(w)) == 5, np.nan, w)
    with pytest.raises(AssertionError):
        tested()


def test_a_device_of_modelica_may_start_at_any_time():
    """The first step then is shorter than the others."""
    run = modelica.block(export.to_modelica(DEVICES["rate"]), "law", "Device")
    t = np.array([0.2, 0.5, 1.0, 1.5])
    u = np.sin(t)
    w = [run(time=at, u=x, period=0.5, w0=0.3) for at, x in zip(t, u, strict=True)]
    record = hj.Recording(t, u, np.full(4, 0.3))
    law = hj.simulate(DEVICES["rate"], record, w0=0.3, method=FixedStep(1)).w
    np.testing.assert_allclose(w, law, rtol=1e-12)
