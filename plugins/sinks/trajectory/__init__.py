"""Plugin `trajectory`: where the robot was at each scan, as a text file."""

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port


class TrajectoryConfig(PluginConfig):
    """Where the path goes."""

    name: str = Field("trajectory", pattern=r"^[\w.-]+$", description="file name without ending, in the run's folder")


MANIFEST = Manifest(
    name="trajectory",
    kind="sink",
    summary="writes the robot's pose at each scan in TUM format, as estimated and as corrected later",
    impl="knotwork.plugins.sinks.trajectory.writer:TrajectoryWriter",
    config=TrajectoryConfig,
    inputs={
        "pose": Port(
            "pose",
            role="estimate",
            many=True,
            summary="poses with a scan_id; second and later producers get files named after them",
        ),
        "trajectory": Port("trajectory", optional=True, many=True, summary="supersedes earlier poses"),
    },
    example="path: {plugin: trajectory}",
)
