"""Scores of trajectories: relations, absolute and relative trajectory error, TUM files."""
