"""Tolerances as they are typed, with a unit of measurement, or automatic; kept between starts, and undone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

from boat_daq.formatting import TYPED
from boat_daq.viewmodels.common.services import Change, Services
from protocol.base.errors import BoatDaqError, RequestError

T = TypeVar("T")
AUTOMATIC = "Automatic"
"""Text of no tolerance: by the precision in Settings."""
SIGNS = ("\u00b1", "+-")


@dataclass(frozen=True, slots=True)
class TypedTolerance:
    """Greatest error that a computation itself may leave, at 95 %, in its unit, as `mm` or `%FSO`."""

    value: float
    unit: str

    def __str__(self) -> str:
        """Return it as it is shown."""
        return f"\u00b1{self.value:.10g} {self.unit.replace('%', '% ')}"


def tolerance_of(text: str, units: tuple[str, ...]) -> TypedTolerance | None:
    """Return the tolerance that was typed; None where it is left to the precision.

    Parameters
    ----------
    text : number with its unit, for example "0.05 % FSO" or "\u00b10.005mm"; a number alone where there is one unit.
    """
    plain = plain_text(text)
    if plain in ("", AUTOMATIC.lower()):
        return None
    for sign in SIGNS:
        plain = plain.removeprefix(sign)
    unit = next((unit for unit in units if plain.endswith(unit.lower())), units[0] if len(units) == 1 else "")
    try:
        value = float(plain.removesuffix(unit.lower()))
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf or not unit:
        cause = "has no unit" if 0.0 < value < math.inf else "is not a tolerance"
        examples = " or ".join(str(TypedTolerance(0.01, unit)).removeprefix(SIGNS[0]) for unit in units)
        raise RequestError(f"{text!r} {cause}", f"Enter a number above 0 with its unit, as {examples}, or {AUTOMATIC}.")
    return TypedTolerance(value, unit)


def plain_text(text: str) -> str:
    """Return a typed text without spaces and capitals, with a decimal point."""
    return "".join(text.translate(TYPED).split()).lower()


def tolerance_choice(
    services: Services, name: str, suggested: tuple[TypedTolerance, ...], apply: Callable[[TypedTolerance | None], Any]
) -> TypedChoice[TypedTolerance | None]:
    """Return the choice of a tolerance, automatic at first, in any unit of those suggested; others as `TypedChoice`."""
    units = tuple(dict.fromkeys(one.unit for one in suggested))
    return TypedChoice(services, name, (None, *suggested), partial(tolerance_of, units=units), apply)


class TypedText(Protocol):
    """What a field shows and changes: a text."""

    @property
    def text(self) -> str:
        """Return the text in force."""
        ...

    @property
    def suggestions(self) -> tuple[str, ...]:
        """Return texts that are offered."""
        ...

    def choose(self, text: str) -> None:
        """Take another text; raises where it cannot be used."""
        ...


class TypedChoice(Generic[T]):
    """A value that is chosen from suggestions or typed, kept between starts.

    Parameters
    ----------
    name : completes "Undo ...", and is the key in the preferences.
    read : returns the value of a text; raises RequestError where it has none.
    """

    def __init__(
        self,
        services: Services,
        name: str,
        suggestions: tuple[T, ...],
        read: Callable[[str], T],
        apply: Callable[[T], Any],
        show: Callable[[T], str] = lambda value: AUTOMATIC if value is None else str(value),
    ) -> None:
        self._services, self._name, self._read, self._apply, self._show = services, name, read, apply, show
        self.suggestions = tuple(map(show, suggestions))
        self.value = suggestions[0]
        try:
            kept = read(services.preferences.get(name, self.text))
        except BoatDaqError:  # the file was edited, or is of another version
            return
        if kept != self.value:
            self.value = kept
            apply(kept)

    @property
    def text(self) -> str:
        """Return the text of the value in force."""
        return self._show(self.value)

    def choose(self, text: str) -> None:
        """Use the value of a text from now on, undoably."""
        value, before = self._read(text), self.value
        if value != before:
            self._services.undo.push(Change(self._name, partial(self._use, value), partial(self._use, before)))

    def _use(self, value: T) -> None:
        self.value = value
        self._services.preferences.set(self._name, self.text)
        self._apply(value)
