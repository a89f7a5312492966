from boat_daq import find_cycles, load_recording

print(find_cycles(load_recording("recordings/simulated_SA1_two_cycles.boat")).as_json())
