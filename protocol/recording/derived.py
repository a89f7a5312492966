"""Derived channels: columns computed from the columns of a sample by an expression, such as ``s1_mv / s2_mv``.

A definition is one line, ``NAME [UNIT] = EXPRESSION``, stored in `session.derived`. Values are not stored: the same
operations on the same samples give the same bits, live in blocks and offline in one piece.

Strategy: an expression is untrusted, so Python never evaluates it. It is parsed by precedence climbing into at most
`_MAX_STEPS` numpy operations from a closed list, on float64 columns; time and memory are linear in the samples. Units
of a product are multiplied, those of a sum must agree; a stated unit takes precedence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from protocol.base.errors import RecordingError
from protocol.recording.channels import ExtraChannel

Column: TypeAlias = NDArray[np.float64]
Powers: TypeAlias = Mapping[str, float]  # symbol of a unit: its exponent; empty for a number

MAX_LETTERS, _MAX_STEPS, MAX_DEPTH, MAX_CHANNELS = 400, 120, 24, 16
_ROWS_AT_ONCE = 1 << 16  # memory is bounded by the steps times this

_DEFINITION = re.compile(
    r"\s*([A-Za-z][A-Za-z0-9_]{0,31})\s*(?:\[\s*([^\[\]=;:\"\x00-\x1f]{0,24}?)\s*\])?\s*=(.*)", re.S
)
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign>\*\*|<=|>=|==|!=|[-+*/(),<>]))"
)
_RESERVED = re.compile(r"index|time_s|pressure_kpa|target_kpa|state|flags|segment|elongation.*|u_mm|s[1-9]\w*")


class ExpressionError(RecordingError):
    """A definition that is refused, with its cause and remedy."""


class DerivedChannel(NamedTuple):
    """A definition as `session.derived` keeps it; an empty unit is derived from those of the channels."""

    name: str
    unit: str
    expression: str

    @property
    def column(self) -> str:
        """Its column in tables and files."""
        return self.name

    @property
    def title(self) -> str:
        """Its name as a label."""
        return self.name


def _same(powers: Sequence[Powers]) -> Powers:
    """Return the unit that all have; numbers without a unit take that of the others."""
    stated = [each for each in powers if each]
    if any(each != stated[0] for each in stated):
        texts = " and ".join(dict.fromkeys(unit_text(each) for each in stated))
        raise ExpressionError(
            f"{texts} are combined in a sum, a comparison or a choice", "State the unit: NAME [UNIT] = ..."
        )
    return stated[0] if stated else {}


def _number(powers: Sequence[Powers]) -> Powers:
    """Return no unit; arguments may have any, for a ratio is often formed with a number."""
    return {}


def _scaled(powers: Powers, by: float) -> Powers:
    return {symbol: power * by for symbol, power in powers.items() if power * by}


def _product(left: Powers, right: Powers, sign: float) -> Powers:
    found = {symbol: left.get(symbol, 0.0) + sign * right.get(symbol, 0.0) for symbol in {**left, **right}}
    return {symbol: power for symbol, power in found.items() if power}


def _where(condition: Column, a: Column, b: Column) -> Column:
    return np.where(condition != 0, a, b)


_UnitRule: TypeAlias = Callable[[Sequence[Powers]], Powers]
FUNCTIONS: Mapping[str, tuple[int, Callable[..., Any], _UnitRule]] = {  # number of arguments, what, its unit
    "abs": (1, np.abs, _same),
    "sqrt": (1, np.sqrt, lambda p: _scaled(p[0], 0.5)),
    "exp": (1, np.exp, _number),
    "log": (1, np.log, _number),
    "log10": (1, np.log10, _number),
    "sin": (1, np.sin, _number),
    "cos": (1, np.cos, _number),
    "tan": (1, np.tan, _number),
    "atan": (1, np.arctan, _number),
    "atan2": (2, np.arctan2, _number),
    "hypot": (2, np.hypot, _same),
    "floor": (1, np.floor, _same),
    "ceil": (1, np.ceil, _same),
    "round": (1, np.rint, _same),
    "min": (2, np.minimum, _same),
    "max": (2, np.maximum, _same),
    "where": (3, _where, lambda p: _same(p[1:])),
}
_OPERATORS: Mapping[str, tuple[int, Callable[..., Any], _UnitRule]] = {
    "+": (1, np.add, _same),
    "-": (1, np.subtract, _same),
    "*": (2, np.multiply, lambda p: _product(p[0], p[1], 1.0)),
    "/": (2, np.divide, lambda p: _product(p[0], p[1], -1.0)),
    "<": (0, np.less, lambda p: _scaled(_same(p), 0.0)),
    ">": (0, np.greater, lambda p: _scaled(_same(p), 0.0)),
    "<=": (0, np.less_equal, lambda p: _scaled(_same(p), 0.0)),
    ">=": (0, np.greater_equal, lambda p: _scaled(_same(p), 0.0)),
    "==": (0, np.equal, lambda p: _scaled(_same(p), 0.0)),
    "!=": (0, np.not_equal, lambda p: _scaled(_same(p), 0.0)),
}
_CONSTANTS = {"pi": math.pi, "nan": math.nan}


@dataclass(frozen=True, slots=True)
class _Step:
    """One operation of a program: a constant, a channel, or a function of the values before."""

    value: float | str | None = None
    arguments: int = 0
    function: Callable[..., Any] | None = None
    unit: _UnitRule | None = None
    exponent: float | None = None  # of a power


class _Reader:
    """Reads an expression by precedence climbing."""

    def __init__(self, text: str) -> None:
        if len(text) > MAX_LETTERS:
            raise ExpressionError(
                f"the expression has {len(text)} letters, more than {MAX_LETTERS}", "Divide it in two."
            )
        self.tokens: list[tuple[str, str]] = []
        at = 0
        while text[at:].strip():
            found = _TOKEN.match(text, at)
            if found is None:
                raise ExpressionError(f"{text[at:].strip()[:12]!r} is not understood", _REMEDY)
            kind = str(found.lastgroup)
            self.tokens.append((kind, found[kind]))
            at = found.end()
        self.at, self.steps = 0, list[_Step]()

    def read(self) -> tuple[_Step, ...]:
        """Return the whole expression's program."""
        self._level(0, 0)
        if self.at < len(self.tokens):
            raise ExpressionError(f"{self.tokens[self.at][1][:12]!r} is not expected there", _REMEDY)
        return tuple(self.steps)

    def _peek(self) -> str:
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("", "")
        return text if kind == "sign" else ""

    def _take(self, sign: str) -> None:
        if self._peek() != sign:
            found = repr(self.tokens[self.at][1][:12]) if self.at < len(self.tokens) else "its end"
            raise ExpressionError(f"{sign!r} is expected before {found}", _REMEDY)
        self.at += 1

    def _add(self, step: _Step) -> None:
        self.steps.append(step)
        if len(self.steps) > _MAX_STEPS:
            raise ExpressionError(f"the expression has more than {_MAX_STEPS} operations", "Divide it in two.")

    def _level(self, lowest: int, depth: int) -> None:
        """Read operators that bind at least as `lowest`."""
        if depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested deeper than {MAX_DEPTH}", "Divide it in two.")
        self._operand(depth)
        while (sign := self._peek()) in _OPERATORS and _OPERATORS[sign][0] >= lowest:
            binds, function, unit = _OPERATORS[sign]
            self.at += 1
            self._level(binds + 1, depth + 1)
            self._add(_Step(None, 2, function, unit))
            if not binds and self._peek() in _OPERATORS and not _OPERATORS[self._peek()][0]:
                raise ExpressionError("comparisons are not chained", "Multiply two of them: (a < b) * (b < c).")

    def _operand(self, depth: int) -> None:
        if self._peek() in ("-", "+"):
            negative = self._peek() == "-"
            self.at += 1
            if depth > MAX_DEPTH:
                raise ExpressionError(f"the expression is nested deeper than {MAX_DEPTH}", "Divide it in two.")
            self._operand(depth + 1)
            if negative:
                self._add(_Step(None, 1, np.negative, _same))
            return
        self._atom(depth)
        if self._peek() == "**":
            self.at += 1
            self._add(_Step(None, 1, None, None, self._exponent()))

    def _exponent(self) -> float:
        """Return the number behind `**`: an exponent is a number, so that a power has a unit."""
        sign = 1.0
        if self._peek() == "-":
            sign, self.at = -1.0, self.at + 1
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("", "")
        if kind != "number":
            raise ExpressionError("an exponent must be a number", "Use exp(y * log(x)) for x to the power of y.")
        self.at += 1
        return sign * _finite(text)

    def _atom(self, depth: int) -> None:
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("", "")
        self.at += 1
        if kind == "number":
            self._add(_Step(_finite(text)))
        elif kind == "name" and self._peek() == "(":
            self._call(text, depth)
        elif kind == "name":
            self._add(_Step(_CONSTANTS.get(text, text)))
        elif text == "(":
            self._level(0, depth + 1)
            self._take(")")
        else:
            raise ExpressionError(
                "the expression is incomplete" if not text else f"{text!r} is not expected there", _REMEDY
            )

    def _call(self, name: str, depth: int) -> None:
        if name not in FUNCTIONS:
            raise ExpressionError(f"there is no function {name[:32]!r}", f"Use one of {', '.join(FUNCTIONS)}.")
        wanted, function, unit = FUNCTIONS[name]
        self._take("(")
        for number in range(wanted):
            if number:
                self._take(",")
            self._level(0, depth + 1)
        self._take(")")
        self._add(_Step(None, wanted, function, unit))


