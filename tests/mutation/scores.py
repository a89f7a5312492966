"""The scores of the mutation tests: `python -m tests.mutation.scores` writes scores.csv from the results of `mutate`.

It prints the survivors that have no reason in survivors.toml yet. A reason names the module, the line as it is, and,
where it explains one mutant of the line only, the line as mutated.
"""

from __future__ import annotations

import csv
import sys
import tomllib
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from tests.mutation.mutate import MODULES, Results, results_file

REASONS = Path(__file__).with_name("survivors.toml")
SCORES = Path(__file__).with_name("scores.csv")
COLUMNS = ("module", "date", "tried", "all", "killed", "equivalent", "share_percent", "low_percent", "high_percent")


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a mutant survives, and whether it is equivalent; of every mutant of the line where `after` is empty."""

    module: str
    before: str
    why: str
    after: str = ""
    equivalent: bool = False


def reasons() -> list[Reason]:
    """Return the reasons of survivors.toml."""
    return [Reason(**row) for row in tomllib.loads(REASONS.read_text(encoding="utf-8"))["survivor"]]


def score(module: str, day: str, tried: int, killed: int, equivalent: int, *, whole: bool) -> dict[str, Any]:
    """Return a row of scores.csv; the share is of the mutants that are not equivalent, with Wilson's 95 % interval."""
    able = tried - equivalent
    low, high = (100.0 * bound for bound in binomtest(killed, able).proportion_ci(method="wilson"))
    share = 100.0 * killed / able
    bounds = (share, share) if whole else (low, high)
    values = (module, day, tried, whole, killed, equivalent)
    return dict(zip(COLUMNS, (*values, *(round(value, 1) for value in (share, *bounds))), strict=True))


def _reason(module: str, mutant: dict[str, Any]) -> Reason | None:
    alike = (r for r in reasons() if (r.module, r.before) == (module, mutant["before"]))
    return next((r for r in alike if r.after in ("", mutant["after"])), None)


def main() -> None:
    """Write the scores of all modules with results, and print the survivors without a reason."""
    with SCORES.open(encoding="utf-8", newline="") as file:
        rows = {row["module"]: row for row in csv.DictReader(file)}
    rows = {module: rows[module] for module in MODULES if module in rows}
    for module in MODULES:
        kept = Results.kept(module)
        found = list(kept["found"].values())
        survivors = [one for one in found if one["outcome"] == "survived"]
        known = [(one, _reason(module, one)) for one in survivors]
        equivalent = sum(reason is not None and reason.equivalent for _, reason in known)
        if len(found) > equivalent:
            killed = len(found) - len(survivors)
            day = date.fromtimestamp(results_file(module).stat().st_mtime).isoformat()
            rows[module] = score(module, day, len(found), killed, equivalent, whole=kept["whole"])
        for one, reason in known:
            if reason is None:
                sys.stdout.write(f"{module}:{one['line']}: {one['before']}  ->  {one['after']}\n")
    with SCORES.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows.values())


if __name__ == "__main__":
    main()
