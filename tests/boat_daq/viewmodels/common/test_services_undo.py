"""The undo history."""

from __future__ import annotations

import pytest

from boat_daq.viewmodels.common.services import Change, UndoHistory


def test_changes_are_undone_in_order():
    """Undo takes the last change back first; redo does it again; a new change drops what was undone."""
    values = [0]
    reported: list[str] = []
    history = UndoHistory(reported.append)
    for n in (1, 2):
        history.push(Change(f"{n}", lambda n=n: values.append(n), values.pop))
    history.undo()
    assert values == [0, 1]
    history.redo()
    assert values == [0, 1, 2]
    history.undo()
    history.push(Change("3", lambda: values.append(3), values.pop))
    assert values == [0, 1, 3]
    assert history.undone == []
    assert reported == ["Undone: 2", "Redone: 2", "Undone: 2"]


def test_change_that_can_no_longer_be_undone_does_not_block_those_before_it():
    """The reading of a closed recording was counted as undone, then as redone."""
    values = [0]
    history = UndoHistory()
    history.push(Change("1", lambda: values.append(1), values.pop))
    history.push(Change("2", lambda: None, {}.popitem))
    with pytest.raises(KeyError):
        history.undo()
    assert history.undone == []
    history.undo()
    assert values == [0]
