"""The finite-element method: mesh, element, material, pressure, equilibrium, stability."""
