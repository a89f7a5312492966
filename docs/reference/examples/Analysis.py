from boat_daq import analyse

analysis = analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False)
print(analysis.to_frame())
for warning in analysis.warnings:
    print(warning.code, warning.text)
