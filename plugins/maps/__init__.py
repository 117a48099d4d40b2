"""Maps that ship with Knotwork."""
