"""docs/MUTATION.md from the results of `tests.mutation.mutate` and the reasons in survivors.toml.

`python -m tests.mutation.page` writes it. A reason names the module, the line as it is, and, where it is not that of
every mutant of the line, the line as mutated.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.mutation.mutate import MODULES, PAGE, ROOT, Results

REASONS = Path(__file__).with_name("survivors.toml")
HEAD = """# Mutation tests

Made by `make mutation`; do not edit. A mutant is a module with one small fault, made by [Cosmic
Ray](https://cosmic-ray.readthedocs.io): a comparison moved or turned round, an operation replaced by its opposite, a
number one more or one less, a condition negated, a loop left out. It is killed where one of the tests in
`tests.mutation.mutate.MODULES` fails or never ends. What is not a fault is left out: annotations, and the keywords
`strict`, `slots` and `frozen`, which guard against a programmer's mistake. Mutants are tried in random order, so that
those of an unfinished run are a sample of all.
"""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a mutant survives; of every mutant of the line where `after` is empty."""

    module: str
    before: str
    why: str
    after: str = ""


def reasons() -> list[Reason]:
    """Return the reasons that are stated."""
    return [Reason(**row) for row in _stated()["survivor"]]


def _stated() -> dict[str, Any]:
    return tomllib.loads(REASONS.read_text(encoding="utf-8"))


def page() -> str:
    """Return the text of docs/MUTATION.md, from the results that are kept."""
    rows, details = [], []
    tried = killed = made = 0
    for module in MODULES:
        kept = Results.kept(module)
        found = list(kept["found"].values())
        survivors = [one for one in found if one["outcome"] == "survived"]
        n, total = len(found) - len(survivors), kept["total"]
        share = f"{100 * n / len(found):.0f} %" if found else "-"
        rows.append(f"| `{module}` | {total} | {len(found)} | {n} | {share} |")
        tried, killed, made = tried + len(found), killed + n, made + total
        details += _survivors(module, survivors)
    share = f"{100 * killed / tried:.0f} %" if tried else "-"
    rows.append(f"| all | {made} | {tried} | {killed} | {share} |")
    table = ["| module | mutants | tried | killed | share |", "|---|---:|---:|---:|---:|", *rows]
    return "\n".join([HEAD, *table, "", _stated()["run"].strip(), "", "## Survivors", *details]) + "\n"


def _survivors(module: str, survivors: list[dict[str, Any]]) -> list[str]:
    if not survivors:
        return []
    stated = [reason for reason in reasons() if reason.module == module]
    lines = ["", f"### {module}", "", "| line | mutant | why |", "|---|---|---|"]
    for one in sorted(survivors, key=lambda one: (one["line"], one["operator"])):
        why = next(
            (r.why for r in stated if r.before == one["before"] and r.after in ("", one["after"])), "not yet examined"
        )
        lines.append(f"| `{_cell(one['before'])}` | `{_cell(one['after'])}` | {why} |")
    return lines


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("`", "'")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE.relative_to(ROOT)} written\n")
