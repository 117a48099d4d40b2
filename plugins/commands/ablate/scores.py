"""How accurate a finished run is: against relations, the log's true poses, a reference trajectory.

Scored from the stored trajectory each time a table is written, so other metrics need no new run.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from knotwork.core.errors import InputError
from knotwork.core.evaluation import relations as by_relations
from knotwork.core.evaluation.se2 import relative
from knotwork.core.evaluation.trajectory_error import score_trajectory
from knotwork.core.evaluation.tum import StampedPoses, read_tum
from knotwork.core.messages import F64
from knotwork.plugins.commands.ablate.plan import Run
from knotwork.plugins.commands.ablate.store import Stored

_read_relations = lru_cache(maxsize=16)(by_relations.read_relations)
_read_reference = lru_cache(maxsize=16)(read_tum)
_TOLERANCE = 0.01  # s, to match a reference's stamps


@dataclass(slots=True)
class Scores:
    """Figures by group ("relations", "truth", "reference"), what could not be scored, and the errors to plot."""

    figures: dict[str, dict[str, Any]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    errors: F64 = field(default_factory=lambda: np.empty(0))  # m: of relations, else of positions
    errors_of: str = ""


def score(run: Run, stored: Stored) -> Scores:
    """Score a run; one that has no trajectory gets empty scores."""
    scores = Scores()
    estimate = stored.poses() if stored.finished else None
    if estimate is None:
        return scores
    if run.relations:
        try:
            measured = _read_relations(run.relations)
            scores.figures["relations"] = by_relations.score_relations(estimate, measured)
            trans, _, used = by_relations.relation_errors(estimate, measured)
            scores.errors, scores.errors_of = trans[used], "relations"
        except InputError as error:
            scores.problems.append(str(error))
    truth, matched = stored.poses("truth.tum"), stored.poses("estimate.tum")
    if truth is not None and matched is not None:
        distance, turn = _to_truth(matched, truth)
        scores.figures["truth"] = {
            "position_rms_m": float(np.sqrt((distance**2).mean())),
            "position_max_m": float(distance.max()),
            "heading_rms_deg": float(np.degrees(np.sqrt((turn**2).mean()))),
        }
        if not scores.errors_of:
            scores.errors, scores.errors_of = distance, "true poses"
    if run.reference:
        try:
            error_of = score_trajectory(estimate, _read_reference(run.reference), "se2", _TOLERANCE)["ate"]
            scores.figures["reference"] = {
                "position_rms_m": error_of["trans_rmse_m"],
                "heading_rms_deg": error_of["rot_rmse_deg"],
            }
        except InputError as error:
            scores.problems.append(str(error))
    return scores


def _to_truth(estimate: StampedPoses, truth: StampedPoses) -> tuple[F64, F64]:
    """Return distances [m] and turns [rad] between pairs of poses; nothing is aligned."""
    error = relative(truth.poses, estimate.poses)
    return np.hypot(error[:, 0], error[:, 1]), error[:, 2]
