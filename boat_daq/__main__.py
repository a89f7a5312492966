"""`python -m boat_daq` is `boat-daq`."""

from boat_daq.cli import main

if __name__ == "__main__":
    main()