_REMEDY = "Write numbers, channels, + - * / ** < > and functions, such as log(s1_mv / s2_mv)."


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ExpressionError(f"{text[:12]}... is too large for a number", "Write a smaller one.")
    return value


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression that was read. `channels` are the names that it needs."""

    steps: tuple[_Step, ...]

    @classmethod
    def read(cls, text: str) -> Expression:
        """Parse an expression. ExpressionError: it is none, or too large."""
        return cls(_Reader(text).read())

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that it needs, each once."""
        return tuple(dict.fromkeys(step.value for step in self.steps if isinstance(step.value, str)))

    def evaluate(self, columns: Mapping[str, NDArray[Any]]) -> Column:
        """Return the value of every row from `columns` [n]; NaN or infinite where undefined."""
        n = max((len(column) for column in columns.values()), default=0)
        result = np.empty(n)
        with np.errstate(all="ignore"):
            for first in range(0, n, _ROWS_AT_ONCE):
                rows = slice(first, first + _ROWS_AT_ONCE)
                known = {name: np.ascontiguousarray(columns[name][rows], dtype=np.float64) for name in self.channels}
                result[rows] = self._rows(known, len(result[rows]))
        return result

    def _rows(self, columns: Mapping[str, Column], n: int) -> Column:
        stack: list[Column] = []
        for step in self.steps:
            if isinstance(step.value, str):
                stack.append(columns[step.value])
            elif step.value is not None:
                stack.append(np.full(n, step.value))
            elif step.exponent is not None:
                stack.append(_power(stack.pop(), step.exponent))
            else:
                assert step.function is not None
                arguments = stack[-step.arguments :]
                stack[-step.arguments :] = [np.asarray(step.function(*arguments), dtype=np.float64)]
        return stack[0]

    def unit(self, units: Mapping[str, str]) -> str:
        """Return the unit of the result, from those of channels. ExpressionError: unlike units added or compared."""
        stack: list[Powers] = []
        for step in self.steps:
            if isinstance(step.value, str):
                unit = units.get(step.value, "")
                stack.append({unit: 1.0} if unit not in ("", "1") else {})
            elif step.value is not None:
                stack.append({})
            elif step.exponent is not None:
                stack.append(_scaled(stack.pop(), step.exponent))
            else:
                assert step.unit is not None
                stack[-step.arguments :] = [step.unit(stack[-step.arguments :])]
        return unit_text(stack[0])


