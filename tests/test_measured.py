"""Refined laws of measured devices."""

import pytest

from hystjax.reproduce import reproduce

pytestmark = [pytest.mark.recordings, pytest.mark.slow]


@pytest.fixture(scope="module")
def rows():
    return {row.name: row for row in reproduce("measured").rows}


def test_the_papers_terms_are_as_good_as_known(rows):
    law = rows["piezo_ayala, the paper's terms"]
    assert law.matched <= 0.210


def test_a_sixth_term_comes_close_to_the_noise(rows):
    law = rows["piezo_ayala, and du*|du|"]
    assert law.matched <= 0.153 and law.fitted <= 0.153
    assert law.unseen <= 0.171


def test_every_law_forgets_its_start(rows):
    assert {name for name, row in rows.items() if not row.forgets} == set()
