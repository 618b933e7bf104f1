"""Other projects' own tests on our environments and networks: ``pytest -m slow tests/peers``.

Each suite is fetched in the version that is installed: from the source distribution where it has
all tests, else from the project's repository. Where neither can be reached, the test is skipped.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FETCH_SECONDS = 180.0


@dataclass(frozen=True)
class Suite:
    """Tests of a project, and which of them fail because of what they assume."""

    module: str
    tests: tuple[str, ...]
    plugin: str
    at_least: int  #: Number of tests in which our code must take part.
    repository: str = ""  #: Empty if the source distribution has all tests.
    ids: str = ""  #: Environments that become ours.
    keyword: str = ""  #: Part of the names of the tests.
    #: End of a test's name -> the reason; one that begins with "by chance" may pass.
    expected: dict[str, str] = field(default_factory=dict)


SUITES = {
    "gymnasium": Suite(
        "gymnasium",
        ("envs/test_envs", "envs/test_rendering"),
        "peer_fish",
        at_least=45,
        repository="https://github.com/Farama-Foundation/Gymnasium",
        keyword="AquaFish",
        expected={
            "test_pickle_env[AquaFishBullet-v0]": "PyBullet's world lives in one process",
        },
    ),
    "stable-baselines3": Suite(
        "stable_baselines3",
        ("test_monitor", "test_predict", "test_vec_monitor", "test_vec_normalize"),
        "peer_fish",
        at_least=35,
        ids="Pendulum-v1,CartPole-v1=discrete",
        expected={
            "test_monitor_error_cases": "it resets with an option that is not ours",
            "test_get_original": "each reward of CartPole is 1",
            "test_normalize_external": "by chance: each reward of CartPole is 1",
            "test_sync_vec_normalize[make_env]": "by chance: it allows an error of 1e-8",
        },
    ),
    "neat-python": Suite(
        "neat",
        (
            "test_nn",
            "test_simple_run",
            "test_xor_example",
            "test_export",
            "test_recurrent_network",
            "test_feedforward_network",
        ),
        "peer_networks",
        at_least=12,
        repository="https://github.com/CodeReclaimers/neat-python",
    ),
}


def fetched(package: str, suite: Suite, folder: Path) -> Path:
    """Return the folder with a package's tests; skip the test if they cannot be fetched.

    A repository that can be reached but has no tag of the installed version is a failure.
    """
    wanted = version(package)
    if suite.repository:
        found = folder / "repository"
        commands = [
            ["git", "clone", "-q", "--depth", "1", "--branch", f"v{wanted}", suite.repository,
             str(found)],
        ]  # fmt: skip
    else:
        found = folder / f"{package.replace('-', '_')}-{wanted}"
        pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", package]
        commands = [
            [*pip, f"{package}=={wanted}", "--dest", str(folder)],
            ["tar", "-xzf", f"{found}.tar.gz", "-C", str(folder)],
        ]
    try:
        for command in commands:
            subprocess.run(
                command, check=True, capture_output=True, timeout=FETCH_SECONDS,
                env={**os.environ, "LC_ALL": "C"},
            )  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        if b"Remote branch" in (getattr(error, "stderr", None) or b""):
            pytest.fail(f"{suite.repository} has no tag v{wanted}")
        pytest.skip(f"the tests of {package} {wanted} cannot be fetched here: {error}")
    return found


def test_a_missing_tag_is_no_skip(tmp_path: Path) -> None:
    repository = tmp_path / "theirs"
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@b.c"]
    subprocess.run([*git, "init", "-q", str(repository)], check=True)
    suite = replace(SUITES["gymnasium"], repository=str(repository))
    commit = [*git, "-C", str(repository), "commit", "-q", "--allow-empty", "-m", "none"]
    subprocess.run(commit, check=True)
    with pytest.raises(pytest.fail.Exception, match="has no tag v"):
        fetched("gymnasium", suite, tmp_path / "one")
    subprocess.run(["git", "-C", str(repository), "tag", f"v{version('gymnasium')}"], check=True)
    assert (fetched("gymnasium", suite, tmp_path / "two") / ".git").is_dir()
    absent = replace(suite, repository=str(tmp_path / "absent"))
    with pytest.raises(pytest.skip.Exception, match="cannot be fetched here"):
        fetched("gymnasium", absent, tmp_path / "three")


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("package", SUITES)
def test_their_tests_pass_on_ours(package: str, tmp_path: Path) -> None:
    suite = SUITES[package]
    pytest.importorskip(suite.module)
    place = fetched(package, suite, tmp_path)
    expected = tmp_path / "expected.json"
    expected.write_text(json.dumps(suite.expected))
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")},
        # Plugins by their own names: these projects have a package "tests", too.
        "PYTHONPATH": os.pathsep.join([str(ROOT / "tests" / "peers"), str(ROOT)]),
        "PEER_IDS": suite.ids,
        "PEER_EXPECTED": str(expected),
        "PEER_AT_LEAST": str(suite.at_least),
    }
    files = [f"tests/{each}.py" for each in suite.tests]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "ignore",
         "-p", suite.plugin, "-k", suite.keyword, *files],
        cwd=place, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
