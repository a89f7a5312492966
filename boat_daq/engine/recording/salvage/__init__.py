"""Rows of a damaged recording, from what can be read of its file, its log and its raw bytes."""
