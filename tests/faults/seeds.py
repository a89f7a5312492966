"""One or more valid inputs of every decoder: where mutation and fuzzing start."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import tomli_w

from analysis.optics.sweep.sweep_file import SweepFile
from analysis.shadow.fem.mesh_files import write_state
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from protocol.link.messages import (
    Heartbeat,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Vent,
    encode_command,
    encode_message,
)
from tests.faults.decoders import ROOT, folder, kept
from tests.faults.old_recordings import SCHEMAS, write_old_recording, write_recording
from tests.protocol.link.streams import hello_and, sample

CSV = (
    b"time_s,pressure_kpa,s1_mv,s2_mv,note\n# comment\n0.00,50.1,1650.2,1620,a\n0.01,50.0,1651,1619,b\n0.02,,NaN,1,c\n",
    b"\xef\xbb\xbfZeit;Druck [kPa];S1 (V)\ns;kPa;V\n0,00;50,1;1,65\n0,01;50,0;1,66\n",
    "t\tp\ts1\n0\t1\t2\n1\t2\t3\n".encode("utf-16"),
    b"# operator: {}\n# started_utc: 5\ntime_s,pressure_kpa,s1_mv\n0,1,2\n1,1,2\n2,1,2\n",
    b"1 2 3\n2 3 4\n3 4 5\n",
)
READINGS = (
    b"pressure_kpa,elongation_mm\n50,3.8\n40,3.1\n-40,-2.7\n",
    b"cycle,branch,pressure_kpa,elongation_mm\n1,unloading,50,3.8\n1,loading,-40,-2.7\n",
)
FORCES = "\n".join(["displacement (mm),force (N)", *(f"{0.02 * i},{0.02 * i * 6}" for i in range(120))]).encode()
CURVES = "\n".join(["guide,x,z", *(f"{g},{g * 9 + 0.1 * i * i},{i * 2.5}" for g in (1, 2) for i in range(8))]).encode()


def _link() -> list[bytes]:
    return [hello_and(*(sample(i) for i in range(20))), b"boot\r\n\0\0" + hello_and(sample(2), sample(9))]


def _commands() -> list[bytes]:
    commands = (Identify(), Heartbeat(2000), SetLimits(-40_000, 50_000), Start(100), SetPressure(20_000, 5_000), Vent())
    pieces = [encode_command(command, 0).rstrip(b"\0") for command in commands]
    return [b"".join(piece.ljust(16, b"\1") for piece in pieces)]


def _recordings() -> list[bytes]:
    home = kept(b"", "none").parent
    made = [write_recording(home / "now.boat", blocks=4)]
    made += [write_old_recording(home / f"{name}.boat", name) for name in SCHEMAS]
    return [path.read_bytes() for path in made]


def _unit() -> bytes:
    library = UnitLibrary(kept(b"", "none").parent)
    library.save(Unit("SA1"))
    library.add_calibration("SA1", {"degree": 3, "coefficients": [1.0, 2.0]})
    return (folder() / "SA1.toml").read_bytes()


def _meshes() -> list[bytes]:
    small = dataclasses.replace(
        ActuatorParameters(), cells=1, axial_elements=2, wall_elements=1, lattice_elements=1, guide_bow_mm=1.0
    )
    model = FullModel(small)
    home = kept(b"", "none").parent
    for kind in ("vtu", "msh"):
        write_state(home / f"mesh.{kind}", kind, model.parameters, model.mesh, model.solve(pressure_kpa=0.0))
    return [(home / f"mesh.{kind}").read_bytes() for kind in ("vtu", "msh")]


def _sweep() -> bytes:
    path = kept(b"", "none").with_name("sweep.sqlite")
    SweepFile(path, {"rays": 1})
    return path.read_bytes()


def _arrays() -> bytes:
    file = io.BytesIO()
    np.savez(file, a=np.zeros(3), b=np.eye(2))
    return file.getvalue()


def seeds(name: str) -> list[bytes]:
    """Return valid inputs of a decoder."""
    profiles = [path.read_bytes() for path in sorted(Path(ROOT / "protocol" / "profiles").glob("*.toml"))]
    match name:
        case "framing" | "bulk":
            return _link()
        case "messages":
            return [encode_message(sample(3), 1)[1:-1]]
        case "samples":
            return [bytes((2, 22)) + bytes(22), bytes((4, 9)) + bytes(9) + bytes((2, 22)) + bytes(22)]
        case "board":
            return _commands()
        case "text lines":
            return [b"120340,12034,49.83,2107,41,1988,37,23.4\n120350,12035,49.83,2107,41,1988,37,23.4\r\n"]
        case "rx8 packets":
            return [bytes.fromhex("43 0001 1388 0400 0410 00 43 000b 1388 0401 0410 00 43")]
        case "rx8 format":
            return [b"RX8 [h=43] @1T @0T @1P @0P @1S1 @0S1 [t=00]"]
        case "profile":
            return profiles
        case "recording":
            return _recordings()
        case "cells":
            return [bytes(range(n, n + 12)) for n in range(0, 240, 6)]
        case "csv":
            return list(CSV)
        case "column map":
            return [json.dumps({"boat_daq_import": 1, "columns": {"s1_mv": "2:V"}}).encode()]
        case "elongation":
            return list(READINGS)
        case "compression":
            return [FORCES]
        case "curves":
            return [CURVES, CURVES.replace(b"guide,x,z", b"").replace(b"1,", b"", 1)]
        case "plan":
            return [plan.to_toml().encode() for plan in built_in_plans().values()]
        case "unit":
            return [_unit()]
        case "settings":
            return [tomli_w.dumps(dataclasses.asdict(Settings())).encode()]
        case "shadow parameters":
            return [tomli_w.dumps(dataclasses.asdict(ActuatorParameters())).encode()]
        case "shadow table":
            return [_arrays()]
        case "mesh":
            return _meshes()
        case "sweep":
            return [_sweep()]
    raise KeyError(name)
