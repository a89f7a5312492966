"""The controller: sequencer, interlock, board commands, watchdog; no thread, no port."""
