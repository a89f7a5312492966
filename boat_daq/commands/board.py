"""`boat-daq board`, `ports` and `profile`: a virtual board, the boards on the ports, another firmware's profile."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, present, progress_bar, show
from boat_daq.commands.options import AllowRemoteOption

if TYPE_CHECKING:
    from boat_daq.engine.simulator.server import BoardServer, BoardSettings

_OF_CAMERA = "camera."  # begins a fault of the virtual camera


TcpOption = Annotated[
    str | None, typer.Option("--tcp", metavar="HOST:PORT", help="Serve on TCP; port 0 = any free one.")
]
UnitOption = Annotated[
    str,
    typer.Option(
        help="SA1, SA2 or SA3; with the ending -falling, the signal falls with elongation; x1 to x4: sensors."
    ),
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="NAME@SECONDS[:VALUE]|list",
        help="Fault of the board or of its camera; `list` prints them; may be repeated.",
    ),
]
VideoOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Video of a virtual camera to write: .mkv (lossless), .avi, .mp4."),
]
MjpegOption = Annotated[
    int | None,
    typer.Option(min=0, max=65535, metavar="PORT", help="Serve a virtual camera as MJPEG on this computer; 0 = any."),
]
CameraOption = Annotated[
    list[str] | None,
    typer.Option(
        "--camera",
        metavar="KEY=VALUE",
        help="Setting of the virtual camera: tilt_deg, distortion, noise_grey, ...",
    ),
]


def board(
    pty: Annotated[bool, typer.Option("--pty", help="Serve on a pseudo-terminal.")] = False,
    tcp: TcpOption = None,
    speed: Annotated[float, typer.Option(min=1, max=1000, help="Board time over real time.")] = 1.0,
    unit: UnitOption = "SA1",
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise.")] = 0,
    fault: FaultOption = None,
    truth: Annotated[Path | None, typer.Option(help="CSV to write with the noise-free values of each sample.")] = None,
    link: Annotated[Path | None, typer.Option(help="Symbolic link to make to the pseudo-terminal.")] = None,
    allow_remote: AllowRemoteOption = False,
    video: VideoOption = None,
    mjpeg: MjpegOption = None,
    camera: CameraOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run a virtual board; the first line of standard output is its port. Ctrl-C ends it.

    With --json that line is an object: port, unit, seed, speed, and the unit's true figures. All its data are marked
    SIMULATED.

    Example: boat-daq board --pty --speed 100 --fault estop@30:5 --truth truth.csv
    """
    if fault == ["list"]:
        _present_faults(as_json=as_json)
        return
    if pty == (tcp is not None):
        raise typer.BadParameter("use either --pty or --tcp HOST:PORT")
    if tcp is not None and link is not None:
        raise typer.BadParameter("--link needs --pty")
    if video is not None and mjpeg is not None:
        raise typer.BadParameter("use either --video or --mjpeg")
    from boat_daq.engine.simulator.server import BoardServer, BoardSettings

    filmed = [text for text in fault or () if text.startswith(_OF_CAMERA)]
    if (camera or filmed) and video is None and mjpeg is None:
        raise typer.BadParameter("--camera and camera faults need --video or --mjpeg")

    settings = BoardSettings(
        port=tcp or "pty",
        speed=speed,
        unit=unit,
        seed=seed,
        faults=tuple(text for text in fault or () if text not in filmed),
        truth=str(truth) if truth else None,
        link=str(link) if link else None,
        allow_remote=allow_remote,
        video=str(video) if video else None,
        mjpeg=mjpeg,
        scene=tuple(camera or ()),
        camera_faults=tuple(text.removeprefix(_OF_CAMERA) for text in filmed),
    )
    server = BoardServer(settings)
    try:
        _announce(server, settings, as_json=as_json)
        server.run(lambda: False, show)
    finally:
        server.close()


def _present_faults(*, as_json: bool) -> None:
    from boat_daq.engine.simulator.virtual_camera import CAMERA_FAULTS
    from protocol.simulator.faults import FAULTS, fault_list

    listed = "\n".join(f"  {_OF_CAMERA + name:20} {sentence}" for name, (sentence, _) in CAMERA_FAULTS.items())
    present(FAULTS, f"{fault_list()}\nof the camera:\n{listed}", as_json=as_json)


