"""How long something took, over the last few thousand times."""

from collections import deque

_KEPT = 4096


class Latency:
    """Durations of one thing."""

    def __init__(self) -> None:
        self._kept: deque[int] = deque(maxlen=_KEPT)
        self._maximum = 0

    def add(self, duration: int) -> None:
        """Add a duration [ns]."""
        self._kept.append(duration)
        self._maximum = max(self._maximum, duration)

    def summary(self, name: str) -> dict[str, float]:
        """Return `NAME_p95_ms` over those kept and `NAME_max_ms` over all; nothing before the first."""
        kept = sorted(self._kept.copy())
        if not kept:
            return {}
        return {f"{name}_p95_ms": kept[int(0.95 * (len(kept) - 1))] * 1e-6, f"{name}_max_ms": self._maximum * 1e-6}
