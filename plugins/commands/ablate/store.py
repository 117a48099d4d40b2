"""What is kept of each run: a folder with its files and, written last, `result.json`."""

import io
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.evaluation.tum import StampedPoses, read_tum
from knotwork.core.files import write_atomic
from knotwork.plugins.commands.ablate.job import Outcome
from knotwork.plugins.commands.ablate.plan import Run

FORMAT = 1  # of result.json; grows when old ones must not be taken any more


@dataclass(frozen=True, slots=True)
class Stored:
    """One run on disk; `result` is empty when it has not been run (to its end)."""

    folder: Path
    result: dict[str, Any] = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Return whether it came to its end without an error."""
        return bool(self.result) and not self.result["error"]

    @property
    def error(self) -> str:
        """Return why it failed, "" if it did not."""
        return str(self.result.get("error", ""))

    def poses(self, name: str = "trajectory.tum") -> StampedPoses | None:
        """Return a trajectory of the run."""
        path = self.folder / name
        return read_tum(path) if path.is_file() else None

    def grid(self) -> tuple[NDArray[np.int8], float, tuple[float, float, float]] | None:
        """Return cells, resolution and origin of the final map, as in `messages.Grid`."""
        path = self.folder / "map.npz"
        if not path.is_file():
            return None
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            resolution, x, y, yaw = archive["frame"].tolist()
            return archive["cells"], resolution, (x, y, yaw)


class Store:
    """The folder of an ablation.

    Raises
    ------
    InputError
        It cannot be made.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.runs = out / "runs"
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the folder: {error.strerror}", where=str(out), hint="--out DIR") from error
        self._folders = {name.rpartition("-")[2]: self.runs / name for name in _names(self.runs)}

    def get(self, run: Run) -> Stored:
        """Return what is known of a run."""
        folder = self._folders.get(run.digest) or self.runs / f"{_slug(run.names.values())}-{run.digest}"
        try:
            result = json.loads((folder / "result.json").read_text())
        except (OSError, ValueError):
            return Stored(folder)
        whole = isinstance(result, dict) and (result.get("format"), result.get("digest")) == (FORMAT, run.digest)
        return Stored(folder, result if whole else {})

    def keep(self, run: Run, outcome: Outcome) -> Stored:
        """Write what a run gave; it counts from the moment its result.json is there.

        Raises
        ------
        KnotworkError
            It cannot be written.
        """
        folder = self.get(run).folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "result.json").unlink(missing_ok=True)
        except OSError as error:
            raise KnotworkError(f"cannot write: {error.strerror}", where=str(folder)) from error
        for name, data in outcome.files.items():
            write_atomic(folder / name, data)
        result = {"format": FORMAT, "digest": run.digest, "names": run.names, "error": outcome.error, **outcome.data}
        result = json.loads(json.dumps(_plain(result), default=str))
        write_atomic(folder / "result.json", (json.dumps(result, indent=1, allow_nan=False) + "\n").encode())
        self._folders[run.digest] = folder
        return Stored(folder, result)


def _names(folder: Path) -> Iterable[str]:
    return (one.name for one in folder.iterdir() if one.is_dir())


def _slug(names: Iterable[str]) -> str:
    text = "_".join(re.sub(r"[^A-Za-z0-9.+-]+", "-", name).strip("-.") for name in names)
    return text[:80] or "run"


def _plain(value: Any) -> Any:
    """Return what JSON can hold: no NaN or infinity (null instead)."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not np.isfinite(value) else value
