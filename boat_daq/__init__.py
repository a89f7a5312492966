"""The desktop program: engine, view models, windows and commands."""

__version__ = "0.1.0"
