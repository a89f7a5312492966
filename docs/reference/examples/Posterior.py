from boat_daq import Posterior, analyse

posterior = analyse("recordings/simulated_SA1_two_cycles.boat").sensors[0].posterior
assert isinstance(posterior, Posterior)
chains = posterior.chains()  # arviz.summary(chains) gives R-hat and effective sizes
print(posterior, chains["b1"].shape)
