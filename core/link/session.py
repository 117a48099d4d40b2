"""Zenoh sessions: nodes of one process that name the same endpoints share one."""

import json
from threading import Lock
from typing import Any

import zenoh

from knotwork.core.errors import KnotworkError
from knotwork.core.link.config import LinkConfig

_LEASE = 2000  # ms without a sign of life after which a connection is given up and made anew
_RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}

_Key = tuple[tuple[str, ...], tuple[str, ...], bool]
_open: dict[_Key, list[Any]] = {}  # session and how many use it
_lock = Lock()


def acquire(config: LinkConfig) -> Any:
    """Return a session; give it back with `release`.

    Raises
    ------
    KnotworkError
        An endpoint cannot be listened on, or is none.
    """
    key = _key(config)
    with _lock:
        if key not in _open:
            _open[key] = [_new(config), 0]
        _open[key][1] += 1
        return _open[key][0]


def release(config: LinkConfig) -> None:
    """Give a session back; the last one closes it."""
    key = _key(config)
    with _lock:
        entry = _open[key]
        entry[1] -= 1
        if not entry[1]:
            del _open[key]
            entry[0].close()


def _key(config: LinkConfig) -> _Key:
    return config.listen, config.connect, config.scouting


def _new(config: LinkConfig) -> Any:
    settings = {
        "mode": "peer",
        "listen/endpoints": list(config.listen),
        "connect/endpoints": list(config.connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": _RETRY,
        "scouting/multicast/enabled": config.scouting,
        "scouting/gossip/enabled": config.scouting,
        "transport/link/tx/lease": _LEASE,
    }
    try:
        wanted = zenoh.Config()
        for name, value in settings.items():
            wanted.insert_json5(name, json.dumps(value))
        return zenoh.open(wanted)
    except zenoh.ZError as error:
        where = ", ".join((*config.listen, *config.connect))
        raise KnotworkError(f"cannot open the link: {error}", where=where, hint="is the endpoint taken?") from error
