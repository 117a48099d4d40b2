"""The outputs of one node: what its config names."""

from knotwork.core.errors import InputError
from knotwork.core.manifest import Port
from knotwork.core.message_types import message_types
from knotwork.plugins.drivers.zenoh_in import ZenohInConfig

_WITH_ROLES = ("pose", "depths", "camera_pose")


def outputs(config: ZenohInConfig) -> dict[str, Port]:
    """Return the ports; raises InputError for a message type that nobody defines."""
    known = message_types()
    ports = {"link": Port("link_state", summary="offset of the clocks, round trip, losses; each second")}
    for name, remote in config.streams.items():
        if remote.message not in known:
            raise InputError(f"streams.{name}: no message type {remote.message!r}")
        if (remote.message in _WITH_ROLES) != bool(remote.role):
            needs = "needs its role (prior, estimate or truth)" if not remote.role else "has no role"
            raise InputError(f"streams.{name}: a {remote.message} {needs}")
        ports[name] = Port(remote.message, role=remote.role, summary=f"{remote.stream} of the other machine")
    return ports
