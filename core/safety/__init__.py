"""What keeps a base safe, in one place: limits, ramps, command age, faults that last until re-armed."""
