"""Which scans a file has lines of, in order, in little memory: scans are numbered one after another."""

from collections.abc import Iterator


class ScanNumbers:
    """Numbers of scans with the revision each was first estimated in, as runs of evenly spaced numbers."""

    def __init__(self) -> None:
        self._runs: list[tuple[range, int]] = []
        self._highest: int | None = None

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """Give (scan_id, revision) in the order they were added."""
        return ((number, revision) for numbers, revision in self._runs for number in numbers)

    def revision(self, number: int) -> int | None:
        """Return the revision of a scan; None: there is no such scan."""
        if self._highest is not None and number <= self._highest:
            for numbers, revision in reversed(self._runs):
                if number in numbers:
                    return revision
        return None

    def add(self, number: int, revision: int) -> None:
        """Add a scan that is not there yet."""
        self._highest = number if self._highest is None else max(self._highest, number)
        if self._runs:
            numbers, same = self._runs[-1]
            step = number - numbers[-1]
            if same == revision and step > 0 and (len(numbers) == 1 or step == numbers.step):
                self._runs[-1] = range(numbers[0], number + 1, step), revision
                return
        self._runs.append((range(number, number + 1), revision))
