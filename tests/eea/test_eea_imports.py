from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import eea

SOURCES = sorted((Path(eea.__file__).parent / "core").glob("*.py"))


def test_importing_the_package_loads_numpy_and_the_standard_library_only():
    code = (
        "import sys, eea; from eea import PaperConfig; "
        "heavy = {'matplotlib', 'pybullet', 'torch', 'numba', 'aquafish_gym', 'tyro', 'rich', "
        "'scipy'}; "
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_joint_inference_loads_its_statistics_when_it_is_used():
    code = (
        "import sys; from eea import JointConfig, Number, Robot; "
        "JointConfig(noise=0.01); Number(0.0, 1.0); "
        "early = 'scipy' in sys.modules; from eea import JointInference; "
        "sys.exit(early or 'scipy' not in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_all_public_names_are_there_and_others_are_not():
    for name in eea.__all__:
        assert getattr(eea, name) is not None
    with pytest.raises(AttributeError, match="No eea attribute estimate_morphologie"):
        _ = eea.estimate_morphologie
