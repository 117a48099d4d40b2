"""A few manifests in the style of real plugins, and a registry that holds them."""

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field, model_validator

from knotwork.core.manifest import Manifest, PluginConfig, Port, Use, quantity

Positive = Annotated[float, Field(gt=0)]


class MapKeys(PluginConfig):
    resolution: tuple[Positive, ...] = quantity((0.3, 0.125, 0.05), "m", "cell sides, coarse to fine", min_length=1)
    range_min: float = quantity(0.05, "m", "nearer returns are ignored", ge=0)
    range_max: float = quantity(40.0, "m", "returns beyond count as none", gt=0)
    fuse: bool = Field(True, description="false: localise only")
    save: str = Field("", description="file to write")

    @model_validator(mode="after")
    def _ordered(self) -> "MapKeys":
        if self.range_min >= self.range_max:
            raise ValueError("range_min must be less than range_max")
        return self


class SplineOptions(PluginConfig):
    degree: int = quantity(3, "1", "of the spline", ge=1, le=5)
    loss: Literal["none", "huber", "cauchy"] = Field("none", description="robust loss")


class GridOptions(PluginConfig):
    kernel: Literal["bilinear", "nearest"] = Field("bilinear", description="interpolation")


class LogKeys(PluginConfig):
    path: str = Field(description="the log file")
    pitch: float = quantity(0.0, "rad", "of the laser")


class Mount(PluginConfig):
    x: float = quantity(0.0, "m", "forward")
    yaw: float = quantity(0.0, "rad", "left")


class RigKeys(PluginConfig):
    """Everything a config model may hold."""

    mount: Mount = Mount()
    mounts: dict[str, Mount] = Field({}, description="by sensor")
    beams: list[Mount] = Field([], description="one per beam")
    port: str | int = Field("/dev/ttyUSB0", description="name or number")
    folder: Path = Field(Path("runs"), description="where to write")
    token: str = Field("", description="of the server")
    limit: float | None = quantity(None, "m/s", "none: no limit", gt=0)


class PriorKeys(PluginConfig):
    noise: float = quantity(0.1, "m", "of odometry", gt=0)


class FaultyKeys(PluginConfig):
    x: float = Field(1.0, description="divisor")

    @model_validator(mode="after")
    def _divide(self) -> "FaultyKeys":
        1 / self.x
        return self


class ClashKeys(PluginConfig):
    queue: int = 1


MAP_PORTS = {"outputs": {"grid": Port("grid")}, "provides": ("map",)}
MANIFESTS = (
    Manifest("carmen", "driver", "a log", "x:X", LogKeys, outputs={"scan": Port("scan"), "odom": Port("odometry")}),
    Manifest("rig", "driver", "a robot", "x:X", RigKeys, outputs={"scan": Port("scan", summary="of the lidar")}),
    Manifest("spline-surface", "map", "a surface", "x:X", MapKeys, SplineOptions, **MAP_PORTS),
    Manifest("grid", "map", "cells", "x:X", MapKeys, GridOptions, **MAP_PORTS, example="map: {plugin: grid}"),
    Manifest("ekf", "observer", "a prior", "x:X", PriorKeys, inputs={"odom": Port("odometry")}, provides=("prior",)),
    Manifest(
        "gauss-newton",
        "localizer",
        "aligns scans",
        "x:X",
        inputs={"scan": Port("scan", summary="to align")},
        outputs={"pose": Port("pose", role="estimate")},
        uses={"map": Use("map"), "prior": Use("prior", optional=True, summary="where to begin")},
    ),
    Manifest("mcap", "sink", "a log file", "x:X", inputs={"messages": Port("*", many=True)}, extra="mcap"),
    Manifest("faulty", "sink", "its check fails", "x:X", FaultyKeys),
    Manifest("clash", "sink", "uses a reserved key", "x:X", ClashKeys),
    Manifest("doctor", "command", "looks after the robot", "x:X"),
)


class Shelf:
    """Manifests in memory; `cameras` is installed and broken."""

    def __init__(self, manifests=MANIFESTS):
        self.manifests = {one.name: one for one in manifests}

    def find(self, name):
        return self.manifests.get(name)

    def names(self, kind=None):
        return [one.name for one in self.manifests.values() if kind in (None, one.kind)]

    def why_not(self, name):
        return "needs opencv: pip install knotwork[vision]" if name == "cameras" else ""


@pytest.fixture(scope="session")
def shelf():
    return Shelf()


VALID = """\
pipeline: intel-surface
description: the Intel lab
clock: replay
rate: max
vars:
  log: "${DATA:-data}/intel.clf"
  far: 30.0
nodes:
  log: {plugin: carmen, path: "${log}"}
  prior: {plugin: ekf}
  map:
    plugin: spline-surface
    resolution: [0.30, 0.125, 0.05]
    range_max: ${far}
    options:
      spline-surface: {degree: 2}
      grid: {kernel: nearest}
  localizer:
    plugin: gauss-newton
    uses: {map: map, prior: prior}
    inputs: {scan: log.scan}
  recorder: {plugin: mcap, queue: {size: 1000, policy: block}}
"""


@pytest.fixture(scope="session")
def valid():
    return VALID


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write files into the current folder, so that messages show short names."""
    monkeypatch.chdir(tmp_path)

    def put(text, name="p.yaml"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return name

    return put
