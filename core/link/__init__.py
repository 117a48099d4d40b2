"""Streams from one machine to another: order, loss, clocks; the network itself is Eclipse Zenoh."""
