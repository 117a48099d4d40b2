"""The subcommand: arguments in, a table or JSON out."""

import json
import math
import sys
from typing import Any

from knotwork.core.contracts import Command
from knotwork.core.errors import InputError
from knotwork.core.evaluation import relations, trajectory_error
from knotwork.core.evaluation.tum import read_tum


class EvaluateCommand(Command):
    """`evaluate relations TRAJECTORY RELATIONS` and `evaluate trajectory EST REF`."""

    def arguments(self, parser: Any) -> None:
        """Add the two forms and their options."""
        forms = parser.add_subparsers(dest="form", required=True, metavar="{relations,trajectory}")

        form = forms.add_parser("relations", help="Kuemmerle et al. metrics against measured relations")
        form.add_argument("trajectory", metavar="TRAJECTORY", help="TUM file of robot poses")
        form.add_argument("relations", metavar="RELATIONS", help="file of `t1 t2 x y z roll pitch yaw` lines")
        _common(form, relations.TOLERANCE)

        form = forms.add_parser("trajectory", help="absolute and relative trajectory error against a reference")
        form.add_argument("estimate", metavar="EST", help="TUM file of the estimate")
        form.add_argument("reference", metavar="REF", help="TUM file of the reference")
        form.add_argument("--align", choices=("none", "se2"), default="none", help="move EST onto REF before ATE")
        _common(form, trajectory_error.TOLERANCE)

    def run(self, arguments: Any) -> int:
        """Score and write to standard output; raises InputError for files that cannot be used."""
        if not 0.0 <= arguments.tolerance < math.inf:
            raise InputError(f"expected 0 s or more, found {arguments.tolerance}", where="--tolerance")
        if arguments.form == "relations":
            poses = read_tum(arguments.trajectory)
            score = relations.score_relations(poses, relations.read_relations(arguments.relations), arguments.tolerance)
            table = _relations_table(score)
        else:
            score = trajectory_error.score_trajectory(
                read_tum(arguments.estimate),
                read_tum(arguments.reference),
                arguments.align,
                arguments.tolerance,
            )
            table = _trajectory_table(score)
        sys.stdout.write(json.dumps(score, indent=2) + "\n" if arguments.json else table)
        return 0


def _common(form: Any, tolerance: float) -> None:
    form.add_argument(
        "--tolerance",
        type=float,
        default=tolerance,
        metavar="S",
        help=f"to match stamps; default {tolerance} s",
    )
    form.add_argument("--json", action="store_true", help="write JSON")


def _relations_table(score: dict[str, Any]) -> str:
    head = ("", "used", "missed", "trans [m]", "trans^2 [m^2]", "rot [deg]", "rot^2 [deg^2]")
    rows: list[tuple[str, ...]] = [head]
    for name, part in (
        ("all", score),
        ("|t2 - t1| < 10 s", score["short"]),
        ("|t2 - t1| > 60 s", score["long"]),
    ):
        cells = [name, str(part["used"]), str(part["missed"])]
        for key, unit in (("trans_abs", "m"), ("trans_sq", "m2"), ("rot_abs", "deg"), ("rot_sq", "deg2")):
            cells.append(_spread(part[f"{key}_mean_{unit}"], part[f"{key}_std_{unit}"]))
        rows.append(tuple(cells))
    return _aligned(rows) + "mean +- standard deviation\n"


def _trajectory_table(score: dict[str, Any]) -> str:
    rows: list[tuple[str, ...]] = [("", "pairs", "rmse", "mean +- std", "median", "max")]
    names = (("ate", "absolute"), ("rpe_frame", "per frame"), ("rpe_metre", "per metre"))
    for key, name in names:
        for part, unit in (("trans", "m"), ("rot", "deg")):
            figures = score[key]
            rmse, mean, std, median, largest = (
                figures[f"{part}_{what}_{unit}"] for what in ("rmse", "mean", "std", "median", "max")
            )
            cells = (
                str(figures["pairs"]),
                _number(rmse),
                _spread(mean, std),
                _number(median),
                _number(largest),
            )
            rows.append((f"{name} [{unit}]", *cells))
    note = f"{score['matched']} poses matched, {score['missed']} missed, alignment: {score['align']}\n"
    return _aligned(rows) + note


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _spread(mean: float | None, std: float | None) -> str:
    return "-" if mean is None else f"{_number(mean)} +- {_number(std)}"


def _aligned(rows: list[tuple[str, ...]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(lines) + "\n"
