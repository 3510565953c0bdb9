import re
import subprocess
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from exported import (
    DEVICES,
    GCC,
    LAW,
    MORE,
    RECORD,
    STRICT,
    W0,
    Fading,
    U,
    compiled,
    expected,
    free_run,
)

import hystjax as hj
from hystjax import models
from hystjax.export import to_c

needs_gcc = pytest.mark.skipif(GCC is None, reason="no C compiler here")


QUICK = {name: DEVICES[name] for name in ("rate", "value")}
REST = {name: DEVICES[name] for name in DEVICES.keys() - QUICK.keys()} | MORE


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return compiled(QUICK, tmp_path_factory.mktemp("c"))


@needs_gcc
@pytest.mark.parametrize("name", QUICK)
def test_c_runs_as_hystjax_does(runs, name):
    w, size = expected(name)
    np.testing.assert_allclose(runs[name](), w, rtol=0, atol=1e-12 * size)


class Signed(models.AbstractModel):
    """Signs upon signs, which may be written as other operators are."""

    def rate(self, x, m, now):
        return -jnp.negative(now.du)

    def output(self, x, m, now):
        return -jnp.negative(x) - -now.u * -jnp.negative(jnp.cos(x))


@needs_gcc
def test_signs_may_follow_signs(tmp_path):
    run = compiled({"signed": Signed()}, tmp_path)["signed"]()
    x = W0 + U - U[0]
    np.testing.assert_allclose(run, x + U * np.cos(x), rtol=0, atol=1e-12)
    for write in (hj.export.to_modelica, hj.export.to_matlab):
        assert not re.search(r"[-+*/^] *-", write(Signed())), write


# Of the others the output does not rise with the input everywhere, or cannot be led
# from sample to sample.
FOLLOWED = MORE.keys() - {"butterfly"}
FOLLOWED |= {"rate", "memory", "preisach", "magnet", "stack"}


def follows(run, name):
    """The inverse's steps lead the output where it was led before."""
    w, size = expected(name)
    reached = run("run", run("back", w, U[0]))
    np.testing.assert_allclose(reached, w, rtol=0, atol=1e-12 * size, err_msg=name)


@needs_gcc
@pytest.mark.parametrize("name", sorted(FOLLOWED & QUICK.keys()))
def test_the_inverse_steps_lead_the_output(runs, name):
    follows(runs[name], name)


@needs_gcc
def test_the_inverse_keeps_limits(runs):
    u = runs["rate"]("back", 2 * expected("rate")[0], U[0])
    assert np.max(np.abs(u)) <= 2


@needs_gcc
def test_the_inverse_leaps_after_a_rest_that_was_none_to_the_last_digit(runs):
    wanted = np.zeros_like(U)
    wanted[300], wanted[301:] = 2e-14, 0.2
    reached = runs["value"]("run", runs["value"]("back", wanted, 0.0))
    np.testing.assert_allclose(reached, wanted, rtol=0, atol=1e-13)


@needs_gcc
@pytest.mark.thorough
def test_all_other_families_run_as_hystjax_does(tmp_path):
    for name, run in compiled(REST, tmp_path).items():
        w, size = expected(name)
        np.testing.assert_allclose(run(), w, rtol=0, atol=1e-12 * size, err_msg=name)
        if name in FOLLOWED:
            follows(run, name)


@needs_gcc
def test_the_way_back_knows_no_unit_of_the_input(tmp_path):
    """A contact that slides after a millimetre, over positions in mm, m and Gm."""
    units = {"mm": 1.0, "m": 1e-3, "Gm": 1e-12}
    contacts = {name: models.Dahl(2.0 / unit, 0.5, 1.4) for name, unit in units.items()}
    for name, run in compiled(contacts, tmp_path).items():
        w = run("run", units[name] * U, 0.0)
        back = run("back", 0.8 * w, units[name] * U[0]) / units[name]
        again = run("run", units[name] * back, 0.0)
        np.testing.assert_allclose(again, 0.8 * w, rtol=0, atol=1e-12, err_msg=name)
        assert np.max(np.abs(back)) < np.max(np.abs(U)), name


