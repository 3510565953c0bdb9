import json
import os
from collections.abc import Callable

import equinox as eqx
import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from classical_equations import play
from hypothesis import given

import hystjax as hj
from hystjax import InputError
from hystjax._core.files import write_atomically
from hystjax.library import (
    Custom,
    Fourier,
    Library,
    LogCreep,
    NoMemory,
    Play,
    Polynomial,
    Term,
)
from hystjax.models import (
    AbstractModel,
    BoucWen,
    BoucWenOscillator,
    Butterfly,
    Duhem,
    Instrumented,
    MaxwellSlip,
    SparseModel,
)
from hystjax.saving import difference
from hystjax.signals import Signals


def back(path, model, functions=None):
    hj.save(path, model)
    return hj.load(path, functions)


def batch(model):
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * 4), model)


def bits(array):
    return np.asarray(array).dtype, np.asarray(array).tobytes()


CANDIDATES = (Polynomial(2) + Fourier((0.5, 1 / 3), "|w|")).terms
PAIRS = st.tuples(*[st.text(st.characters(codec="utf-8"), max_size=10)] * 2)


@st.composite
def fields(draw):
    dtype = np.dtype(draw(st.sampled_from(["float32", "float64"])))
    finite = hnp.from_dtype(dtype, allow_nan=False, allow_infinity=False)
    terms = draw(st.lists(st.sampled_from(CANDIDATES), min_size=1, unique=True))
    support = draw(hnp.arrays(bool, len(terms)))
    values = draw(hnp.arrays(dtype, len(terms), elements=finite))
    return tuple(terms), values, support, draw(PAIRS), draw(PAIRS)


@given(fields())
def test_sparse_models_load_bit_for_bit(tmp_path_factory, fields):
    terms, values, support, names, units = fields
    values = np.where(support, values, values.dtype.type(0))
    model = SparseModel(Library(terms), values, support, names=names, units=units)
    loaded = back(tmp_path_factory.getbasetemp() / "law.json", model)
    assert loaded.library.terms == terms  # in their order
    assert bits(loaded.coefficients) == bits(values)
    assert bits(loaded.support) == bits(support)
    assert (loaded.names, loaded.units) == (names, units)


@pytest.mark.parametrize(
    "model",
    [
        Duhem(0.1, 1 / 3, -7e-300, names=("coil", "field"), units=("A", "T")),
        Duhem(*(jnp.float32(x) for x in (0.1, 1 / 3, -2e38))),
        BoucWen(1e22, 0.1, -0.3, 1.7),
        BoucWenOscillator(2, 0.1, 5e4, 1e22, 1 / 3, -0.3, 1.7, units=("N", "m")),
        Duhem((0.1, 1 / 3), 0.2, (1e-9, -3.0, 1e22)),
        Instrumented(Duhem((0.1,), 0.2, 0.3), delay=1 / 3, output_gain=-7e-300),
        Butterfly(Duhem((0.1, 1 / 3), 0.2, 0.3), -1 / 3, 1e-300, units=("V", "mm")),
        Instrumented(BoucWen(1.0, 0.1, -0.3), names=("coil", "field")),
        Instrumented(
            SparseModel.from_terms({"u": 1 / 3, "w": -0.1}, units=("A", "T")),
            input_gain=0.1,
        ),
    ],
    ids=lambda model: str(model),
)
def test_classical_models_load_bit_for_bit(tmp_path, model):
    loaded = back(tmp_path / "law.json", model)
    assert type(loaded) is type(model)
    for one, other in zip(jax.tree.leaves(loaded), jax.tree.leaves(model), strict=True):
        assert bits(one) == bits(other)
    assert (loaded.names, loaded.units) == (model.names, model.units)


def test_the_file_is_plain_readable_json(tmp_path):
    terms = {"du": 0.25, "u*|du|": 0.4, "w*|du|": -0.5}
    path = tmp_path / "law.json"
    hj.save(path, SparseModel.from_terms(terms, units=("V", "µm")))
    text = path.read_text(encoding="utf-8")
    assert json.loads(text) == {
        "format": "hystjax model",
        "version": 2,
        "law": "w' = 0.25 u' + 0.4 u |u'| - 0.5 w |u'|",
        "dtype": "float64",
        "model": {
            "kind": "SparseModel",
            "names": ["input", "output"],
            "units": ["V", "µm"],
            "target": "rate",
            "terms": terms,
            "candidates": list(terms),
        },
    }
    lines = [line.strip().rstrip(",") for line in text.splitlines()]
    assert '"w*|du|": -0.5' in lines  # one line a coefficient
    assert '"units": ["V", "µm"]' in lines


