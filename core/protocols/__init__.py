"""What a robot's devices say on the wire, byte by byte; drivers and the emulated robot share it."""
