"""MRPT rawlogs as a source."""

from knotwork.core.manifest import Port
from knotwork.core.playback.driver import PlaybackDriver, outputs
from knotwork.core.playback.rawlog import RawlogRecording
from knotwork.plugins.drivers.rawlog import Config


class Rawlog(PlaybackDriver):
    """Plays a rawlog."""

    def recording(self) -> RawlogRecording:
        """Open the file."""
        return RawlogRecording(self.settings.path)


def ports(config: Config) -> dict[str, Port]:
    """Return the output ports; raises InputError for a file that cannot be read."""
    return {output.port: output.declared for output in outputs(RawlogRecording(config.path), config)}