def test_candidates_off_the_support_are_kept_and_zero(tmp_path):
    library = Polynomial(1)
    support = jnp.array([False, True, False, True, False, False])
    model = SparseModel(library, jnp.arange(1.0, 7.0), support)
    loaded = back(tmp_path / "law.json", model)
    assert loaded.library.names == ("1", "w", "u", "du", "|du|", "|w|")
    np.testing.assert_array_equal(loaded.coefficients, [0, 2, 0, 4, 0, 0])
    np.testing.assert_array_equal(loaded.support, support)
    now = Signals(*jnp.array([0.3, -0.7, 2.0]))
    x = jnp.asarray(0.4)
    np.testing.assert_array_equal(loaded.rate(x, (), now), model.rate(x, (), now))


def knee(w, u, du):
    return jnp.tanh(w) * du


def test_functions_are_passed_and_never_run_from_the_file(tmp_path):
    library = Custom({"knee": knee}) * Polynomial(1, ("u", "|du|"))
    model = SparseModel(library, jnp.array([1.0, 2.0, 3.0]), jnp.ones(3, bool))
    path = tmp_path / "law.json"
    assert back(path, model, {"knee": knee}).library == library
    with pytest.raises(InputError, match=r"'knee'.*functions="):
        hj.load(path)


def document(**changes):
    """A sound model file as a dictionary, with changes; ... leaves a field out."""
    sound = {
        "format": "hystjax model",
        "version": 2,
        "dtype": "float64",
        "model": law(),
    }
    return {k: v for k, v in (sound | changes).items() if v is not ...}


def law(**changes):
    sound = {
        "kind": "SparseModel",
        "names": ["input", "output"],
        "units": ["V", "µm"],
        "target": "rate",
        "terms": {"w": -1, "u": 2.5},
        "candidates": ["w", "u", "du"],
    }
    return {k: v for k, v in (sound | changes).items() if v is not ...}


def sparse(dtype="float64", **changes):
    return document(model=law(**changes), dtype=dtype)


def of_kind(kind, **fields):
    return document(model={"kind": kind, **fields})


def duhem(**parameters):
    return of_kind("Duhem", **parameters)


def instrumented(**parameters):
    device = {"kind": "Duhem", "alpha": 1, "beta": 2, "gamma": 3}
    return of_kind("Instrumented", device=device, **parameters)


FLAGS = {"dtype": "bool", "shape": [2], "numbers": [True, False]}


def array(shape, numbers, dtype="float64"):
    return duhem(
        alpha={"dtype": dtype, "shape": shape, "numbers": numbers}, beta=1, gamma=1
    )


def test_only_polynomials_have_several_numbers(tmp_path, unchecked):
    path = tmp_path / "law.json"
    path.write_text(json.dumps(duhem(alpha=1, beta=[1], gamma=1)))
    with pytest.raises(InputError, match=r"must be a number.*shape \(1,\)"):
        hj.load(path)


