"""Stick in, commands out, at a steady rate."""

from knotwork.core.contracts import Context, Policy, Stick
from knotwork.core.messages import Twist
from knotwork.plugins.policies.teleop_web import TeleopWebConfig


class TeleopWeb(Policy):
    """Asks for the stick at each tick of a timer; when it is let go or its page is gone, that is zero."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._config: TeleopWebConfig = context.config
        self._stick: Stick = context.uses["stick"]
        context.every(1.0 / self._config.rate, self._send)

    def _send(self, time: int) -> None:
        forward, left = self._stick.stick()
        config = self._config
        self.context.emit(
            "twist", Twist(stamp=self.context.now(), vx=forward * config.speed, wz=left * config.yaw_rate)
        )
