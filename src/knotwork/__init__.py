"""Knotwork: compose, run, compare and trust a robot's perception from one YAML file."""

__version__ = "0.1.0"
