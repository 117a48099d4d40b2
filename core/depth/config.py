"""The config keys that all depth observers share; imports neither NumPy nor the kernels."""

from pydantic import field_validator

from knotwork.core.manifest import PluginConfig, Port, quantity


class DepthObserverConfig(PluginConfig):
    """How features come, go and start."""

    guess: float | dict[int, float] = quantity(
        1.0, "1/m", "inverse depth a feature starts with: one number, or one for each id (others start at 1)"
    )
    memory: float = quantity(1.0, "s", "an unseen feature is predicted this long, then forgotten", ge=0)
    gap: float = quantity(0.5, "s", "a longer break between frames forgets all features", gt=0)
    excitation: float = quantity(1e-4, "m^2/s^2", "sigma^2 that condition 3 of Theorem 8.2 is reported to need", ge=0)
    offset: float = quantity(
        0.0, "m", "with odometry: how far the camera is ahead of the base's centre, looking forward"
    )
    ignore: tuple[int, ...] = quantity((), "1", "ids of features to leave out")

    @field_validator("guess")
    @classmethod
    def _positive(cls, value: float | dict[int, float]) -> float | dict[int, float]:
        numbers = value.values() if isinstance(value, dict) else (value,)
        if not all(0.0 < number < float("inf") for number in numbers):
            raise ValueError("inverse depths must be positive and finite")
        return value


INPUTS = {
    "features": Port("features", summary="tracked points; a frame without features is a message too"),
    "twist": Port("camera_twist", optional=True, summary="motion of the camera since the last frame"),
    "odometry": Port("odometry", optional=True, summary="instead of `twist`: motion of the base that carries it"),
}
OUTPUTS = {"depths": Port("depths", role="estimate", summary="inverse depths of the features in view")}
