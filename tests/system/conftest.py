import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

KNOTWORK = [sys.executable, "-P", "-m", "knotwork"]


@pytest.fixture(scope="session")
def knotwork() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in a process of its own."""

    def run(*argv: str | Path, **options) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*KNOTWORK, *map(str, argv)], capture_output=True, text=True, timeout=300, check=False, **options
        )

    return run


@pytest.fixture(scope="session")
def start() -> Callable[..., subprocess.Popen[str]]:
    """Start the command line and go on."""

    def begin(*argv: str | Path) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*KNOTWORK, *map(str, argv)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )

    return begin
