"""Units of pressure, in kPa; the exact factors of NIST SP 811."""

from __future__ import annotations

KPA_PER_UNIT = {
    "kpa": 1.0, "pa": 1e-3, "hpa": 0.1, "mpa": 1e3, "bar": 100.0, "mbar": 0.1, "psi": 6.894757293168361,
    "mmhg": 0.13332236842105263, "torr": 0.13332236842105263, "atm": 101.325,
}  # fmt: skip