RUNS = "__import__('pathlib').Path('ran').touch()"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not JSON"),
        ('{"format": "hystjax model"', "not JSON"),
        ('{"format": "hystjax model", "format": 1}', "same key twice: format"),
        ('{"format": NaN', "not JSON"),
        ("1" * 5000, "no model"),
        ("[" * 100_000, "not JSON"),
        (sparse(names=json.loads("[" * 900 + "]" * 900)), "lists inside of lists"),
        (b"\xff\xfe", "not JSON"),
        ("[1, 2]", "no model"),
        ({}, "no model"),
        (document(format="hystjax report"), 'no model.*"hystjax model"'),
        (document(version=3), "version 3.*reads version 2.*Update"),
        (document(version=...), '"version" must be 2, got None'),
        (document(version=True), '"version" must be 2, got True'),
        (document(version=1), '"version" must be 2, got 1'),
        (document(model=...), "model must be an object, got None"),
        (document(model=[1]), r"model must be an object, got \[1\]"),
        (of_kind("Stranger"), "'Stranger'.*Import the package.*AbstractModel`.$"),
        (of_kind("SparsModel"), "'SparsModel'.*Did you mean SparseModel"),
        (of_kind("os.system"), "'os.system'.*Import the package"),
        (of_kind("AbstractLaw"), "'AbstractLaw' is no kind"),
        (of_kind("Library", terms=["w"]), "no model, but a Library"),
        (sparse(kind=...), 'needs a "kind"'),
        (sparse(kind=3), 'needs a "kind"'),
        (sparse(units=["V"]), "`units` must hold two texts"),
        (sparse(units=["V", 3]), "`units` must hold two texts"),
        (sparse(units="Vm"), "`units` must hold two texts"),
        (sparse(target="both"), "`target` must be 'rate' or 'value'"),
        (sparse(target="value"), "a law of the value w cannot hold w"),
        (
            sparse(colour=1),
            "SparseModel has no colour; its fields are names, units, target, "
            "fitted_range, terms, candidates",
        ),
        (of_kind("Library", terms=["w"], colour=1), "Library has no colour"),
        (sparse(terms=...), '"terms" must be an object'),
        (sparse(terms=["w"]), '"terms" must be an object'),
        (sparse(candidates=...), "must be a list of text, got None"),
        (sparse(candidates="w"), "must be a list of text"),
        (sparse(candidates=-1.0), "must be a list of text, got -1.0"),
        (sparse(candidates=["w", 1]), "must be a list of text"),
        (sparse(candidates=[]), "at least one term"),
        (sparse(candidates=["w", "u", "w"]), "twice.*'w'"),
        (
            sparse(candidates=["w", "u", "position"]),
            "'position' in the term .* neither a var",
        ),
        (sparse(candidates=["w", "u", RUNS]), r"__import__\('pathlib.* neither a var"),
        (
            sparse(candidates=["w", "u", "sin(x*u)"]),
            "'sin.x.u.' in the term .* neither a var",
        ),
        (sparse(terms={"du^2": 1}), '"du\\^2" is in "terms" but not in "candidates"'),
        (sparse(terms={"u*w": 1, "w*u": 1}, candidates=["w*u"]), "term twice"),
        (sparse(terms={"w": "1"}), '"w" in "terms" must be a number'),
        (sparse(terms={"w": True}), '"w" in "terms" must be a number'),
        (sparse(terms={"w": float("nan")}), "finite, got w = nan"),
        (sparse(terms={"w": float("inf")}), "finite, got w = inf"),
        (sparse(terms={"w": 10**400}), "finite, got w = inf"),
        (json.dumps(sparse()).replace("-1", "-1e400"), "finite, got w = -inf"),
        (sparse(terms={"w": 1e300}, dtype="float32"), "finite, got w = inf"),
        (document(dtype=...), '"dtype" must be float32 or float64'),
        (document(dtype="object"), '"dtype" must be float32 or float64'),
        (duhem(alpha=1, beta=2), "needs gamma; got alpha, beta"),
        (
            duhem(alpha=1, beta=2, gamma=3, n=1),
            "no n; its fields are names, units, fitted_range, alpha, beta, gamma",
        ),
        (duhem(alpha="1", beta=2, gamma=3), "must be real numbers"),
        (duhem(alpha=[], beta=2, gamma=3), "needs at least one coefficient"),
        (duhem(alpha={}, beta=2, gamma=3), "must be real numbers"),
        (duhem(alpha=[[1, 2], [3]], beta=2, gamma=3), "must be a number"),
        (duhem(alpha=-1e400, beta=2, gamma=3), "finite, got alpha = -inf"),
        (duhem(alpha={"python": float("nan")}, beta=2, gamma=3), "finite, got alpha"),
        (duhem(alpha={"leaves": {}}, beta=2, gamma=3), "register the class"),
        (duhem(alpha={"kind": "NoMemory"}, beta=2, gamma=3), "must be real numbers"),
        (array([2], [1.0, 2.0]), "must be a number, got an array"),
        (array([3], [1.0, 2.0]), r"2 numbers.*shape \[3\]"),
        (array([10**9], []), r"0 numbers.*shape"),
        (array([-1, -2], [1.0, 2.0]), "2 numbers"),
        (array([1] * 40, [1.0]), "1 numbers"),
        (array("2", [1.0, 2.0]), "must be lists"),
        (array([], [1.0], "object"), "no known type: 'object'"),
        (array([], [1.0], ["float64"]), "no known type"),
        (array([], ["1"]), "float64 only, got '1'"),
        (array([], [True]), "float64 only, got True"),
        (array([], [float("nan")]), "finite, got alpha = nan"),
        (array([], [10**400]), "finite, got alpha = inf"),
        (array([], [1.5], "int8"), "whole numbers"),
        (array([], [300], "int8"), "too large for int8"),
        (sparse(names=["\ud800", "w"]), r"'\\ud800', half a character"),
        (sparse(candidates=["w", "u", "\udc00"]), r"'\\udc00', half a character"),
        (sparse(terms={"\udc00": 1}), r"'\\udc00', half a character"),
        (instrumented(delay=1, volume=2), "Instrumented has no volume"),
        (of_kind("Instrumented"), "needs device; got nothing"),
        (of_kind("Instrumented", device=3.0), "`device` must be a model"),
        (of_kind("BoucWen", alpha=1, beta=1, gamma=1, n=-1), "`n` must be at least 0"),
        pytest.param(
            duhem(alpha=1, beta=1, gamma=1, names=FLAGS),
            "`names` must hold two texts",
            marks=pytest.mark.filterwarnings("ignore:A JAX array is being set"),
        ),
    ],
)
def test_unusable_files_are_refused(tmp_path, monkeypatch, unchecked, content, message):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "law.json"
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as caught:
        hj.load(path)
    assert str(path) in str(caught.value)
    assert os.listdir(tmp_path) == ["law.json"]  # nothing in the file was run


