"""Pipeline files: loaded strictly, resolved with the origin of every value, described as a schema.

`load(path, registry, overrides)` reads a file, merges what it includes, applies `--set` arguments,
replaces references and checks everything against the models of the manifests. It gives a `Pipeline`
or raises one `ConfigError` with all problems. The registry is anything that has the three methods of
`Manifests`. `Pipeline.where("nodes.map.uses.prior")` gives the place for errors found later.

`show(pipeline, origin=True)` is the resolved file with the origin of each value, `dump(resolved)` can be
loaded again, `mask` hides secrets before either is stored. `json_schema` and `reference` describe the
plugins of a registry. Nothing here imports NumPy or a plugin's implementation.
"""

from knotwork.core.config.model import Clock, Manifests, NodeSpec, Origin, Pipeline, Queue
from knotwork.core.config.overrides import Change
from knotwork.core.config.reference import reference
from knotwork.core.config.render import dump, mask, show
from knotwork.core.config.resolve import load
from knotwork.core.config.schema import json_schema

__all__ = [
    "Change",
    "Clock",
    "Manifests",
    "NodeSpec",
    "Origin",
    "Pipeline",
    "Queue",
    "dump",
    "json_schema",
    "load",
    "mask",
    "reference",
    "show",
]
