"""Policies that ship with Knotwork."""
