"""The actuator: full model, reduced model, states, frames for the window."""
