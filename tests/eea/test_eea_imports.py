from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import eea

SOURCES = sorted(Path(eea.__file__).parent.glob("*.py"))
# The bridge and its engine, the pictures, the command lines, what reads and fills folders, and
# what is timed.
MAY_USE_MORE = {
    "__main__.py",
    "analysis.py",
    "aquafish.py",
    "bench.py",
    "figures.py",
    "folder.py",
    "plots.py",
    "progress.py",
    "replicate.py",
    "spectral.py",
    "study.py",
    "study_command.py",
}


def test_importing_the_package_loads_numpy_and_the_standard_library_only():
    code = (
        "import sys, eea; from eea import EEAConfig; "
        "heavy = {'matplotlib', 'pybullet', 'torch', 'numba', 'aquafish_gym', 'tyro', 'rich'}; "
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_only_the_bridge_imports_more(path):
    roots = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            roots |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            roots.add((node.module or "").split(".")[0])
    if path.name not in MAY_USE_MORE:
        assert roots <= set(sys.stdlib_module_names) | {"numpy", "eea"}


def test_all_public_names_are_there_and_others_are_not():
    for name in eea.__all__:
        assert getattr(eea, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'estimate_morphologie'"):
        _ = eea.estimate_morphologie
