"""The receiver's half of a link: each message once, in order, and what will never come is counted."""

from typing import Literal

Verdict = Literal["new", "duplicate", "gap"]


class Arrivals:
    """Follows the numbers of one sender at a time.

    Attributes
    ----------
    expected
        The number that comes next.
    lost
        Messages that the sender says it no longer has.
    sessions
        How often a sender began anew.
    """

    def __init__(self) -> None:
        self.session = 0
        self.expected = 0
        self.lost = 0
        self.duplicates = 0
        self.gaps = 0
        self.sessions = 0

    def judge(self, session: int, seq: int, first: int) -> Verdict:
        """Take a number; `first` is the oldest the sender still has."""
        if session != self.session:
            self.session, self.expected = session, first
            self.sessions += 1
        if first > self.expected:
            self.lost += first - self.expected
            self.expected = first
        if seq < self.expected:
            self.duplicates += 1
            return "duplicate"
        if seq > self.expected:
            self.gaps += 1
            return "gap"
        self.expected += 1
        return "new"
