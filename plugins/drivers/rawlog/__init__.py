"""Plugin `rawlog`: feeds a pipeline from an MRPT rawlog."""

from knotwork.core.manifest import Manifest
from knotwork.core.playback.config import PlaybackConfig


class Config(PlaybackConfig):
    """An MRPT `.rawlog`, plain or gzip."""


MANIFEST = Manifest(
    name="rawlog",
    kind="driver",
    summary="MRPT rawlog: laser scans and odometry, of observations or of actions and sensory frames",
    impl="knotwork.plugins.drivers.rawlog.driver:Rawlog",
    config=Config,
    ports="knotwork.plugins.drivers.rawlog.driver:ports",
    example="log: {plugin: rawlog, path: lab.rawlog}",
)
