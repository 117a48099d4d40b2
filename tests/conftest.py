import os
from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is slow, not wrong: no example has a time limit.
settings.register_profile("knotwork", deadline=None)
settings.load_profile("knotwork")

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def data() -> Path:
    """The recorded logs: KNOTWORK_DATA, else ../shared/data beside the checkout."""
    folder = Path(os.environ.get("KNOTWORK_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "intel").is_dir():
        pytest.skip(f"no recorded logs at {folder} (set KNOTWORK_DATA)")
    return folder