def test_a_network_without_an_array_is_refused(tmp_path):
    law, path = hj.models.Duhem(0.4, 0.5, 0.25), tmp_path / "law.json"
    record = hj.Recording(np.arange(9.0), np.sin(np.arange(9.0)), np.arange(9.0))
    hybrid = hj.models.Hybrid.untrained(law, record, width=2, key=jax.random.key(0))
    hj.save(path, hybrid)
    whole = json.loads(path.read_text())
    for place, leaf in whole["model"]["network"]["leaves"].items():
        numbers = leaf.pop("numbers")
        path.write_text(json.dumps(whole))
        with pytest.raises(InputError, match=f'"network" needs an array at {place}'):
            hj.load(path)
        leaf["numbers"] = numbers


def nested(levels, device):
    for _ in range(levels):
        device = {"kind": "Instrumented", "device": device}
    return document(model=device)


def count(name, numbers):
    return {name.format(i): 1 for i in range(numbers)}


# Where time grew with the square of what is in the file, this would take minutes.
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (lambda: json.dumps(count("k{}", 60_000))[:-1] + ', "k0": 1}', "twice: k0"),
        (lambda: "{" + '"w": 1, ' * 60_000 + '"u": 1}', "twice: w"),
        (lambda: "[" + "1," * 30_000_000 + "1]", r"more than 4 MB.*compact\(\)"),
        (lambda: sparse(names=["w"] * 60_000), "`names` must hold two texts"),
        (lambda: of_kind("w" * 3_000_000), "'www.* is no kind of model"),
        (lambda: sparse(candidates=list(count("x{}", 30_000))), "'x0'.*functions="),
        (lambda: sparse(candidates=["w"] * 10_000), "twice.*'w'"),
        (lambda: sparse(candidates=["w"] * 60_000), "60000 candidate.*at most 30000"),
        (lambda: sparse(terms=count("w*u^{}", 30_000)), '"w\\*u\\^1" is in "terms"'),
        (lambda: sparse(terms=count("u*{}", 60_000)), "60000 candidate terms"),
        (lambda: sparse(terms=count("{}", 30_000)), "'0' in the term .* neither a var"),
        (lambda: duhem(**count("k{}", 60_000)), "Duhem has no k0"),
        (lambda: duhem(alpha=[1] * 60_000, beta=1, gamma=1), "60002 parameters"),
        (lambda: array([60_000], [1] * 60_000), r"must be a number.*60000"),
        (lambda: nested(300, duhem(alpha=1)["model"]), "a model inside of a model"),
        (lambda: nested(300, None), "a model inside of a model"),
    ],
    ids=lambda value: value[:30] if isinstance(value, str) else "file",
)
def test_large_files_are_refused_soon(tmp_path, unchecked, content, message):
    path = tmp_path / "law.json"
    content = content()  # made here: all of them at once are large
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError, match=message) as caught:
        hj.load(path)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 1000 + len(str(path))


@pytest.mark.thorough
def test_large_laws_come_back(tmp_path):
    """As many candidates as a file may hold, and more nested models than are useful."""
    law = law_of(30_000)
    loaded = back(tmp_path / "law.json", law)
    assert loaded.library.terms == law.library.terms
    assert bits(loaded.coefficients) == bits(law.coefficients * law.support)
    assert bits(loaded.support) == bits(law.support)
    model = instruments(15, Duhem(tuple(range(998)), 1.0, 1.0))
    assert eqx.tree_equal(back(tmp_path / "law.json", model), model)


def law_of(count):
    """A law of many candidates, every other of which takes part."""
    library = Library(tuple(Term.parse(f"u^{i}") for i in range(count)))
    return SparseModel(library, np.arange(1.0, count + 1), np.arange(count) % 2 == 0)


def instruments(levels, model):
    for _ in range(levels):
        model = Instrumented(model, delay=0.1)
    return model


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"there is no file .*absent\.json"):
        hj.load(tmp_path / "absent.json")
    with pytest.raises(InputError, match="cannot be read: it is a folder"):
        hj.load(tmp_path)
    with pytest.raises(InputError, match=r"nul\\x00l.*cannot be read"):
        hj.load("nul\0l")


def test_what_has_no_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")  # would wait for a writer
    (tmp_path / "link").symlink_to("pipe")
    for path in (tmp_path / "pipe", tmp_path / "link", "/dev/zero"):
        with pytest.raises(InputError, match=r"not an ordinary file.*write to a file"):
            hj.load(path)


def test_a_byte_order_mark_and_whole_numbers_are_fine(tmp_path):
    path = tmp_path / "law.json"
    path.write_text(json.dumps(document()), encoding="utf-8-sig")
    assert hj.load(path).terms() == {"w": -1.0, "u": 2.5}


