"""The report of a qualification, for signature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from analysis.numbers import finite
from analysis.reports.document import Report, ReportTable, Section
from analysis.reports.html import write_html
from analysis.reports.pdf import write_pdf
from protocol.base.whole_file import write_whole

SCOPE = (
    "I have read this report. It tests program, computer, disk and port with a virtual board; it does not cover the "
    "lab's board, its sensors or its plumbing."
)


def write_reports(content: dict[str, Any], folder: Path) -> list[Path]:
    """Write the object of a qualification as HTML, PDF and JSON into a folder; return the files."""
    report = build(content)
    paths = [folder / f"qualification{suffix}" for suffix in (".html", ".pdf", ".json")]
    write_html(report, paths[0])
    write_pdf(report, paths[1])
    write_whole(paths[2], json.dumps(finite(content), indent=1, ensure_ascii=False) + "\n")
    return paths


def build(content: dict[str, Any]) -> Report:
    """Return the report: verdict, installation, signature, and each drill's criteria."""
    drills, begun, known = content["drills"], content["begun"], content["program"]
    summary = ReportTable(
        ("Drill", "Result", "Lost", "Injected"),
        tuple((drill["name"], _verdict(drill), drill["lost"], drill["injected"]) for drill in drills),
        "What was injected into the virtual board, what the recording lacks, and whether every criterion is met.",
        numeric=False,
    )
    lines = (_signature("Operator"), ("", "", "", ""), _signature("Checked by"))
    signature = ReportTable(("", "Name", "Date", "Signature"), lines, numeric=False)
    versions = ReportTable(("Program or library", "Version"), tuple(content["versions"].items()), numeric=False)
    return Report(
        "Qualification of the installation",
        f"{content['machine']['name']}, {begun[:10]}",
        True,
        content["verdict"],
        (
            ("Begun", begun),
            ("Duration", f"{content['seconds']:.0f} s for {len(drills)} drills"),
            *_installation(content),
            ("Boards", "; ".join(dict.fromkeys(filter(None, map(_board, drills)))) or "none"),
        ),
        (
            Section("Signature", (SCOPE, signature)),
            Section("Drills", (summary,)),
            *map(_section, drills),
            Section("Versions", (versions, f"SHA-256 over the program's {known['files']} files: {known['sha256']}")),
        ),
        f"boat-daq {content['versions']['boat-daq']}, qualification of {begun[:10]}",
        begun,
    )


def _verdict(drill: dict[str, Any]) -> str:
    return "passed" if drill["passed"] else "FAILED"


def _signature(who: str) -> tuple[str, str, str, str]:
    return who, "_" * 24, "_" * 12, "_" * 28


def _installation(content: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    program, machine, disk = content["program"], content["machine"], content["disk"]
    return (
        ("Program", f"boat-daq {program['version']}, files {program['sha256'][:16]}, in {program['folder']}"),
        ("Computer", f"{machine['name']}: {machine['processor']}, {machine['memory']}"),
        ("System", f"{machine['system']}, Python {content['versions']['Python']}"),
        *(("Shortcoming", "{cause}. {remedy}: {command}".format(**found)) for found in content["shortcomings"]),
        ("Folder", disk["folder"]),
        ("Disk", "{file_system} on {device}, {free_gb:g} of {size_gb:g} GB free".format(**disk)),
    )


def _board(drill: dict[str, Any]) -> str:
    """Return port, speed, rate, unit and seed of a drill's first board; empty where it had none."""
    if not drill["boards"]:
        return ""
    rate = "rate unknown" if drill["rate_hz"] is None else f"{drill['rate_hz']:g} Hz"
    return "{port}, {speed:g}x real time, {rate}, {unit}, seed {seed}".format(rate=rate, **drill["boards"][0])


def _section(drill: dict[str, Any]) -> Section:
    """Return a drill's criteria and observations, its board and its counts."""
    counts = "; ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in drill["counts"].items())
    faults = "; ".join(", ".join(board["faults"]) or "no fault of the board" for board in drill["boards"])
    caption = ". ".join(filter(None, (_board(drill), f"Faults: {faults}" if faults else "", counts)))
    rows = tuple((c["text"], c["seen"], "yes" if c["kept"] else "NO") for c in drill["criteria"])
    table = ReportTable(("Criterion", "Observed", "Met"), rows, caption, numeric=False)
    return Section(f"{drill['name']}: {_verdict(drill)}", (table,))
