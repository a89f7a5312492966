"""What each page knows and decides, without Qt."""

from boat_daq.own_packages import require_own

require_own("analysis")
