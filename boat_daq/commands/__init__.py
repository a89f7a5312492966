"""One file for each group of commands; `boat_daq.cli` puts them together."""

from boat_daq.own_packages import NAMES, require_own

for name in NAMES:
    require_own(name)
