"""Text profiles: refused by the key that is wrong, and profiles without commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from protocol import (
    ProfileError,
    RequestError,
    SetPressure,
    TextConnection,
    Vent,
    load_profile,
)
from tests.protocol.text.devices import LINES, RX8


def test_profile_without_commands_gives_the_reason() -> None:
    """No template, or no limits: read-only, with the reason, and nothing is pressurised."""
    link = TextConnection(load_profile(RX8))
    assert not link.can_command
    assert "commands.set_pressure" in link.cannot_command_reason
    for command in (SetPressure(0, 0), Vent()):
        with pytest.raises(RequestError, match=r"commands\."):
            link.send(command, 0)
    limitless = (
        LINES.read_text(encoding="utf-8").replace("pressure_min_kpa = -50", "").replace("pressure_max_kpa = 60", "")
    )
    link = TextConnection(load_profile(limitless))
    assert link.cannot_command_reason.endswith("no pressure limits under `device`")
    with pytest.raises(RequestError, match="limits"):
        link.send(SetPressure(0, 0), 0)
    assert link.send(Vent(), 0) == b"V\n"


REFUSED = [
    ('name = "Delimited', 'nane = "Delimited', "unknown key nane"),
    ("n_sensors = 2", "n_sensors = 5", r"device\.n_sensors"),
    ("n_sensors = 2", 'n_sensors = "2"', r"device\.n_sensors is '2', not of type int"),
    ("n_sensors = 2", "n_sensors = true", r"device\.n_sensors is True"),
    ("rate_hz = 100 ", "", r"device\.rate_hz is missing"),
    ("rate_hz = 100 ", "rate_hz = 0", r"device\.rate_hz"),
    ("polarity = 1 ", "polarity = 2", "polarity"),
    ("adc_bits = 12", "", "adc_bits is missing"),
    ("pressure_min_kpa = -50", "pressure_min_kpa = 70", "pressure limits"),
    ("pressure_min_kpa = -50", "", "only one of"),
    ("pressure_max_kpa = 60", "pressure_max_kpa = nan", "pressure limits"),
    ('kind = "lines"', 'kind = "csv"', "kind = 'csv'"),
    ('delimiter = ","', 'delimeter = ","', r"unknown key lines\.delimeter"),
    ('delimiter = ","', 'delimiter = ",,"', "one character"),
    ('checksum = "none"', 'checksum = "crc"', "checksum"),
    ('comments = ["#", "time_ms"]', "comments = [1]", "comments"),
    ('comments = ["#", "time_ms"]', f"comments = {['#'] * 21}", r"lines\.comments has 21 entries, more than 20"),
    ('"s2_dark"', ", ".join(['"a"'] * 494), r"lines\.fields has 501 entries, more than 500"),
    ('kind = "lines"', 'kind = "lines"\n#' + "x" * 100_000, "has more than 100000 characters"),
    ('unit = "kPa"', 'unit = "torr"', "pressure has the unit 'torr'"),
    ('unit = "ms", wraps_at = 4294967296', "wraps_at = 7", "wraps_at = 7"),
    ('unit = "ms", wraps_at', "wraps_at", "time has the unit None"),
    ('"s1_lit"', '"s1_lt"', "sensors' fields"),
    ('"s1_lit"', '"s2_lit"', "s2_lit is given twice"),
    ('name = "pressure"', 'name = "druck"', "no field is named pressure"),
    ('"index"', '{ name = "index", scale = 2 }', "index has scale 2"),
    ("P{kpa:.1f}", "P{kpa.__class__}", "unknown field"),
    ("P{kpa:.1f}", "P{kpa!r}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:{pa}}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:>99999}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:d}", "commands.set_pressure"),
    ("P{kpa:.1f}", "P{0}", "unknown field"),
    ("P{kpa:.1f}", "P{}", "unknown field"),
    ("P{kpa:.1f}", "P{kpa", "commands.set_pressure"),
    ("P{kpa:.1f}", "P{kpa[0]}", "unknown field"),
    ("P{kpa:.1f}", "PÄ{kpa}", "ascii"),
    ('vent = "V', 'went = "V', r"unknown key commands\.went"),
    ('vent = "V\\n"', "vent = 1", r"commands\.vent is 1"),
]


def test_more_channels_than_a_sample_holds_are_refused() -> None:
    """The remedy leaves fields out."""
    text = LINES.read_text(encoding="utf-8").replace('"s1_lit"', ", ".join(['"a"'] * 40 + ['"s1_lit"']))
    with pytest.raises(ProfileError, match="41 fields beside those with a meaning, more than 32"):
        load_profile(text)
    assert len(load_profile(text.replace('"a"', '"_"')).channels) == 1


@pytest.mark.fault(53, how="profiles with each kind of mistake", times=38)
@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_a_profile_is_refused_by_key(old: str, new: str, message: str) -> None:
    """Unknown keys, wrong types, missing parts, swapped limits, templates that reach for more: named, with a remedy."""
    text = LINES.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(ProfileError, match=message) as caught:
        load_profile(text.replace(old, new, 1))
    assert caught.value.remedy


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00", b"a = [", b"x" * 200_000])
def test_other_file_is_refused(tmp_path: Path, content: bytes | None) -> None:
    """Absent, not text, not TOML, far too long."""
    path = tmp_path / "profile.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ProfileError) as caught:
        load_profile(path)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('style = "xml"', "lines.style = 'xml'"),
        ('style = "labels"\nassign = "=>"', "lines.assign = '=>'"),
        ('style = "json"', "the label pressure is given twice"),
        ("base = 8", "unknown key lines.base"),
    ],
)
def test_unknown_style_of_lines_is_refused(line: str, message: str) -> None:
    """A style, a sign or a label that cannot be read is named."""
    fields = '["pressure", "s1_signal", { name = "flow", label = "pressure" }]'
    text = f'name = "x"\nkind = "lines"\n[device]\nn_sensors = 1\nrate_hz = 10\n[lines]\n{line}\nfields = {fields}\n'
    with pytest.raises(ProfileError, match=message):
        load_profile(text)
    with pytest.raises(ProfileError, match="has the base 8"):
        load_profile(text.replace(line, "").replace('label = "pressure"', "base = 8"))
