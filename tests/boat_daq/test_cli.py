"""The command line: interruption."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

INTERRUPTED_IN_A_CALLBACK = """
import ctypes, os, signal, time
from boat_daq.cli import Interruption
Interruption()
discards = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
try:
    discards()
    time.sleep(20)
except KeyboardInterrupt:
    print("ended")
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_in_a_callback_of_compiled_code_still_ends() -> None:
    """Such a callback discards the exception: the command would run to its end, after a traceback."""
    command = [sys.executable, "-c", INTERRUPTED_IN_A_CALLBACK]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("ended\n", "")
