"""Work in parts: spread over processes, each part kept in a file, so that a broken run goes on where it was."""

import json
import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from knotwork.core.errors import InputError

FORMAT = 2  # of the files; grows when old parts must not be taken any more


@dataclass(frozen=True, slots=True)
class Part:
    """A block of scenarios of one kind."""

    setting: str
    disturbance: str
    mode: str
    n: int
    seed: int
    first: int
    count: int

    @property
    def file(self) -> str:
        """Name of its file."""
        return "-".join(str(value) for value in asdict(self).values()).replace("+", "p") + ".json"


def run_parts(parts: list[Part], work: Callable[[Part], Any], folder: Path, jobs: int) -> dict[Part, Any]:
    """Return the result of each part, from its file or from `work` (a function of a module).

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder: {error.strerror}", where=str(folder)) from error
    results = {part: found for part in parts if (found := _kept(folder, part)) is not None}
    missing = [part for part in parts if part not in results]
    jobs = min(jobs or os.cpu_count() or 1, max(len(missing), 1))
    if jobs == 1:
        for part in missing:
            results[part] = _keep(folder, part, work(part))
            _progress(len(results), len(parts))
    elif missing:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=context) as pool:
            futures = {pool.submit(work, part): part for part in missing}
            for future in as_completed(futures):
                part = futures[future]
                results[part] = _keep(folder, part, future.result())
                _progress(len(results), len(parts))
    return results


def write_json(path: Path, data: Any) -> None:
    """Write a file whole or not at all."""
    scratch = path.with_suffix(".tmp")
    scratch.write_text(json.dumps(data, indent=1) + "\n")
    scratch.replace(path)


def _kept(folder: Path, part: Part) -> Any:
    try:
        data = json.loads((folder / part.file).read_text())
    except (OSError, ValueError):
        return None
    same = isinstance(data, dict) and data.get("format") == FORMAT and data.get("part") == asdict(part)
    return data["result"] if same else None


def _keep(folder: Path, part: Part, result: Any) -> Any:
    write_json(folder / part.file, {"format": FORMAT, "part": asdict(part), "result": result})
    return result


def _progress(done: int, total: int) -> None:
    if sys.stderr.isatty() or done == total:
        filled = 40 * done // total
        end = "\n" if done == total else ""
        sys.stderr.write(f"\r[{'#' * filled}{'.' * (40 - filled)}] {done}/{total} parts{end}")
        sys.stderr.flush()
