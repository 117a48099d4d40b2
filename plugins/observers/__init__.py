"""Observers that ship with Knotwork."""
