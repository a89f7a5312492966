"""Boards with other firmware: text lines and RX8 packets, described by a profile."""
