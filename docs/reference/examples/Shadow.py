from boat_daq import Shadow

state = Shadow().state(pressure_kpa=-30.0)
print(state.elongation_mm, state.tracked_points_mm.shape)
