"""`make audit`: known vulnerabilities of the installed packages, by pip-audit; no answer never counts as "none found".

Exit codes: 0 every package was looked up and none has a known vulnerability; 1 some have; 3 packages could not be
looked up, as where the advisory service is out of reach.
"""

from __future__ import annotations

import json
import subprocess
import sys


def audited(report: str) -> tuple[list[str], list[str], int]:
    """Return, from pip-audit's JSON, a line per vulnerability, the packages not looked up, and the number looked up."""
    packages = json.loads(report)["dependencies"]
    weak = [
        f"{package['name']} {package['version']}: {found['id']}, fixed in {', '.join(found['fix_versions']) or 'none'}"
        for package in packages
        for found in package.get("vulns", [])
    ]
    others = [package for package in packages if "editable" not in package.get("skip_reason", "")]  # all but our own
    skipped = [package["name"] for package in others if "skip_reason" in package]
    return weak, skipped, len(others) - len(skipped)


def main() -> int:
    """Run pip-audit on this environment and print what is known, and for which packages nothing is."""
    command = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off", "--skip-editable"]
    done = subprocess.run(command, capture_output=True, text=True)
    try:
        weak, skipped, looked_up = audited(done.stdout)
    except (ValueError, KeyError):
        error = done.stderr.strip().splitlines()[-1:] or ["no message"]
        print(f"NOT AUDITED: the advisory service gave no answer ({error[0][:200]}); nothing is known")
        return 3
    for line in weak:
        print(f"WEAK {line}")
    print(f"{looked_up} packages looked up, {len(weak)} known vulnerabilities")
    if skipped:
        print(f"NOT AUDITED: {len(skipped)} packages, because the advisory service did not know or answer for them: ")
        print("  " + ", ".join(skipped))
    return 1 if weak else 3 if skipped else 0


if __name__ == "__main__":
    sys.exit(main())
