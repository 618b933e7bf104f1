"""Short names for states of code, so that results can say which code they come from."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from platform import python_version_tuple
from typing import Any


def code_stamp(sources: Iterable[Path]) -> str:
    """Return a hash of source files and of their names; comments and docstrings have no say.

    Parameters
    ----------
    sources
        Python files, and others that count byte by byte. Their order has no say, nor has where
        they are, but for the folder that each is in.
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
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_text(body[0]):
            del body[0]
    return ast.dump(tree).encode()


def _is_text(statement: Any) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
