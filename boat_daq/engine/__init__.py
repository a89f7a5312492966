"""The running instrument without a window: ports, recorder, sequencer, interlock, session."""
