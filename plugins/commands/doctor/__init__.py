"""`knotwork doctor`: which devices are there, what they are, what is wrong, and how to mend it."""

from knotwork.core.manifest import Manifest

MANIFEST = Manifest(
    name="doctor",
    kind="command",
    summary="list a robot's devices, ask what they are, say how to mend what is wrong",
    impl="knotwork.plugins.commands.doctor.command:Doctor",
    example="knotwork doctor --port /dev/ttyUSB0",
)
