"""A study's folder: what its study.json says, and how a later command may extend it.

``study.json`` describes what is run: every arm with all its settings, the target and the simulator,
and the seeds of each arm at each length of trial. It also records the versions of the packages that
made results. Each finished replicate is a file of its own (``plan.ReplicateKey.file``).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from aquafish_gym.damage import Damage
from aquafish_gym.runs.manifest import first_difference, flat, read_manifest
from aquafish_gym.runs.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief
from eea.core.checks import ConfigurationError
from eea.study.plan import RUNS, joined, read_plan, written_plan
from eea.study.study import Study

STUDY, SCHEMA = "study.json", "eea.study/1"
_GROWING = ("replicates", "versions", "source", "arms")  # these may differ when a study is extended


def read_description(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's study.json; refuse a missing or damaged one by name."""
    path = folder / STUDY
    if not path.exists():
        raise ConfigurationError(
            f"{folder} must hold a study, which aquafish study --out {folder} begins; it has no "
            f"{STUDY}"
        )
    document = read_document(path, SCHEMA, "study")
    try:
        arms_have_settings = all("condition" in arm for arm in document["arms"].values())
        sound = arms_have_settings and document["rounds"] >= 1 and bool(read_plan(document))
    except (AttributeError, KeyError, TypeError, ValueError):
        sound = False
    if not sound:
        raise DamagedFileError(f"{path} is damaged: it needs rounds, arms and their replicates")
    return document


def extended(folder: Path, study: Study) -> dict[str, Any]:
    """Return the study.json of a study together with the one in its folder; write nothing.

    Raises
    ------
    InvalidArgumentError
        If the folder holds something else or a study with other settings; the message names the
        first difference.
    """
    asked: dict[str, Any] = json.loads(json.dumps(study.to_dict()))
    if not (folder / STUDY).exists():
        _refuse_other_content(folder)
        return asked
    held = read_description(folder)
    shared = held["arms"].keys() & asked["arms"].keys()
    before, now = (
        {"arms": {name: arm for name, arm in document["arms"].items() if name in shared}}
        | {name: value for name, value in document.items() if name not in _GROWING}
        for document in (held, asked)
    )
    name = first_difference(before, now)
    if name is not None:
        raise InvalidArgumentError(
            f"out: {folder} holds a study with {name} {_spelled(name, before)}, not "
            f"{_spelled(name, now)}; choose another folder"
        )
    try:
        plan = joined(read_plan(held), read_plan(asked))
    except ValueError as gap:
        raise InvalidArgumentError(f"out: {folder} holds {gap}") from None
    versions = [*held.get("versions", [])]
    versions += [one for one in asked["versions"] if one not in versions]
    return {
        **held,
        "replicates": written_plan(plan),
        "arms": {**held["arms"], **asked["arms"]},
        "versions": versions,
    }


def write_description(folder: Path, document: dict[str, Any]) -> None:
    """Write study.json unless it already has this content."""
    if not (folder / STUDY).exists() or read_description(folder) != document:
        write_document(folder / STUDY, document, SCHEMA)


def _refuse_other_content(folder: Path) -> None:
    rule, other = "out must be a new directory or hold a study", read_manifest(folder)
    if other is not None:
        raise InvalidArgumentError(f"{rule}; {folder} holds {other['kind']}")
    if (folder / RUNS).exists():
        raise InvalidArgumentError(f"{rule}; {folder} holds {RUNS} but no {STUDY}")


def _spelled(name: str, settings: dict[str, Any]) -> str:
    """Return a setting's value for a message."""
    value = flat(settings).get(name)
    if name == "target_damage" and isinstance(value, list):
        return str(Damage.coerce(value))
    return value if isinstance(value, str) else brief(value)
