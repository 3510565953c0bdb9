"""Chandra et al. (2023) with their settings, against a rerun of their scripts."""

import pytest

from hystjax.reproduce import reproduce

ROUNDED = "  with the script's rounded law"
COEFFICIENTS = {
    "1": {"u*|du|": 0.400, "w*|du|": -0.500, "du": 0.251},
    "2": {"du": 4.999, "w*|du|": -0.250, "du*|w|": -0.499},
    "6": {"1": -0.176, "w": -2.383, "u": 0.580, "du": 0.119, "w*|w|": -0.076},
}
NUMBERS = [
    "1",
    "2",
    pytest.param("6", marks=pytest.mark.recordings),
]


@pytest.fixture(scope="module")
def ours():
    """Our figures of an experiment by quantity; each experiment is run once."""
    known = {}

    def figures(number):
        if number not in known:
            known[number] = {row.quantity: row.ours for row in reproduce(number).rows}
        return known[number]

    return figures


@pytest.mark.parametrize("number", NUMBERS)
def test_law_is_that_of_the_scripts(ours, number):
    name = "coefficient of "
    found = {
        quantity.removeprefix(name): value
        for quantity, value in ours(number).items()
        if quantity.startswith(name)
    }
    assert found == pytest.approx(COEFFICIENTS[number], abs=1e-3)


@pytest.mark.parametrize(("number", "error"), [("1", "5.81e-06"), ("2", "4.63e-06")])
def test_squared_errors_of_the_rounded_laws(ours, number, error):
    assert f"{ours(number)[ROUNDED]:.2e}" == error
    exact = ours(number)["squared error, %"]
    assert exact < float(error)
    printed = ours(number)["relative error, %"]
    assert (printed / 100) ** 2 == pytest.approx(exact / 100)


@pytest.mark.recordings
def test_errors_on_the_piezo(ours):
    figures = ours("6")
    assert f"{figures[ROUNDED]:.4f}" == "0.2328"
    assert figures["NRMSE, own rows, %"] == pytest.approx(0.2328, abs=0.005)
    assert f"{figures['R2, own rows, rounded law']:.5f}" == "0.99996"
    assert f"{figures['squared error, own rows, rounded law, %']:.2e}" == "4.37e-03"


@pytest.mark.recordings
@pytest.mark.parametrize(
    "quantity",
    ["NRMSE, unseen rows 17500:35000, %", "  with the unrounded law"],
)
def test_errors_on_cycles_the_piezo_law_has_not_seen(ours, quantity):
    assert ours("6")[quantity] == pytest.approx(0.248, abs=0.005)
