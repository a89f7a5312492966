from boat_daq import load_recording

run = load_recording("recordings/simulated_SA1_two_cycles.boat")
print(run)
