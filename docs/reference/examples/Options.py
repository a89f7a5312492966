from boat_daq import Options, analyse

analysis = analyse("recordings/simulated_SA1_two_cycles.boat", options=Options(degree="spline", mcmc=False))
print(analysis.sensors[0].calibration)
