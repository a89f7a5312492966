"""One file for each group of commands; `boat_daq.cli` puts them together."""
