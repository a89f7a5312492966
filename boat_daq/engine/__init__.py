"""The running instrument without a window: ports, recorder, sequencer, interlock, session.

What cannot be done raises a `protocol.base.errors.BoatDaqError` with its cause and remedy, and changes nothing:
`RequestError` for a request, `DeviceError` for a port or board, `StorageError` and `FileError` for files.
"""

from boat_daq.own_packages import require_own

require_own("protocol")
