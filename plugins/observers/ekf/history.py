"""The buffer of the filter: a time-ordered list whose states are a function of its entries alone.

However late a correction comes, it is put where it belongs and everything after it is computed again with
the same operations, so the outcome does not depend on the order of arrival.
"""

import math
from typing import cast

from knotwork.core.geometry import IDENTITY, Pose2, log, relative, scaled
from knotwork.plugins.observers.ekf import EkfConfig
from knotwork.plugins.observers.ekf.entries import Entry, Fix, Knot, Place, State
from knotwork.plugins.observers.ekf.filter import Triangle
from knotwork.plugins.observers.ekf.model import SECOND, Model

_TRIM_AT = 256
_SWEEP = SECOND // 4  # [ns] that a scan takes at most


class History:
    """Odometry and corrections in order of time, with the filter's state after each."""

    def __init__(self, config: EkfConfig) -> None:
        self._c = config
        self.model = Model(config)
        self.entries: list[Entry] = []
        self.number = -1  # of the newest knot
        self.newest: Knot | None = None
        self._trim_at = _TRIM_AT
        self._gap = round(config.gap * SECOND)
        self._buffer = round(config.buffer * SECOND)
        self._window = (round(config.twist_window[0] * SECOND), round(config.twist_window[1] * SECOND))

    # --- what arrives -------------------------------------------------------------------------------

    def append_odometry(
        self, time: int, odom: Pose2, twist: Pose2 | None, covariance: Triangle | None, jump: bool
    ) -> Knot:
        """Add an odometry message measured at `time` [ns]; it is not before any other, whatever its time says."""
        last = self.newest
        knot = Knot(max(time, last.time) if last else time, self.number + 1, odom, self.model.start)
        if last is not None and last.odom is not None:
            knot.jump = jump
            knot.covariance = covariance
            if not jump and knot.time - last.time > self._gap:
                dx, dy, turn = relative(last.odom, odom)
                most, most_turn = self._c.gap_motion
                knot.gap = math.hypot(dx, dy) > most or abs(turn) > most_turn
        knot.twist = self._twist(knot) if twist is None else twist
        self._append(knot)
        return knot

    def append_scan(self, time: int) -> Knot:
        """Append a scan of a robot without odometry."""
        last = self.newest
        knot = Knot(max(time, last.time) if last else time, self.number + 1, None, self.model.start)
        self._append(knot)
        return knot

    def insert(self, fix: Fix) -> bool:
        """Put a correction where it belongs and compute what follows anew; False: older than the buffer."""
        entries = self.entries
        if not entries or fix.key < entries[0].key or fix.time < entries[-1].time - self._buffer:
            return False
        at = len(entries)
        while entries[at - 1].key > fix.key:
            at -= 1
        entries.insert(at, fix)
        self._recompute(at)
        return True

    def place(self, time: int) -> Place:
        """Return where a measurement at `time` [ns] belongs: after the last knot that is not later.

        A little before the very first knot is at that knot: the first scan of a robot may have begun before
        its first odometry. Number -1: before all that is remembered.
        """
        for entry in reversed(self.entries):
            if entry.time <= time:
                return time, entry.number
        if self.entries:
            first = self.entries[0]
            if first.number == 0 and first.time - time <= self._buffer:
                return first.time, 0
        return time, -1

    # --- what is asked ------------------------------------------------------------------------------

    def at(self, time: int) -> tuple[State, Pose2, bool]:
        """Return state, body twist from then on and whether the state is weak at a time; changes nothing."""
        entries = self.entries
        model = self.model
        at = len(entries) - 1
        while at >= 0 and entries[at].time > time:
            at -= 1
        if at < 0:
            return (entries[0].state if entries else model.start), IDENTITY, bool(entries)
        entry = entries[at]
        state = entry.state
        knot = self._knot(at)
        follower = self._follower(at)
        if knot.odom is None:
            twist = model.steady_twist(state)
            if time > entry.time:
                period = (follower.time - entry.time) / SECOND if follower else state.steady.period
                ahead = (time - entry.time) / SECOND
                state = model.steady_part(state, min(1.0, ahead / period) if period > 0.0 else 1.0)
            late = False
        else:
            if time > entry.time:
                odom, part = model.odometry_at(knot, follower, time)
                state = model.moved(entry, odom, part, time, knot, follower)
            late = follower is None and time - knot.time > self._gap
            twist = follower.twist if follower and time > knot.time else IDENTITY if late else knot.twist
            twist = self._mean_twist(at, model.odometry_at(knot, follower, time)[0], time) or twist
        most, most_turn = self._c.weak_motion
        return state, twist, late or state.weak or state.moved > most or state.turned > most_turn

    # --- states -------------------------------------------------------------------------------------

    def _append(self, knot: Knot) -> None:
        entries = self.entries
        at = place = len(entries)
        if self.newest is not None:
            # Corrections after the last knot were placed by extrapolation; now their place is known.
            while entries[at - 1].time > self.newest.time:
                at -= 1
            # Odometry that comes late belongs before the corrections of what was measured after it.
            while place > at and entries[place - 1].time > knot.time:
                place -= 1
        self.number = knot.number
        self.newest = knot
        entries.insert(place, knot)
        self._recompute(at)
        if len(entries) > self._trim_at:
            self._trim(knot.time - self._buffer)

    def _trim(self, oldest: int) -> None:
        """Forget what no correction can reach any more, up to the last knot before it."""
        entries = self.entries
        excess = len(entries) - self._c.buffer_size
        keep = 0
        for i, entry in enumerate(entries):
            if entry.time >= oldest and i >= excess:
                break
            if isinstance(entry, Knot):
                keep = i
        del entries[:keep]
        self._trim_at = max(_TRIM_AT, min(2 * len(entries), len(entries) + _TRIM_AT))

    def _knot(self, at: int) -> Knot:
        """Return the last knot at or before an index; the oldest entry is always one."""
        entry = self.entries[at]
        while not isinstance(entry, Knot):
            at -= 1
            entry = self.entries[at]
        return entry

    def _follower(self, at: int) -> Knot | None:
        """Return the next knot after an index, None where odometry does not lead there without a break."""
        for i in range(at + 1, len(self.entries)):
            entry = self.entries[i]
            if isinstance(entry, Knot):
                return entry if not entry.jump else None
        return None

    def _recompute(self, first: int) -> None:
        for i in range(first, len(self.entries)):
            entry = self.entries[i]
            if isinstance(entry, Fix):
                self._at_fix(i, entry)
            elif i > 0:
                entry.state = self._at_knot(i, entry)

    def _at_knot(self, i: int, knot: Knot) -> State:
        before = self.entries[i - 1]
        if knot.odom is None:
            return self.model.next_scan(before, knot.time)
        if knot.jump:
            return self.model.jumped(before)
        start = self._knot(i - 1)
        if start.odom is None:
            return self.model.first_odometry(before, knot.time)
        return self.model.moved(before, knot.odom, 1.0, knot.time, start, knot)

    def _at_fix(self, i: int, fix: Fix) -> None:
        before = self.entries[i - 1]
        knot = self._knot(i - 1)
        state = before.state
        if knot.odom is not None:
            follower = self._follower(i)
            fix.odom, fix.part = self.model.odometry_at(knot, follower, fix.time)
            state = self.model.moved(before, fix.odom, fix.part, fix.time, knot, follower)
        fix.state = self.model.corrected(state, fix, steady=knot.odom is None)

    def _mean_twist(self, at: int, odom: Pose2, time: int) -> Pose2 | None:
        """Return the mean body twist after a time, as far as odometry after entry `at` tells it.

        That is the motion by which a scan that begins then is skewed; the twist of one odometry message is
        noisier, and older than most of the scan.
        """
        last: Knot | None = None
        for entry in self.entries[at + 1 :]:
            if isinstance(entry, Fix):
                continue
            if entry.jump or entry.odom is None or entry.time - time > _SWEEP:
                break
            last = entry
        if last is None or last.time - time < self._window[0]:
            return None
        motion = log(relative(odom, cast(Pose2, last.odom)))
        return self.model.plausible(scaled(motion, SECOND / (last.time - time)))

    def _twist(self, knot: Knot) -> Pose2:
        """Return the body twist up to a new knot, no motion where times do not allow to tell it."""
        least, most = self._window
        if knot.jump:
            return IDENTITY
        for entry in reversed(self.entries):
            if isinstance(entry, Fix):
                continue
            elapsed = knot.time - entry.time
            if entry.odom is None or elapsed > most:
                break
            if elapsed >= least:
                motion = log(relative(entry.odom, cast(Pose2, knot.odom)))
                return self.model.plausible(scaled(motion, SECOND / elapsed))
            if entry.jump:
                break
        return IDENTITY
