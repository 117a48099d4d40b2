"""Drivers that ship with Knotwork."""
