"""Files: found, read as text, included, merged; a later file wins."""

import os
import stat
from importlib.resources import files
from pathlib import Path as FilePath

from knotwork.core.config.tree import MAX_SIZE, Item, Path, Problems, container
from knotwork.core.config.yaml_source import MAX_BYTES, compose

SHIPPED = "configs:"  # `configs:radish` is a file that ships with the package
MAX_FILES = 64


class Sources:
    """Reads a file and what it includes.

    Parameters
    ----------
    problems
        Takes what can be survived; what cannot is raised as ConfigError.
    what, needs
        What the file should be and the keys it cannot do without, for messages.
    """

    def __init__(self, problems: Problems, what: str = "a pipeline", needs: str = "`pipeline:` and `nodes:`") -> None:
        self.problems = problems
        self.what = what
        self.needs = needs
        self.count = 0

    def gather(self, name: str, included_at: str = "", chain: tuple[str, ...] = ()) -> Item:
        """Return the tree of the file `name` merged over what it includes."""
        if "\0" in name:
            raise self.problems.fatal(included_at or "the file's name", "", "it holds a null character")
        identity = name if name.startswith(SHIPPED) else os.path.realpath(name)
        if identity in chain:
            shown = " -> ".join(_label(one) for one in (*chain[chain.index(identity) :], identity))
            raise self.problems.fatal(included_at, "include", f"files include each other: {shown}")
        self.count += 1
        if self.count > MAX_FILES:
            raise self.problems.fatal(included_at, "include", f"more than {MAX_FILES} files are included")
        own = self._parse(name, included_at)
        root = container({}, own.where)
        for each in self._includes(own):
            inner = beside(name, str(each.value))
            root = self.merge(root, self.gather(inner, each.where, (*chain, identity)))
        root = self.merge(root, own)
        if root.size > MAX_SIZE:
            raise self.problems.fatal(own.where, "", f"larger than {MAX_SIZE} values with what it includes")
        return root

    def merge(self, base: Item, over: Item, path: Path = ()) -> Item:
        """Return `over` laid on `base`: mappings key by key, anything else replaced; a null node goes."""
        if not isinstance(over.value, dict):
            empty_section = over.value is None and not over.broken and path in (("nodes",), ("vars",))
            return base if empty_section else over
        merged = dict(base.mapping())
        for name, child in over.value.items():
            below = (*path, name)
            if path == ("nodes",) and child.value is None and not child.broken:
                self._remove(merged, name, child)
            else:
                merged[name] = self.merge(merged.get(name) or container({}, child.where), child, below)
        return container(merged, over.where, key=over.key, via=over.via)

    def _remove(self, nodes: dict[str, Item], name: str, item: Item) -> None:
        if nodes.pop(name, None) is None:
            message = "null removes a node, and there is no such node before this"
            hint = self.problems.nearest(name, nodes) or "write {plugin: ...}"
            self.problems.add(item.key or item.where, ("nodes", name), message, hint)

    def _includes(self, own: Item) -> list[Item]:
        item = own.child("include")
        if item is None or item.broken:
            return []
        entries = item.value if isinstance(item.value, list) else [item]
        for entry in entries:
            if entry.broken:
                continue
            if not isinstance(entry.value, str) or not entry.value:
                self.problems.add(entry.where, "include", "expected a file name or a list of file names")
            elif "${" in entry.value:
                self.problems.add(entry.where, "include", "references are not replaced in include")
        self.problems.check()
        return entries

    def _parse(self, name: str, included_at: str) -> Item:
        text = self._text(name, included_at)
        item = compose(text, lambda line, column: f"{name}:{line + 1}:{column + 1}", self.problems)
        if item is None or (item.value is None and not item.broken):
            raise self.problems.fatal(f"{name}:1:1", "", "the file is empty", f"{self.what} needs {self.needs}")
        if not isinstance(item.value, dict):
            what = "a list" if isinstance(item.value, list) else "a single value"
            message = f"expected a mapping with {self.needs}, this is {what}"
            raise self.problems.fatal(item.where, "", message)
        return item

    def _text(self, name: str, included_at: str) -> str:
        where = included_at or name
        path = "include" if included_at else ""
        said = f"{name} " if included_at else ""
        try:
            data = _shipped(name) if name.startswith(SHIPPED) else _file(name)
        except FileNotFoundError:
            raise self.problems.fatal(where, path, f"{said}does not exist", self._similar(name)) from None
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise self.problems.fatal(where, path, f"{said}cannot be read: {reason}") from None
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise self.problems.fatal(where, path, f"{said}is UTF-16; save it as UTF-8")
        try:
            return data.decode("utf-8-sig").replace("\r\n", "\n")
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            column = error.start - data.rfind(b"\n", 0, error.start)
            message = f"byte 0x{data[error.start]:02x} is not UTF-8"
            raise self.problems.fatal(f"{name}:{line}:{column}", "", message, "is this a text file?") from None

    def _similar(self, name: str) -> str:
        if name.startswith(SHIPPED):
            shipped = [one.name.removesuffix(".yaml") for one in files("knotwork.configs").iterdir()]
            return self.problems.nearest(name[len(SHIPPED) :], (one for one in shipped if "__" not in one))
        folder = FilePath(name).parent
        if not folder.is_dir():
            return f"there is no folder {folder}"
        found = [one.name for one in sorted(folder.iterdir())[:1000] if one.suffix in (".yaml", ".yml")]
        hint = self.problems.nearest(FilePath(name).name, found)
        return hint if hint.startswith("did you mean") else ""


def beside(file: str, name: str) -> str:
    """Return the file that `file` means by `name`: relative to its own folder, or one that ships."""
    if name.startswith(SHIPPED) or file.startswith(SHIPPED):
        return name if name.startswith(SHIPPED) else SHIPPED + name
    return os.path.normpath(FilePath(file).parent / name)


def _label(identity: str) -> str:
    return identity if identity.startswith(SHIPPED) else os.path.relpath(identity)


def _file(name: str) -> bytes:
    with open(name, "rb", opener=_open_regular) as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"larger than {MAX_BYTES >> 20} MiB")
    return data


def _open_regular(name: str, flags: int) -> int:
    # A device or a pipe could keep the reader waiting for ever.
    mode = os.stat(name).st_mode
    if not stat.S_ISREG(mode):
        raise ValueError("it is a folder" if stat.S_ISDIR(mode) else "it is not a regular file")
    return os.open(name, flags)


def _shipped(name: str) -> bytes:
    inner = name[len(SHIPPED) :]
    if not inner or inner.startswith("/") or ".." in inner.split("/"):
        raise FileNotFoundError(inner)
    path = files("knotwork.configs").joinpath(inner if inner.endswith((".yaml", ".yml")) else f"{inner}.yaml")
    return path.read_bytes()
