"""Random numbers that depend on a seed and a purpose, so that one source of noise never shifts another."""

from zlib import crc32

import numpy as np


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Return the generator of `purpose` ("lidar", "slip") for a run's `seed`."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(crc32(purpose.encode()),)))
