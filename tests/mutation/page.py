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

from scipy.stats import binomtest

from tests.mutation.mutate import MODULES, PAGE, ROOT, Results

REASONS = Path(__file__).with_name("survivors.toml")
HEAD = """# Mutation tests

Made by `make mutation`; do not edit. A mutant is a module with one small fault, made by [Cosmic
Ray](https://cosmic-ray.readthedocs.io): a comparison moved or turned round, an operation replaced by its opposite, a
number one more or one less, a condition negated, a loop left out. It is killed where one of the tests in
`tests.mutation.mutate.MODULES` fails or never ends. What is not a fault is left out: annotations, and the keywords
`strict`, `slots` and `frozen`, which guard against a programmer's mistake. An equivalent mutant does what the module
does: no test can kill it, and the share is that of the others. Where not all are tried, they were drawn at random,
always the same ones, and the share has Wilson's 95 % interval.
"""


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a mutant survives, and whether it is equivalent; of every mutant of the line where `after` is empty."""

    module: str
    before: str
    why: str
    after: str = ""
    equivalent: bool = False


def reasons() -> list[Reason]:
    """Return the reasons that are stated."""
    return [Reason(**row) for row in _stated()["survivor"]]


def _stated() -> dict[str, Any]:
    return tomllib.loads(REASONS.read_text(encoding="utf-8"))


def page() -> str:
    """Return the text of docs/MUTATION.md, from the results that are kept."""
    rows, details = [], []
    for module in MODULES:
        kept = Results.kept(module)
        found = list(kept["found"].values())
        survivors = [one for one in found if one["outcome"] == "survived"]
        stated = [_reason(module, one) for one in survivors]
        equivalent = sum(reason is not None and reason.equivalent for reason in stated)
        rows.append(_row(module, len(found), len(found) - len(survivors), equivalent, whole=kept["whole"]))
        details += _survivors(module, survivors)
    table = ["| module | tried | killed | equivalent | share |", "|---|---:|---:|---:|---|", *rows]
    return "\n".join([HEAD, *table, "", _stated()["run"].strip(), "", "## Survivors", *details]) + "\n"


def _row(module: str, tried: int, killed: int, equivalent: int, *, whole: bool) -> str:
    able = tried - equivalent
    share = "-" if not able else f"{100 * killed / able:.0f} %"
    if able > 0 and not whole:
        low, high = binomtest(killed, able).proportion_ci(method="wilson")
        share += f" ({100 * low:.0f} to {100 * high:.0f} %)"
    return f"| `{module}` | {tried}{', all' if whole else ''} | {killed} | {equivalent} | {share} |"


def _reason(module: str, mutant: dict[str, Any]) -> Reason | None:
    alike = (r for r in reasons() if (r.module, r.before) == (module, mutant["before"]))
    return next((r for r in alike if r.after in ("", mutant["after"])), None)


def _survivors(module: str, survivors: list[dict[str, Any]]) -> list[str]:
    if not survivors:
        return []
    lines = ["", f"### {module}", "", "| line | mutant | why |", "|---|---|---|"]
    for one in sorted(survivors, key=lambda one: (one["line"], one["operator"])):
        reason = _reason(module, one)
        why = "not yet examined" if reason is None else f"{'equivalent: ' if reason.equivalent else ''}{reason.why}"
        lines.append(f"| `{_cell(one['before'])}` | `{_cell(one['after'])}` | {why} |")
    return lines


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("`", "'")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE.relative_to(ROOT)} written\n")
