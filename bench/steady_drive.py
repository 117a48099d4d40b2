"""A policy that drives steadily and, at a time, fails or falls silent; for measuring how a base stops."""

from typing import Literal

from pydantic import Field

from knotwork.core.contracts import Context, Policy
from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity
from knotwork.core.messages import Odometry, Twist


class Config(PluginConfig):
    speed: float = quantity(0.2, "m/s", "forward")
    yaw_rate: float = quantity(0.0, "rad/s", "turning")
    after: float = quantity(0.0, "s", "from the first odometry to what `then` says; 0: never")
    then: Literal["raise", "silence", "nan"] = Field("silence", description="what happens then")


MANIFEST = Manifest(
    name="steady-drive",
    kind="policy",
    summary="drives steadily, then fails",
    impl="steady_drive:SteadyDrive",
    config=Config,
    inputs={"odometry": Port("odometry")},
    outputs={"twist": Port("twist")},
)


class SteadyDrive(Policy):
    """Answers each odometry with the same command; writes the time of its failure to `failed_at`."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._begun = 0
        self._done = False

    def on_odometry(self, message: Odometry) -> None:
        config: Config = self.context.config
        now = self.context.now()
        self._begun = self._begun or now
        if config.after and now - self._begun > config.after * 1e9:
            if not self._done:
                (self.context.out / "failed_at").write_text(str(self._last))
                self._done = True
            if config.then == "raise":
                raise ValueError("this policy fails on purpose")
            if config.then == "silence":
                return
        v = float("nan") if self._done else config.speed
        self._last = now
        self.context.emit("twist", Twist(stamp=now, vx=v, wz=config.yaw_rate))
