"""The data sets: names, public addresses, licences, checksums; `datasets.yaml` or a file of the user's own."""

from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from knotwork.core.errors import InputError

_OWN = "datasets.yaml"


class _Keys(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RemoteFile(_Keys):
    """One file: its address and, where it is known, its checksum."""

    url: str = Field(pattern=r"^https?://")
    sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")


class DataSet(_Keys):
    """One data set: files by the name they are kept under."""

    name: str = ""
    summary: str
    licence: str
    thanks: str = ""
    driver: str = ""
    files: dict[str, RemoteFile]


def add_argument(parser: Any) -> None:
    """Add --catalogue."""
    parser.add_argument(
        "--catalogue", type=Path, metavar="FILE", help="another list of data sets (YAML), as of a laboratory's own"
    )


def catalogue(path: Path | None) -> dict[str, DataSet]:
    """Return the data sets by name.

    Raises
    ------
    InputError
        The file cannot be read or is no such list.
    """
    where = str(path) if path is not None else _OWN
    try:
        text = path.read_text() if path is not None else files(__package__).joinpath(_OWN).read_text()
        given = yaml.safe_load(text)
        if not isinstance(given, dict):
            raise InputError("expected a mapping of data sets by name", where=where)
        for name in given:
            if not str(name).replace("-", "").replace("_", "").isalnum():
                raise InputError(f"{name!r} is no name of a data set", where=where, hint="letters, digits, - and _")
        return {str(name): DataSet.model_validate({"name": str(name), **keys}) for name, keys in given.items()}
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", where=where) from error
    except yaml.YAMLError as error:
        raise InputError(f"not YAML: {str(error).splitlines()[0]}", where=where) from error
    except (ValidationError, TypeError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else {"loc": (), "msg": str(error)}
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{place}: {first['msg']}", where=where) from error
