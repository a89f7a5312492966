"""Offline scripts to start from; each runs by itself and is run by the tests."""
