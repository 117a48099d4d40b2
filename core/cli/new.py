"""`knotwork new plugin NAME --kind KIND`: a third-party package that passes the conformance kit as made.

The templates are a whole plugin called my-plugin; making one renames it.
"""

import argparse
import importlib.util
import keyword
import re
import sys
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from knotwork.core.errors import InputError, KnotworkError
from knotwork.core.manifest import KINDS
from knotwork.core.registry import Registry

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_LONGEST = 40  # characters


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add `plugin`, NAME, --kind, --dir."""
    parser.add_argument("what", choices=["plugin"], help="what to make")
    parser.add_argument("name", metavar="NAME", help="its name in pipeline files, like my-plugin")
    parser.add_argument("--kind", choices=KINDS, required=True, help="what it is")
    parser.add_argument("--dir", metavar="DIR", default=".", help="where the folder NAME is made (default: here)")


def run(arguments: argparse.Namespace) -> int:
    """Make it and say what to do next."""
    name, kind = arguments.name, arguments.kind
    check_name(name, kind)
    folder = Path(arguments.dir) / name
    made = write(name, kind, folder)
    out = sys.stdout.write
    out("".join(f"{path}\n" for path in made))
    out(f"next: cd {folder} && pip install -e '.[test]' && pytest\n")
    return 0


def check_name(name: str, kind: str) -> None:
    """Refuse a name that would not work.

    Raises
    ------
    InputError
        It is ill-formed, or taken by an installed plugin, a package or a command.
    """
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        raise InputError(
            f"{name!r} cannot name a plugin: expected lower-case letters and digits in words joined by `-`, "
            f"a letter first, at most {_LONGEST} characters",
            where="NAME",
            hint="like my-plugin",
        )
    registry = Registry()
    record = registry.record(name)
    if record is not None:
        raise InputError(f"there is a plugin {name!r} already, of {record.distribution}", where="NAME")
    if importlib.util.find_spec(package_of(name)) is not None:
        raise InputError(f"there is a package {package_of(name)} already", where="NAME")
    if keyword.iskeyword(class_of(name)):
        raise InputError(f"{class_of(name)} is a word of Python and cannot name a class", where="NAME")
    if kind == "command":
        from knotwork.core.cli.main import OWN

        if name in {command.name for command in OWN}:
            raise InputError(f"`knotwork {name}` exists already", where="NAME")


def package_of(name: str) -> str:
    """Return the import name of the package: my-plugin is in knotwork_my_plugin."""
    return f"knotwork_{name.replace('-', '_')}"


def class_of(name: str) -> str:
    """Return the name of the class: MyPlugin."""
    return "".join(word.capitalize() for word in name.split("-"))


def write(name: str, kind: str, folder: Path) -> list[Path]:
    """Write the package into `folder`, which must not exist yet; returns its files.

    Raises
    ------
    InputError
        The folder exists, or cannot be made.
    KnotworkError
        A file cannot be written.
    """
    templates = files("knotwork.core.cli") / "templates"
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise InputError("exists already", where=str(folder), hint="choose another NAME or --dir") from error
    except OSError as error:
        raise InputError(f"cannot make the folder: {error.strerror}", where=str(folder)) from error
    made: list[Path] = []
    try:
        for root in (templates / "common", templates / kind):
            for path, content in _files(root, ""):
                target = folder / render(path.removesuffix(".in"), name, kind)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(render(content, name, kind))
                made.append(target)
    except OSError as error:
        raise KnotworkError(f"cannot write: {error.strerror}", where=str(error.filename or folder)) from error
    return sorted(made)


def render(text: str, name: str, kind: str) -> str:
    """Return a template's text, or path, with my-plugin renamed."""
    how = f"knotwork {name} --help" if kind == "command" else "knotwork run pipeline.yaml"
    replaced = {
        "my-plugin": name,
        "my_plugin": name.replace("-", "_"),
        "MyPlugin": class_of(name),
        "KIND": kind,
        "MODULE": kind,
        "HOW": how,
    }
    return re.sub("|".join(replaced), lambda found: replaced[found[0]], text)


def _files(folder: Traversable, path: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for entry in folder.iterdir():
        below = f"{path}/{entry.name}" if path else entry.name
        if entry.is_dir():
            found += _files(entry, below)
        elif entry.name.endswith(".in"):
            found.append((below, entry.read_text()))
    return found
