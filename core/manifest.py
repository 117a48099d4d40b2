"""What a plugin says about itself before it is imported: a manifest, light enough to list and validate.

A plugin is a package whose `__init__` holds a `MANIFEST` and its pydantic config model and imports
neither NumPy nor its own implementation; `impl` names the class that a pipeline imports when it runs.
"""

from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

CONTRACT_VERSION = 1  # grows when a plugin written for the last one must change

Kind = Literal["driver", "map", "localizer", "observer", "policy", "sink", "command"]
KINDS: tuple[Kind, ...] = ("driver", "map", "localizer", "observer", "policy", "sink", "command")


class PluginConfig(BaseModel):
    """Base of every plugin's config: frozen, unknown keys refused; every number states its unit."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


def quantity(default: Any, unit: str, description: str, **bounds: Any) -> Any:
    """Describe a number of a config model: default (`...` for required), unit ("m", "rad", "1"), meaning, bounds."""
    return Field(default, description=description, json_schema_extra={"unit": unit}, **bounds)


@dataclass(frozen=True, slots=True)
class Port:
    """A stream a node takes or gives.

    Attributes
    ----------
    message
        Type name of its messages ("scan"); "*" on a sink's input takes everything.
    role
        For poses: "prior", "estimate" or "truth"; "" for any.
    optional
        The node works without it.
    feedback
        May close a cycle (a pose back to the prior).
    many
        Takes every producer that fits instead of exactly one.
    """

    message: str
    role: str = ""
    optional: bool = False
    feedback: bool = False
    many: bool = False
    summary: str = ""


@dataclass(frozen=True, slots=True)
class Use:
    """Another node's queryable state, through a protocol of `knotwork.core.contracts` ("map", "prior")."""

    protocol: str
    optional: bool = False
    summary: str = ""


@dataclass(frozen=True, slots=True)
class Manifest:
    """Everything the framework knows of a plugin before it runs.

    Attributes
    ----------
    name, kind, summary
        Name in the YAML, kind, one line of meaning.
    impl
        `package.module:Class`, imported only when a pipeline configures it.
    config, options
        Config models: the node's own keys, and the keys only this backend understands
        (`options: {<plugin>: {...}}` in the YAML).
    inputs, outputs
        Ports by name. An input `scan` is handled by the method `on_scan`.
    uses, provides
        Protocols of other nodes it needs, and the protocols it offers ("map", "prior").
    ports
        `package.module:function` that returns the outputs of one node from its config, for a plugin whose
        outputs are what a file holds; "" when `outputs` says it all.
    push
        It gives what the world gives it (a device, a person): a driver that pushes from its own thread is
        refused in replay and sim; a replay takes the node's messages from the log.
    closed_loop
        A driver that is a simulated world: its commands come back within the same run.
    extra
        Extra of the distribution that must be installed (`pip install knotwork[can]`).
    requires
        Import names that must be present for `impl` to load.
    message_types
        Message types the plugin adds: name to `package.module:Class`.
    kernels
        Modules with compiled kernels that `knotwork warm` compiles.
    """

    name: str
    kind: Kind
    summary: str
    impl: str
    config: type[BaseModel] = PluginConfig
    options: type[BaseModel] | None = None
    inputs: dict[str, Port] = field(default_factory=dict)
    outputs: dict[str, Port] = field(default_factory=dict)
    uses: dict[str, Use] = field(default_factory=dict)
    provides: tuple[str, ...] = ()
    push: bool = False
    closed_loop: bool = False
    extra: str = ""
    requires: tuple[str, ...] = ()
    message_types: dict[str, str] = field(default_factory=dict)
    example: str = ""
    contract: int = CONTRACT_VERSION
    ports: str = ""

    def of(self, config: Any) -> Self:
        """Return the manifest of a node with this config: its outputs are known then.

        Raises
        ------
        KnotworkError
            The config names something the outputs cannot be read from.
        """
        if not self.ports:
            return self
        module, _, function = self.ports.partition(":")
        return replace(self, outputs=getattr(import_module(module), function)(config))

    @property
    def external(self) -> bool:
        """Whether its messages come from outside the run: a replay takes them from the log."""
        return bool(self.outputs or self.ports) and (self.kind in ("driver", "sink") or self.push)
