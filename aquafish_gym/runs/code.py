"""A hash of the code that computes a result, so that no folder mixes results of two versions.

The hash covers a function's module, every module of ours that it imports, also inside functions and
by a name in quotes, and the data files of their packages; of a function of one's own also the
modules beside it. It reads the files that this process imports, and is the same for a clone, an
editable installation and a wheel.
"""

from __future__ import annotations

import functools
import hashlib
import re
import sys
from collections.abc import Callable, Iterator
from importlib.machinery import ModuleSpec, PathFinder
from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path
from typing import Any

PACKAGES = ("aquafish", "aquafish_gym", "eea", "experiments", "gait", "instruments")
#: Modules with one of these in their names draw, print and start results, and compute none.
WITHOUT_RESULTS = frozenset(
    {"cli", "drawing", "figures", "page", "plots", "rendering", "report", "runs", "viewer"}
)
INSTALLED = ("site-packages", "dist-packages")
DATA = (".ini", ".json")  # endings of files beside the modules, or in a folder "data" there
DIGITS = 16  # of the hash

Name = tuple[str, str | None]  # a module, and what is imported from it
_IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+([.\w]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))",
    re.MULTILINE,
)
_COMMENT = re.compile(rb"#[^\n]*")
_QUOTED = re.compile(rb"[\"']((?:%s)(?:\.\w+)+)(?::\w+)?[\"']" % "|".join(PACKAGES).encode())


def code_hash(work: Callable[..., Any]) -> str:
    """Return the hash of the code that computes a function's results."""
    return _hash(work.__module__)


@functools.cache
def _hash(root: str) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(code_of(root).items()):
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:DIGITS]


def code_of(root: str) -> dict[str, bytes]:
    """Return the modules and data files that a module depends on, by name, with their contents."""
    found: dict[str, bytes] = {}
    seen: set[Name] = set()
    todo: list[Name] = [(root, None)]
    while todo:
        name = todo.pop()
        own = name[0] == root or _computes(name[0]) or _beside(name[0], root)
        if name in seen or not own:
            continue
        seen.add(name)
        module, attribute = _defined(*name)
        if (module, attribute) != name:
            todo.append((module, attribute))
        elif (spec := _spec(module)) is not None and module not in found:
            found[module] = _source(spec)
            todo += imported(found[module], module)
    packages = {package for module in found for package in _above(module)}
    for package in sorted(packages):
        spec = _spec(package)
        if spec is not None and spec.origin is not None:  # else a folder without __init__.py
            found[package] = _source(spec)
            found.update(_data(files(package), package))
    return found


def imported(source: bytes, module: str) -> Iterator[Name]:
    """Yield the modules that a module's source imports or names in quotes."""
    for place, names, modules in _IMPORT.findall(source):
        if place:
            whole = _absolute(place.decode(), module)
            for name in _COMMENT.sub(b"", names).strip(b"() \t\r\n").split(b","):
                if name.strip():
                    yield whole, name.split()[0].decode()
        for name in _COMMENT.sub(b"", modules).split(b","):
            if name.strip():
                yield name.split()[0].decode(), None
    for name in _QUOTED.findall(source):
        yield name.decode(), None


def _computes(module: str) -> bool:
    """Return whether results can depend on a module."""
    parts = module.split(".")
    return parts[0] in PACKAGES and WITHOUT_RESULTS.isdisjoint(parts)


def _beside(module: str, root: str) -> bool:
    """Return whether a module stands in the folder of a function of one's own, such as its helpers.

    Of an installed function only the modules of its package do.
    """
    tops = [name.partition(".")[0] for name in (module, root)]
    if not set(PACKAGES).isdisjoint(tops):
        return False
    if tops[0] == tops[1]:
        return True
    there, here = map(_folder, tops)
    return there is not None and there == here and here.name not in INSTALLED


def _folder(top: str) -> Path | None:
    """Return the folder in which a module or package without dots stands; None for no file."""
    spec = _spec(top)
    if spec is None:
        return None
    inside = list(spec.submodule_search_locations or ())
    if not (inside or spec.has_location):
        return None
    return Path(inside[0] if inside else str(spec.origin)).parent


def _defined(module: str, attribute: str | None) -> Name:
    """Return where a name that is imported from a module comes from; None is the whole module.

    A package's names are those of its stub, if it has one, because it may import them when they
    are first used.
    """
    spec = _spec(module)
    if attribute is None or spec is None or spec.submodule_search_locations is None:
        return module, None
    if _spec(f"{module}.{attribute}") is not None:
        return f"{module}.{attribute}", None
    stub = files(module).joinpath("__init__.pyi")
    source = stub.read_bytes() if stub.is_file() else _source(spec)
    names = list(imported(source, f"{module}.__init__"))
    for place, name in names:
        if name == attribute:
            return place, name
    for place, name in names:
        if name == "*" and _defined(place, attribute) != (place, None):
            return place, attribute
    return module, None


def _absolute(place: str, module: str) -> str:
    """Return the absolute name of a module that another one imports."""
    name = place.lstrip(".")
    dots = len(place) - len(name)
    return ".".join([*module.split(".")[:-dots], *filter(None, [name])]) if dots else name


def _above(module: str) -> Iterator[str]:
    """Yield the packages that a module lies in."""
    while module := module.rpartition(".")[0]:
        yield module


def _spec(module: str) -> ModuleSpec | None:
    """Return the specification of a module as this process imports it; None for no module."""
    loaded = sys.modules.get(module)
    known: ModuleSpec | None = getattr(loaded, "__spec__", None)
    if known is not None:
        return known
    if loaded is not None:  # a program
        return spec_from_file_location(module, getattr(loaded, "__file__", None))
    package = module.rpartition(".")[0]
    if not package:
        return find_spec(module)
    above = _spec(package)
    inside = None if above is None else above.submodule_search_locations
    return None if inside is None else PathFinder.find_spec(module, inside)


def _source(spec: ModuleSpec) -> bytes:
    """Return a module's source with line ends of one kind."""
    loader: Any = spec.loader
    return bytes(loader.get_data(spec.origin)).replace(b"\r\n", b"\n")


def _data(folder: Traversable, name: str) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the data files in a package's folder."""
    for entry in folder.iterdir():
        path = f"{name}/{entry.name}"
        if entry.name.endswith(DATA):
            yield path, entry.read_bytes().replace(b"\r\n", b"\n")
        elif entry.is_dir() and (entry.name == "data" or "/data" in path):
            yield from _data(entry, path)
