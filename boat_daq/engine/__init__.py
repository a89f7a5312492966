"""The running instrument without a window: ports, recorder, sequencer, interlock, session."""

from boat_daq.own_packages import require_own

require_own("protocol")
