"""Runs a wired pipeline: one dispatcher, run to completion, in every clock."""

from knotwork.core.runtime.run import Result, Run

__all__ = ["Result", "Run"]
