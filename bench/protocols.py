"""Throughput of each parser as a multiple of its device's traffic, in time of one core.

    python bench/protocols.py

Streams are clean; a second column has 1 % of the bytes lost and 0.1 % of the bits inverted. Serial bytes
come in chunks of 64, as a USB adapter gives them.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from knotwork.core.protocols import agilex, lds01, lds02, lds03, opencr
from knotwork.core.protocols import dynamixel as dxl

CHUNK = 64
LEAST = 100


def lds01_turns(random: np.random.Generator) -> bytes:
    """60 packets a turn."""
    draw = random.integers
    return b"".join(lds01.encode(k, 300.0, draw(0, 3500, 6).tolist(), draw(0, 60_000, 6).tolist()) for k in range(60))


def lds02_turns(random: np.random.Generator) -> bytes:
    """32 packets a turn, about."""
    draw = random.integers
    return b"".join(
        lds02.encode(
            2160, k * 1127 % 36000, (k * 1127 + 1033) % 36000, draw(0, 8000, 12).tolist(), draw(0, 255, 12).tolist(), k
        )
        for k in range(32)
    )


def lds03_turn(random: np.random.Generator) -> bytes:
    """Ten packets a turn."""
    draw = random.integers
    return b"".join(
        lds03.encode(k == 0, 10.0, 36.0 * k, 36.0 * k + 35.1, draw(0, 9000, 40).tolist(), draw(0, 255, 40).tolist())
        for k in range(10)
    )


def opencr_answers(random: np.random.Generator) -> bytes:
    """Per cycle: the block from clock to encoders, an acknowledged command and heartbeat."""
    cycle = [dxl.status(opencr.DEVICE, 0, random.bytes(n)) for n in (134, 0, 0)]
    return b"".join(cycle)


def motor_answers(random: np.random.Generator) -> bytes:
    """Per cycle: a sync read of ten bytes from two motors."""
    return b"".join(dxl.status(device, 0, random.bytes(10)) for device in (1, 2))


def damage(stream: bytes, random: np.random.Generator) -> bytes:
    array = np.frombuffer(stream, np.uint8)
    array = array[random.random(len(array)) >= 0.01]
    return (array ^ np.packbits(random.random((len(array), 8)) < 0.001, axis=1).ravel()).tobytes()


def seconds_a_byte(make: Callable[[], Any], stream: bytes) -> float:
    """Best of three."""
    chunks = [stream[at : at + CHUNK] for at in range(0, len(stream), CHUNK)]
    best = float("inf")
    for _ in range(3):
        parser = make()
        begin = time.process_time()
        for chunk in chunks:
            parser.feed(chunk)
        best = min(best, time.process_time() - begin)
    return best / len(stream)


def main() -> int:
    random = np.random.default_rng(0)
    # name, parser, bytes of one cycle, cycles a second
    serial = [
        ("LDS-01, 5 turns/s", lds01.Parser, lds01_turns(random), 5.0),
        ("LDS-02, 2300 points/s", lds02.Parser, lds02_turns(random), 2300.0 / 12 / 32),
        ("LDS-03, 4000 samples/s", lds03.Parser, lds03_turn(random), 10.0),
        ("OpenCR, 50 Hz", dxl.Parser, opencr_answers(random), 50.0),
        ("two motors, 50 Hz", dxl.Parser, motor_answers(random), 50.0),
    ]
    print(f"{'device':<24}{'traffic':>12}{'clean':>10}{'damaged':>10}")
    poor = False
    for name, parser, cycle, rate in serial:
        traffic = len(cycle) * rate
        stream = cycle * (400_000 // len(cycle))
        factors = [1.0 / (traffic * seconds_a_byte(parser, s)) for s in (stream, damage(stream, random))]
        poor |= min(factors) < LEAST
        print(f"{name:<24}{traffic:>8.0f} B/s" + "".join(f"{f:>9.0f}x" for f in factors))
    # Motion, odometer and four motors at 50 Hz, state at 10 Hz.
    frames = [agilex.encode("MotionState", linear=0.3, angular=-0.2), agilex.encode("Odometer", left=1.0, right=2.0)]
    frames += [agilex.encode(f"ActuatorFast{i}", speed=100, pulses=12345) for i in range(1, 5)]
    frames = frames * 5 + [agilex.encode("SystemState", mode=1, battery=24.0)]
    decoder = agilex.Decoder()
    best = float("inf")
    for _ in range(3):
        begin = time.process_time()
        for _ in range(200):
            for identifier, data in frames:
                decoder.decode(identifier, data)
        best = min(best, time.process_time() - begin)
    factor = 200 / 10.0 / best
    poor |= factor < LEAST
    print(f"{'AgileX, 310 frames/s':<24}{len(frames) * 10:>5} frames/s{factor:>7.0f}x")
    return 1 if poor else 0


if __name__ == "__main__":
    raise SystemExit(main())
