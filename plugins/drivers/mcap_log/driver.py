"""MCAP files as a source."""

from knotwork.core.manifest import Port
from knotwork.core.playback.driver import PlaybackDriver, outputs
from knotwork.core.playback.mcap import McapRecording
from knotwork.plugins.drivers.mcap_log import Config


class McapLog(PlaybackDriver):
    """Plays MCAP files."""

    def recording(self) -> McapRecording:
        """Open the files."""
        return McapRecording(self.settings.path)


def ports(config: Config) -> dict[str, Port]:
    """Return the output ports; raises InputError for a file that cannot be read."""
    return {output.port: output.declared for output in outputs(McapRecording(config.path), config)}
