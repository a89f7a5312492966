"""ROS 2 bags: written by rosbags, read back by the other library (mcap) and from SQLite without any."""

from __future__ import annotations

import json
import sqlite3
import struct
from contextlib import closing
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from analysis import load_recording
from analysis.data.export import export
from analysis.data.recording import Recording
from protocol.base.errors import FileError
from tests.docs.pages import ROOT

pytestmark = pytest.mark.skipif(find_spec("rosbags") is None, reason="rosbags is not installed")


@pytest.fixture(scope="module")
def run() -> Recording:
    """Two seconds of the example, with steps and readings."""
    whole = load_recording(ROOT / "recordings" / "simulated_SA1_two_cycles.boat")
    rows = slice(0, 200)
    columns = {name: getattr(whole, name)[rows] for name in ("target_kpa", "lit", "dark", "state", "flags", "index")}
    return Recording.from_arrays(
        whole.time_s[rows], whole.pressure_kpa[rows], whole.signal_mv[rows], **columns, meta=whole.meta,
        steps=whole.steps, readings=whole.readings,
    )  # fmt: skip


def test_mcap_is_read_back_by_the_other_library(run: Recording, tmp_path: Path) -> None:
    """Every value, every stamp, of standard types; the description and a marker for each step."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    export(run, tmp_path / "bag", "rosbag")
    assert {file.name for file in (tmp_path / "bag").iterdir()} == {"bag.mcap", "metadata.yaml"}
    file = tmp_path / "bag" / "bag.mcap"
    found: dict[str, list] = {}
    for message in reader.read_ros2_messages(str(file)):
        found.setdefault(message.channel.topic, []).append((message.log_time_ns, message.ros_msg, message.schema.name))
    for name, column in {"s1_mv": run.signal_mv[:, 0]}.items():
        values = [message.data for _, message, _ in found[f"/boat/{name}"]]
        np.testing.assert_array_equal(values, column)
    pressures = found["/boat/pressure"]
    assert pressures[0][2] == "sensor_msgs/msg/FluidPressure"
    np.testing.assert_allclose([m.fluid_pressure for _, m, _ in pressures], run.pressure_kpa * 1e3, rtol=1e-15)
    started = datetime.fromisoformat(run.started_utc).timestamp()
    stamps = np.array([stamp for stamp, _, _ in pressures]) * 1e-9 - started
    np.testing.assert_allclose(stamps, run.time_s, atol=1e-6)
    stamp = pressures[7][1].header.stamp
    assert stamp.sec * 1_000_000_000 + stamp.nanosec == pressures[7][0]
    assert pressures[7][1].header.frame_id == "boat"
    description = json.loads(found["/boat/description"][0][1].data)
    assert description["SIMULATED"] is True
    assert description["columns"]["s1_mv"] == "mV"
    markers = [json.loads(message.data)["kind"] for _, message, _ in found["/boat/markers"]]
    assert markers.count("step") == len(run.steps)
    assert markers.count("reading") == len(run.readings)


def test_sqlite_is_read_back_without_a_library(run: Recording, tmp_path: Path) -> None:
    export(run, tmp_path / "bag", "rosbag-sqlite3")
    file = tmp_path / "bag" / "bag.db3"
    with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as db:
        sql = "SELECT data FROM messages JOIN topics t ON t.id = topic_id WHERE name = '/boat/s2_mv' ORDER BY timestamp"
        values = [struct.unpack("<4xd", data)[0] for (data,) in db.execute(sql)]
    np.testing.assert_array_equal(values, run.signal_mv[:, 1])


def test_a_bag_never_replaces_another(run: Recording, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(FileError, match="exists already"):
        export(run, tmp_path / "bag", "rosbag")
    assert list(tmp_path.iterdir()) == [tmp_path / "bag"]
