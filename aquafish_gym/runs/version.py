"""The version of the code that runs: in a clone it names the commit.

An installation has the version that setuptools-scm wrote when it was built. A clone changes after
it was installed, so git is asked for its commit.
"""

from __future__ import annotations

import functools
import os
import re
import subprocess
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version
from pathlib import Path

PACKAGE = "aquafish-gym"
HERE = Path(__file__).resolve().parents[2]  # the clone, or site-packages
GIT_SECONDS = 10.0
# Neither wait for another git's lock, nor start a program that a clone's settings name.
_GIT = ("git", "--no-optional-locks", "-c", "core.fsmonitor=false")
# By which a hook of another clone, in which a command may run, would lead git there.
_ELSEWHERE = frozenset(
    f"GIT_{name}" for name in ("COMMON_DIR", "DIR", "INDEX_FILE", "OBJECT_DIRECTORY", "WORK_TREE")
)
# Results and pages may change without another code.
_CODE = ("--", ".", ":!docs", ":!paper", ":!*.md")


@functools.cache
def version() -> str:
    """Return the version of the code that this process runs, such as 0.1.dev1393+g718fb808b.

    It is that of setuptools-scm, with ``.dirty`` in a clone whose code differs from its commit.
    Where git does not know the commit of a clone, the version ends in ``+unknown``.
    """
    try:
        installed = installed_version(PACKAGE)
    except PackageNotFoundError:  # a folder on the path
        installed = "0"
    if not is_clone(HERE):
        return installed
    return clone_version(HERE) or installed.partition("+")[0] + "+unknown"


def is_clone(folder: Path) -> bool:
    """Return whether a folder is a clone of the repository."""
    return (folder / ".git").exists() and (folder / "aquafish_gym" / "__init__.py").is_file()


def clone_version(clone: Path) -> str | None:
    """Return the version of a clone as setuptools-scm writes it; None if git does not know it."""
    commit = git(clone, "rev-parse", "--short=9", "HEAD")
    count = git(clone, "rev-list", "--count", "HEAD")
    changed = git(clone, "status", "--porcelain", "--untracked-files=no", *_CODE)
    if commit is None or count is None or changed is None:
        return None
    dirty = bool(changed)
    described = git(clone, "describe", "--tags", "--long", "--match", "v[0-9]*")
    if described is None:
        public = f"0.1.dev{count}"
        distance = 1
    else:
        tag, steps, _ = described.rsplit("-", 2)
        public = tag[1:]
        distance = int(steps)
    if described is not None and not distance and not dirty:
        return public
    if described is not None:  # on the way to the next version
        following = re.sub(r"\d+$", lambda last: str(int(last[0]) + 1), public)
        public = f"{following}.dev{distance}"
    return f"{public}+g{commit}" + (".dirty" if dirty else "")


def git(clone: Path, *words: str) -> str | None:
    """Return what git prints about a clone; None if it cannot."""
    try:
        done = subprocess.run(
            [*_GIT, "-C", str(clone), *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=GIT_SECONDS,
            env={name: value for name, value in os.environ.items() if name not in _ELSEWHERE},
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def other_clone_here() -> str | None:
    """Return a sentence if the working directory lies in a clone of another version than runs."""
    try:
        here = Path.cwd().resolve()
    except OSError:  # the folder was removed
        return None
    clone = next((folder for folder in (here, *here.parents) if is_clone(folder)), None)
    if clone is None or clone == HERE:
        return None
    there = clone_version(clone)
    if there == version():
        return None
    return (
        f"this folder is a clone of {there or 'an unknown version'}, but {version()} in {HERE} "
        'runs; "pip install -e ." in the clone changes that'
    )
