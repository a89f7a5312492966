from boat_daq import analyse

figure = analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False).sensors[0].figures["sensitivity_mv_per_mm"]
print(float(figure), figure.uncertainty, figure.unit, figure.low, figure.high)