def _power(base: Column, exponent: float) -> Column:
    """Return base ** exponent; small whole powers by multiplication, as every machine does it alike."""
    if exponent == 2.0:
        return base * base
    return np.asarray(np.power(base, exponent), dtype=np.float64)


def unit_text(powers: Powers) -> str:
    """Return a unit as text: mV, mV/kPa, mV^2; "1" for a number."""

    def part(symbol: str, power: float) -> str:
        return symbol if power == 1 else f"{symbol}^{power:g}"

    above = " ".join(part(symbol, power) for symbol, power in powers.items() if power > 0)
    below = [part(symbol, -power) for symbol, power in powers.items() if power < 0]
    return "/".join([above or "1", *below]) if below else above or "1"


@dataclass(frozen=True, slots=True)
class DerivedColumns:
    """Definitions that were checked against the channels of a board."""

    channels: tuple[DerivedChannel, ...] = ()
    expressions: tuple[Expression, ...] = ()

    @classmethod
    def of(cls, definitions: Iterable[DerivedChannel], units: Mapping[str, str]) -> DerivedColumns:
        """Check definitions; each may use those before it. ExpressionError: over `MAX_CHANNELS`, or one refused."""
        known, channels, expressions = dict(units), list[DerivedChannel](), list[Expression]()
        for definition in definitions:
            name = definition.name
            if len(channels) == MAX_CHANNELS:
                raise ExpressionError(f"there are more than {MAX_CHANNELS} derived channels", "Leave some out.")
            if name in known or _RESERVED.fullmatch(name) or name in FUNCTIONS or name in _CONSTANTS:
                raise ExpressionError(f"the name {name!r} is taken", "Choose another one.")
            try:
                expression = Expression.read(definition.expression)
                missing = [channel for channel in expression.channels if channel not in known]
                if missing:
                    cause = f"there is no channel {missing[0][:40]!r}"
                    raise ExpressionError(cause, f"Use one of {', '.join(known)}.")
                unit = definition.unit or expression.unit(known)
            except ExpressionError as error:
                raise ExpressionError(f"derived channel {name}: {error.cause}", error.remedy) from error
            channels.append(DerivedChannel(name, unit, definition.expression))
            expressions.append(expression)
            known[name] = unit
        return cls(tuple(channels), tuple(expressions))

    def evaluate(self, columns: Mapping[str, NDArray[Any]]) -> dict[str, Column]:
        """Return the values [n] of every derived channel by name, from `columns` [n]."""
        known = dict(columns)
        for channel, expression in zip(self.channels, self.expressions, strict=True):
            known[channel.name] = expression.evaluate(known)
        return {channel.name: known[channel.name] for channel in self.channels}


