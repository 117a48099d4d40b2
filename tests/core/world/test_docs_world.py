"""The world file printed in the documentation is one."""

import re
from pathlib import Path

from knotwork.core.world.files import parse_world
from knotwork.core.world.raycast import RayCaster


def test_the_documented_world_can_be_driven_in():
    page = (Path(__file__).parents[3] / "docs" / "worlds.md").read_text()
    world = parse_world(re.search(r"```yaml\n(name: .*?)```", page, re.DOTALL)[1])
    assert RayCaster(world).clearances(world.paths["tour"]).min() > 0.105
    for key, count in (("segments", world.segments), ("arcs", world.arcs)):
        assert len(count) > 0, key
