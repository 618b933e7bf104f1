"""Short names for states of code, so that results can say which code they come from."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from platform import python_version_tuple


def code_stamp(sources: Iterable[Path]) -> str:
    """Return a hash of source files, of their names and of the folder that each is in.

    Comments and docstrings of Python files have no say; other files count byte by byte.
    """
    digest = hashlib.sha256()
    named = sorted((source.parts[-2:], source.read_bytes()) for source in sources)
    for (folder, name), content in named:
        digest.update(f"{folder}/{name}".encode())
        digest.update(_meaning(content) if name.endswith(".py") else content)
    return digest.hexdigest()[:16]


def versions(packages: Iterable[str] = ("aquafish-gym", "numba", "numpy")) -> dict[str, str]:
    """Return the versions of installed packages that compute results, and of Python."""
    python = ".".join(python_version_tuple()[:2])
    return {**{name: version(name) for name in packages}, "python": python}


def _meaning(code: bytes) -> bytes:
    tree = ast.parse(code)
    for node in ast.walk(tree):
        match getattr(node, "body", None):
            case [ast.Expr(ast.Constant(str())), *_] as body:
                del body[0]
    return ast.dump(tree).encode()
