from boat_daq import analyse, elongation_reader

analysis = analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False)
frame = analysis.recording.to_frame(reader=elongation_reader(analysis))
print(frame[["time_s", "elongation_mm", "u_mm"]].tail(), frame.attrs["simulated"])
