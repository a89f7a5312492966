"""Building the table of the reduced model, and its cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import (
    DEFAULT_TABLE,
    build_table,
    default_unstable,
    load_arrays,
    load_table,
    read_table,
    table_digest,
    write_table,
)
from tests.analysis.shadow.make_default_table import unstable_places

SMALL = TableSettings(pressures=3, elongations=3, modes=4, held_out=4)


def test_cache_is_used_rebuilt_or_skipped(short: ActuatorParameters, tmp_path: Path) -> None:
    """The second call builds nothing; a torn file is built again; a folder that cannot be made does not matter."""
    calls: list[float] = []

    def count(done: float, total: float) -> None:
        calls.append(done / total)

    first = load_table(short, SMALL, progress=count, folder=tmp_path)
    assert calls[-1] == 1.0
    built = len(calls)
    again = load_table(short, SMALL, progress=count, folder=tmp_path)
    assert len(calls) == built
    np.testing.assert_array_equal(again.amplitudes, first.amplitudes)
    kept = tmp_path / f"{table_digest(short, SMALL)}.npz"
    kept.write_bytes(kept.read_bytes()[:1000])
    assert read_table(kept) is None
    np.testing.assert_array_equal(load_table(short, SMALL, folder=tmp_path).errors_mm, first.errors_mm)
    blocked = tmp_path / "file"
    blocked.write_text("")
    np.testing.assert_array_equal(load_table(short, SMALL, folder=blocked / "sub").errors_mm, first.errors_mm)
    write_table(first, tmp_path / "new" / "table.npz")
    assert read_table(tmp_path / "new" / "table.npz") is not None


def test_digest_depends_on_parameters_and_settings(short: ActuatorParameters) -> None:
    """Another actuator or another grid is another table."""
    names = {
        table_digest(short, SMALL),
        table_digest(ActuatorParameters(), SMALL),
        table_digest(short, TableSettings()),
    }
    assert len(names) == 3


def test_building_can_be_cancelled(short: ActuatorParameters) -> None:
    """What the progress callback raises comes through."""

    def stop(done: float, total: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_table(short, SMALL, stop)


def test_the_program_s_table_is_that_of_the_default_actuator() -> None:
    """Named by the present parameters; a full solution and the stability at one pressure are those of it."""
    kept = load_arrays(DEFAULT_TABLE, ("digest",))
    assert kept is not None
    assert str(kept["digest"]) == table_digest(ActuatorParameters(), TableSettings())
    table, model = load_table(), FullModel()
    solved = model.solver.solve(pressure_kpa=-30.0, elongation_mm=-1.5)
    away = table.tracked(np.array([-30.0]), np.array([-1.5]))[0] - model.tracked(solved)
    assert np.abs(away).max() < table.error_bound_mm
    assert unstable_places(Shadow(table=table), [-42]) == {place for place in default_unstable() if place[0] == -42}
