"""What `hystjax reproduce properties` says of the laws of the paper."""

import numpy as np
import pytest

from hystjax.reproduce import reproduce

pytestmark = [pytest.mark.recordings, pytest.mark.thorough]


@pytest.fixture(scope="module")
def table():
    return reproduce("properties")


@pytest.fixture(scope="module")
def rows(table):
    return {(row.family, row.law): row for row in table.rows}


def test_only_laws_of_degree_one_are_rate_independent(table):
    for row in table.rows:
        of_one_degree = row.family not in ("6, piezo", "8, steel")
        assert (row.properties.rate_dependence < 1e-9) == of_one_degree


def test_work_of_the_refined_law_is_that_of_the_true_one(rows):
    """Branches of w' = |u'| (0.4 u - 0.5 w) + 0.25 u' approach two parallel lines, 2.2
    apart, exponentially over 1/0.5; the range of t sin t is wide beside that."""
    t = np.linspace(0, 7 * np.pi, 1000)
    width = np.ptp(t * np.sin(t))
    expected = -2.2 * (width - 2 / 0.5)
    found = rows["1", "refined"].properties.dissipation.work[-1, 0]
    assert found == pytest.approx(expected, rel=1e-4)


def test_no_law_keeps_return_points(table):
    assert not any(row.properties.memory_loss < 1e-12 for row in table.rows)


def test_the_laws_of_the_steel_diverge(table):
    lines = table.text().splitlines()
    lost = {line.split(",")[0] for line in lines if "diverged" in line}
    assert lost == {"8"}
