"""Convert a recording to MCAP, losslessly and as viewers draw it."""

import tempfile
from pathlib import Path
from typing import Any

from knotwork.core import config
from knotwork.core.cli.main import main
from knotwork.core.errors import InputError
from knotwork.plugins.commands.data.formats import recognise


def arguments(parser: Any) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a recording that a driver reads; not changed")
    parser.add_argument("--output", type=Path, metavar="PATH", help="where to write instead of FILE.mcap")
    parser.add_argument("--driver", metavar="PLUGIN", help="driver that reads it (default: told by its content)")
    parser.add_argument(
        "--set",
        dest="keys",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="a key of the driver's config, e.g. mount=[0.1,0,0]; may be repeated",
    )


def run(arguments: Any) -> int:
    """Run a pipeline of the driver and a recorder."""
    path: Path = arguments.file
    output = (arguments.output or path.with_name(path.name + ".mcap")).absolute()
    driver = arguments.driver
    if driver is None:
        driver = recognise(path).driver
    if output.exists() and output.samefile(path):
        raise InputError("the output must be another file than the recording", where=str(output))
    nodes = {
        "log": {"plugin": driver, "path": _escaped(str(path))},
        "recorder": {"plugin": "mcap", "path": _escaped(str(output))},
    }
    with tempfile.TemporaryDirectory(prefix="knotwork-convert-") as folder:
        file = Path(folder) / "convert.yaml"
        file.write_text(config.dump({"pipeline": "convert", "nodes": nodes}))
        overrides = [part for text in arguments.keys for part in ("--set", f"nodes.log.{text}")]
        code = main(["run", str(file), "--out", str(Path(folder) / "out"), "--quiet", *overrides])
    if code == 0:
        return main(["log", "info", str(output)])
    return code


def _escaped(text: str) -> str:
    return text.replace("${", "$${")
