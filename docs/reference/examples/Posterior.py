from boat_daq import Posterior, analyse

posterior = analyse("recordings/simulated_SA1_two_cycles.boat").sensors[0].posterior
assert isinstance(posterior, Posterior)
chains = posterior.chains()  # arviz.from_dict({"posterior": chains})
print(posterior, chains["b1"].shape)
