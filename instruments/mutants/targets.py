"""What is mutated, by which tests each file is judged, and which mutants are drawn."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.mutants.operators import Edit, edits_of, is_mutant


@dataclass(frozen=True)
class Group:
    """Files that are mutated, and the tests that judge them.

    Attributes
    ----------
    folder
        The package of the files.
    left_out
        Names of its files that no result depends on.
    tests
        Tests of the ordinary suite as pytest takes them, the quickest first: a failure ends a run.
    """

    folder: str
    left_out: tuple[str, ...]
    tests: tuple[str, ...]


GROUPS = {
    "physics": Group(
        "aquafish_gym/physics",
        # They compile, print and name what the others state.
        ("compiling.py", "printing.py", "symbols.py"),
        (
            "tests/physics/test_backends.py",
            "tests/physics/test_known_answers.py",
            "tests/physics/test_reactive.py",
            "tests/physics/test_oracles.py",
            "tests/physics/test_quadrature.py",
            "tests/physics/test_printing.py",
            "tests/engines/test_agreement.py",
            "tests/engines/test_determinism.py",
            "tests/engines/test_lag.py",
            "tests/engines/test_nuisances.py",
            "tests/engines/test_spectrum.py",
            "tests/test_imu.py",
            "tests/test_bullet.py",
            "tests/test_rollout.py",
            "tests/robustness/test_extremes.py",
            "tests/physics/test_mujoco.py",
            "tests/test_golden.py::test_environment_is_unchanged",
        ),
    ),
    "inference": Group(
        "eea/infer",
        (),
        (
            "tests/eea/infer",
            "tests/eea/test_infer_cli.py",
            "tests/robustness/test_arguments.py",
            "tests/test_golden.py::test_command_is_unchanged",
        ),
    ),
    "damage": Group(
        "aquafish_gym/damage",
        (),
        (
            "tests/test_damage.py",
            "tests/test_damage_words.py",
            "tests/test_stages.py",
            "tests/envs/test_fault_words.py",
            "tests/envs/test_fault_refusals.py",
            "tests/envs/test_fault_spaces.py",
            "tests/contract/test_faces.py",
            "tests/envs/test_fault_episodes.py",
            "tests/envs/test_schedule.py",
            "tests/envs/test_env.py",
            "tests/envs/test_vector.py",
            "tests/test_rollout.py",
            "tests/envs/test_checker.py",
            "tests/robustness/test_arguments.py",
            "tests/test_golden.py::test_environment_is_unchanged",
        ),
    ),
}


@dataclass(frozen=True)
class Mutant:
    """A mutant to be judged, or with ``edit`` None the source as it is."""

    group: str
    path: str  #: Of the mutated file, from the repository's root.
    number: int  #: In its group.
    edit: Edit | None

    @property
    def name(self) -> str:
        """For people."""
        if self.edit is None:
            return f"{self.group} without a mutant"
        return f"{self.path}, line {self.edit.line}: {self.edit.what}"

    @property
    def file(self) -> str:
        """Where its result is, within the folder."""
        return f"mutants/{self.group}/{'whole' if self.edit is None else self.number}.json"

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that judge it: the examples in the file's docstrings, then the group's."""
        tests = GROUPS[self.group].tests
        if self.edit is None:
            return tests
        return (self.path, *tests)


def sources_of(root: Path, group: str) -> dict[str, str]:
    """Return the texts of a group's files by their paths from the root."""
    folder = root / GROUPS[group].folder
    files = [f for f in sorted(folder.glob("*.py")) if f.name not in GROUPS[group].left_out]
    if not files:
        raise InvalidArgumentError(f"repository must hold {GROUPS[group].folder}; got {root}")
    return {f.relative_to(root).as_posix(): f.read_text(encoding="utf-8") for f in files}


def draw_mutants(root: Path, groups: list[str], count: int, seed: int) -> list[Mutant]:
    """Return ``count`` mutants, equally many of each group, in turns; fewer if there are no more.

    All mutants of a group are equally likely. A larger count has the mutants of a smaller one.
    """
    drawn = []
    for group in groups:
        sources = sources_of(root, group)
        every = [(path, edit) for path, source in sources.items() for edit in edits_of(source)]
        rng = np.random.default_rng([seed, list(GROUPS).index(group)])
        mutants = (every[chosen] for chosen in rng.permutation(len(every)).tolist())
        good = ((path, edit) for path, edit in mutants if is_mutant(sources[path], edit))
        for turn, (path, edit) in enumerate(islice(good, count)):
            drawn.append(Mutant(group, path, turn, edit))
    return sorted(drawn, key=lambda mutant: mutant.number)[:count]


def tracked_files(root: Path) -> list[str]:
    """Return the files of a clone that Git knows and that are there."""
    try:
        done = subprocess.run(
            ["git", "ls-files", "-z"], cwd=root, capture_output=True, check=True, encoding="utf-8"
        )
    except (OSError, subprocess.CalledProcessError) as error:
        raise InvalidArgumentError(
            f"repository must be a folder of a Git repository; {root}: {error}"
        ) from None
    return [name for name in done.stdout.split("\0") if name and (root / name).is_file()]
