"""The form of type B contributions: fields and tables, refusals at the field, storage and undo."""

from __future__ import annotations

import dataclasses

import pytest

from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.results.contributions import PRESETS, ContributionFields, ContributionsModel, Refusal
from protocol.base.errors import RequestError

PARALLAX = dataclasses.replace(PRESETS["parallax"], value="0,1", source="two readers")


@pytest.fixture
def model(tmp_path):
    """The contributions of a unit without any, with the calls after a change."""
    calls = []
    found = ContributionsModel(UnitLibrary(tmp_path), "SA1", UndoHistory(), lambda: calls.append(1))
    found.calls = calls
    return found


@pytest.mark.parametrize(
    ("table", "fields"),
    [
        (
            {"half_width_mm": 0.1, "distribution": "rectangular", "source": "two readers"},
            ContributionFields(value="0.1", source="two readers"),
        ),
        (
            {"expanded_percent": 0.2, "distribution": "normal", "k": 2.0, "dof": 8.0, "certificate": "DKD 4711"},
            ContributionFields(
                "expanded", "0.2", "percent", "normal", k="2", dof="8", certificate="DKD 4711"
            ),
        ),
        (
            {"u_k": 1.0, "distribution": "arcsine", "sensitivity_mm_per_k": 0.0},
            ContributionFields("u", "1", "k", "arcsine", sensitivity="0"),
        ),
    ],
)  # fmt: skip
def test_fields_are_a_table_and_back(table, fields):
    """Every way of stating a contribution is the table that the library reads, and the same fields again."""
    assert fields.table() == table
    assert ContributionFields.of(table) == fields


def test_stated_contribution_is_in_the_file_and_is_undone(model):
    """What is not stated is not assessed, zero is a statement; undo restores the file, and each change is followed."""
    assert [statement for _, _, statement in model.rows()] == ["not assessed"] * len(PRESETS)
    assert "not assessed: scale of grid" in model.traceability().text
    model.state("parallax", PARALLAX)
    model.state("pressure_gauge", dataclasses.replace(PRESETS["pressure_gauge"], value="0", sensitivity="0"))
    stated = {name: statement for name, _, statement in model.rows()}
    assert stated["parallax"] == "u = 0.0577 mm, rectangular, two readers"
    assert stated["pressure_gauge"] == "u = 0 kPa, rectangular"
    assert UnitLibrary(model.units.folder).load("SA1").type_b["parallax"]["half_width_mm"] == 0.1
    assert model.fields("parallax") == dataclasses.replace(PARALLAX, value="0.1")
    model.withdraw("parallax")
    assert list(model.tables()) == ["pressure_gauge"]
    for names in (["parallax", "pressure_gauge"], ["parallax"], []):
        model._undo.undo()
        assert sorted(model.tables()) == names
    assert len(model.calls) == 6
    model._undo.redo()
    assert list(model.tables()) == ["parallax"]


def test_unchanged_statement_is_no_change(model):
    """Storing a contribution again as it is, or withdrawing one that is not stated, is nothing to undo."""
    model.state("parallax", PARALLAX)
    model.state("parallax", PARALLAX)
    model.withdraw("temperature")
    assert len(model._undo.done) == 1


@pytest.mark.parametrize(
    ("name", "changed", "field"),
    [
        ("parallax", {"value": ""}, "value"),
        ("parallax", {"value": "a little"}, "value"),
        ("parallax", {"value": "-1"}, "value"),
        ("parallax", {"distribution": "normal"}, "distribution"),
        ("parallax", {"stated": "expanded", "k": "0"}, "k"),
        ("parallax", {"unit": "kpa"}, "sensitivity"),
        ("parallax", {"dof": "0.5"}, "dof"),
        ("  ", {}, "name"),
    ],
)
def test_refusal_names_its_field(model, name, changed, field):
    """The library's refusal is at the field that it is of, with what to enter; nothing is stored."""
    fields = dataclasses.replace(PARALLAX, **changed)
    found = model.check(name, fields)
    assert isinstance(found, Refusal)
    assert found.field == field
    assert found.text.endswith(".")
    with pytest.raises(RequestError, match="is not stated"):
        model.state(name, fields)
    assert model.tables() == {}


def test_another_contribution_has_a_name_of_its_own(model):
    """A name that is typed is the budget's; one that is offered or stated already is refused."""
    assert model.check("Parallax", PARALLAX, new=True).field == "name"
    model.state("Lens distortion", PARALLAX)
    assert model.rows()[-1][:2] == ("lens_distortion", "Lens distortion")
    assert model.check("lens  distortion", PARALLAX, new=True).field == "name"


def test_contributions_of_a_simulated_unit_are_its_own(tmp_path):
    """A simulated unit has the real unit's until it is stored itself; a change of it is not one of the real unit."""
    real, simulated = UnitLibrary(tmp_path), UnitLibrary(tmp_path, simulated=True)
    real.save(Unit("SA1", type_b={"scale": {"u_percent": 0.1}}))
    model = ContributionsModel(simulated, "SA1", UndoHistory(), lambda: None)
    assert list(model.tables()) == ["scale"]
    model.state("parallax", PARALLAX)
    model.withdraw("scale")
    assert (list(model.tables()), list(real.load("SA1").type_b)) == (["parallax"], ["scale"])