def test_64_bit_numbers_are_not_rounded_in_silence(tmp_path):
    path = tmp_path / "law.json"
    hj.save(path, Duhem(0.1, 0.2, 0.3))
    with jax.enable_x64(False), pytest.warns(UserWarning, match="jax_enable_x64"):
        loaded = hj.load(path)
    assert bits(loaded.alpha) == bits(np.float32(0.1))
    hj.save(path, Duhem(1e300, 0.2, 0.3))
    with (
        jax.enable_x64(False),
        pytest.warns(UserWarning, match="jax_enable_x64"),
        pytest.raises(InputError, match="finite, got alpha = inf"),
    ):
        hj.load(path)


class Opaque(Duhem):
    """A law with something in it that no file holds."""

    shape: Callable = jnp.tanh


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (Opaque(1.0, 1.0, 1.0), r"model's shape\. Register .*like="),
        (Polynomial(1), "must be a model or the `Solution` of a fit, got a Library"),
        (batch(SparseModel.from_terms({"w": 1.0, "u": 2.0})), r"batch.*\(4, 2\)"),
        (batch(Duhem(1.0, 2.0, 3.0)), r"shape \(4,\).*batches of models"),
        (Duhem(1.0, jnp.inf, 1.0), "finite, got beta = inf"),
        (
            MaxwellSlip([2.0, 1.0], [0.1, np.inf]),
            r"in a file .* limits = inf\. .* give one far beyond the input's range",
        ),
        (SparseModel.from_terms({"w": 1.0, "u": np.inf}), "finite, got terms.u = inf"),
        (Duhem(1.0, 1.0, 1.0, names=("\ud800", "w")), r"half a character.*\\ud800"),
        (Duhem(1.0, 1.0, 1.0, units=("V", "m\udc00")), r"half a character.*m\\udc00"),
        (Duhem(1.0, 1.0, 1.0, names=("u" * 5_000_000, "w")), r"takes \d+\.\d MB"),
    ],
    ids=lambda value: "model" if isinstance(value, eqx.Module) else value[:20],
)
@pytest.mark.filterwarnings("ignore")
def test_models_that_cannot_be_saved(tmp_path, unchecked, model, message):
    with pytest.raises(InputError, match=message):
        hj.save(tmp_path / "law.json", model)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Duhem(tuple(range(1001)), 1.0, 1.0), "1003 parameters"),
        (lambda: instruments(16, Duhem(1.0, 1.0, 1.0)), "a model inside of a model"),
        (lambda: instruments(300, Duhem(1.0, 1.0, 1.0)), "a model inside of a model"),
        (lambda: law_of(30_001), r"30001 candidate terms.*compact\(\)"),
    ],
    ids=["parameters", "levels", "many levels", "terms"],
)
def test_models_that_are_too_large_to_be_saved(tmp_path, unchecked, make, message):
    with pytest.raises(InputError, match=message):
        hj.save(tmp_path / "law.json", make())
    assert not os.listdir(tmp_path)


def test_a_traced_model_is_refused(tmp_path):
    def traced(alpha):
        hj.save(tmp_path / "law.json", Duhem(alpha, 1.0, 1.0))
        return alpha

    with pytest.raises(InputError, match="outside `jit`"):
        jax.jit(traced)(1.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing/law.json", "no folder .*missing.*Create it"),
        ("file/law.json", "no folder"),
        ("folder", "is a folder"),
        ("n" * 300 + ".json", "cannot be written"),  # longer than file systems allow
    ],
)
def test_places_that_cannot_be_written(tmp_path, name, message):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("kept")
    with pytest.raises(InputError, match=message):
        hj.save(tmp_path / name, Duhem(1.0, 1.0, 1.0))
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]
    assert (tmp_path / "file").read_text() == "kept"


def test_special_files_are_not_replaced():
    with pytest.raises(InputError, match="not an ordinary file"):
        hj.save(os.devnull, Duhem(1.0, 1.0, 1.0))


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="has no /proc")
def test_what_output_is_redirected_to_is_not_replaced(tmp_path):
    kept = tmp_path / "all.csv"
    with kept.open("w") as stream:
        stream.write("precious")
        stream.flush()
        with pytest.raises(InputError, match="is a device; give the path of a file"):
            hj.save(f"/proc/self/fd/{stream.fileno()}", Duhem(1.0, 1.0, 1.0))
    assert kept.read_text() == "precious"


@pytest.mark.skipif(not os.path.isdir("/dev/fd"), reason="has no /dev/fd")
def test_a_pipe_is_called_as_it_was_given():
    """And not by where its link leads, which is no path: /proc/1/fd/pipe:[5]."""
    ends = os.pipe()
    try:
        with pytest.raises(InputError, match=rf"/dev/fd/{ends[1]} is not an ordinary"):
            hj.save(f"/dev/fd/{ends[1]}", Duhem(1.0, 1.0, 1.0))
    finally:
        for end in ends:
            os.close(end)


