"""AgileX frames against the maker's examples, and any frame at all."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knotwork.core.protocols import agilex


@pytest.mark.parametrize(
    ("v", "w", "payload"),
    [
        (0.15, 0.0, "00 96 00 00 00 00 00 00"),
        (0.0, 0.05, "00 00 00 32 00 00 00 00"),
        (-0.2, -0.3, "FF 38 FE D4 00 00 00 00"),
        (99.0, -99.0, "7F FF 80 00 00 00 00 00"),  # clamped
    ],
)
def test_published_motion_commands(v: float, w: float, payload: str) -> None:
    assert agilex.motion_command(v, w) == (0x111, bytes.fromhex(payload))


def test_layout_of_the_state() -> None:
    state = bytes((1, 3, 0x00, 0xF5, 0b101, 0, 0, 77))
    frame = agilex.Decoder().decode(0x211, state)
    assert frame is not None
    assert frame.name == "SystemState"
    assert frame.signals == {
        "vehicle": agilex.EMERGENCY_STOP,
        "mode": agilex.REMOTE,
        "battery": pytest.approx(24.5),
        "under_voltage": 1,
        "low_voltage": 0,
        "remote_lost": 1,
        "counter": 77,
    }
    frame = agilex.Decoder().decode(0x311, (-1500).to_bytes(4, "big", signed=True) + (42).to_bytes(4, "big"))
    assert frame is not None
    assert frame.signals == {"left": pytest.approx(-1.5), "right": pytest.approx(0.042)}
    assert agilex.encode("ControlMode", mode=agilex.CAN) == (0x421, b"\x01")
    assert agilex.Decoder().decode(0x421, b"\x01" + bytes(7)) == ("ControlMode", {"mode": 1})  # as the SDK sends it


@given(st.lists(st.tuples(st.integers(0x100, 0x4FF) | st.sampled_from([0x111, 0x211, 0x361]), st.binary(max_size=8))))
def test_any_frame(frames: list[tuple[int, bytes]]) -> None:
    decoder = agilex.Decoder()
    good = [decoder.decode(identifier, data) for identifier, data in frames]
    assert decoder.received == len(frames)
    assert decoder.packets == sum(frame is not None for frame in good)
    assert decoder.packets + decoder.rejected + decoder.unknown == len(frames)
    for (_, data), frame in zip(frames, good, strict=True):
        if frame is not None and len(data) == 8 and frame.name in ("MotionCommand", "Odometer", "ActuatorFast1"):
            assert agilex.encode(frame.name, **frame.signals)[1] == data


def test_unknown_names() -> None:
    with pytest.raises(KeyError):
        agilex.encode("MotionCommand", speed=1.0)
    with pytest.raises(KeyError):
        agilex.encode("Nonsense")
