"""The pipelines that ship with Knotwork."""
