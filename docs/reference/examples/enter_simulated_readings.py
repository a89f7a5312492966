from pathlib import Path

from boat_daq import Plan, Session, enter_simulated_readings

plan = Plan("short", "staircase", cycles=1, high_kpa=20.0, low_kpa=0.0, step_kpa=10.0, ramp_kpa_per_s=40.0)
with Session.simulated(speed=50.0, record_to=Path("read.boat")) as session:
    session.run(plan)
    print(enter_simulated_readings(session), "readings")