@needs_gcc
def test_the_way_back_sees_what_is_near_after_a_leap(tmp_path):
    """A softening spring: so far as the leap was, the output has come back."""
    spring = models.BoucWenForce(0.2, 12.0, 12.0, 6.4, 1.5)
    ((_, run),) = compiled({"spring": spring}, tmp_path).items()
    u = np.sin(0.05 * np.arange(len(U)))
    u[201:] = u[200] - 0.6 + 0.0125 * np.minimum(np.arange(len(U) - 201), 40)
    w = run("run", u, 0.0)
    reached = run("run", run("back", w, u[0]), 0.0)
    np.testing.assert_allclose(reached, w, rtol=0, atol=1e-9)


SATURATED = """
int main(void)
{
    law_state s;
    int good = 0, beyond = 0;
    for (int i = 1; i <= 9; i++) {
        law_init(&s, 0, 0.4);
        const bool known = law_follow(&s, 0.1 * i, 0.02, -1e3, 1e3, 1e-9);
        good += (i < 5) && known;
        beyond += (i > 5) && known;
    }
    return ((good == 4) && (beyond == 0)) ? 0 : 1;
}
"""


@needs_gcc
def test_a_leap_that_is_too_long_for_a_step_reaches_nothing(tmp_path):
    """A contact whose force is 0.5 at most, and by long steps is more."""
    source = to_c(models.Dahl(2.0, 0.5, 1.4)) + SATURATED
    (tmp_path / "law.c").write_text(source, encoding="utf-8")
    command = [GCC, *STRICT, "law.c", "-o", "law", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run(["./law"], cwd=tmp_path, check=True)


@needs_gcc
def test_a_spring_that_slides_is_drawn_no_farther_by_what_is_rounded(tmp_path):
    """Its force is 0.61 at most, 0.9 nm from where it rests, and it may go 2 m."""
    springs = models.MaxwellSlip([1e9, 6e8, 3e8], [1e-10, 4e-10, 9e-10])
    run = compiled({"springs": springs}, tmp_path)["springs"]
    wanted = 0.8 * np.sin(3 * RECORD.t)
    back = run("back", wanted, 0.0)
    assert np.max(np.abs(back)) < 4e-9
    kept = np.clip(wanted, -0.61, 0.61)
    np.testing.assert_allclose(run("run", back, 0.0), kept, rtol=0, atol=1e-12)


@needs_gcc
def test_floats_are_off_by_their_rounding(tmp_path):
    name = "rate"
    run = compiled({name: DEVICES[name]}, tmp_path, f"-D{name.upper()}_FLOAT")[name]
    off = np.max(np.abs(run() - free_run(DEVICES[name])))
    assert 1e-9 < off < 1e-5


@needs_gcc
@pytest.mark.thorough
@pytest.mark.parametrize("name", DEVICES | MORE)
def test_floats_of_all_families_lose_a_millionth_at_most(name, tmp_path):
    device = {name: (DEVICES | MORE)[name]}
    run = compiled(device, tmp_path, f"-D{name.upper()}_FLOAT")[name]
    w, size = expected(name)
    np.testing.assert_allclose(run(), w, rtol=0, atol=1e-6 * size)


# Of a million inputs some are no numbers, some huge, and some steps have no length.
HOSTILE = """
#include <stdio.h>
int main(void)
{{
    static const double odd[8] = {{NAN, INFINITY, -INFINITY, 1e300, -1e300, 1e-300,
                                  -0.0, 1.7976931348623157e308}};
    {0}_state s;
    unsigned seed = 1u;
    int refused = 0;
    {0}_init(&s, 0.1, 0.2);
    for (long i = 0; i < {1}L; i++) {{
        seed = seed * 1664525u + 1013904223u;
        const unsigned pick = seed >> 20;
        const double u = (pick % 50u == 0u) ? odd[(pick / 50u) % 8u]
                                            : (double)(pick % 997u) / 400.0 - 1.2;
        const double h = (pick % 83u == 0u) ? odd[pick % 8u] : 0.01;
        refused += {0}_step(&s, u, h) ? 0 : 1;
        if (i % 997 == 0) {{
            (void){0}_follow(&s, u, h, -2.0, (pick % 3u == 0u) ? odd[pick % 8u] : 2.0,
                             odd[(pick / 7u) % 8u]);
        }}
        if (!isfinite({0}_output(&s, s.du))) {{
            return 1;
        }}
    }}
    (void)printf("%d\\n", refused);
    return 0;
}}
"""


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("name", DEVICES)
def test_nothing_that_comes_in_breaks_it(tmp_path, name):
    source = to_c(DEVICES[name], name="law") + HOSTILE.format("law", 10**6)
    (tmp_path / "law.c").write_text(source, encoding="utf-8")
    flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = [GCC, *STRICT, *flags, "law.c", "-o", "law", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    run = subprocess.run(["./law"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0 and not run.stderr, run.stderr
    assert int(run.stdout) > 10_000


@needs_gcc
def test_self_test_of_a_record(tmp_path):
    record = hj.Recording(RECORD.t, U, free_run(DEVICES["rate"]))
    text = to_c(DEVICES["rate"], record=record)
    assert "w' = 0.25 u'" in text and "Of the record: u from" in text
    (tmp_path / "law.c").write_text(text, encoding="utf-8")
    for flags in ([], ["-DLAW_FLOAT"]):
        command = [GCC, *STRICT, "-DLAW_SELF_TEST", *flags, "law.c", "-o", "law", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        assert subprocess.run(["./law"], cwd=tmp_path, check=False).returncode == 0


def test_a_test_is_no_run_beyond_what_was_fitted():
    """Nor are its times, which begin at 0, those of the record."""
    t = 5000 + np.linspace(0, 3, 61)
    small, large = (hj.Recording(t, x * np.sin(t), x * np.cos(t)) for x in (1.0, 2.0))
    known = hj.models.FittedRange.of([small])
    law = models.Duhem(0.4, 0.5, 0.25).fitted_on(known)
    with pytest.warns(UserWarning, match="from t = 500"):
        hj.simulate(law, large)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        to_c(law, record=large)


class Ageing(models.AbstractModel):
    """A model of one's own, of time, a switch, a loop and a table."""

    table: jax.Array = eqx.field(converter=jnp.asarray)

    @property
    def memory(self):
        return hj.library.Relays(jnp.array([0.3, 0.5]), jnp.array([-0.2, 0.1]))

    def rate(self, x, m, now):
        slow = jax.lax.fori_loop(0, 3, lambda i, y: y + jnp.tanh(y) / (i + 1), x)
        place = jnp.searchsorted(self.table, now.u)
        # Infinite where the input is negative.
        side = jnp.where(jnp.isfinite(1 / jnp.maximum(now.u, 0.0)), 0.2, -0.1)
        rate = self.table[place] - slow * jnp.exp(-now.t / 10) + jnp.sum(m * 0.1)
        return rate + side * jax.nn.sigmoid(x)

    def output(self, x, m, now):
        return jax.lax.cond(x > 0.1, lambda: x, lambda: x**3 + 0.1 - 0.001)


@needs_gcc
def test_models_of_ones_own(tmp_path):
    model = Ageing([-0.5, 0.0, 0.5])
    run = compiled({"own": model}, tmp_path)["own"]
    np.testing.assert_allclose(run(), free_run(model), rtol=0, atol=1e-12)


class Edge(models.AbstractModel):
    """A curve that ends within the input's range, and a table that ends there too."""

    table: jax.Array

    def rate(self, x, m, now):
        return 0.0 * x

    def output(self, x, m, now):
        place = jnp.clip(jnp.floor(now.u * 1e12).astype(int), 0, 2)
        curve = jnp.maximum(jnp.sqrt(1 - (2 * now.u) ** 2), 0.0)
        return jnp.minimum(curve, jnp.sign(curve) * 3.0) + self.table[place]


@needs_gcc
def test_what_is_no_number_stays_none_and_what_is_no_int_ends_the_table(tmp_path):
    run = compiled({"edge": Edge(jnp.array([10.0, 20.0, 30.0]))}, tmp_path)["edge"]
    with np.errstate(invalid="ignore"):
        curve = np.sqrt(1 - (2 * U) ** 2)
    assert 0 < np.isnan(curve).sum() < len(U)
    place = np.clip(np.floor(U * 1e12), 0, 2)
    w, lost = run(), np.isnan(curve)
    # A step to where there is no output is refused, and told at its beginning.
    np.testing.assert_array_equal(np.isnan(w[:-1]), lost[1:])
    there = ~(lost[:-1] | lost[1:])
    expected = curve + 10 * (place + 1)
    np.testing.assert_allclose(w[:-1][there], expected[:-1][there], rtol=1e-12)


@needs_gcc
@pytest.mark.parametrize("name", ["flt", "dbl", "ldbl"])
def test_names_of_the_language_are_no_macros(name, tmp_path):
    law = DEVICES["rate"]
    compiled({name: law}, tmp_path)
    compiled({name: law}, tmp_path, f"-D{name.upper()}_FLOAT")


def test_names_and_units_stay_in_the_comment():
    hostile = '*/ int main(void) { return 1; } /* "'
    model = LAW({"du": 0.25}, names=(hostile, "stroke\n#error"), units=("V", "µm"))
    text = to_c(model)
    comment = text[: text.index("#include")]
    assert comment.count("*/") == 1 and "stroke #error, in µm" in comment


def test_a_law_of_single_precision_passes_its_own_test(tmp_path):
    t = np.linspace(0, 20, 401)
    with jax.enable_x64(False):
        law = models.SparseModel.from_terms({"du": 0.25, "w*|du|": -0.5})
        source = to_c(law, record=hj.Recording(t, np.sin(t), 0.1 + 0 * t))
    (tmp_path / "law.c").write_text(source)
    for flags in ((), ("-DLAW_FLOAT",)):
        command = [GCC, *STRICT, "-DLAW_SELF_TEST", *flags, "law.c", "-o", "law", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        subprocess.run(["./law"], cwd=tmp_path, check=True)


def test_a_record_of_our_days_is_tested_to_the_last_digits(tmp_path):
    """Seconds since 1970 are known to a quarter of a microsecond."""
    law = LAW({"lag(u,0.5)": 1.0, "u": 0.3}, target="value")
    t = 1.7e9 + np.linspace(0, 6, 241)
    record = hj.Recording(t, np.sin(2 * t), np.zeros_like(t))
    (tmp_path / "law.c").write_text(to_c(law, record=record))
    command = [GCC, *STRICT, "-DLAW_SELF_TEST", "law.c", "-o", "law", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run(["./law"], cwd=tmp_path, check=True)


def test_a_device_that_fades_is_tested_at_the_times_of_its_record(tmp_path):
    t = np.linspace(5, 15, 101)
    record = hj.Recording(t, np.sin(t), np.sin(t))
    source = to_c(Fading(2.0), record=record)
    assert "{5.0, " in source and "{0.0, " not in source
    (tmp_path / "law.c").write_text(source)
    command = [GCC, *STRICT, "-DLAW_SELF_TEST", "law.c", "-o", "law", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run(["./law"], cwd=tmp_path, check=True)
    namespace = {}
    exec(hj.export.to_numpy(Fading(2.0)), namespace)
    faded = Fading(2.0).along(t, np.sin(t))
    np.testing.assert_allclose(namespace["run"](t, np.sin(t)), faded, atol=1e-12)


def test_a_record_in_other_units_is_told():
    law = models.Duhem(0.4, 0.5, 0.2, units=("V", "µm"))
    record = hj.Recording(RECORD.t, U, 0 * U, units=("mV", "nm"))
    with pytest.warns(UserWarning, match="input in V, and the recording's is in mV"):
        to_c(law, record=record)


def test_a_record_of_steps_too_long_for_a_law_is_told():
    """Which one step of Runge and Kutta a sample loses, and no other method does."""
    law = models.SparseModel.from_terms({"w": -500.0, "u": 100.0})
    t = 0.01 * np.arange(400)
    record = hj.Recording(t, np.sin(t), 0 * t)
    assert np.all(np.isfinite(hj.simulate(law, record).w))
    with pytest.raises(hj.InputError, match="sampled more finely, or none"):
        to_c(law, record=record)


@needs_gcc
def test_a_self_test_of_what_is_no_number_fails(tmp_path):
    record = hj.Recording(RECORD.t, U, free_run(DEVICES["rate"]))
    text = to_c(DEVICES["rate"], record=record)
    rows = re.findall(r"^    \{.*, .*, (.*)\},?$", text, re.MULTILINE)
    (tmp_path / "law.c").write_text(text.replace(rows[5], "NAN"), encoding="utf-8")
    command = [GCC, *STRICT, "-DLAW_SELF_TEST", "law.c", "-o", "law", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert subprocess.run(["./law"], cwd=tmp_path, check=False).returncode == 1
