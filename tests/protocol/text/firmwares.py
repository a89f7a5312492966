"""Outputs of made-up firmware, all of one motion: what a laboratory's own board may print."""

from __future__ import annotations

import json
from functools import reduce
from operator import xor

import numpy as np

from protocol.text.readers import CHECKSUMS

N = 60
TIME_MS = 5000 + 10 * np.arange(N)
PRESSURE_KPA = np.round(30 * np.sin(np.arange(N) / 6), 1)
COUNTS = np.column_stack([(500 + 4 * PRESSURE_KPA).astype(int), (620 - 3 * PRESSURE_KPA).astype(int)])
ROWS = list(zip(TIME_MS.tolist(), PRESSURE_KPA.tolist(), *COUNTS.T.tolist(), strict=True))


def _text(form: str, end: str = "\r\n") -> bytes:
    return ("".join(form.format(t=t, p=p, a=a, b=b) + end for t, p, a, b in ROWS)).encode()


def _nmea(text: str) -> str:
    return f"${text}*{reduce(xor, text.encode(), 0):02X}"


def _rx8(t: int, p: float, a: int, b: int) -> bytes:
    return b"\x43" + round(p * 100).to_bytes(2, "big", signed=True) + a.to_bytes(2, "big") + b.to_bytes(2, "big")


PLAIN = [f"{t},{p:.1f},{a},{b}" for t, p, a, b in ROWS]
OUTPUTS: dict[str, bytes] = {
    "columns with a heading": b"Time (ms),Pressure (kPa),Sensor 1,Sensor 2\r\n" + _text("{t},{p:.1f},{a},{b}"),
    "Arduino plotter with labels": _text("P_kPa:{p:.1f},S1:{a},S2:{b}"),
    "Arduino plotter without labels": _text("{p:.1f}\t{a}\t{b}"),
    "JSON": "".join(json.dumps({"t": t, "press": p, "adc": [a, b], "ok": 1}) + "\n" for t, p, a, b in ROWS).encode(),
    "key=value": _text("t={t} p={p:.1f} s1={a} s2={b}", "\n"),
    "hexadecimal with separators": "".join(
        f"{t:08X};{round(10 * p) & 0xFFFF:04X};{a:04X};{b:04X}\n" for t, p, a, b in ROWS
    ).encode(),
    "hexadecimal of one width": "".join(
        f"{t & 0xFFFF:04X}{round(10 * p) & 0xFFFF:04X}{a:04X}{b:04X}\n" for t, p, a, b in ROWS
    ).encode(),
    "checksum": "".join(_nmea(f"BOAT,{t},{p:.1f},{a},{b}") + "\r\n" for t, p, a, b in ROWS).encode(),
    "decimal comma": _text("{t};{p:.1f};{a};{b}").replace(b".", b","),
    "comments and aligned columns": b"# rig 3, started\n# t_ms p_kPa ch0 ch1\n"
    + _text("{t:>8} {p:>7.1f} {a:>5} {b:>5}"),
    "units behind the numbers": _text("Press: {p:.1f}kPa | S1: {a}mV | S2: {b}mV | Temp: 24.5C"),
    "old line ends and a counter": b"".join(
        f"{i},{t / 1000:.3f},{p:.1f},{a},{b}\r".encode() for i, (t, p, a, b) in enumerate(ROWS)
    ),
}
OUTPUTS |= {
    f"checksum {kind}": "".join(f"{text},{CHECKSUMS[kind][0](text.encode()):0{digits}X}\r\n" for text in PLAIN).encode()
    for kind, (_, digits) in CHECKSUMS.items()
    if kind != "nmea"
}
SECONDS = 0.01 * N
PACKETS = b"".join(_rx8(*row) for row in ROWS)
PACKETS_WITH_TAIL = b"".join(b"\xaa" + _rx8(*row) + b"\x0d\x0a" for row in ROWS)
