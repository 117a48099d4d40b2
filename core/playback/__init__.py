"""Recorded messages as a source: what drivers of logs with many channels share, whoever recorded them."""
