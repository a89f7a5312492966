"""The digital shadow: mesh, finite-strain solver, reduced model, monitor."""