def _announce(server: BoardServer, board: BoardSettings, *, as_json: bool) -> None:
    """Print where a virtual board is, the first line of standard output."""
    from protocol.simulator.truth import truth_figures

    notify(f"SIMULATED board {board.unit} at {board.speed:g}x on {server.url}; Ctrl-C ends it")
    if server.camera_url:
        notify(f"SIMULATED camera on {server.camera_url}")
    if as_json:
        head = {"port": server.url, "camera": server.camera_url or None}
        given = {"unit": board.unit, "seed": board.seed, "speed": board.speed}
        emit_json(head | given | {"truth": truth_figures(board.unit)})
    else:
        show(server.url)


def ports(
    port: Annotated[
        list[str] | None,
        typer.Option("--port", help="Query this port, a device or socket://HOST:PORT; may be repeated."),
    ] = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="Query the boards used before, known by their USB serial numbers.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the serial ports without opening one; --ask and --port query for BOAT boards, which are marked with *.

    A port that is queried is opened, identified and closed; no pressure is commanded. Other ports are left alone: they
    may be those of other instruments. Pseudo-terminals are not in the system's list: name them with --port.

    Example: boat-daq ports --port /dev/pts/3
    """
    from boat_daq.engine.link.opening import identify_known, identify_port, listed_ports
    from boat_daq.engine.settings import UnitLibrary

    if port:
        answers = [identify_port(name) for name in port]
    else:
        answers = listed_ports(UnitLibrary().boards())
        if ask:
            with progress_bar("identifying") as progress:
                answers = identify_known(answers, progress=progress)
    if as_json:
        same = ("port", "description", "hello", "usb_serial", "unit", "queried")
        rows = [{**{key: getattr(a, key) for key in same}, "remark": a.problem} for a in answers]
        emit_json({"ports": [{**row, "boat": row["hello"] is not None} for row in rows]})
        return
    if not answers:
        notify("no serial ports; for a virtual board: boat-daq board --pty")
    for a in answers:
        board = f"BOAT {a.hello.board_id}, {a.hello.n_sensors} sensors" if a.hello else a.problem
        serial, unit = (f"{label} {text}, " if text else "" for label, text in (("USB", a.usb_serial), ("of", a.unit)))
        show(f"{'*' if a.hello else ' '} {a.port}  {a.description}  {serial}{unit}{board}".rstrip())
    unknown = [a.port for a in answers if not a.queried and not a.unit]
    if unknown:
        notify(f"ports that are not queried were not opened; to query one: boat-daq ports --port {unknown[0]}")
    if any(a.unit and not a.queried for a in answers):
        notify("to query the boards used before: boat-daq ports --ask")


def profile(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="Text that the board printed.")] = None,
    port: Annotated[str | None, typer.Option(help="Listen on this port instead; nothing is sent.")] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=600, help="Time of listening, 3 by default; that of the file, if known."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File to write.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Propose the text profile of a board from what it prints: separator, fields, units, rate, checksum.

    What names tell is stated; what the numbers alone suggest is marked as a guess, and has to be checked: a wrong field
    as pressure gives wrong data. Limits and commands are never proposed. Packets of bytes become an RX8 format.

    Example: boat-daq profile capture.txt --out board.toml
    """
    if (file is None) == (port is None):
        raise typer.BadParameter("give either a FILE or --port PORT")
    import tomli_w

    from boat_daq.engine.link.opening import listen
    from protocol.text.proposal import propose_any

    data, took_s = listen(port, seconds or 3.0) if port else (Path(file or "").read_bytes(), seconds or 0.0)
    found = propose_any(data, took_s)
    text = tomli_w.dumps(found.content("Own board"))
    fields = [{key: getattr(f, key) for key in ("label", "name", "unit", "guessed")} for f in found.fields]
    if out is not None:
        from protocol.base.whole_file import write_whole

        write_whole(out, text)
    if as_json:
        keys = ("rate_hz", "fitting", "seen", "missing")
        emit_json({"profile": text, "fields": fields, **{key: getattr(found, key) for key in keys}})
        return
    if out is None:
        show(text)
    notify(found.summary)
    for field in fields:
        if field["guessed"]:
            notify(
                f"a guess: {field['label'] or 'a field without a label'} is {field['name']} in {field['unit'] or '1'}"
            )
    if not took_s and not any(field["name"] == "time" for field in fields):
        notify(f"the rate is not known: {found.rate_hz:g} Hz is assumed; state --seconds")
    if found.missing:
        notify(f"not a profile yet: {found.missing}")
