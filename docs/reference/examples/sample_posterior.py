import numpy as np

from boat_daq import sample_posterior

x = np.linspace(-2.0, 3.0, 20)
y = 1650.0 + 40.0 * x + np.random.default_rng(0).normal(size=20)
print(sample_posterior(x, y, degree=1, max_steps=500))
