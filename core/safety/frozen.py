"""Notices wheels that are told to turn and do not."""

_PATIENCE = 1_000_000_000  # ns


class FrozenWheels:
    """Compares what was commanded with when the encoders last changed."""

    def __init__(self) -> None:
        self._since: int | None = None  # when the wheels were told to turn

    def look(self, commanded: bool, moved: int, now: int) -> bool:
        """Return whether the wheels are frozen.

        Parameters
        ----------
        commanded
            They are told to turn.
        moved
            When the encoders changed last [ns].
        now
            When the encoders were read last [ns]: a host that paused has seen nothing.
        """
        if not commanded:
            self._since = None
        elif self._since is None:
            self._since = now
        return self._since is not None and now - max(self._since, moved) > _PATIENCE
