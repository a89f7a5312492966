from boat_daq import Scene, trace

for state in (0, 7, 14):
    print(state, trace(Scene(cavities=5, width_mm=1.0, depth_mm=0.5, spacing_mm=0.9, state=state)).ndr)
