"""How the state goes from one entry of the history to the next: odometry, steady motion, corrections."""

import math
from typing import cast

from knotwork.core.geometry import IDENTITY, Pose2, compose, exp, interpolate, log, relative, scaled
from knotwork.plugins.observers.ekf import EkfConfig
from knotwork.plugins.observers.ekf.entries import Entry, Fix, Knot, Outcome, State, Steady
from knotwork.plugins.observers.ekf.filter import (
    Triangle,
    add,
    correct,
    correct_information,
    diagonal,
    distance,
    information_distance,
    innovation,
    predict,
    rotated,
    times,
)

SECOND = 1_000_000_000  # [ns]
_CHANGE = (1.5, 6.0)  # [m/s^2, rad/s^2] at which a robot's motion may change between two odometry messages
_PERIOD_GAIN = 0.05  # of the running mean of the time between scans; bursts of stamps average out


def _between(knot: Knot, follower: Knot, *parts: float) -> Triangle:
    """Return the covariance of places on the way from a knot to the next, that were interpolated.

    A robot that changes its speed is off the place by at most a T^2 s (1 - s) / 2, and by no more than it moves.
    """
    dx, dy, turn = relative(cast(Pose2, knot.odom), cast(Pose2, follower.odom))
    period = (follower.time - knot.time) / SECOND
    share = 2.0 * sum((s * (1.0 - s)) ** 2 for s in parts) ** 0.5
    most, most_turn = (0.25 * a * period * period for a in _CHANGE)
    return diagonal(share * min(math.hypot(dx, dy), most), share * min(abs(turn), most_turn))


