"""Puts readings on the host's clock by the time the device says it took them."""

_WINDOW = 5_000_000_000  # ns; two such windows back: crystals differ by 50 ms in a thousand seconds


class DeviceClock:
    """Maps the counter of a device, in ms, to the host's clock.

    An answer arrives after its reading was taken, never before: the answer that was least late tells how far
    the two clocks are apart, and all others are stamped by it, however late they come.
    """

    def __init__(self) -> None:
        self._count = -1
        self._began = 0
        self._offsets = [0, 0]  # least of this window and of the one before [ns]

    def hear(self, count: int, received: int) -> int:
        """Return when a reading was taken [ns].

        Parameters
        ----------
        count
            The device's own time of the reading [ms]; one that falls is that of a device that has restarted.
        received
            When its answer had arrived, by the host's clock [ns].
        """
        offset = received - count * 1_000_000
        if count < self._count or self._count < 0:
            self._offsets = [offset, offset]
            self._began = received
        elif received - self._began > _WINDOW:
            self._offsets = [offset, self._offsets[0]]
            self._began = received
        self._count = count
        self._offsets[0] = min(self._offsets[0], offset)
        return count * 1_000_000 + min(self._offsets)