def test_a_failed_write_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "old.txt"
    path.write_bytes(b"old")

    def fails(stream):
        stream.write(b"half")
        assert path.read_bytes() == b"old"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, fails)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["old.txt"]


def test_a_replaced_file_keeps_its_link_and_usual_permissions(tmp_path):
    plain, path, link = (tmp_path / name for name in ("plain", "path", "link"))
    plain.write_bytes(b"")
    link.symlink_to(path)
    write_atomically(link, lambda stream: stream.write(b"new"))
    assert link.is_symlink()
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode == plain.stat().st_mode


def test_odd_powers_come_back(tmp_path):
    library = Library((Term.parse(f"|w|^{1 / 3!r}"),))
    model = SparseModel(library, jnp.ones(1), jnp.ones(1, bool))
    hj.save(tmp_path / "law.json", model)
    assert hj.load(tmp_path / "law.json").library.terms == library.terms


LONG = [
    "*" * 50_000, "w*" * 20_000 + "x", "w" * 200_000, "(" * 200_000,
    "*(" * 100_000, "sin(" * 50_000, "sin(1.0*" * 25_000 + "u" + ")" * 25_000,
    "sin(" + "1" * 200_000 + "*u", "u^" * 100_000, "|" * 200_000,
    "play(u," + "1" * 200_000, "play(" * 50_000, "lag(u,1" + "0" * 200_000 + ")",
]  # fmt: skip
TOO_LARGE = [
    "|w|^1e400", "|du|^-1e400", "|w|^1e308*|w|^1e308", "|w|^nan",
    "u^1" + "0" * 400, "sin(1e400*u)", "cos(-1e400*|w|)", "sin(nan*u)", "sin(inf*u)",
    "play(u,1e400)", "lag(u,inf)", "u^\u0663",
]  # fmt: skip


@pytest.mark.parametrize("name", LONG, ids=lambda name: name[:12])
def test_long_names_are_refused_soon(tmp_path, name):
    """Time must not grow with the square of a name's length."""
    with pytest.raises(InputError, match=r"in the term .* is neither a var") as caught:
        Term.parse(name)
    assert len(str(caught.value)) < 2000  # the name is not shown whole
    law = {"kind": "SparseModel", "names": ["u", "w"], "units": ["", ""]}
    law |= {"target": "rate", "terms": {}, "candidates": [name]}
    document = {"format": "hystjax model", "version": 2, "dtype": "float64"}
    path = tmp_path / "law.json"
    path.write_text(json.dumps(document | {"model": law}))
    with pytest.raises(InputError, match=r"law\.json"):
        hj.load(path)


@pytest.mark.parametrize("name", TOO_LARGE, ids=lambda name: name[:12])
def test_numbers_in_names_are_finite(name):
    with pytest.raises(
        InputError, match=r"is neither a variable|must be finite, got inf"
    ):
        Term.parse(name)


def test_a_long_product_is_read():
    assert Term.parse("*".join(["u"] * 40_000)) == Term.parse("u^40000")


# --------------------------------------------------------------- classes of one's own


class Own(Duhem):
    """A law that hystjax does not know."""


class Mixed(AbstractModel):
    """Something of everything that a file holds."""

    spring: BoucWen
    taus: jax.Array
    parts: tuple
    order: int = eqx.field(static=True, default=2)
    share: float = eqx.field(static=True, default=0.5)
    plain: float = 1.5
    none: None = None

    def rate(self, x, m, now):
        return now.u - x

    def output(self, x, m, now):
        return x


MIXED = Mixed(
    BoucWen(1 / 3, 0.1, 0.2),
    jnp.array([[0.1, 1 / 3]]),
    (
        {"kind": jnp.arange(3), "on": jnp.array([True]), "python": 2},
        [jnp.float32(0.1), (Play([0.0, 0.1]) + LogCreep(0.1, 9.0)).memory, NoMemory()],
        ("word", True, None, 7, jnp.zeros((0, 2))),
    ),
    order=3,
    units=("V", "m"),
)


def same(one, other):
    return eqx.tree_equal(one, other, typematch=True)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_a_static_number_is_finite_too(tmp_path, number):
    path = tmp_path / "law.json"
    hj.save(path, MIXED)
    text = path.read_text()
    assert text.count('"share": 0.5') == 1
    path.write_text(text.replace('"share": 0.5', f'"share": {number}'))
    with pytest.raises(InputError, match=r"must be finite|NaN|Infinity"):
        hj.load(path)


