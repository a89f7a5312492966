"""The desktop program: engine, view models, windows and commands."""

import os

# Linear algebra here is many small systems: threads of the BLAS only get in one another's way on a busy computer.
# It is read when numpy is imported, so it stands before everything else.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
