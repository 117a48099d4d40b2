"""The observer `ekf`: messages in, priors out."""

import math
from typing import Any

import numpy as np

from knotwork.core.contracts import Context, Observer, PriorEstimate
from knotwork.core.geometry import Pose2, compose, inverse, wrap
from knotwork.core.messages import F64, Message, Odometry, Pose, Scan, Transform
from knotwork.plugins.observers.ekf import EkfConfig
from knotwork.plugins.observers.ekf.entries import Fix, Knot, Place
from knotwork.plugins.observers.ekf.filter import Triangle, diagonal, is_positive, to_matrix, to_triangle
from knotwork.plugins.observers.ekf.history import History
from knotwork.plugins.observers.ekf.model import SECOND

_MARKS = 4096  # stamps and scans whose place in the odometry is remembered


class Ekf(Observer):
    """Predicted pose of the robot in the map, from odometry and corrections in any order of arrival.

    Implements `knotwork.core.contracts.Prior`. Equations (3.8)-(3.14), as the errata mend them.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        config: EkfConfig = context.config
        self._history = History(config)
        self._late = round(config.buffer * SECOND)  # most that odometry may be late [ns]
        self._sigma = diagonal(*config.correction_sigma)
        self._scans: dict[tuple[int, int], Place] = {}  # by stamp and scan_id
        self._stamps: dict[int, Place] = {}  # by stamp of odometry
        self._told: set[str] = set()

    def prior(self, time: int) -> PriorEstimate:
        """Return the predicted pose at `time` [ns]: inside the buffer, or beyond its end by extrapolation.

        The stamp of an odometry message means the instant of that message, also where stamps run backwards.
        """
        known = self._stamps.get(time)
        time = time if known is None else known[0]
        state, twist, weak = self._history.at(time)
        newest = self._history.newest
        ahead = 0.0 if newest is None or newest.odom is None else max(0.0, (time - newest.time) / SECOND)
        return PriorEstimate(np.array(state.pose), to_matrix(state.covariance), np.array(twist), weak, ahead)

    def on_odometry(self, message: Odometry) -> None:
        """Integrate the motion since the last odometry message and publish the prior."""
        x, y, yaw = message.pose.tolist()
        twist: Pose2 | None = None
        covariance: Triangle | None = None
        if message.twist is not None:
            vx, vy, w = message.twist.tolist()
            twist = (vx, vy, w)
        if message.covariance is not None:
            covariance = to_triangle(message.covariance)
        if not _finite(x, y, yaw, *(twist or ()), *(covariance or ())):
            self._tell("invalid_odometry", "odometry with a value that is no number is ignored")
            return
        knot = self._history.append_odometry(
            self._measured(message), (x, y, yaw), twist, covariance, message.discontinuity
        )
        _remember(self._stamps, message.stamp, (knot.time, knot.number))
        if knot.jump:
            self._tell("discontinuities", "odometry was interrupted: weak prediction until the next correction")
        elif knot.gap:
            self.context.count("gaps")
        self._publish(message, knot)

    def on_scan(self, message: Scan) -> None:
        """Remember where in the odometry the scan was taken; without odometry, predict its pose."""
        history = self._history
        newest = history.newest
        if newest is None or newest.odom is None:
            knot = history.append_scan(message.time)
            _remember(self._stamps, message.stamp, (knot.time, knot.number))
            self._publish(message, knot)
        _remember(self._scans, (message.stamp, message.scan_id), self._instant(message.stamp, message.time))

    def on_correction(self, message: Pose) -> None:
        """Take the pose of a scan, however late."""
        if message.lost:
            self.context.count("lost_corrections")
            return
        fix = self._fix(message)
        if fix is None:
            self._tell("invalid_corrections", "a correction whose numbers make no pose and covariance is ignored")
            return
        if not self._history.insert(fix):
            self._tell("old_corrections", "a correction older than the buffer is ignored; raise `buffer`")
            return
        if fix.outcome == "refused":
            self._tell("refused_corrections", f"a correction far from the prediction is refused: {fix.pose}")
        elif fix.outcome == "forced":
            self.context.count("forced_corrections")
            self.context.report("warning", "corrections keep disagreeing with the prediction: believing them")
        last = self._history.entries[-1]
        if last.odom is not None:
            pose = np.array(compose(last.state.pose, inverse(last.odom)))
            self.context.emit("transform", Transform(stamp=message.stamp, parent="map", child="odom", pose=pose))

    def _measured(self, message: Odometry) -> int:
        """Return when odometry was measured [ns]: at its stamp, unless that is no time of the run's clock.

        A busy host hands it on late, after scans that were taken after it; counted from then on, motion that
        those scans' poses already have in them would be added to them once more.
        """
        late = message.time - message.stamp
        return message.stamp if 0 <= late <= self._late else message.time

    def _publish(self, message: Message, knot: Knot) -> None:
        state = knot.state
        self.context.emit(
            "prior",
            Pose(
                stamp=message.stamp,
                role="prior",
                pose=np.array(state.pose),
                covariance=to_matrix(state.covariance),
            ),
        )

    def _fix(self, message: Pose) -> Fix | None:
        """Return the correction with its place in the history, None if its numbers are unusable."""
        pose, stated, information = message.pose, message.covariance, None
        if message.prior_included and message.local_covariance is not None:
            stated = message.local_covariance
        if not message.prior_included and message.scan_information is not None:
            information = message.scan_information
            pose = message.pose if message.scan_pose is None else message.scan_pose
        if information is not None and not _is_information(information):
            return None
        if stated is not None and stated.shape != (3, 3):
            return None
        covariance = self._sigma if stated is None else to_triangle(stated)
        if information is None and not is_positive(covariance):
            return None
        x, y, yaw = pose.tolist()
        if not _finite(x, y, yaw):
            return None
        time, number = self._place(message)
        key = (time, number, 1, message.stamp, message.scan_id)
        mean: Pose2 = (x, y, wrap(yaw))
        return Fix(key, mean, covariance, information, message.prior_included)

    def _place(self, message: Pose) -> tuple[int, int]:
        """Return time and knot number of the scan that a correction belongs to."""
        place = self._scans.get((message.stamp, message.scan_id))
        if place is not None:
            return place
        history = self._history
        newest = history.newest
        if newest is None or (newest.odom is None and message.time > newest.time):
            history.append_scan(message.time)
            return history.place(message.time)
        return self._instant(message.stamp, message.time)

    def _instant(self, stamp: int, time: int) -> Place:
        """Return where a measurement belongs: at its stamp's odometry, else at its stamp, never after `time`."""
        known = self._stamps.get(stamp)
        if known is not None:
            return known
        return self._history.place(min(stamp, time))

    def _tell(self, counter: str, text: str) -> None:
        """Count, and report the first of its kind."""
        self.context.count(counter)
        if counter not in self._told:
            self._told.add(counter)
            self.context.report("warning", f"{text} (first of its kind; the summary counts them as {counter})")


def _remember(places: dict[Any, Place], key: Any, place: Place) -> None:
    places.pop(key, None)
    places[key] = place
    if len(places) > _MARKS:
        del places[next(iter(places))]


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


def _is_information(matrix: F64) -> bool:
    if not np.isfinite(matrix).all():
        return False
    values = np.linalg.eigvalsh(matrix)
    return bool(values[0] >= -1e-9 * max(1.0, values[-1]))
