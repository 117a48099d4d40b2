"""ROS bags as a source."""

from contextlib import closing

from knotwork.core.manifest import Port
from knotwork.core.playback.driver import PlaybackDriver, outputs
from knotwork.core.playback.rosbag import RosbagRecording
from knotwork.plugins.drivers.rosbag import Config


class Rosbag(PlaybackDriver):
    """Plays a bag."""

    def recording(self) -> RosbagRecording:
        """Open the bag."""
        return RosbagRecording(self.settings.path)


def ports(config: Config) -> dict[str, Port]:
    """Return the output ports; raises InputError for a bag that cannot be read."""
    with closing(RosbagRecording(config.path)) as recording:
        return {output.port: output.declared for output in outputs(recording, config)}
