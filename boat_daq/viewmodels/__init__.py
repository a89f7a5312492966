"""What each page knows and decides, without Qt.

An action that is not possible raises `protocol.base.errors.BoatDaqError` with cause and remedy, which
`common.notices.Notices.attempt` shows; other errors are documented where they are raised.
"""

from boat_daq.own_packages import require_own

require_own("analysis")
