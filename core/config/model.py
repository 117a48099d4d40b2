"""A pipeline as it was resolved, and the keys that the framework itself understands."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, ConfigDict, Field

from knotwork.core.manifest import Manifest

Clock = Literal["auto", "replay", "sim", "real"]
NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"  # of nodes and variables; a dot would be a port


class Manifests(Protocol):
    """Where the loader finds plugins: the registry, or a few manifests in a test."""

    def find(self, name: str) -> Manifest | None:
        """Return the manifest of a usable plugin."""

    def names(self, kind: str | None = None) -> list[str]:
        """Return the names of the usable plugins, of one kind or of all."""

    def why_not(self, name: str) -> str:
        """Return why an installed plugin cannot be used ("needs python-can: ..."); "" for an unknown name."""


class _Keys(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Queue(_Keys):
    """A bounded queue at a thread border."""

    size: int = Field(100, ge=1, le=1_000_000, description="messages it holds", json_schema_extra={"unit": "messages"})
    policy: Literal["block", "drop-oldest", "latest"] | None = Field(
        None, description="what happens when it is full; null: block in replay, drop-oldest otherwise"
    )


class PipelineKeys(_Keys):
    """Keys of a pipeline file beside `include`, `vars` and `nodes`."""

    pipeline: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=100,
        description="name of the pipeline: letters, digits, '.', '_' and '-'",
    )
    description: str = Field("", description="one line for people")
    clock: Clock = Field("auto", description="which clock drives the run; auto: by the drivers")
    rate: Literal["max"] | Annotated[float, Field(gt=0)] = Field(
        "max", description="pace of a replay as a multiple of sensor time", json_schema_extra={"unit": "1"}
    )
    seed: int = Field(0, ge=0, lt=1 << 64, description="of every random number of the run")


class NodeKeys(_Keys):
    """Keys of a node that the framework understands; every other key goes to the plugin's config."""

    plugin: str = Field(description="name of the plugin")
    uses: dict[str, str] = Field({}, description="nodes whose state it asks, by the plugin's use name")
    inputs: dict[str, str | list[str]] = Field(
        {},
        description="producers by input port: 'node.port', 'node' or a list of them; inferred when left out",
    )
    options: dict[str, dict[str, Any]] = Field(
        {}, description="keys that one backend alone understands, by plugin name; the chosen one's apply"
    )
    queue: Queue | None = Field(None, description="queue before this node, where it has a thread of its own")
    worker: bool = Field(False, description="runs in a thread of its own on the latest input (clock real)")


RESERVED = frozenset(NodeKeys.model_fields)


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """One node, checked.

    Attributes
    ----------
    config, options
        Instances of the manifest's models; `options` is None for a plugin without an options model.
    uses
        Node names by use name, as written; the graph adds what it infers.
    inputs
        Producers by port, as written: each "node.port" or "node".
    """

    name: str
    plugin: str
    manifest: Manifest
    config: BaseModel
    options: BaseModel | None
    uses: dict[str, str]
    inputs: dict[str, tuple[str, ...]]
    queue: Queue | None
    worker: bool


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a value came from: a place in a file or an argument, what it came through, or a default."""

    where: str
    via: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Render as `file:line:column via var log, env HOME`."""
        return " via ".join(part for part in (self.where, ", ".join(self.via)) if part)


@dataclass(frozen=True, slots=True)
class Pipeline:
    """A resolved pipeline; two are equal when they run the same, wherever their values came from.

    Attributes
    ----------
    rate
        Multiple of sensor time a replay is paced to; "max" as fast as possible.
    resolved
        Plain data that, written as YAML (`knotwork.core.config.dump`) and loaded, gives an equal pipeline.
    origins
        Origin of each value of `resolved` by dotted key path.
    places
        Where each key of the files stands, by dotted key path.
    """

    name: str
    description: str
    clock: Clock
    rate: float | Literal["max"]
    seed: int
    nodes: dict[str, NodeSpec]
    resolved: dict[str, Any]
    origins: dict[str, Origin] = field(compare=False)
    places: dict[str, str] = field(compare=False)
    path: str = field(compare=False)

    def where(self, key: str) -> str:
        """Return `file:line:column` (or the argument) of a key path, or of what is nearest above it."""
        while key:
            if key in self.places:
                return self.places[key]
            key = key.rpartition(".")[0]
        return self.places.get("", self.path)
