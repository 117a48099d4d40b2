"""What stands in an ablation file."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

MAX_RUNS = 10_000


class _Keys(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class AblationKeys(_Keys):
    """Keys of an ablation file beside `include` and `vars`."""

    ablation: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=100, description="name of the ablation")
    description: str = Field("", description="one line for people")
    base: str = Field(min_length=1, description="pipeline file, relative to this one; configs:NAME for one that ships")
    set: dict[str, Any] = Field({}, description="config keys that are the same in every run")
    axes: dict[str, list[Any]] = Field(min_length=1, description="what is varied: a list of values for each axis")
    average: list[str] = Field([], description="axes the table averages over (seeds)")
    metrics: list[Any] = Field(
        ["trans_m", "rot_deg", "localise_ms", "update_ms", "map_bytes", "lost_scans"],
        min_length=1,
        description="columns of the table",
    )


class NamedValue(_Keys):
    """A value of an axis that sets several keys, and what its runs are scored against."""

    name: str = Field(min_length=1, max_length=100, description="how it is called in the table")
    set: dict[str, Any] = Field({}, description="config keys and their values")
    relations: str = Field("", description="file of measured relations the runs are scored against")
    reference: str = Field("", description="trajectory (TUM or `stamp x y yaw`) the runs are scored against")


class CustomMetric(_Keys):
    """A figure of a run's `result.json` as a column."""

    name: str = Field(min_length=1, max_length=60, description="its column")
    key: str = Field(min_length=1, description="dotted path in result.json, e.g. statistics.nodes.prior.mean_ms")
    unit: str = Field("", description="shown behind the name")
