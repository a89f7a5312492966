from boat_daq import analyse, write_report

write_report([analyse("recordings/simulated_SA1_two_cycles.boat", mcmc=False)], "report.html")
