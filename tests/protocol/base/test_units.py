"""Units: one table for imported files, device profiles and what the operator sees."""

from __future__ import annotations

import pickle

import pytest

from protocol.base.units import (
    KPA_PER_UNIT,
    Quantity,
    ShownUnits,
    UnitText,
    conversion,
    find_unit,
    in_a_name,
    in_shown_units,
    unbroken,
)
from protocol.text.profile import PA_PER_UNIT

PA = {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5, "psi": 6894.757293168}


@pytest.mark.parametrize("unit", PA)
def test_factors_are_those_of_device_profiles(unit: str) -> None:
    """A unit means the same pressure in a CSV and in a device profile."""
    assert PA_PER_UNIT[unit] == pytest.approx(PA[unit], rel=1e-12)
    assert KPA_PER_UNIT[unit.lower()] == pytest.approx(PA[unit] / 1000.0, rel=1e-12)


def test_a_pascal_is_exact() -> None:
    """A pressure in Pa stays the whole number that it is."""
    assert (PA_PER_UNIT["Pa"], set(PA_PER_UNIT)) == (1.0, set(PA))


@pytest.mark.parametrize("name", KPA_PER_UNIT)
def test_both_tables_of_pressures_agree(name: str) -> None:
    """A name in small letters, as an importer reads it, is the same unit with the same factor, bit for bit."""
    found = find_unit(name)
    assert found is not None and (found.quantity, found.factor) == ("pressure", KPA_PER_UNIT[name])


@pytest.mark.parametrize(
    ("value", "given", "wanted", "expected"),
    [
        (1.0, "V", "mV", 1000.0), (250.0, "µV", "mV", 0.25), (1.0, "bar", "psi", 14.503773773),
        (14.503773773, "PSI", "kPa", 100.0), (20.0, "°C", "degF", 68.0), (300.0, "K", "degC", 26.85),
        (-40.0, "degF", "degC", -40.0), (20.0, "mA", "A", 0.02), (1.0, "L/min", "mL/min", 1000.0),
        (1.0, "m³/h", "L/min", 1000 / 60), (1.0, "in", "mm", 25.4), (2.0, "min", "s", 120.0),
    ],
)  # fmt: skip
def test_conversion(value: float, given: str, wanted: str, expected: float) -> None:
    """Prefixes, spellings, offsets of temperatures and ratios of units; the inverse leads back."""
    there, back = conversion(given, wanted), conversion(wanted, given)
    assert there is not None and back is not None
    assert value * there[0] + there[1] == pytest.approx(expected, rel=1e-9)
    assert expected * back[0] + back[1] == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("text", ["", "widgets", "kpsi", "mdegC", "K/s/s", "Pa/degF"])
def test_an_unknown_unit_is_none(text: str) -> None:
    """What is no unit, and a rate of a unit that has an offset, is not guessed."""
    assert find_unit(text) is None


def test_the_case_of_a_prefix_counts() -> None:
    """MPa and mPa differ by a billion; a name in small letters is the usual one of the two."""
    assert [find_unit(text).factor for text in ("MPa", "mPa", "mpa")] == [1e3, 1e-6, 1e3]  # type: ignore[union-attr]


def test_no_conversion_between_quantities() -> None:
    """Nothing is converted from a pressure to a voltage, or to or from an unknown unit; the same unit is itself."""
    assert (conversion("kPa", "mV"), conversion("widgets", "mV"), conversion("x", "x")) == (None, None, (1.0, 0.0))


def test_a_unit_ends_the_name_of_a_column() -> None:
    """As kpa in pressure_kpa."""
    assert [in_a_name(unit) for unit in ("°C", "L/min", "%", "µV", "", "a.u.")] == [
        "degc", "l_per_min", "percent", "uv", "", "a_u",
    ]  # fmt: skip


def test_text_with_quantities_is_shown_in_other_units() -> None:
    """Truth: 52 kPa = 7.542 psi, 0.125 mm = 4.92 mil; as a string, and in a pickle, it has the stored units."""
    text = UnitText(Quantity(52.0, "kPa"), " is above the plan's limit of ", Quantity(50.0, "kPa"))
    assert text == "52 kPa is above the plan's limit of 50 kPa"
    psi = ShownUnits.of("psi,in")
    assert in_shown_units(text, psi) == "7.542 psi is above the plan's limit of 7.252 psi"
    assert UnitText(Quantity(-0.01, "kPa", "+.0f"), " to ", Quantity(-0.01, "mm", ".1f")) == "0 kPa to 0.0 mm"
    half = UnitText("\u00b1", Quantity(125.0, "um", ".0f"), " at ", Quantity(-2.5, "mm", "+.1f", named=False))
    assert (half, in_shown_units(half, psi)) == ("\u00b1125 \u00b5m at -2.5", "\u00b10.0049 in at -0.10")
    both = pickle.loads(pickle.dumps(UnitText("; ").joined([text, "no", half])))
    assert in_shown_units(both, psi) == "; ".join([in_shown_units(text, psi), "no", in_shown_units(half, psi)])
    assert (
        in_shown_units(UnitText.filled("{kpa}: {why}", kpa=Quantity(10.0, "kPa", ".1f"), why="low"), psi)
        == "1.45 psi: low"
    )
    assert in_shown_units("30 kPa", psi) == "30 kPa"


def test_a_value_and_its_unit_stay_on_one_line() -> None:
    """Every space but those a line may end at; numbers of other things are left as they are."""
    text = "U = 0.13 mm (k = 2) to 4.0 mm; 5.01 % FSO, 2 mV/kPa, 21 \u00b0C; 1 reading to check"
    parts = ["U = 0.13 mm", "(k = 2)", "to", "4.0 mm;", "5.01 % FSO,", "2 mV/kPa,", "21 \u00b0C;", "1", "reading"]
    found = unbroken(text)
    assert found.replace("\u00a0", " ") == text
    assert [part.replace("\u00a0", " ") for part in found.split(" ")] == [*parts, "to", "check"]
