"""What people state about a recording: typed values, what stays with a unit, foreign files."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from protocol.base.errors import ChoiceError, RequestError
from protocol.recording import Metadata


def test_typed_values_become_metadata_and_other_keys_are_free_fields() -> None:
    stated = Metadata(customer="A", fields={"rig": "1"}).changed(
        {"ambient_temperature_c": "21,5", "customer": " B ", "rig": "", "batch": "7", "": "x"}
    )
    assert stated == Metadata(customer="B", ambient_temperature_c=21.5, fields={"batch": "7"})
    assert Metadata.of(asdict(stated)) == stated
    assert stated.lines()[1] == ("Ambient temperature", "21.5 °C")


@pytest.mark.parametrize("text", ["warm", "nan", "1e400", "500"])
def test_no_temperature_is_refused_by_its_key(text: str) -> None:
    with pytest.raises(RequestError, match="ambient_temperature_c"):
        Metadata().changed({"ambient_temperature_c": text})


@pytest.mark.parametrize("values", [{"customer": 1}, {"fields": {"a": 1}}, {"fields": [1]}, {"note": "x" * 30_000}])
def test_foreign_values_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="not a t"):
        Metadata.of(values, 20_000)


def test_a_stored_note_of_any_length_is_read_and_typed_ones_are_bounded() -> None:
    """A recording of an older version may hold a longer one."""
    text = "x" * 30_000
    assert Metadata.of({"note": text}).note == text
    with pytest.raises(RequestError, match="note is not a text of at most 20000"):
        Metadata().changed({"note": text})


def test_a_unit_keeps_its_item_but_neither_note_nor_ambient_conditions() -> None:
    stated = Metadata("Eve", "A", "I", "7", "wet", 21.0, 40.0, {"batch": "7"})
    assert stated.of_unit() == Metadata("Eve", "A", "I", "7", fields={"batch": "7"})


def test_a_misspelled_key_is_no_field_of_ones_own() -> None:
    """What resembles a known key is refused with the key that is meant; other names are fields."""
    for key, meant in (("custmer", "customer"), ("serial_nummer", "serial_number")):
        with pytest.raises(ChoiceError, match=f"did you mean {meant}"):
            Metadata().changed({key: "x"})
    assert Metadata().changed({"room": "B 2.11"}).fields == {"room": "B 2.11"}
