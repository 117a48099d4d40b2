"""The examples of docs/splines.md run as they stand and say what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[3] / "docs" / "splines.md"


def test_examples_of_the_page(tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) >= 6
    page = tmp_path / "page.py"  # the kernel example needs a file to be cached beside
    page.write_text("\n".join(blocks))
    space: dict = {"__name__": "page", "__file__": str(page)}
    exec(compile(page.read_text(), str(page), "exec"), space)
    assert space["basis"].domain(8) == pytest.approx((0.3, 0.8))
    assert space["clearance_of"](space["path"], space["walls"]) >= 0.15 - 1e-6
    tau = np.linspace(*space["curve"].domain, 50)
    np.testing.assert_allclose(space["fine"](tau), space["both"](tau), atol=1e-9)
    assert space["mean_height"](*space["surface"].control.arrays(), 0.5, space["points"]) == pytest.approx(
        space["surface"](space["points"]).mean()
    )
    for name in re.findall(r"\]\((pictures/[^)]+)\)", PAGE.read_text()):
        assert (PAGE.parent / name).is_file()
