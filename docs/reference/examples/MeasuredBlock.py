from boat_daq import Session

with Session.simulated() as session:
    block = next(iter(session.samples(seconds=1.0)))
print(block.time_s.size, block.signal_mv.mean(axis=0))
