"""What a script that measures imports, as `analysis` is for one that evaluates.

    from pathlib import Path
    from boat_daq.measure import Session

    with Session.open("/dev/ttyACM0", unit="SA1", record_to=Path("SA1.boat")) as session:
        ending = session.run("calibration")

`Session` drives one board, `Plan` is what it runs, `MeasuredBlock` is what `Session.samples` yields.
"""

from boat_daq.engine.plan import Plan as Plan
from boat_daq.engine.session.measured_blocks import MeasuredBlock as MeasuredBlock
from boat_daq.engine.session.session import Session as Session

__all__ = ["MeasuredBlock", "Plan", "Session"]
