"""Plugin `mcap-log`: feeds a pipeline from MCAP files."""

from knotwork.core.manifest import Manifest
from knotwork.core.playback.config import PlaybackConfig


class Config(PlaybackConfig):
    """A run logged by the sink `mcap`, or an MCAP file of Foxglove's schemas or of ROS."""


MANIFEST = Manifest(
    name="mcap-log",
    kind="driver",
    summary="MCAP file: a logged run, Foxglove's schemas (JSON, protobuf) or ROS messages; a port for each stream",
    impl="knotwork.plugins.drivers.mcap_log.driver:McapLog",
    config=Config,
    ports="knotwork.plugins.drivers.mcap_log.driver:ports",
    requires=("mcap", "zstandard", "lz4"),
    example="log: {plugin: mcap-log, path: runs/demo/log.mcap}",
)
