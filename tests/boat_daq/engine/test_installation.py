"""What is installed, and what of it is slow."""

from __future__ import annotations

import json
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cobs.cobs import _cobs_py
from typer.testing import CliRunner

from boat_daq.cli import app
from boat_daq.commands.qualify_report import build
from boat_daq.engine.bug_report import write_bug_report
from boat_daq.engine.installation import SLOW_DECODER, library_versions, shortcomings
from boat_daq.engine.qualification.result import qualification
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import MessageKind
from protocol.link import framing
from tests.conftest import ROOT

EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the decoder in Python, as where no compiler was there at installation."""
    monkeypatch.setattr(framing.cobs, "decode", _cobs_py.decode)


def test_versions_are_of_what_is_installed() -> None:
    """A library that is not there has no version."""
    assert list(library_versions(["numpy", "no-such-library"])) == ["numpy"]


def test_compiled_decoder_is_no_shortcoming(monkeypatch: pytest.MonkeyPatch) -> None:
    """A function in C, as `len` is one, is the fast path."""
    monkeypatch.setattr(framing.cobs, "decode", len)
    assert shortcomings() == ()


@pytest.mark.usefixtures("slow")
def test_slow_decoder_is_named_with_its_remedy(tmp_path: Path) -> None:
    """In a session's messages, `info`, the qualification and the bug report; frames are decoded all the same."""
    frame = framing.encode_frame(1, 2, b"abc")
    assert framing.FrameReader().receive(frame) == [framing.Frame(1, 2, b"abc")]
    told = [m for m in Session().snapshot().messages if m.kind is MessageKind.SLOW]
    assert [(m.cause, m.remedy) for m in told] == [(SLOW_DECODER.cause, SLOW_DECODER.remedy)]
    ran = CliRunner().invoke(app, ["info", str(EXAMPLE), "--json"])
    assert json.loads(ran.stdout)["shortcomings"][0]["command"] == SLOW_DECODER.command
    assert SLOW_DECODER.command in ran.stderr
    content = qualification([], datetime.now(UTC), whole=False, folder=tmp_path)
    assert ("Shortcoming", SLOW_DECODER.text) in build(content).facts
    with zipfile.ZipFile(write_bug_report(tmp_path / "bug.zip")) as archive:
        versions = json.loads(archive.read("versions.json"))
    (told_of,) = versions["shortcomings"]  # the path of Python, in its command, is personal
    assert told_of.startswith(SLOW_DECODER.text.partition('"')[0])
    assert "cobs" in versions["packages"]
