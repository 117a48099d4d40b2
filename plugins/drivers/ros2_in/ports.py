"""The outputs of one node: what its config names."""

from knotwork.core.manifest import Port
from knotwork.plugins.drivers.ros2_in import Ros2InConfig


def outputs(config: Ros2InConfig) -> dict[str, Port]:
    """Return the ports."""
    return {name: Port(each.message, summary=f"ROS 2 topic {each.topic}") for name, each in config.topics.items()}
