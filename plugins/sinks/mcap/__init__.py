"""Records every stream to an MCAP file, losslessly and as existing viewers read it."""

from typing import Literal

from pydantic import Field

from knotwork.core.manifest import Manifest, PluginConfig, Port, quantity


class McapConfig(PluginConfig):
    """What is recorded, where and how often it reaches the disk."""

    path: str = Field("log.mcap", description="file to write; a relative path is within the run's folder")
    compression: Literal["zstd", "lz4", "none"] = Field("zstd", description="of the chunks")
    level: int | None = quantity(
        None,
        "1",
        "compression level, higher is smaller and slower; the fastest if absent",
        ge=0,
        le=22,
    )
    chunk_size: int = quantity(65536, "B", "a chunk is closed when it holds this much", ge=1024, le=64 << 20)
    split_size: int = quantity(
        0, "B", "begin a new file when one has this much (log.0000.mcap, log.0001.mcap, ...); 0: never", ge=0
    )
    split_time: float = quantity(0.0, "s", "begin a new file after this much of the run's time; 0: never", ge=0)
    include: tuple[str, ...] = Field(("*",), description="streams to record, as `node.port` with * and ?")
    exclude: tuple[str, ...] = Field((), description="streams to leave out of these")
    views: bool = Field(True, description="also write what viewers draw without set-up: /tf, laser scans, grids, ...")
    flush: float = quantity(1.0, "s", "wall time after which messages are in the file at the latest", gt=0)
    fsync: float = quantity(5.0, "s", "wall time after which they survive a power cut; 0: left to the system", ge=0)


MANIFEST = Manifest(
    name="mcap",
    kind="sink",
    summary="records every stream to an MCAP file that survives a crash and opens in Foxglove",
    impl="knotwork.plugins.sinks.mcap.recorder:McapRecorder",
    config=McapConfig,
    inputs={"all": Port("*", many=True, summary="every stream of the pipeline")},
    requires=("mcap", "zstandard", "lz4", "foxglove_schemas_protobuf"),
    example="recorder: {plugin: mcap, exclude: ['camera.*']}",
)
