"""Columns saved as CSV."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.numbers import FORMULA_STARTS
from boat_daq.viewmodels.common import tables
from tests.boat_daq.viewmodels.helpers import finite

words = st.text(st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp")), max_size=8)


@pytest.mark.fault(49, how="any words, and those that a spreadsheet would run", times=100)
@given(st.lists(finite, max_size=5), st.lists(words | st.sampled_from(["=1+1", "+x", "-x", "@x", "\tx"]), max_size=5))
def test_saved_table_reads_back(numbers, texts):
    """Numbers come back to the last digit; a text that a spreadsheet would run gets an apostrophe."""
    text = tables.csv_text({"a": np.array(numbers), "b": texts})
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert rows[0] == ["a", "b"]
    assert [float(row[0]) for row in rows[1:] if row[0]] == numbers
    read = [row[1] for row in rows[1:]][: len(texts)]
    assert not any(cell.startswith(FORMULA_STARTS) for cell in read)
    assert [
        cell[1:] if word.startswith(FORMULA_STARTS) else cell for cell, word in zip(read, texts, strict=True)
    ] == texts
