"""What a recording holds, whoever made it: tracks, and the messages of all tracks in their order."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError
from knotwork.core.messages import Message
from knotwork.core.playback.frames import Frames


@dataclass(slots=True)
class Track:
    """One topic that can be read.

    Attributes
    ----------
    topic
        Name in the recording: `node.port` of a run's stream, else the topic ("/scan").
    type, role
        Of the messages it gives.
    decode
        What stands in the recording (bytes) to the message as its maker defined it, or to ours; raises
        ValueError or KnotworkError.
    convert
        That message, time of arrival [ns], frames and number to ours; None when `decode` gives ours.
    source
        It came from outside the run that was recorded (a device, a log): what a replay feeds.
    count
        Messages; 0 when unknown.
    """

    topic: str
    type: str
    role: str
    decode: Callable[[Any], Any]
    convert: Callable[[Any, int, Frames, int], Iterator[Message]] | None = None
    source: bool = True
    count: int = 0


@dataclass(slots=True)
class Damages:
    """What a pass could not read: one line each, and how often."""

    lines: list[str] = field(default_factory=list)
    lost: dict[str, int] = field(default_factory=dict)  # counter to number

    def add(self, counter: str, line: str, n: int = 1) -> None:
        """Count something lost; its line is kept."""
        self.lost[counter] = self.lost.get(counter, 0) + n
        if line:
            self.lines.append(line)


class Recording(ABC):
    """An opened recording.

    Attributes
    ----------
    tracks
        What can be read, by topic.
    other
        Topics that cannot, with the name of their type.
    start, end
        First and last time of arrival [ns].
    damages
        What the passes so far could not read.
    """

    def __init__(self) -> None:
        self.tracks: dict[str, Track] = {}
        self.other: dict[str, str] = {}
        self.start = 0
        self.end = 0
        self.damages = Damages()

    @abstractmethod
    def messages(self, start: int, stop: int | None) -> Iterator[tuple[Track, int, Any]]:
        """Yield track, time of arrival [ns] and what `decode` takes, in order of arrival; damage raises nothing."""

    def close(self) -> None:  # noqa: B027 - not every recording keeps a file open
        """Release the files."""


def parts(path: str) -> list[Path]:
    """Return the files that a path with `*` and `?` means, by name.

    Raises
    ------
    InputError
        There is none.
    """
    plain = Path(path)
    if plain.exists() or not any(sign in path for sign in "*?"):
        if not plain.exists():
            raise InputError("no such file", where=path, hint="check the path")
        return [plain]
    root = Path(plain.anchor) if plain.is_absolute() else Path()
    found = sorted(root.glob(str(plain.relative_to(plain.anchor))))
    if not found:
        raise InputError("no file has such a name", where=path, hint="check the path")
    return found
