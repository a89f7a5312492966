"""`python -m boat_daq` is `boat-daq`: the command line, left quietly if Ctrl-C comes while it is still loading."""

import sys
from contextlib import suppress


def main() -> None:
    """Load the command line and run it; exit code 130 after Ctrl-C."""
    try:
        from boat_daq.own_packages import prefer_own_packages

        prefer_own_packages()
        from boat_daq.cli import main as run

        run()
    except KeyboardInterrupt:
        ignore_interruptions()
        sys.exit(130)


def ignore_interruptions() -> None:
    """Ignore Ctrl-C from now on: another one while the interpreter ends would kill it."""
    import signal  # not earlier: a file of that name in the working folder would be taken

    while True:
        with suppress(KeyboardInterrupt):  # by one that is pending, which `signal.signal` handles first
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            return


if __name__ == "__main__":
    main()
