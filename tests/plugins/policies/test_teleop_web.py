from knotwork.plugins.policies.teleop_web import MANIFEST
from knotwork.plugins.policies.teleop_web.policy import TeleopWeb


class Held:
    at = (0.0, 0.0)

    def stick(self):
        return self.at


def test_the_stick_becomes_commands_at_the_rate(knotwork_context):
    held = Held()
    context = knotwork_context(MANIFEST, {"speed": 0.3, "yaw_rate": 2.0, "rate": 10}, uses={"stick": held})
    TeleopWeb(context)
    context.advance(0)
    context.advance(100_000_000)
    held.at = (0.5, -1.0)
    context.advance(200_000_000)
    sent = context.messages("twist")
    assert [(t.stamp, t.vx, t.wz) for t in sent] == [(100_000_000, 0, 0), (200_000_000, 0.15, -2.0)]
