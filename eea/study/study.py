"""A study, and its folder's ``study.json``, which later commands may extend.

``study.json`` describes the plan: every arm with all its settings, the target and the simulator,
and the span of seeds of each arm at each length of trial. It also records the versions of the
packages that made results, and the hash of their code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aquafish_gym.bodies import plan_key
from aquafish_gym.damage import Damage
from aquafish_gym.damage.held_out import held_out
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.code import code_hash
from aquafish_gym.runs.manifest import (
    joined_versions,
    read_manifest,
    refuse_difference,
    refuse_other_code,
    versions,
)
from aquafish_gym.utils.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, file_path
from eea.core.checks import ConfigurationError, whole
from eea.core.config import JointConfig
from eea.fish.joint import check_groups
from eea.study.method import ArmConfig
from eea.study.replicate import (
    RUNS_FOLDER,
    Replicate,
    ReplicateKey,
    StudyWorld,
    replicate,
)

STUDY_FILE = "study.json"
STUDY_SCHEMA = "eea.study/1"
# Settings of the study; an arm with fewer rounds has its own.
_NOT_AN_ARMS = ("steps", "rounds")
# An extension may change these; the code has a check of its own.
_GROWING = ("replicates", "versions", "arms", "code")
MOST_REPLICATES = 10_000  # of an arm; the paper has 25
MOST_JOBS = 100_000


@dataclass(frozen=True)
class Study:
    """The plan of a study: its replicates, and everything that determines their results.

    Raises
    ------
    ConfigurationError
        If a number is out of range, or a name unknown.
    """

    arms: Mapping[str, ArmConfig]  #: Arm to settings; ``steps`` replace theirs.
    steps: tuple[int, ...]  #: Lengths of trials; every arm has all.
    first_seed: int
    #: Number of seeds of each arm at each length. Seeds are equal in all arms, to pair them.
    replicates: int
    world: StudyWorld

    def __post_init__(self) -> None:
        whole("replicates", self.replicates, 1, MOST_REPLICATES)
        if self.world.held_out:  # more would repeat damages
            most = len(held_out(self.world.held_out_list))
            whole("replicates with held_out", self.replicates, 1, most)
        whole("first_seed", self.first_seed, 0, 2**63 - 1)
        if len(set(self.steps)) < len(self.steps):
            raise ConfigurationError(f"steps must differ from each other; got {self.steps}")
        count = len(self.arms) * len(self.steps) * self.replicates
        whole("arms times steps times replicates", count, 1, MOST_JOBS)
        self.jobs()  # checks the steps
        for config in self.arms.values():
            if isinstance(config, JointConfig):
                check_groups(config.nuisances, self.world.morphology.plan)

    @property
    def rounds(self) -> int:
        """The most rounds of an arm."""
        return max(config.rounds for config in self.arms.values())

    def jobs(self) -> list[Replicate]:
        """Return every replicate, by arm, steps and seed."""
        configs = [
            (name, replace(config, steps=steps))
            for name, config in self.arms.items()
            for steps in self.steps
        ]
        return [
            Replicate(name, config, seed, self.world)
            for name, config in configs
            for seed in range(self.first_seed, self.first_seed + self.replicates)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return everything that determines the results, ready for JSON."""
        world = dict(vars(self.world))
        gap = world.pop("gap")
        held_out = world.pop("held_out")
        reactive = world.pop("reactive")
        seeds = {"first": self.first_seed, "count": self.replicates}
        return {
            **plan_key(self.world.morphology.plan),
            "target_morphology": world.pop("morphology").to_dict(),
            "target_damage": world.pop("damage").to_list(),
            **world,
            "current": list(self.world.current),
            **({"gap": gap.changes} if gap.changes else {}),
            **({"reactive": True} if reactive else {}),
            **({"held_out": self.world.held_out_list} if held_out else {}),
            "rounds": self.rounds,
            "replicates": {
                name: {str(steps): seeds for steps in sorted(self.steps)} for name in self.arms
            },
            "arms": {
                name: {k: v for k, v in config.to_dict().items() if k not in _NOT_AN_ARMS}
                | ({} if config.rounds == self.rounds else {"rounds": config.rounds})
                for name, config in self.arms.items()
            },
            "versions": [versions()],
            "code": code_hash(replicate),
        }


