"""Table III of the paper: sparse laws, evolution and networks on the piezo."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import hystjax as hj
from hystjax.reproduce import table_3, write
from hystjax.reproduce._devices import Method, MethodTable, Published, Task, tried

NETWORKS = ("LSTM", "GRU", "TCN", "FCN")
FOUR = "four terms, refined"
EXAMPLE = MethodTable(
    "A table",
    (
        Method("law", 0.25, 0.5, 1.5, 0.001, 0.002, 3),
        Method("net", 0.125, float("nan"), 9.0, 8.0, 0.5, 99, Published(0.2, 60.0, 1)),
    ),
    ("A note.",),
)


def test_table_of_methods_prints_a_line_a_method():
    title, _, head, law, net, _, note = EXAMPLE.text().splitlines()
    assert (title, note) == ("A table", "A note.")
    assert head.split()[:3] == ["own", "rows", "paper"]
    assert law.split() == [
        "law",
        "0.25",
        "-",
        "0.5",
        "1.5",
        "0.001",
        "-",
        "0.002",
        "-",
        "3",
    ]
    assert net.split() == [
        "net",
        "0.125",
        "0.2",
        "diverged",
        "9",
        "8",
        "60",
        "0.5",
        "1",
        "99",
    ]


def test_table_of_methods_is_written_by_its_name(tmp_path):
    write(tmp_path, "table3", EXAMPLE)
    content = json.loads((tmp_path / "table3.json").read_text())
    law, net = content["rows"]
    assert (law["warm"], law["paper"]) == (
        0.001,
        {"nrmse": None, "training": None, "testing": None},
    )
    assert net["unseen"] is None and net["paper"]["training"] == 60
    assert (tmp_path / "table3.md").read_text().startswith("# A table\n\n|  | own rows")


def test_first_fit_is_told_from_the_warm_ones(monkeypatch):
    law = hj.models.Duhem(0.4, -0.5, 0.25)
    sine, method = hj.excitation.Sine(1.0, 0.1), hj.simulation.FixedStep(4)
    record = hj.generate(law, sine, np.arange(200) / 10, method=method)
    own, unseen = record.split(0.5)
    clock = [0.0]
    watch = SimpleNamespace(perf_counter=lambda: clock[-1])
    monkeypatch.setattr("hystjax.reproduce._devices.time", watch)

    def learn():
        clock.append(clock[-1] + (0.25 if len(clock) == 1 else 0.03125))
        return hj.Solution(law, hj.RESULTS.successful, {})  # pyright: ignore

    method = tried("truth", learn, Task(own, unseen), lambda model: 3)
    assert (method.training, method.warm, method.testing) == (0.25, 0.03125, 0.0)
    assert max(method.own, method.unseen) < 1e-3
    assert method.numbers == 3
    given = tried("truth", learn, Task(own, unseen), lambda _: 3, warm=lambda _: 7.0)
    assert given.warm == 7.0


def methods(epochs=None):
    return {method.name: method for method in table_3(epochs).rows}


@pytest.mark.recordings
@pytest.mark.thorough
def test_sparse_laws_are_as_good_as_known():
    found = methods(epochs=1)  # of the networks, whose training takes minutes
    assert found["SINDy"].own == pytest.approx(0.23, abs=0.005)
    assert found["SINDy, refined"].own < 0.212
    evolved = found["evolution, SINDy's terms"]
    assert evolved.own == pytest.approx(found["SINDy, refined"].own, abs=1e-3)
    four = found[FOUR]
    assert four.numbers == 4
    # Better than the best network of the paper, on rows that it has not seen too.
    assert four.own < four.unseen < 0.19


@pytest.mark.recordings
@pytest.mark.thorough
def test_networks_are_not_crippled():
    found = methods()
    for name in NETWORKS:
        network = found[name]
        assert network.own < network.paper.nrmse, name
        assert network.unseen < 1.3 * network.own, name
