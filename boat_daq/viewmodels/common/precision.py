"""How finely the window computes: one of the levels of `analysis.fidelity`, kept between starts."""

from __future__ import annotations

from collections.abc import Callable

from analysis.fidelity import LEVELS, Fidelity, Level, fidelity
from boat_daq.viewmodels.common.preferences import Preferences

DEFAULT: Level = "normal"


class Precision:
    """The chosen level.

    Parameters
    ----------
    preferences : keep the level.
    apply : is called with the fidelity now and after each choice.
    """

    def __init__(self, preferences: Preferences, apply: Callable[[Fidelity], None]) -> None:
        self._preferences, self._apply = preferences, apply
        apply(fidelity(self.level))

    @property
    def level(self) -> Level:
        """Return the level in use."""
        kept = self._preferences.get("fidelity", DEFAULT)
        return next((level for level in LEVELS if level == kept), DEFAULT)

    def choose(self, level: Level) -> None:
        """Compute at `level` from now on; results shown stay until they are computed again."""
        self._preferences.set("fidelity", level)
        self._apply(fidelity(level))
