"""Sinks that ship with Knotwork."""
