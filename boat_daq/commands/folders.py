"""`boat-daq batch` and `history`: a folder of runs in one table, and the calibrations of one unit over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show, show_table
from boat_daq.commands.options import AllowRemoteOption, FolderArgument, SeedOption

if TYPE_CHECKING:
    from pandas import DataFrame

    from analysis.history.unit_history import UnitHistory


_COLUMNS = ("run", "unit", "sensor", "cycles", "sensitivity_mv_per_mm", "snr_db")


def batch(
    folder: FolderArgument,
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.csv", help="Also write the table.")] = None,
    seed: SeedOption = 0,
    mcmc: Annotated[bool, typer.Option("--mcmc", help="Sample the posteriors as well.")] = False,
    workers: Annotated[int | None, typer.Option(min=1, help="Number of processes; default one a core.")] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster.")] = None,
    allow_remote: AllowRemoteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a folder of runs into one table, one row a sensor, on all cores or on a Dask cluster.

    Example: boat-daq batch recordings --out table.csv
    """
    from analysis.history.batch import batch as run_batch
    from analysis.history.batch import write_table

    with progress_bar("Analysing") as advance:
        table = run_batch(
            folder,
            seed=seed,
            mcmc=mcmc,
            workers=workers,
            scheduler=scheduler,
            allow_remote=allow_remote,
            progress=advance,
        )
    if to is not None:
        write_table(table, to)
        notify(f"wrote {to}")
    failed = int((table["error"] != "").sum()) if "error" in table else 0
    omitted = table.attrs["omitted"]
    rows = table.to_dict(orient="records")
    content = {"runs": table["run"].nunique(), "failed": failed, "omitted": omitted, "rows": rows}
    if as_json:
        emit_json(content)
    else:
        _show_runs(table)
    if omitted:
        notify(f"no runs: {', '.join(omitted)}")
    if failed:
        notify(f"{failed} runs could not be analysed")
        raise typer.Exit(1)


def _show_runs(table: DataFrame) -> None:
    """Print a row a sensor, and why a run has none in a line of its own."""
    good = table[table["error"] == ""]
    columns = [name for name in _COLUMNS if name in good]
    if len(good):
        shown = good[columns].assign(unit=good["unit"].str.cat(good["simulated"].map({True: "  SIMULATED", False: ""})))
        show_table(columns, ([_cell(row[name]) for name in columns] for row in shown.to_dict(orient="records")), left=3)
    for row in table[table["error"] != ""].to_dict(orient="records"):
        show(f"{row['run']}: {row['error']}")


def _cell(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def history(
    folder: FolderArgument,
    unit: Annotated[str, typer.Option(metavar="NAME", help="Name of the unit, as recorded.")],
    check_point: Annotated[float, typer.Option(metavar="MM", help="Elongation of the control chart.")] = 0.0,
    simulated: Annotated[
        bool | None,
        typer.Option(
            "--simulated/--real", help="Runs of simulated or of real boards; default real where there are any."
        ),
    ] = None,
    max_drift: Annotated[
        float | None,
        typer.Option("--max-drift", min=0.0, metavar="MM", help="Permissible drift; default U of an elongation."),
    ] = None,
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.html|FILE.pdf", help="Also write a report.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the calibrations of one unit over time: a control chart of a check point, En, and when it is due again.

    The interval to the next calibration is proposed from the drift, as ILAC-G24 does.

    Example: boat-daq history recordings --unit SA1 --check-point 2 --out SA1.html
    """
    if to is not None and to.suffix.lower() not in (".html", ".pdf"):
        raise typer.BadParameter("must end in .html or .pdf", param_hint="--out")
    from analysis.history.unit_history import calibrations_in, due_first, unit_history

    with progress_bar("Analysing") as advance:
        found = calibrations_in(folder, unit, simulated=simulated, progress=advance)
    for entry in found.left_out:
        notify(f"{entry['run']} omitted: {entry['reason']}")
    sensors = range(min(len(a.sensors) for a in found.analyses))
    histories = [unit_history(found.analyses, i, check_point_mm=check_point, limit_mm=max_drift) for i in sensors]
    kind, due = found.analyses[0].recording.simulated, due_first(histories)
    if to is not None:
        from analysis.reports.unit_report import write_unit_report

        write_unit_report(unit, histories, to, simulated=kind)
        notify(f"wrote {to}")
    if as_json:
        rows = {"sensors": [one.as_json() for one in histories], "interval": due.as_json(), "left_out": found.left_out}
        emit_json({"unit": unit, "simulated": kind, **rows})
        return
    if kind:
        show("SIMULATED")
    for one in histories:
        _show(one)
    show(due.sentence)


def _show(one: UnitHistory) -> None:
    from analysis.numbers import rounded, with_uncertainty
    from protocol.base.units import as_text

    u, unit = float(one.expanded_mv.min()) / 2.0, as_text(one.signal_unit)
    ends = f"{rounded(one.lower_mv, u)} to {rounded(one.upper_mv, u)}"
    limits = f", control limits {ends} {unit}" if len(one.when) > 1 else ""
    show(f"{one.sensor}: mean {rounded(one.centre_mv, u)} {unit}{limits}")
    rows = []
    for k, (when, value, expanded, en) in enumerate(zip(one.when, one.value_mv, one.expanded_mv, one.en, strict=True)):
        state = "outside" if k in one.out_of_control else "within"
        rows.append((
            when, with_uncertainty(float(value), float(expanded)), "" if en != en else f"{en:+z.2f}",
            state + (", differs from the previous" if abs(en) > 1 else ""),
        ))  # fmt: skip
    show_table(("calibrated", f"y({one.check_point_mm:g} mm) ± U, {unit}", "En", "control"), rows, left=4)
