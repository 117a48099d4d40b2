"""Config models of a simulated robot, by default a TurtleBot3 Burger; simulator and emulator share them."""

from math import pi, sqrt
from typing import Self

from pydantic import Field, field_validator, model_validator

from knotwork.core.manifest import PluginConfig, quantity

_FULL_TURN = 2.0 * pi


class BaseParameters(PluginConfig):
    """A differential-drive base: geometry, limits of the motors, and what its sensors and tyres get wrong."""

    wheel_radius: float = quantity(0.033, "m", "radius of the wheels", gt=0)
    wheel_separation: float = quantity(0.160, "m", "distance between the wheels", gt=0)
    radius: float = quantity(0.105, "m", "radius of the disc that must not touch obstacles", gt=0)
    wheel_speed_max: float = quantity(
        0.2097, "m/s", "fastest rim speed; a command over it is slowed with its curvature kept", gt=0
    )
    acceleration: float = quantity(1.0, "m/s^2", "at which a wheel's rim speeds up", gt=0)
    deceleration: float = quantity(1.5, "m/s^2", "at which a wheel's rim slows down", gt=0)
    command_timeout: float = quantity(0.25, "s", "age of a command after which the base brakes", gt=0)
    ticks: int = quantity(4096, "1/turn", "encoder ticks a turn of a wheel; 0: no quantisation", ge=0)
    slip_scale: float = quantity(0.002, "1", "sigma of each wheel's scale error, drawn once a run", ge=0, lt=0.5)
    slip: float = quantity(0.001, "m/sqrt(m)", "white slip of each wheel: sigma after a metre", ge=0)
    gyro_noise: float = quantity(2.6e-4, "rad/s/sqrt(Hz)", "noise density of the gyro", ge=0)
    gyro_bias: float = quantity(5e-4, "rad/s", "sigma of the gyro's bias, drawn once a run", ge=0)
    accelerometer_noise: float = quantity(1.9e-3, "m/s^2/sqrt(Hz)", "noise density of the accelerometer", ge=0)

    def exact(self) -> Self:
        """Return the same base without any error."""
        names = ("ticks", "slip_scale", "slip", "gyro_noise", "gyro_bias", "accelerometer_noise")
        return self.model_copy(update=dict.fromkeys(names, 0))


class LidarParameters(PluginConfig):
    """A planar lidar; the defaults are the LDS-01: 360 beams at 5 Hz, clockwise, thesis (3.15) and (3.16)."""

    beams: int = quantity(360, "1", "beams a turn", ge=1)
    fov: float = quantity(_FULL_TURN, "rad", "field of view; 2 pi: the last beam is a step before the first", gt=0)
    angle_min: float = quantity(0.0, "rad", "direction of beam 0 in the sensor frame")
    rate: float = quantity(5.0, "Hz", "scans a second", gt=0)
    sweep: float | None = quantity(
        None, "s", "time from the first beam of a turn to the end; 0: all at once; none: 1 / rate", ge=0
    )
    clockwise: bool = Field(default=True, description="beams are measured in the order of falling angle")
    range_min: float = quantity(0.12, "m", "nearer returns are invalid (NaN)", ge=0)
    range_max: float = quantity(3.5, "m", "farther returns are no return (inf)", gt=0)
    mount: tuple[float, float, float] = quantity(
        (-0.032, 0.0, 0.0), "m, m, rad", "pose of the sensor in the base frame"
    )
    precision: tuple[float, float] = quantity(
        (0.0026, 0.00253), "1, m", "(a, b) of the white noise sigma_p = a r + b (3.16)"
    )
    accuracy: float = quantity(
        0.05, "1", "sigma of the range scale error, drawn once a run (3.15); 0: off", ge=0, lt=0.5
    )

    @field_validator("precision")
    @classmethod
    def _not_negative(cls, value: tuple[float, float]) -> tuple[float, float]:
        if min(value) < 0.0:
            raise ValueError("must not be negative")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.fov > _FULL_TURN + 1e-9:
            raise ValueError(f"fov is {self.fov} rad, expected at most 2 pi")
        if self.range_min >= self.range_max:
            raise ValueError("range_min must be less than range_max")
        if self.sweep is not None and self.sweep * self.rate > 1.0 + 1e-9:
            raise ValueError("sweep must be at most 1 / rate")
        return self

    @property
    def angle_increment(self) -> float:
        """Angle from a beam to the next [rad]."""
        if self.fov >= _FULL_TURN - 1e-9:
            return _FULL_TURN / self.beams
        return self.fov / max(self.beams - 1, 1)

    @property
    def sweep_time(self) -> float:
        """Duration of a turn's beams [s]."""
        return 1.0 / self.rate if self.sweep is None else self.sweep

    @property
    def timing(self) -> tuple[float, float]:
        """`time_offset` and `time_increment` of `Scan` [s], the stamp being the first beam's time."""
        step = self.sweep_time / self.beams
        return ((self.beams - 1) * step, -step) if self.clockwise else (0.0, step)

    def exact(self) -> Self:
        """Return the same sensor without noise and range error."""
        return self.model_copy(update={"precision": (0.0, 0.0), "accuracy": 0.0})


def gyro_sigma(parameters: BaseParameters, period: float) -> float:
    """Return the white noise of a gyro sample that averages over `period` [s]: sigma [rad/s]."""
    return parameters.gyro_noise / sqrt(period)
