"""Sinks that a robot runs for days do not grow with the time it drives."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from knotwork.core.messages import Pose
from knotwork.plugins.sinks.map_image import MapImageConfig
from knotwork.plugins.sinks.map_image.image import MapImage
from knotwork.plugins.sinks.summary import SummaryConfig
from knotwork.plugins.sinks.summary.writer import SummaryWriter
from knotwork.plugins.sinks.trajectory import TrajectoryConfig
from knotwork.plugins.sinks.trajectory.writer import TrajectoryWriter

SINKS = [(TrajectoryWriter, TrajectoryConfig), (MapImage, MapImageConfig), (SummaryWriter, SummaryConfig)]
SCANS = 10_000  # half an hour


@pytest.mark.parametrize(("sink", "config"), SINKS, ids=lambda each: each.__name__)
def test_later_scans_take_no_more_than_the_first(tmp_path, sink, config):
    node = sink(SimpleNamespace(out=tmp_path, config=config(), run={}, report=print, count=print))
    tracemalloc.start()
    sizes = []
    for first in (0, SCANS, 2 * SCANS):
        for i in range(first, first + SCANS):
            where = np.array([0.01 * i, 0.02 * i, 0.003 * i])
            message = Pose(stamp=200_000_000 * i, role="estimate", pose=where, scan_id=i)
            node.on_message("localizer.pose", message.sealed(message.stamp, i))
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    node.close()
    # The picture's path swings between 4096 and 8192 poses of 300 bytes; kept poses would be 3 MB more each time.
    assert max(sizes) - sizes[0] < 1_500_000
    assert sizes[2] - sizes[1] < 1_500_000
