"""Notices by weight and time, and attempts."""

from __future__ import annotations

from boat_daq.viewmodels.common.notices import Notices, Severity
from protocol.base.errors import RequestError


def test_current_notice_is_the_most_severe():
    """A fault stays over later warnings, an information leaves by itself, a dismissed one gives way."""
    now = [0.0]
    notices = Notices(lambda: now[0])
    notices.add(Severity.FAULT, "the port is gone")
    now[0] = 1.0
    notices.add(Severity.WARNING, "2 samples lost")
    now[0] = 5.0
    assert notices.current().cause == "the port is gone"
    now[0] = 10.0
    notices.inform("Saved")
    assert notices.current().cause == "Saved"  # it was hidden behind the older ones, and never seen
    now[0] = 16.5
    notices.inform("Saved")
    now[0] = 17.0
    notices.add(Severity.FAULT, "the port is gone")
    assert notices.current().cause == "the port is gone"
    assert notices.waiting() == 2
    notices.dismiss(notices.current())
    assert notices.current().cause == "Saved"
    notices.dismiss(notices.current())
    assert notices.current().cause == "2 samples lost"
    notices.dismiss(notices.current())
    now[0] = 60.0
    assert notices.current() is None


def test_attempt_never_raises():
    """An error of the program has cause and remedy; any other is shown with its details."""

    def refuse():
        raise RequestError("no port was chosen", "Choose one.")

    now = [0.0]
    notices = Notices(lambda: now[0])
    assert not notices.attempt(refuse)
    now[0] = 100.0
    assert notices.current() is None  # nobody waits for the answer any more
    assert not notices.attempt(refuse)
    assert (notices.current().cause, notices.current().remedy, notices.current().details) == (
        "no port was chosen",
        "Choose one.",
        "",
    )
    assert not notices.attempt(lambda: 1 / 0)
    assert "ZeroDivisionError" in notices.current().details
    assert notices.attempt(lambda: None, done="Saved")
    assert notices.waiting() == 2  # the refusal is new: it may not have been read yet
    now[0] = 110.0
    assert notices.attempt(lambda: None)
    assert notices.current().details  # the operator did something else: only the fault of the program waits
    assert notices.waiting() == 0


def test_a_file_name_keeps_its_first_letter() -> None:
    """It was shown as another file: D.toml."""
    from boat_daq.viewmodels.common.notices import sentence

    assert sentence("d.toml is not a plan") == "d.toml is not a plan."
    assert sentence("the port is gone") == "The port is gone."
