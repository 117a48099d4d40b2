"""A robot that is not there: its electronics, byte for byte, in front of a simulated world."""
