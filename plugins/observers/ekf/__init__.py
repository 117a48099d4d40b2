"""Plugin `ekf`: where the robot is before the next scan has been looked at."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity

Positive = Annotated[float, Field(gt=0)]


class EkfConfig(PluginConfig):
    """Config of the EKF prior. Noise grows along the path: n times the way gives sqrt(n) times the sigma."""

    start: tuple[float, float, float] = quantity(
        (0.0, 0.0, 0.0), "m, m, rad", "pose in the map before the first motion"
    )
    start_sigma: tuple[Positive, Positive] = quantity(
        (1e-3, 1e-3), "m, rad", "sigma of `start`: each position axis, yaw"
    )

    translation_per_metre: float = quantity(
        0.06, "m/sqrt(m)", "sigma of each position axis after one metre of odometry", ge=0
    )
    translation_per_radian: float = quantity(
        0.06, "m/sqrt(rad)", "sigma of each position axis after one radian of turning", ge=0
    )
    rotation_per_metre: float = quantity(0.06, "rad/sqrt(m)", "sigma of yaw after one metre of odometry", ge=0)
    rotation_per_radian: float = quantity(0.08, "rad/sqrt(rad)", "sigma of yaw after one radian of turning", ge=0)
    floor: tuple[Positive, Positive] = quantity(
        (0.005, 0.005), "m/sqrt(s), rad/sqrt(s)", "sigma that a second adds even to a robot that stands"
    )

    gap: float = quantity(
        1.0,
        "s",
        "longer without odometry: the prediction is weak; counted as a gap if odometry moved much",
        gt=0,
    )
    gap_motion: tuple[Positive, Positive] = quantity(
        (0.3, 0.3), "m, rad", "odometry over a gap that moved less than both is trusted as ever"
    )
    gap_noise: float = quantity(2.0, "1", "sigma of odometry over a gap is this many times larger", ge=1)
    inflate: tuple[Positive, Positive] = quantity(
        (0.5, 0.5), "m, rad", "sigma added at a discontinuity of odometry, which is not integrated"
    )
    horizon: float = quantity(0.5, "s", "beyond the newest odometry the last twist goes on for so long", ge=0)
    unknown: tuple[Positive, Positive] = quantity(
        (0.3, 0.3), "m/sqrt(s), rad/sqrt(s)", "sigma added by a second beyond the newest odometry"
    )
    weak_motion: tuple[Positive, Positive] = quantity(
        (0.5, 0.5), "m, rad", "way and turning since the last correction above which the prediction is weak"
    )

    twist_window: tuple[Positive, Positive] = quantity(
        (0.05, 0.5), "s", "times between odometry messages from which a twist is believed: least, most"
    )
    twist_limit: tuple[Positive, Positive] = quantity(
        (3.0, 6.0), "m/s, rad/s", "faster than this is taken for a fault of the time stamps: no twist"
    )

    gate: float = quantity(
        10.0,
        "sigma",
        "a correction further away is refused, unless the prior is in it (Mahalanobis distance); 0: none is",
        ge=0,
    )
    gate_motion: tuple[Positive, Positive] = quantity(
        (0.2, 0.2), "m, rad", "a correction that moves the pose by less than both is never refused"
    )
    gate_patience: int = quantity(3, "corrections", "after so many refused in a row the next one is believed", ge=1)
    correction_sigma: tuple[Positive, Positive] = quantity(
        (0.02, 0.01), "m, rad", "sigma of a correction that states none"
    )

    steady_gain: float = quantity(
        0.7,
        "1",
        "without odometry: weight of the newest motion between two scans in the predicted one",
        gt=0,
        le=1,
    )
    steady_noise: tuple[Positive, Positive] = quantity(
        (0.03, 0.03),
        "m, rad",
        "without odometry: sigma of the motion from scan to scan around the predicted one",
    )
    steady_limit: tuple[Positive, Positive] = quantity(
        (0.6, 0.6), "m, rad", "without odometry: most that is predicted from one scan to the next"
    )
    steady_scans: int = quantity(
        3, "scans", "without odometry: the motion goes on for so many scans without a correction", ge=0
    )

    buffer: float = quantity(10.0, "s", "a correction older than this is ignored, and counted", gt=0)
    buffer_size: int = quantity(20000, "entries", "most odometry messages and corrections kept", ge=16)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.twist_window[0] >= self.twist_window[1]:
            raise ValueError("twist_window must be (least, most) with least < most")
        return self


MANIFEST = Manifest(
    name="ekf",
    kind="observer",
    summary="Predicts the robot's pose from odometry or its last motion, and takes late corrections.",
    impl="knotwork.plugins.observers.ekf.node:Ekf",
    config=EkfConfig,
    inputs={
        "odometry": Port("odometry", optional=True, summary="without it: constant velocity from the corrections"),
        "scan": Port(
            "scan",
            optional=True,
            many=True,
            summary="says where in the odometry a correction with that scan_id belongs",
        ),
        "correction": Port(
            "pose", role="estimate", optional=True, feedback=True, summary="pose of a scan, late or not"
        ),
    },
    outputs={
        "prior": Port("pose", role="prior", summary="predicted pose at each odometry message"),
        "transform": Port("transform", summary="odom in map, after each correction"),
    },
    provides=("prior",),
    example="prior: {plugin: ekf}",
)
