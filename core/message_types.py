"""Which message types exist, by name; importing this imports neither NumPy nor the messages."""

from importlib import import_module
from typing import TYPE_CHECKING

from knotwork.core.errors import InputError, KnotworkError

if TYPE_CHECKING:
    from knotwork.core.messages import Message

_CORE = "knotwork.core.messages"

# Name in YAML, ports and logs to "module:Class".
_TYPES: dict[str, str] = {
    "scan": f"{_CORE}:Scan",
    "odometry": f"{_CORE}:Odometry",
    "pose": f"{_CORE}:Pose",
    "trajectory": f"{_CORE}:Trajectory",
    "transform": f"{_CORE}:Transform",
    "twist": f"{_CORE}:Twist",
    "motion_control": f"{_CORE}:MotionControl",
    "motion_state": f"{_CORE}:MotionState",
    "camera_twist": f"{_CORE}:CameraTwist",
    "imu": f"{_CORE}:Imu",
    "wheels": f"{_CORE}:Wheels",
    "battery": f"{_CORE}:Battery",
    "grid": f"{_CORE}:Grid",
    "image": f"{_CORE}:Image",
    "features": f"{_CORE}:Features",
    "depths": f"{_CORE}:Depths",
    "camera_pose": f"{_CORE}:CameraPose",
    "servo_state": f"{_CORE}:ServoState",
    "event": f"{_CORE}:Event",
    "statistics": f"{_CORE}:Statistics",
}

# Types whose content comes from the wall clock: logged, never compared between runs.
_WALL_CLOCK: set[str] = {"statistics"}


def register(name: str, path: str, *, wall_clock: bool = False) -> None:
    """Add a message type, as a manifest's `message_types` does.

    Parameters
    ----------
    name
        Its `type_name`.
    path
        `package.module:Class`, imported when the first such message is read.
    wall_clock
        Its content differs between identical runs, so comparisons leave it out.

    Raises
    ------
    KnotworkError
        The name already stands for another class, or `path` is not of that form.
    """
    module, _, attribute = path.partition(":")
    if not (module and attribute):
        raise KnotworkError(f"message type `{name}`: `{path}` is not of the form package.module:Class")
    known = _TYPES.get(name)
    if known not in (None, path):
        raise KnotworkError(
            f"message type `{name}` is {known} already, so it cannot be {path}", hint="choose another name"
        )
    _TYPES[name] = path
    if wall_clock:
        _WALL_CLOCK.add(name)


def message_types() -> dict[str, str]:
    """Return all known types: name to `module:Class`."""
    return dict(_TYPES)


def is_wall_clock(name: str) -> bool:
    """Tell whether a type's content differs between identical runs."""
    return name in _WALL_CLOCK


def message_class(name: str) -> type["Message"]:
    """Import and return the class of a message type.

    Raises
    ------
    InputError
        No such type, or its module cannot be imported.
    """
    path = _TYPES.get(name)
    if path is None:
        raise InputError(
            f"unknown message type `{name}`; known are {', '.join(sorted(_TYPES))}",
            hint="install the plugin that brings it",
        )
    module, _, attribute = path.partition(":")
    try:
        found: type[Message] = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InputError(f"message type `{name}` cannot be loaded from {path}: {error}") from error
    if found.type_name != name:
        raise InputError(f"{path} calls itself `{found.type_name}`, but is registered as `{name}`")
    return found
