"""The messages of a session as lines of text, for a program without a window."""

from __future__ import annotations

from collections.abc import Callable

from boat_daq.engine.snapshot import LinkWarningCode, SessionSnapshot

_LASTING_S = 6.0  # a rate is that of the last 5 s; a start or a single loss within them is no lasting warning

Notify = Callable[[str], object]


class MessagePrinter:
    """Reports a session's warnings and errors after number `shown`, and each lasting warning of the link once."""

    def __init__(self, notify: Notify, shown: int = 0) -> None:
        self._notify, self._shown = notify, shown
        self._since: dict[LinkWarningCode, float] = {}  # since when, s of board time
        self._printed: set[LinkWarningCode] = set()

    def __call__(self, seen: SessionSnapshot) -> None:
        """Report what is new."""
        for message in seen.messages:
            if message.number > self._shown and message.level != "info":
                self._notify(f"{message.level}: {message.cause}")
                remedy = ": ".join(filter(None, (message.remedy, message.command)))
                if remedy:
                    self._notify(f"  try: {remedy}")
        self._shown = max([self._shown, *(message.number for message in seen.messages)])
        warnings = {w.code: w.text for w in (seen.health.warnings if seen.health is not None else ())}
        warnings.pop(LinkWarningCode.SILENT, None)  # has a message of its own
        self._since = {code: self._since.get(code, seen.recorded_s) for code in warnings}
        for code, since in self._since.items():
            if seen.recorded_s - since >= _LASTING_S and code not in self._printed:
                self._notify(f"warning: {warnings[code]}")
                self._printed.add(code)
