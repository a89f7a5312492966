from boat_daq import find_cycles, find_plateaus, load_recording, plateau_table

run = load_recording("recordings/simulated_SA1_two_cycles.boat")
print(plateau_table(find_plateaus(run, find_cycles(run))).head())
