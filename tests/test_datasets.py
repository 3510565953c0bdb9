import hashlib
import json
import os
import re
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.io

from hystjax import InputError, Recording, datasets
from hystjax.cli._main import keep
from hystjax.recording.datasets._access import REGISTRY, find
from hystjax.recording.datasets._entries import Dataset, File
from hystjax.signals import BandLimited

CONTENT = b"0.0,1.0,2.0\n0.1,1.5,2.5\n0.2,1.75,2.75\n"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache and no data folder, whatever the machine has."""
    monkeypatch.delenv("HYSTJAX_DATA_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "hystjax" / "toy"


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "source.csv"
    path.write_bytes(CONTENT)
    return path


def file_at(url):
    return File("toy.csv", hashlib.sha256(CONTENT).hexdigest(), url)


@pytest.fixture
def toy(cache, source, monkeypatch):
    """A dataset in the registry whose source is a file on this machine."""
    toy = Dataset(
        name="toy",
        what="a toy",
        columns="u input (V), w output (µm)",
        rate="10 Hz, 3 rows",
        licence="MIT",
        citation="Nobody (2020)",
        source="https://example.org",
        files=(file_at(source.as_uri()),),
        loader=lambda find, record: Recording.from_csv(
            find("toy.csv"), time=0, input=1, output=2, names=(record, record)
        ),
        records=("first", "second"),
    )
    monkeypatch.setitem(REGISTRY, "toy", toy)


def test_download_goes_to_the_cache_and_is_not_repeated(toy, cache, source):
    with pytest.raises(InputError, match=r"not all in .*`hystjax data fetch toy`"):
        datasets.path("toy")
    recording = datasets.load("toy")
    np.testing.assert_array_equal(recording.u, [1, 1.5, 1.75])
    assert recording.names == ("first", "first")
    assert [path.name for path in cache.iterdir()] == ["toy.csv"]
    source.unlink()
    assert datasets.load("toy", "second").names == ("second", "second")
    assert datasets.fetch("toy") == (cache / "toy.csv",)
    assert datasets.path("toy") == cache


def test_files_in_several_folders_have_no_path(cache, source, tmp_path, monkeypatch):
    """Though all are there, and each is found."""
    monkeypatch.setenv("HYSTJAX_DATA_DIR", str(tmp_path / "given"))
    file = file_at(source.as_uri())
    files = [replace(file, name=name) for name in ("a.csv", "b.csv")]
    two = replace(REGISTRY["piezo_ayala"], name="two", files=tuple(files))
    monkeypatch.setitem(REGISTRY, "two", two)
    for folder, file in zip(datasets._access.folders("two"), files, strict=True):
        folder.mkdir(parents=True)
        (folder / file.name).write_bytes(source.read_bytes())
    assert len(datasets.fetch("two")) == 2
    with pytest.raises(InputError, match=r"not all in .* or .* put them together"):
        datasets.path("two")


def test_data_folder_comes_first(toy, cache, source, tmp_path, monkeypatch):
    monkeypatch.setenv("HYSTJAX_DATA_DIR", str(tmp_path / "data"))
    assert datasets.fetch("toy") == (cache / "toy.csv",)  # not in the folder yet
    (tmp_path / "data" / "toy").mkdir(parents=True)
    (tmp_path / "data" / "toy" / "toy.csv").write_bytes(CONTENT)
    assert datasets.fetch("toy") == (tmp_path / "data" / "toy" / "toy.csv",)
    assert datasets.path("toy") == tmp_path / "data" / "toy"


def test_cache_without_xdg_is_in_the_home_folder(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for value in ("", "relative/path"):
        monkeypatch.setenv("XDG_CACHE_HOME", value)
        expected = tmp_path / "home" / ".cache" / "hystjax" / "toy" / "toy.csv"
        assert datasets.fetch("toy") == (expected,)


def test_a_user_without_a_home_needs_a_folder(toy, tmp_path, monkeypatch):
    def nobody(uid):
        raise KeyError(uid)

    monkeypatch.setattr("pwd.getpwuid", nobody)
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match=r"no home folder.*set XDG_CACHE_HOME"):
        datasets.load("toy")
    keep()  # without a word
    monkeypatch.setenv("HYSTJAX_DATA_DIR", str(tmp_path / "data"))
    assert datasets.fetch("toy") == (tmp_path / "data" / "toy" / "toy.csv",)


def test_corrupt_file_on_disk_is_refused_until_deleted(toy, cache):
    (path,) = datasets.fetch("toy")
    path.write_bytes(CONTENT[:-5])
    with pytest.raises(InputError, match=f"{re.escape(str(path))}.*SHA-256.*delete it"):
        datasets.load("toy")
    path.unlink()
    assert len(datasets.load("toy")) == 3


def test_source_with_other_content_is_not_kept(cache, source):
    source.write_bytes(b"<html>Please log in</html>")
    with pytest.raises(InputError, match=r"source\.csv sent is not the file.*proxy"):
        find("toy", file_at(source.as_uri()))
    assert not cache.exists()


class Server(BaseHTTPRequestHandler):
    def do_GET(self):
        if self.path == "/secret.csv":
            self.send_error(403)
            return
        self.send_response(200)
        cut = 10 if self.path == "/short.csv" else 0
        self.send_header("Content-Length", str(len(CONTENT) + cut))
        self.end_headers()
        self.wfile.write(CONTENT)

    def log_message(self, *args):
        pass


@pytest.fixture
def server():
    with HTTPServer(("127.0.0.1", 0), Server) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_download_by_http(cache, server):
    path = find("toy", file_at(f"{server}/toy.csv"))
    assert path == cache / "toy.csv"
    assert path.read_bytes() == CONTENT


def test_a_silent_server_is_not_waited_for_for_ever(cache, monkeypatch):
    waited = []

    def silent(url, data=None, timeout=None):
        waited.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr("urllib.request.urlopen", silent)
    with pytest.raises(InputError, match=r"could not be downloaded .*timed out"):
        find("toy", file_at("https://example.org/toy.csv"))
    (timeout,) = waited
    assert timeout is not None and 1 <= timeout <= 120


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("{server}/secret.csv", "the server refused it: 403 Forbidden"),
        ("{server}/short.csv", "network.*IncompleteRead"),
        ("http://127.0.0.1:9/toy.csv", "is there a network"),
        ("file:///nowhere/toy.csv", "No such file"),
    ],
)
def test_failed_download_says_why_and_what_to_do(cache, server, url, reason):
    url = url.format(server=server)
    todo = rf"put the file at {cache}/toy\.csv yourself.*HYSTJAX_DATA_DIR"
    with pytest.raises(InputError, match=f"{url} could not .*{reason}.*{todo}"):
        find("toy", file_at(url))
    assert not cache.exists()


def test_cache_that_cannot_be_written(source, monkeypatch):
    monkeypatch.delenv("HYSTJAX_DATA_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(source))  # a file, not a folder
    with pytest.raises(InputError, match=r"cannot be made.*set XDG_CACHE_HOME"):
        find("toy", file_at(source.as_uri()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("piezo_ayla",), "no dataset 'piezo_ayla'.*mean 'piezo_ayala'.*mr_damper"),
        ((None,), r"no dataset None\. Known are: piezo_ayala"),
        (("zzz",), r"no dataset 'zzz'\. Known are: piezo_ayala, piezo_yan9a"),
        (("mr_damper", "11"), "'mr_damper' has no record '11'.*Known are: 1, 2"),
        (("no27_steel", "loops"), "no record 'loops'. Did you mean 'loop'"),
        (("piezo_ayala", "1"), "'piezo_ayala' is a single recording; leave"),
    ],
)
def test_unknown_names(unchecked, arguments, message):
    with pytest.raises(InputError, match=message):
        datasets.load(*arguments)


def test_records():
    assert datasets.records("piezo_ayala") == ()
    assert datasets.records("no27_steel") == ("loop", "hystlab")
    assert len(datasets.records("mr_damper")) == 10
    assert datasets.records("friction_damper")[0] == "0.5Hz_0.5in"
    assert datasets.records("steel_m130_27s") == ("0.43T", "0.95T", "1.50T")
    assert datasets.records("steel_coupon") == ("1", "3")
    assert datasets.records("forc_md00") == ()


def test_listing_shows_terms_and_whereabouts(toy, cache):
    assert "no; `hystjax data fetch toy`" in datasets.listing()
    datasets.fetch("toy")
    listing = datasets.listing()
    assert f"on disk  {cache}" in listing
    for name, dataset in REGISTRY.items():
        assert f"{name}: " in listing
        for fact in (dataset.licence, dataset.citation, dataset.source, dataset.rate):
            assert fact and fact in listing


def test_sources_are_pinned():
    pinned = r"https://raw\.githubusercontent\.com/[\w.-]+/[\w.-]+/[0-9a-f]{40}/.+"
    for dataset in REGISTRY.values():
        for file in dataset.files:
            assert re.fullmatch(pinned, file.url) and file.url.endswith(file.name)
            assert re.fullmatch("[0-9a-f]{64}", file.sha256)


def data(*parts):
    return Path(os.environ["HYSTJAX_DATA_DIR"], *parts)


@pytest.mark.recordings
def test_registry_has_every_file_with_its_checksum():
    listed = dict(reversed(line.split()) for line in data("SHA256SUMS").open())
    registered = {
        f"{d.name}/{f.name}": f.sha256 for d in REGISTRY.values() for f in d.files
    }
    assert registered == listed
    for name in REGISTRY:
        for path in datasets.fetch(name):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            assert digest == listed[f"{name}/{path.name}"]


def texts():
    def table(*parts, **options):
        return np.genfromtxt(data(*parts), **options)

    ayala = table("piezo_ayala", "hysteresis_v_150_1hz.csv", delimiter=",")
    yan9a = table("piezo_yan9a", "Model_Vi_Do.dat")
    loop = table("no27_steel", "mag10.txt")
    hystlab = table("no27_steel", "data_file_Loops.txt", skip_header=1)
    pin = table("friction_pin", "test_data_2.txt", skip_header=1)
    cycled, pulled = (
        table("steel_coupon", f"example_{n}.csv", delimiter=",", names=True)
        for n in (1, 3)
    )
    return {
        ("piezo_ayala", None): (ayala[:, 1], ayala[:, 3], ayala[:, 2], "V", "µm"),
        ("piezo_yan9a", None): (
            np.arange(8027) * 0.005,
            yan9a[:, 0],
            yan9a[:, 4],
            "V",
            "µm",
        ),
        ("no27_steel", None): (
            np.arange(1000) / 1e4,
            loop[:, 1],
            loop[:, 0],
            "T",
            "A/m",
        ),
        ("no27_steel", "hystlab"): (
            np.arange(988.0),  # which only number its rows
            hystlab[:, 0],
            hystlab[:, 1],
            "mT",
            "A m²",
        ),
        ("friction_pin", None): (pin[:, 0], pin[:, 2], -pin[:, 3], "mm", "µN"),
        **{
            ("steel_coupon", record): (
                np.arange(rows),
                coupon["e_true"],
                coupon["Sigma_true"],
                "1",
                "MPa",
            )
            for record, rows, coupon in ((None, 634, cycled), ("3", 333, pulled))
        },
    }


@pytest.mark.recordings
def test_text_recordings_are_the_files_columns():
    for (name, record), (t, u, w, *units) in texts().items():
        recording = datasets.load(name, record)
        np.testing.assert_allclose(recording.t, t, rtol=1e-14, err_msg=name)
        np.testing.assert_array_equal(recording.u, u, err_msg=name)
        np.testing.assert_array_equal(recording.w, w, err_msg=name)
        assert recording.units == tuple(units)
    assert not datasets.load("no27_steel", "hystlab").clocked
    loops = np.genfromtxt(data("no27_steel", "data_file_Loops.txt"), skip_header=1)
    np.testing.assert_array_equal(datasets.no27_hystlab_fit(), loops[:, 2])


@pytest.mark.recordings
def test_rows_of_piezo_ayala_count_from_the_files_first_line():
    recording = datasets.load("piezo_ayala")
    assert len(recording) == 50_001
    lines = data("piezo_ayala", "hysteresis_v_150_1hz.csv").read_text().splitlines()
    window = recording.window(35001, 45001)
    for row, line in ((0, lines[35001]), (-1, lines[45000])):
        _, t, w, u = line.split(",")
        assert (window.t[row], window.u[row]) == (float(t), float(u))
        assert window.w[row] == float(w)


@pytest.mark.recordings
def test_mr_damper_records_are_displacement_and_force():
    amplitudes = [20.1, 18.5, 16.7, 14.2, 15.5, 10.4, 12.5, 11.4, 9.0, 8.7]
    for record, amplitude in zip(
        datasets.records("mr_damper"), amplitudes, strict=True
    ):
        variables = scipy.io.loadmat(data("mr_damper", f"ensaio{record}.2.2.mat"))
        recording = datasets.load("mr_damper", record)
        np.testing.assert_allclose(recording.t, variables["tout"][:, 0], atol=1e-12)
        np.testing.assert_array_equal(recording.u, variables["x_F"][:, 0])
        np.testing.assert_array_equal(recording.w, variables["x_F"][:, 2])
        assert abs(float(variables["distA"].item()) - amplitude) < 0.1
    assert datasets.load("mr_damper").u[0] == datasets.load("mr_damper", "1").u[0]


@pytest.mark.recordings
def test_flipped_friction_dissipates():
    recording = datasets.load("friction_pin")
    loss = np.trapezoid(recording.w, recording.u) / 50  # µN mm a cycle
    assert 0 < loss < 2 * 0.24 * np.ptp(recording.w)


@pytest.mark.recordings
def test_boucwen_periods():
    u = scipy.io.loadmat(data("boucwen_benchmark", "uest_multisine.mat"))["u"][0]
    y = scipy.io.loadmat(data("boucwen_benchmark", "yest_multisine.mat"))["y"][0]
    whole = datasets.load("boucwen_benchmark")
    np.testing.assert_array_equal(whole.u, u)
    np.testing.assert_array_equal(whole.w, y)
    np.testing.assert_allclose(whole.t[-1], 32767 / 750)
    for period in range(4):
        rows = slice(8192 * period, 8192 * (period + 1))
        recording = datasets.load("boucwen_benchmark", str(period + 1))
        assert isinstance(recording.interpolation, BandLimited)
        for column in "tuw":
            expected = getattr(whole, column)[rows]
            np.testing.assert_array_equal(getattr(recording, column), expected)


@pytest.mark.recordings
def test_boucwen_input_between_samples():
    single, whole = (datasets.load("boucwen_benchmark", r) for r in ("2", "all"))
    u = np.asarray(single.u)
    padded = np.append(np.fft.rfft(u), np.zeros(4096))
    middles = 2 * np.fft.irfft(padded, 2 * u.size)[1:-1:2]
    t = jnp.asarray((single.t[1:] + single.t[:-1]) / 2)
    np.testing.assert_allclose(single.path.at(t)[0], middles, atol=1e-6)
    part = whole.window(8192, 12000)
    for path, until in ((whole.path, 8191), (part.path, 3807)):
        found = path.at(t[:until])[0]
        np.testing.assert_allclose(found, middles[:until], atol=1e-6)


@pytest.mark.recordings
def test_friction_damper_records_are_displacement_and_force():
    for record in datasets.records("friction_damper"):
        frequency, amplitude = re.findall(r"[\d.]+", record)
        name = f"{frequency}Hz30lbtension{amplitude}amplitude.json"
        columns = np.array(
            json.loads(data("friction_damper", name).read_text())["data"]
        )
        recording = datasets.load("friction_damper", record)
        for column, number in zip("tuw", range(3), strict=True):
            np.testing.assert_array_equal(
                getattr(recording, column), columns[:, number]
            )
        np.testing.assert_allclose(np.diff(recording.t), 1 / 1024, rtol=1e-12)
        assert recording.units == ("in", "kip") and recording.clocked
        np.testing.assert_allclose(np.max(recording.u), float(amplitude), rtol=0.02)
        loss = np.trapezoid(recording.w, recording.u) / 7  # kip in a cycle
        assert 0 < loss < 4 * float(amplitude) * np.max(np.abs(recording.w))
        strongest = np.argmax(np.abs(np.fft.rfft(recording.u[:-1])))  # of 7 cycles
        assert strongest / recording.t[-1] == float(frequency)


@pytest.mark.recordings
def test_m130_loops_are_named_by_their_flux_density():
    field = scipy.io.loadmat(data("steel_m130_27s", "H_M130_27s.mat"))["HmeasT"]
    flux = scipy.io.loadmat(data("steel_m130_27s", "B_M130_27s.mat"))["BmeasT"]
    losses = []
    for loop, record in enumerate(datasets.records("steel_m130_27s")):
        recording = datasets.load("steel_m130_27s", record)
        np.testing.assert_array_equal(recording.u, field[:, loop])
        np.testing.assert_array_equal(recording.w, flux[:, loop])
        assert f"{np.max(np.abs(recording.w)):.2f}T" == record
        assert recording.units == ("A/m", "T") and not recording.clocked
        losses.append(np.trapezoid(recording.u, recording.w))  # J/m³
    assert 0 < losses[0] < losses[1] < losses[2] < 4 * 217 * 1.5


@pytest.mark.recordings
def test_cycled_coupon_dissipates_and_has_no_clock():
    recording = datasets.load("steel_coupon")
    assert not recording.clocked and not datasets.load("steel_coupon", "3").clocked
    loss = np.trapezoid(recording.w, recording.u)  # MJ/m³
    assert 0 < loss < np.sum(np.abs(np.diff(recording.u))) * np.max(recording.w)


def forc_blocks():
    """Rows between blank lines, and a reader of numbers in the header."""
    text = data("forc_md00", "MD00-2361").read_bytes().decode("latin-1")
    blocks = [block.strip() for block in re.split(r"\r\n *\r\n", text)]
    tables = [
        np.array([line.split(",") for line in block.splitlines() if line[0] in "+-"])
        for block in blocks
        if re.search(r"^[+-]", block, re.MULTILINE)
    ]

    def said(name):
        return float(re.findall(rf"^{name} +(\S+)", text, re.MULTILINE)[0])

    return [table.astype(float) for table in tables], said


@pytest.mark.recordings
def test_forc_recording_is_the_file_without_its_drift_points():
    blocks, said = forc_blocks()
    drift, curves = blocks[0::2], blocks[1::2]
    assert len(blocks) == said("Number of segments")
    assert len(drift) == len(curves) == said("NForc")
    assert {block.shape for block in drift} == {(1, 2)}
    np.testing.assert_allclose(np.concatenate(drift)[:, 0], said("HCal"), atol=2e-4)
    whole = datasets.load("forc_md00")
    assert len(whole) == said("Number of data") - said("NForc")
    np.testing.assert_array_equal(np.stack([whole.u, whole.w], 1), np.vstack(curves))
    assert not whole.clocked and whole.units == ("T", "A m²")


@pytest.mark.recordings
def test_forc_curves_rise_from_ever_lower_reversals():
    blocks, _ = forc_blocks()
    curves = datasets.forc_md00_curves()
    long = [block for block in blocks[1::2] if len(block) >= 3]
    assert len(curves) == len(long) == 296  # the first has one point
    assert blocks[1].shape == (1, 2) and datasets.load("forc_md00").u[0] == 0.01908159
    for curve, block in zip(curves, long, strict=True):
        np.testing.assert_array_equal(np.stack([curve.u, curve.w], 1), block)
        assert not curve.clocked and np.all(np.diff(curve.u) > 0)
    # Reversals trace the upper branch of the loop, the last curve the lower one.
    reversals = np.array([block[0] for block in long])[::-1]
    assert np.all(np.diff(reversals[:, 0]) > 0)
    low, high = reversals[[0, -1], 0]
    field = np.linspace(low, high, 1000)
    lower = np.interp(field, curves[-1].u, curves[-1].w)
    loss = np.trapezoid(np.interp(field, *reversals.T) - lower, field)  # J
    assert 0 < loss < (high - low) * np.ptp(curves[-1].w)