@pytest.mark.parametrize(
    "model", [Own(1.0, 1 / 3, 1.0), MIXED, Instrumented(Own(1.0, 2.0, 3.0), delay=0.1)]
)
def test_models_of_plain_fields_need_no_word(tmp_path, model):
    loaded = back(tmp_path / "law.json", model)
    assert same(loaded, model)
    text = (tmp_path / "law.json").read_text()
    assert f'"kind": "{__name__}.{"Mixed" if model is MIXED else "Own"}"' in text


def test_float32_comes_back_bit_for_bit(tmp_path):
    with jax.enable_x64(False):
        model = Mixed(BoucWen(1 / 3, 0.1, 0.2), jnp.array([0.1, 1 / 3]), ())
        hj.save(tmp_path / "law.json", model)
        assert same(hj.load(tmp_path / "law.json"), model)
    assert same(hj.load(tmp_path / "law.json"), model)  # with 64-bit numbers on, too


@pytest.mark.parametrize(
    ("front", "name", "left"),
    [
        ("play(u,0.25)", "play.radius", "play(u,0.0)"),
        ("lag(u,0.25)", "lag.time", "play(u,0.0)"),
        ("lag(play(u,0.25),0.5)", "lag(play).time", "play(play(u,0.25),0.0)"),
    ],
)
def test_a_front_that_a_fit_has_closed_comes_back(tmp_path, front, name, left):
    behind = hj.models.Behind(hj.models.Dahl(3.0, 0.8), front)
    model = behind.with_parameters({name: 0.0})
    loaded = back(tmp_path / "law.json", model)
    assert loaded.front.names == (left,)
    assert str(loaded) == str(model)


def test_lags_of_no_time_in_a_law_come_back(tmp_path):
    law = SparseModel.from_terms({"lag(u,0.25)": 0.5, "u": 2.0}, target="value")
    model = law.with_parameters({"lag(u,0.25).time": 0.0})
    loaded = back(tmp_path / "law.json", model)
    assert loaded.parameters() == {"play(u,0.0)": 0.5, "u": 2.0}


def test_a_front_in_single_precision_comes_back(tmp_path):
    """Its number is in its name, as it was given."""
    model = hj.models.Behind(hj.models.Dahl(3.0, 0.8), "play(u,0.1)")
    single = jax.tree.map(lambda x: x.astype(jnp.float32), model)
    loaded = back(tmp_path / "law.json", single)
    assert np.float32(loaded.parameters()["play.radius"]) == np.float32(0.1)
    assert loaded.device.stiffness.dtype == np.float32


def test_laws_in_another_precision_are_others():
    one = SparseModel.from_terms({"u": 0.5})
    other = jax.tree.map(lambda x: x.astype(jnp.float32), one)
    assert difference(one, other) == "the model itself"


@pytest.fixture
def from_single(tmp_path):
    """A model as another process without 64-bit numbers saved it."""

    def made(build):
        with jax.enable_x64(False):
            hj.save(tmp_path / "law.json", build())
        return hj.load(tmp_path / "law.json")

    return made


def test_a_start_saved_in_single_precision_flows_in_double(from_single):
    """All numbers of it are the same in both."""

    def build():
        return Butterfly(Duhem(0.5, 0.5, 0.25), 0.25, 0.125)

    t = np.linspace(0, 6, 121)
    record = hj.Recording(t, np.sin(t), np.ones_like(t))
    method = hj.simulation.FixedStep(2)
    single, double = (
        hj.simulate(model, record, method=method).w
        for model in (from_single(build), build())
    )
    np.testing.assert_array_equal(single, double)


def test_what_was_saved_in_single_precision_is_fitted_in_double(from_single):
    u = np.sin(np.linspace(0, 9, 121)) + np.linspace(0, 0.3, 121)
    w = 0.3 * u + 0.6 * play(u, 0.25)
    start = from_single(lambda: hj.models.PrandtlIshlinskii([0.0, 0.25], [0.5, 0.5]))
    fixed = [name for name in start.parameters() if not name.startswith("weights")]
    found = hj.refine(start, hj.Recording(None, u, w), fixed=fixed).value
    np.testing.assert_allclose(found.weights, [0.3, 0.6], rtol=1e-9)


def test_names_of_ones_own(tmp_path):
    @hj.models.register(name="lab/creep")
    class Creep(Duhem):
        pass

    path = tmp_path / "law.json"
    assert type(back(path, Creep(1.0, 2.0, 3.0))) is Creep
    assert '"kind": "lab/creep"' in path.read_text()
    with pytest.raises(InputError, match=r"'lab/creep' is that of .*Creep already"):
        hj.models.register(Own, name="lab/creep")
    with pytest.raises(InputError, match="'Duhem' is that of hystjax"):
        hj.models.register(Own, name="Duhem")
    with pytest.raises(InputError, match="`name` must be text"):
        hj.models.register(Own, name="a\nb")
    path.write_text(path.read_text().replace("lab/creep", "lab/gone"))
    with pytest.raises(InputError, match=r"'lab/gone'.*Import the package"):
        hj.load(path)