class Model:
    """Pure functions of the states and entries they are given."""

    def __init__(self, config: EkfConfig) -> None:
        self._c = config
        self.start = State(config.start, diagonal(*config.start_sigma))
        self._tt = config.translation_per_metre**2
        self._tr = config.translation_per_radian**2
        self._rt = config.rotation_per_metre**2
        self._rr = config.rotation_per_radian**2
        self._floor = diagonal(*config.floor)
        self._unknown = diagonal(*config.unknown)
        self._inflate = diagonal(*config.inflate)
        self._gap_factor = config.gap_noise**2
        self._steady_noise = diagonal(*config.steady_noise)

    # --- with odometry ------------------------------------------------------------------------------

    def odometry_at(self, knot: Knot, follower: Knot | None, time: int) -> tuple[Pose2, float]:
        """Return odometry at a time from `knot` on, and how far towards `follower` that is, in [0, 1].

        Without a follower the knot's twist goes on for the configured horizon.
        """
        start = cast(Pose2, knot.odom)
        ahead = time - knot.time
        if ahead <= 0:
            return start, 0.0
        if follower is None:
            return compose(start, exp(scaled(knot.twist, min(ahead / SECOND, self._c.horizon)))), 0.0
        part = min(1.0, ahead / max(1, follower.time - knot.time))
        return interpolate(start, cast(Pose2, follower.odom), part), part

    def moved(self, before: Entry, odom: Pose2, part: float, time: int, knot: Knot, follower: Knot | None) -> State:
        """Predict from an entry to odometry `odom` at `time`, `part` of the way from `knot` to `follower`."""
        state = before.state
        start = cast(Pose2, before.odom)
        if time == before.time and odom is start:  # a correction at its odometry's own instant
            return state
        motion = relative(start, odom)
        way = math.hypot(motion[0], motion[1])
        turn = abs(motion[2])
        elapsed = (time - before.time) / SECOND
        weak = state.weak
        if follower is not None and follower.covariance is not None:
            # Stated in axes of `knot`; wanted in axes of `before`, which has turned on since.
            share = times(follower.covariance, part - before.part)
            noise = rotated(share, cast(Pose2, knot.odom)[2] - start[2]) if before.part > 0.0 else share
        else:
            bounded = min(elapsed, self._c.gap)
            t = self._tt * way + self._tr * turn + self._floor[0] * bounded
            r = self._rt * way + self._rr * turn + self._floor[5] * bounded
            noise = (t, 0.0, 0.0, t, 0.0, r)
        if follower is not None and (before.part > 0.0 or part < 1.0):
            noise = add(noise, _between(knot, follower, before.part, part))
        if follower is None:
            noise = add(noise, times(self._unknown, elapsed))
        elif follower.gap:
            noise = times(noise, self._gap_factor)
            weak = True
        pose, covariance = predict(state.pose, state.covariance, motion, noise)
        return State(pose, covariance, state.moved + way, state.turned + turn, weak, state.refused, state.steady)

    def jumped(self, before: Entry) -> State:
        """Stay where the robot was, much less sure of it: odometry cannot be compared."""
        state = before.state
        return state._replace(covariance=add(state.covariance, self._inflate), weak=True)

    def first_odometry(self, before: Entry, time: int) -> State:
        """Change over from steady motion to odometry: where the robot was, or not far from it."""
        state = before.state
        elapsed = (time - before.time) / SECOND
        covariance = add(state.covariance, times(self._unknown, elapsed))
        weak = state.weak or elapsed > self._c.gap
        return state._replace(covariance=covariance, weak=weak, steady=Steady())

    # --- without odometry ---------------------------------------------------------------------------

    def next_scan(self, before: Entry, time: int) -> State:
        """Predict to the next scan. Scans are counted, not timed: their stamps may come in bursts."""
        state = self.steady_part(before.state, 1.0)
        steady = state.steady
        elapsed = (time - before.time) / SECOND
        period = steady.period
        if period > 0.0:
            period += _PERIOD_GAIN * (min(elapsed, 5.0 * period) - period)
        elif elapsed > 0.0:
            period = elapsed
        scans = steady.scans + 1
        weak = state.weak or (steady.last is not None and (steady.step is None or scans > 1))
        return state._replace(weak=weak, steady=steady._replace(scans=scans, period=period))

    def steady_part(self, state: State, part: float) -> State:
        """Predict `part` in [0, 1] of the motion from one scan to the next."""
        steady = state.steady
        twist = IDENTITY
        if steady.step is not None and steady.scans < self._c.steady_scans:
            twist = scaled(steady.step, part)
        pose, covariance = predict(state.pose, state.covariance, exp(twist), times(self._steady_noise, part))
        way = math.hypot(twist[0], twist[1])
        return state._replace(
            pose=pose, covariance=covariance, moved=state.moved + way, turned=state.turned + abs(twist[2])
        )

    def steady_twist(self, state: State) -> Pose2:
        """Return the body twist [m/s, m/s, rad/s] of the motion from scan to scan."""
        step, _, _, period = state.steady
        return self.plausible(scaled(step, 1.0 / period)) if step is not None and period > 0.0 else IDENTITY

    def _learned(self, steady: Steady, pose: Pose2) -> Steady:
        """Take the motion between two corrections into the predicted one."""
        if steady.last is None or steady.scans == 0:
            return steady._replace(last=pose, scans=0)
        vx, vy, w = scaled(log(relative(steady.last, pose)), 1.0 / steady.scans)
        if steady.step is not None:
            gain = self._c.steady_gain
            ox, oy, ow = steady.step
            vx, vy, w = ox + gain * (vx - ox), oy + gain * (vy - oy), ow + gain * (w - ow)
        most, most_turn = self._c.steady_limit
        way = math.hypot(vx, vy)
        shrink = min(1.0, most / way) if way > 0.0 else 1.0
        step = (shrink * vx, shrink * vy, max(-most_turn, min(most_turn, w)))
        return steady._replace(step=step, last=pose, scans=0)

    # --- corrections --------------------------------------------------------------------------------

    def corrected(self, state: State, fix: Fix, steady: bool) -> State:
        """Take a correction or refuse it, and note which in `fix`. `steady`: no odometry."""
        pose, p = state.pose, state.covariance
        fix.outcome = self._judge(state, fix)
        if fix.outcome == "refused":
            return state._replace(refused=state.refused + 1, weak=True)
        if fix.replace:
            pose, p = fix.pose, fix.covariance
        else:
            if fix.outcome == "forced":  # the state was wrong by so much
                ex, ey, eyaw = innovation(pose, fix.pose)
                p = add(p, diagonal(math.hypot(ex, ey), eyaw))
            if fix.information is not None:
                pose, p = correct_information(pose, p, fix.pose, fix.information)
            else:
                pose, p = correct(pose, p, fix.pose, fix.covariance)
        return State(pose, p, steady=self._learned(state.steady, pose) if steady else state.steady)

    def _judge(self, state: State, fix: Fix) -> Outcome:
        c = self._c
        if fix.replace:  # it was weighed against the prior by who gave it, and is in the map by now
            return "taken"
        ex, ey, eyaw = innovation(state.pose, fix.pose)
        if c.gate == 0.0 or (math.hypot(ex, ey) < c.gate_motion[0] and abs(eyaw) < c.gate_motion[1]):
            return "taken"
        if fix.information is not None:
            away = information_distance(state.pose, state.covariance, fix.pose, fix.information)
        else:
            away = distance(state.pose, state.covariance, fix.pose, fix.covariance)
        if away <= c.gate:
            return "taken"
        return "refused" if state.refused < c.gate_patience else "forced"

    # --- twists -------------------------------------------------------------------------------------

    def plausible(self, twist: Pose2) -> Pose2:
        """Return the twist, or no motion where it is faster than a robot can be."""
        most, most_turn = self._c.twist_limit
        return twist if math.hypot(twist[0], twist[1]) <= most and abs(twist[2]) <= most_turn else IDENTITY