def replicate_keys(document: Mapping[str, Any]) -> list[ReplicateKey]:
    """Return the key of every replicate of a study.json, by arm, steps and seed."""
    return [
        ReplicateKey(arm, int(steps), seed)
        for arm in document["arms"]
        for steps, seeds in document["replicates"][arm].items()
        for seed in range(seeds["first"], seeds["first"] + seeds["count"])
    ]


def targets_of(document: Mapping[str, Any]) -> tuple[Morphology, list[Damage]]:
    """Return the body of a study.json's target before the damage, and the seeds' damages."""
    morphology = Morphology.coerce(document["target_morphology"], document.get("plan"))
    damage = Damage.coerce(document["target_damage"])
    world = StudyWorld(morphology, damage, held_out="held_out" in document)
    seeds = sorted({key.seed for key in replicate_keys(document)})
    damages = {str(each): each for each in map(world.damage_of, seeds)}
    return morphology, list(damages.values())


def read_description(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's study.json; an error names a missing or damaged file."""
    path = file_path("folder", folder) / STUDY_FILE
    if not path.exists():
        raise ConfigurationError(
            f"{folder} must hold a study, which aquafish study --out {folder} begins; it has no "
            f"{STUDY_FILE}"
        )
    document = read_document(path, STUDY_SCHEMA, "study")
    try:
        targets_of(document)
        arms_have_settings = all("condition" in arm for arm in document["arms"].values())
        sound = arms_have_settings and document["rounds"] >= 1 and bool(replicate_keys(document))
    except (AttributeError, KeyError, TypeError, ValueError):
        sound = False
    if not sound:
        raise DamagedFileError(
            f"{path} is damaged: it needs a target, rounds, arms and their replicates"
        )
    return document


def extended(folder: Path, study: Study) -> dict[str, Any]:
    """Return study.json of a study, merged with the one in its folder; write nothing.

    Raises
    ------
    InvalidArgumentError
        If the folder holds something else or a study with other settings or of other code; the
        message names the first difference.
    """
    asked: dict[str, Any] = json.loads(json.dumps(study.to_dict()))
    if not (folder / STUDY_FILE).exists():
        other = read_manifest(folder)
        held_by = other["kind"] if other else f"{RUNS_FOLDER} but no {STUDY_FILE}"
        # the settings of these replicates are unknown
        if other is not None or (folder / RUNS_FOLDER).exists():
            raise InvalidArgumentError(
                f"out must be a new directory or hold a study; {folder} holds {held_by}"
            )
        return asked
    held = read_description(folder)
    shared = held["arms"].keys() & asked["arms"].keys()
    before, now = (
        {"arms": {name: arm for name, arm in document["arms"].items() if name in shared}}
        | {name: value for name, value in document.items() if name not in _GROWING}
        for document in (held, asked)
    )
    refuse_difference(folder, "a study", before, now)
    refuse_other_code(folder, "a study", held.get("code"), asked["code"])
    replicates = {arm: dict(seeds) for arm, seeds in held["replicates"].items()}
    for arm, durations in asked["replicates"].items():
        own = replicates.setdefault(arm, {})
        for steps, new in durations.items():
            own[steps] = _joined(own.get(steps, new), new, f"out: {folder} holds {arm}")
        replicates[arm] = {steps: own[steps] for steps in sorted(own, key=int)}
    return {
        **held,
        "replicates": replicates,
        "arms": {**held["arms"], **asked["arms"]},
        "versions": joined_versions(held.get("versions", []), asked["versions"]),
    }


def _joined(old: Mapping[str, int], new: Mapping[str, int], holder: str) -> dict[str, int]:
    """Return the union of two spans of seeds; refuse a gap between them."""
    (start, end), (first, stop) = ((s["first"], s["first"] + s["count"]) for s in (old, new))
    if max(start, first) > min(end, stop):
        raise InvalidArgumentError(
            f"{holder} with seeds {start} to {end - 1}; {first} to {stop - 1} would leave a gap"
        )
    return {"first": min(start, first), "count": max(end, stop) - min(start, first)}


def write_description(folder: Path, document: dict[str, Any]) -> None:
    """Write study.json unless it already has this content."""
    if not (folder / STUDY_FILE).exists() or read_description(folder) != document:
        write_document(folder / STUDY_FILE, document, STUDY_SCHEMA)
