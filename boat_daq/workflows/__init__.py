"""Whole tasks that join the instrument and the analysis, for commands and view models alike.

Run a session to its end, accept a calibration, convert live signals, hold an elongation, track a camera, certify.
A workflow knows engine and analysis, never Qt and never what a page shows. A task that is not possible raises
`protocol.base.errors.BoatDaqError` with cause and remedy; `progress` is called with the work done and the total.
"""
