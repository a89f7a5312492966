"""A recording as a ROS 2 bag: MCAP or SQLite storage, standard message types only.

Topics below `/boat`: `pressure` (sensor_msgs/FluidPressure, Pa, gauge), a `std_msgs/Float64` for every other column of
the export, `markers` and `description` (std_msgs/String, JSON). A sample's stamp is the start of the recording plus
board time. Every message of a topic has one length, so the serialised messages (CDR, little-endian) are the rows of an
array. Source: OMG DDS-RTPS 2.5, 10.5 (encapsulation), design.ros2.org.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.progress import Progress
from protocol.base.errors import FileError
from protocol.base.optional import optional

NOT_TOPICS = ("index", "time_s", "pressure_kpa", "segment", "lit", "dark")
_FRAME = b"boat\0"
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_FLOAT64 = np.dtype([("head", "V4"), ("data", "<f8")])
_PRESSURE = np.dtype(  # stamp, frame_id (length, text, padding to 8), pressure, variance
    [("head", "V4"), ("sec", "<i4"), ("nanosec", "<u4"), ("length", "<u4"), ("frame", "V5"), ("pad", "V7"),
     ("fluid_pressure", "<f8"), ("variance", "<f8")]
)  # fmt: skip


def write_bag(
    frame: pd.DataFrame, description: Mapping[str, Any], path: Path, storage: str, progress: Progress | None = None
) -> None:
    """Write samples in the columns of the export as a bag, a new folder, with mcap or sqlite3 storage.

    Raises FileError if the folder exists, RequestError if rosbags is not installed.
    """
    rosbag2, typesys = optional("rosbags.rosbag2"), optional("rosbags.typesys")
    if path.exists():
        raise FileError(f"{path} exists already", "Choose another name: a bag is a new folder.")
    part = path.with_name(f".{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    unfinished = part / path.name  # the writer names its file after its folder
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    plugin = rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbag2.StoragePlugin.SQLITE3
    started_ns = _started_ns(description.get("session", {}).get("started_utc"))
    stamps_ns = started_ns + np.round(frame["time_s"].to_numpy() * 1e9).astype(np.int64)
    topics = {f"/boat/{name}": _floats(frame[name]) for name in frame if not _is_left_out(str(name))}
    topics["/boat/pressure"] = _pressures(frame["pressure_kpa"].to_numpy() * 1e3, stamps_ns)
    try:
        part.mkdir()
        with rosbag2.Writer(unfinished, version=9, storage_plugin=plugin) as writer:
            kinds = dict.fromkeys(topics, "Float64") | {"/boat/pressure": "FluidPressure"}
            packages = {"Float64": "std_msgs", "FluidPressure": "sensor_msgs"}
            opened = {
                topic: writer.add_connection(topic, f"{packages[kind]}/msg/{kind}", typestore=store)
                for topic, kind in kinds.items()
            }
            _write_texts(writer, store, description, started_ns)
            rows = [(opened[topic], data.tobytes(), data.itemsize) for topic, data in topics.items()]
            for i, stamp in enumerate(stamps_ns.tolist()):
                for connection, data, size in rows:
                    writer.write(connection, stamp, data[i * size : (i + 1) * size])
                if progress is not None and i % 10_000 == 0:
                    progress(i, len(stamps_ns))
        unfinished.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _is_left_out(name: str) -> bool:
    return name in NOT_TOPICS or name.rpartition("_")[2] in NOT_TOPICS


def _started_ns(utc: str | None) -> int:
    """Return the start of a recording, ns since 1970; 0 where it is not known."""
    try:
        return round(datetime.fromisoformat(str(utc)).timestamp() * 1e9)
    except ValueError:
        return 0


def _floats(values: pd.Series) -> npt.NDArray[np.void]:
    """Return the serialised std_msgs/Float64 of a column."""
    found = np.zeros(len(values), _FLOAT64)
    found["head"] = np.void(_LITTLE_ENDIAN)
    found["data"] = values.to_numpy(dtype=np.float64)
    return found


def _pressures(pascals: npt.NDArray[np.float64], stamps_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
    """Return the serialised sensor_msgs/FluidPressure; a variance of 0 says that it is not known."""
    found = np.zeros(len(pascals), _PRESSURE)
    found["head"] = np.void(_LITTLE_ENDIAN)
    found["sec"], found["nanosec"] = stamps_ns // 1_000_000_000, stamps_ns % 1_000_000_000
    found["length"], found["frame"] = len(_FRAME), np.void(_FRAME)
    found["fluid_pressure"] = pascals
    return found


def _write_texts(writer: Any, store: Any, description: Mapping[str, Any], started_ns: int) -> None:
    """Write the description at the start, and a marker for each step and reading."""
    String = store.types["std_msgs/msg/String"]

    def write(connection: Any, stamp_ns: int, content: Mapping[str, Any]) -> None:
        message = String(data=json.dumps(content, default=str))
        writer.write(connection, stamp_ns, store.serialize_cdr(message, "std_msgs/msg/String"))

    about = writer.add_connection("/boat/description", "std_msgs/msg/String", typestore=store)
    write(about, started_ns, description)
    markers = writer.add_connection("/boat/markers", "std_msgs/msg/String", typestore=store)
    ends = {}
    for step in description["steps"]:
        if step["started_s"] is not None:
            write(markers, started_ns + round(step["started_s"] * 1e9), {"kind": "step", **step})
        ends[step["id"]] = step["settled_s"] if step["settled_s"] is not None else step["started_s"]
    for reading in description["readings"]:
        at_s = ends.get(reading["step"])
        if at_s is not None:
            write(markers, started_ns + round(at_s * 1e9), {"kind": "reading", **reading})
