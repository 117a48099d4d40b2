"""Pipeline files: loaded strictly, resolved with the origin of every value, described as a schema."""

from knotwork.core.config.model import Clock, Manifests, NodeSpec, Origin, Pipeline, Queue
from knotwork.core.config.reference import reference
from knotwork.core.config.render import dump, mask, show
from knotwork.core.config.resolve import load
from knotwork.core.config.schema import json_schema

__all__ = [
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
