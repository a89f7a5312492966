"""Certificates of a calibration: their content, the document, and the Digital Calibration Certificate."""
