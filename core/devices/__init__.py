"""What drivers of real devices share: a serial port that wakes up, reconnecting, the loop of a base."""