def test_a_class_that_is_defined_again_is_the_last_one(tmp_path):
    def define():
        class Again(Duhem):
            pass

        return Again

    first, second = define(), define()
    assert type(back(tmp_path / "law.json", second(1.0, 2.0, 3.0))) is second
    with pytest.raises(InputError, match="would come back as another one"):
        hj.save(tmp_path / "law.json", first(1.0, 2.0, 3.0))


def _grey(width, depth):
    return Grey(BoucWen(1.0, 1.0, 1.0), Grey.network_of(width, depth, 0))


@hj.models.register(like=_grey)
class Grey(AbstractModel):
    """A law, and a network beside it."""

    law: BoucWen
    network: eqx.nn.MLP
    share: jax.Array = eqx.field(converter=jnp.asarray, default=1.0)

    def __check_init__(self):
        if not isinstance(self.share, jax.core.Tracer) and self.share < 0:
            raise InputError("`share` must be positive.")

    @staticmethod
    def network_of(width, depth, key, activation=jnp.tanh):
        key = jax.random.key(key)
        return eqx.nn.MLP(3, "scalar", width, depth, activation, key=key)

    @property
    def width(self):
        return self.network.width_size

    @property
    def depth(self):
        return self.network.depth

    def rate(self, x, m, now):
        return self.law.rate(x, m, now) + self.network(jnp.stack([x, now.u, now.du]))

    def output(self, x, m, now):
        return x


GREY = Grey(BoucWen(1.0, 0.1, 0.3), Grey.network_of(4, 1, 7), 1 / 3, names=("a", "b"))


def test_opaque_parts_are_made_anew_and_filled(tmp_path):
    path = tmp_path / "law.json"
    assert same(back(path, GREY), GREY)
    inside = Instrumented(GREY, delay=0.1)
    assert same(back(path, inside), inside)


@pytest.mark.parametrize(
    "network",
    [
        Grey.network_of(4, 1, 7, jax.nn.relu),
        eqx.nn.MLP(2, 1, 4, 1, key=jax.random.key(0)),
    ],
)
def test_what_would_come_back_otherwise_is_not_saved(tmp_path, network):
    model = eqx.tree_at(lambda m: m.network, GREY, network)
    with pytest.raises(InputError, match=r"would come back as another|not read back"):
        hj.save(tmp_path / "law.json", model)
    assert not os.listdir(tmp_path)


def test_zeros_of_another_type_are_another_model():
    one, other = np.zeros(2, np.float32), np.zeros(2, np.int32)
    assert difference(one, one.copy()) is None
    assert difference({"a": one}, {"a": other}) == "a"


class Changing(AbstractModel):
    """Its constructor takes something else than its fields."""

    double: jax.Array

    def __init__(self, double):
        super().__init__()
        self.double = 2 * jnp.asarray(double)

    def rate(self, x, m, now):
        return self.double * now.du

    def output(self, x, m, now):
        return x


def test_a_constructor_that_changes_fields_is_noticed(tmp_path):
    with pytest.raises(InputError, match="would come back as another one: double"):
        hj.save(tmp_path / "law.json", Changing(1.0))


def whole(array):
    """An array of a file with whole numbers in it."""
    array.update(dtype="int32", numbers=[1 for _ in array["numbers"]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m["like"].update(depth=10**9), "settings of 1000 at most"),
        (lambda m: m["like"].update(width=1e9), "settings of 1000 at most"),
        (lambda m: m["like"].update(width=5), "layers.0.weight of float64 and shape"),
        (lambda m: m["like"].update(depth=2), "has arrays .* and `like` makes"),
        (lambda m: m["like"].update(width="4"), "makes no .*Grey of the settings"),
        (lambda m: m["like"].pop("width"), "makes no .*Grey of the settings"),
        (lambda m: m.update(like=3), '"like" must be an object'),
        (lambda m: m.update(share=-1), "`share` must be positive"),
        (lambda m: m["law"].update(n=-1), "`n` must be at least 0"),
        (lambda m: m.pop("law"), "needs law"),
        (lambda m: m["network"]["leaves"].popitem(), "has arrays"),
        (lambda m: whole(m["network"]["leaves"]["layers.0.bias"]), "bias of int32"),
    ],
)
def test_hostile_files_of_ones_own(tmp_path, unchecked, change, message):
    path = tmp_path / "law.json"
    hj.save(path, GREY)
    content = json.loads(path.read_text())
    change(content["model"])
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        hj.load(path)


def test_a_field_called_memory_is_refused_where_it_is_defined():
    with pytest.raises(InputError, match="`memory`, which in a model is a property"):

        class _Wrong(AbstractModel):
            memory: NoMemory
