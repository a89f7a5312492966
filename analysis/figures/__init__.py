"""The figures of a run and of several runs, with their intervals and warnings."""
