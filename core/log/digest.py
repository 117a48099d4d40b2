"""One number for everything a run decided: equal for two runs of the same log, configuration and machine."""

import hashlib
from pathlib import Path

from knotwork.core import codec
from knotwork.core.errors import InputError
from knotwork.core.log.reader import Log


def digest(path: Path, *, streams: frozenset[str] | None = None) -> str:
    """Return the SHA-256 of a log's decoded messages in order, wall-clock channels left out.

    It does not depend on compression, chunks or views.

    Parameters
    ----------
    path
        A log; one that is cut short counts up to where it was cut.
    streams
        Only these streams (`node.port`); None for all.

    Raises
    ------
    InputError
        The file is no log, or some of its messages cannot be decoded here.
    """
    log = Log(path)
    total = hashlib.sha256()
    for stream, message in log.messages(streams=streams, wall_clock=False):
        head = f"{stream} {message.type_name}".encode()
        body = codec.encode_canonical(message)
        total.update(b"%d %d " % (len(head), len(body)) + head + body)
    if log.unreadable:
        reason, n = next(iter(log.unreadable.items()))
        raise InputError(
            f"{sum(log.unreadable.values())} messages cannot be compared; {n} of them: {reason}",
            where=str(path),
        )
    return total.hexdigest()
