from boat_daq import analyse, elongation_reader

fusion = elongation_reader(analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False))
print(fusion.evaluate([[1700.0, 1660.0]]).elongation_mm)
