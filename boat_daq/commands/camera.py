"""`boat-daq camera`: the marks to print, the lens, and the elongation in a video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, present, progress_bar, show

app = typer.Typer(help="Elongation from a camera: marks to print, lens, cameras, videos.")


@app.command("list")
def list_cameras(as_json: JsonOption = False) -> None:
    """List the cameras of this computer and their numbers.

    Example: boat-daq camera list
    """
    from boat_daq.engine.camera.source import cameras

    found = cameras()
    text = "\n".join(f"{number}  {name}" for number, name in found) or "no cameras"
    present([{"number": number, "name": name} for number, name in found], text, as_json=as_json)


@app.command()
def marks(
    to: Annotated[Path, typer.Option("--out", metavar="FILE.pdf", help="Sheet to write, A4 at true size.")],
    mark_mm: Annotated[
        float, typer.Option("--mark-mm", min=2, max=60, metavar="MM", help="Black square's side.")
    ] = 10.0,
    as_json: JsonOption = False,
) -> None:
    """Write the two marks, for base and tip, as a PDF to print.

    Example: boat-daq camera marks --out marks.pdf --mark-mm 8
    """
    from analysis.tracking.sheet import write_sheet

    write_sheet(to, mark_mm)
    present({"file": to, "mark_mm": mark_mm}, as_json=as_json)
    notify(f"wrote {to}: print it at 100 %, check the scale, and measure the printed marks")


@app.command()
def calibrate(
    pictures: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Pictures of a checkerboard, tilted differently.")
    ],
    to: Annotated[Path, typer.Option("--out", metavar="FILE.json", help="Lens to write.")],
    corners: Annotated[str, typer.Option(metavar="COLUMNSxROWS", help="Inner corners of the board.")] = "8x6",
    pitch: Annotated[float, typer.Option(min=0.1, metavar="MM", help="Side of a square.")] = 10.0,
    unit: Annotated[str, typer.Option(help="Unit whose camera it is: the lens is stored with it.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Calibrate a lens from pictures of a checkerboard.

    The reprojection error is the rms distance of the corners from the fitted lens; below 0.5 px is good.

    Example: boat-daq camera calibrate board1.png board2.png board3.png board4.png board5.png --out lens.json
    """
    from analysis.tracking.lens import calibrate_lens
    from boat_daq.engine.camera.source import read_picture

    columns, _, rows = corners.partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise typer.BadParameter(f"{corners!r} is not COLUMNSxROWS", param_hint="--corners")
    views = (read_picture(path) for path in pictures)
    lens = calibrate_lens(views, corners=(int(columns), int(rows)), pitch_mm=pitch)
    lens.write(to)
    if unit:
        from boat_daq.workflows.camera_tracking import keep_lens

        keep_lens(unit, lens)
    notify(f"wrote {to}: {lens.views} pictures, reprojection error {lens.reprojection_px:.3f} px")
    if as_json:
        emit_json(lens.as_json())


@app.command()
def track(
    video: Annotated[
        str,
        typer.Argument(
            metavar="VIDEO|FILE.toml",
            help="Video of the marks, or a file with source (the video), mark_mm, u_mark_mm and lens.",
        ),
    ],
    mark_mm: Annotated[
        float | None,
        typer.Option(
            "--mark-mm", min=0, metavar="MM", help="Side of the marks' black square; 0 = by the millimetre grid."
        ),
    ] = None,
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.csv", help="Table to write.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Track the elongation, with its uncertainty, in a video.

    Example: boat-daq camera track run.mkv --mark-mm 8 --out run.elongation.csv
    """
    from boat_daq.workflows.camera_tracking import camera_choice, track_video
    from protocol.base.errors import writing
    from protocol.base.whole_file import write_whole

    with progress_bar("Tracking") as advance:
        record, about = track_video(camera_choice(video, mark_mm=mark_mm), advance)
    if to is not None:
        rows = zip(record.time_s, record.elongation_mm, record.u_mm, record.fault, strict=True)
        lines = [f"{t:.6f},{x:.6f},{u:.6f},{fault}" if not fault else f"{t:.6f},,,{fault}" for t, x, u, fault in rows]
        with writing(to):
            write_whole(to, "\n".join(["time_s,elongation_mm,u_mm,fault", *lines]) + "\n")
    frames, valid = record.time_s.size, int(record.valid.sum())
    warnings = [{"code": code, "subject": "camera", "text": f"{n} frames"} for code, n in record.faults.items()]
    if as_json:
        head = {"frames": frames, "valid": valid, "dropped": record.dropped, **about}
        columns = {"time_s": record.time_s, "elongation_mm": record.elongation_mm, "u_mm": record.u_mm}
        emit_json(head | {key: column.tolist() for key, column in columns.items()} | {"warnings": warnings})
        return
    low, high = record.elongation_mm[record.valid].min(), record.elongation_mm[record.valid].max()
    show(f"{frames} frames, {valid} with an elongation, {record.dropped} missing; {low:+z.3f} to {high:+z.3f} mm")
    for warning in warnings:
        notify(f"{warning['code']}: {warning['text']} without an elongation")
