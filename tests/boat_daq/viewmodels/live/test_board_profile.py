"""The description of a board in the making: fields, limits, commands, preview; what is not complete is refused."""

from __future__ import annotations

import os
import sys
import tty

import pytest

from boat_daq.engine.settings import Settings
from boat_daq.viewmodels.live.board_profile import BoardProfile
from protocol.base.errors import ProfileError, RequestError
from protocol.text.profile import load_profile
from tests.boat_daq.viewmodels.helpers import until
from tests.protocol.text.firmwares import OUTPUTS, PACKETS


@pytest.fixture
def model(tmp_path):
    """A description from columns without a heading."""
    made = BoardProfile(Settings())
    made.open(printed(tmp_path, OUTPUTS["Arduino plotter without labels"]))
    return made


def printed(folder, data: bytes):
    """Return a file with what a board printed."""
    path = folder / "printed.txt"
    path.write_bytes(data)
    return path


def test_preview_is_what_the_decoder_reads(model):
    """Headings with units, the newest samples, the number of lines that were read; a change is seen at once."""
    shown = model.preview()
    assert shown.headings == ("Time (s)", "Pressure (kPa)", "Sensor 1 (mV)", "Sensor 2 (mV)")
    assert shown.good
    assert shown.rows[-1][1] == "\u221211.90"
    model.set_field(0, unit="mbar")
    assert model.preview().rows[-1][1] == "\u22121.19"
    model.set_scale(0, "10")
    assert model.preview().rows[-1][1] == "\u221211.90"


def test_field_becomes_a_channel_or_is_left_out(model):
    """Another name is an extra channel with its unit; a profile without a signal is refused."""
    model.set_field(2, name="temperature", unit="degC")
    assert model.preview().headings[-1] == "Temperature (degC)"
    model.set_field(1, name="_")
    with pytest.raises(RequestError, match="sensor"):
        model.profile()
    assert "sensor" in model.preview().remark


def test_limits_and_commands_are_stated_never_proposed(model):
    """Without them nothing is commanded; with them the dry run shows the bytes, and a wrong template its reason."""
    assert "no `commands.set_pressure`" in model.profile().cannot_command_reason
    model.set_device("low_kpa", "-50")
    with pytest.raises(ProfileError, match="only one of"):
        model.profile()
    model.set_device("high_kpa", "60")
    model.set_command("set_pressure", "P{kpa:.1f}\\n")
    model.set_command("vent", "V\\n")
    assert model.profile().cannot_command_reason == ""
    assert model.profile().limits_pa == (-50_000, 60_000)
    assert (model.dry_run()["set_pressure"], model.dry_run()["vent"]) == ("P-40.0\\n", "V\\n")
    model.set_command("vent", "V{kpa}")
    assert "unknown field" in model.dry_run()["vent"]
    model.set_command("vent", "")
    assert model.dry_run()["vent"] == ""


def test_profile_is_saved_and_loaded(model, tmp_path):
    """The file is a profile that the program opens."""
    model.name, path = "Rig 3", tmp_path / "rig.toml"
    model.set_device("rate_hz", "50")
    model.save(path)
    assert (load_profile(path).name, load_profile(path).rate_hz) == ("Rig 3", 50.0)


def test_packets_are_described_by_their_format(tmp_path):
    """The bytes are shown as hexadecimal; a variable of a new name is a channel, a wrong format is refused."""
    model = BoardProfile(Settings())
    model.open(printed(tmp_path, PACKETS))
    assert model.raw().startswith("02 ") or " 43 " in model.raw()
    assert model.preview().rows[-1][1] == "\u22127.20"
    model.set_rx8("RX8 [h=43] @1P @0P @1S1 @0S1 @1T @0T")
    assert model.preview().headings[-1] == "T"
    with pytest.raises(ProfileError, match="rx8"):
        model.set_rx8("RX8 nothing")


def test_what_is_no_table_is_told(tmp_path):
    """Prose gives no profile, and the reason."""
    model = BoardProfile(Settings())
    model.open(printed(tmp_path, b"hello there\nthis is a poem\nand it does not rhyme\nat all\nnowhere\n"))
    assert "fit most of the lines" in model.problem
    with pytest.raises(RequestError, match="no profile yet"):
        model.save(tmp_path / "x.toml")
    with pytest.raises(RequestError, match="not a number"):
        model.set_scale(0, "ten")
    with pytest.raises(RequestError, match="no port"):
        model.listen(" ")


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_listening_sends_nothing():
    """What the device prints arrives with its rate, and not a byte goes to it."""
    board, port = os.openpty()
    tty.setraw(port)
    os.set_blocking(board, False)
    model = BoardProfile(Settings())
    model.listen(os.ttyname(port))
    lines = OUTPUTS["key=value"].splitlines(keepends=True)

    def heard() -> bool:
        os.write(board, lines.pop(0) if lines else b"")
        model.follow()
        return len(model._data) >= 500

    until(heard)
    assert model.proposal is not None and model.proposal.summary.startswith("4 fields with labels")
    with pytest.raises(BlockingIOError):
        os.read(board, 1)
    model.stop()
    assert not model.listening
    os.close(board)
    os.close(port)
