"""Logs: MCAP files written, read back, recovered and compared."""
