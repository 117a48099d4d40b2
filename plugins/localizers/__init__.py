"""Localisers that ship with Knotwork."""