def parse_definition(text: str) -> DerivedChannel:
    """Return a definition ``NAME [UNIT] = EXPRESSION``. ExpressionError: another form, or its expression is refused."""
    found = _DEFINITION.fullmatch(text) if len(text) <= MAX_LETTERS + 80 else None
    if found is None:
        remedy = "Write NAME [UNIT] = EXPRESSION, such as ratio = s1_mv / s2_mv."
        raise ExpressionError(f"{text[:40]!r} is no derived channel", remedy)
    name, unit, expression = found[1], (found[2] or "").strip(), found[3].strip()
    Expression.read(expression)
    return DerivedChannel(name, unit, expression)


def are_derived(value: object) -> bool:
    """Whether a value of `session.derived` holds definitions: [[name, unit, expression], ...], each readable."""
    if not isinstance(value, list) or len(value) > MAX_CHANNELS:
        return False
    try:
        for entry in value:
            name, unit, expression = entry
            if parse_definition(f"{name} [{unit}] = {expression}") != (name, unit, expression):
                return False
    except (ExpressionError, TypeError, ValueError):
        return False
    return True


def channel_units(n_sensors: int, kind: str, extra: Iterable[ExtraChannel] = ()) -> dict[str, str]:
    """Return the units of the channels of an expression by name; `n_sensors` and `kind` as in `sample_dtype`."""
    units = {"pressure_kpa": "kPa"} | {f"s{n}_mv": "mV" for n in range(1, n_sensors + 1)}
    if kind == "counts":
        units |= {f"s{n}_{part}": "counts" for n in range(1, n_sensors + 1) for part in ("lit", "dark")}
    return units | {channel.column: channel.unit for channel in extra}
