from boat_daq import Scene, trace

found = trace(Scene(cavities=3, state=0), tolerance=10.0)
print(found.ndr, found.power, found.ledger)
