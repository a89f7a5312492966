from pathlib import Path

from boat_daq import Session

with Session.simulated("SA1", record_to=Path("live.boat")) as session:  # a board: Session.open("/dev/ttyACM0", ...)
    for block in session.samples(seconds=2.0):
        print(block)
