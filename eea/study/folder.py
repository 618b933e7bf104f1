"""A study's folder: what its study.json says, and what may be added to it.

``study.json`` says what is run: every arm with all its settings, the target and the simulator,
which seeds each arm has at each length of trial, and which versions and code have made results.
Each finished replicate is a file of its own (``plan.Place.file``), which the runner writes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from aquafish_gym.damage import Damage
from aquafish_gym.runs.folder import described, first_difference, flat
from aquafish_gym.runs.runner import merge_results
from aquafish_gym.runs.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief
from eea.core.checks import ConfigurationError
from eea.study.plan import RUNS, joined, places, read_plan, written_plan
from eea.study.study import Study

STUDY, SCHEMA = "study.json", "eea.study/1"
_APART = ("replicates", "versions", "source", "arms")  # what two parts of a study may differ in


def read_description(
    folder: Path, checksum: Literal["required", "optional"] = "required"
) -> dict[str, Any]:
    """Return what a folder's study.json says; the first studies have no checksum.

    Raises
    ------
    ConfigurationError
        If there is none.
    InvalidArgumentError
        If it cannot be read, is damaged or does not say what is run; the message names it.
    """
    path = folder / STUDY
    if not path.exists():
        raise ConfigurationError(
            f"{folder} must hold a study, which python -m eea study --out {folder} begins; it has "
            f"no {STUDY}"
        )
    document = read_document(path, SCHEMA, "study", checksum=checksum)
    try:
        read_plan(document)
        for name, kind in (("rounds", int), ("versions", list), ("source", list)):
            if not isinstance(document.get(name), kind) or not document[name]:
                raise ValueError(name)
    except ValueError as name:
        raise DamagedFileError(f"{path} is damaged: it does not say the {name}") from None
    return document


def extended(folder: Path, study: Study, other_code: bool = False) -> dict[str, Any]:
    """Return what study.json is to say, of this study and of the one that is in its folder.

    Nothing is changed in the folder. Results of other code, or of other versions of numpy and the
    like, are gone on from with ``other_code`` only.

    Raises
    ------
    InvalidArgumentError
        If the folder holds something else or a study of other settings; the message names the
        first difference.
    """
    ours: dict[str, Any] = json.loads(json.dumps(study.to_dict()))
    if (folder / STUDY).exists():
        return _joined(folder, read_description(folder), ours, other_code)
    rule, other = "out must be a new directory or hold a study", described(folder)
    if other is not None:
        raise InvalidArgumentError(f"{rule}; {folder} holds {other['kind']}")
    if (folder / RUNS).exists():
        raise InvalidArgumentError(
            f"{rule}; {folder} holds {RUNS} but no {STUDY}, so what they are is not known"
        )
    return ours


def claim(folder: Path, document: dict[str, Any]) -> None:
    """Write study.json, if it does not say so already."""
    if not (folder / STUDY).exists() or read_description(folder) != document:
        write_document(folder / STUDY, document, SCHEMA)


def merge(folder: Path, other: Path, other_code: bool = False) -> int:
    """Add another folder's part of the same study to a folder; return how many results came.

    The other stays as it is; ``other_code`` is as in ``extended``.

    Raises
    ------
    InvalidArgumentError
        If they are not of the same study, a file is damaged, or both have a replicate and differ.
    ConfigurationError
        If one holds no study.
    """
    theirs = read_description(other)
    document = _joined(folder, read_description(folder), theirs, other_code)
    count = merge_results(folder, other, places(read_plan(theirs)))
    claim(folder, document)
    return count


def _joined(
    folder: Path, held: dict[str, Any], ours: dict[str, Any], other_code: bool
) -> dict[str, Any]:
    """Return the description of a study that has what either says."""
    shared = held["arms"].keys() & ours["arms"].keys()
    before, asked = (
        {"arms": {name: arm for name, arm in document["arms"].items() if name in shared}}
        | {name: value for name, value in document.items() if name not in _APART}
        for document in (held, ours)
    )
    name = first_difference(before, asked)
    if name is not None:
        raise InvalidArgumentError(
            f"out: {folder} holds a study with {name} {_spelled(name, before)}, not "
            f"{_spelled(name, asked)}; choose another folder"
        )
    try:
        plan = joined(read_plan(held), read_plan(ours))
    except ValueError as gap:
        raise InvalidArgumentError(f"out: {folder} holds {gap}") from None
    if not other_code:
        _refuse_other_code(folder, held, ours)
    return {
        **held,
        "replicates": written_plan(plan),
        "arms": {**held["arms"], **ours["arms"]},
        **{
            name: [*held[name], *(one for one in ours[name] if one not in held[name])]
            for name in ("versions", "source")
        },
    }


def _spelled(name: str, settings: dict[str, Any]) -> str:
    """Return a setting's value as people say it."""
    value = flat(settings).get(name)
    if name == "target_damage" and isinstance(value, list):
        return str(Damage.from_json(json.dumps(value)))
    return value if isinstance(value, str) else brief(value)


def _refuse_other_code(folder: Path, held: dict[str, Any], ours: dict[str, Any]) -> None:
    """Refuse results of other code, or of other versions of what computes them."""
    difference, last = None, held["versions"][-1]
    for now in ours["source"]:
        if now not in held["source"]:
            difference = f"other code (source {held['source'][-1]}, not {now})"
    for now in ours["versions"]:
        if now not in held["versions"]:
            name = first_difference(last, now) or ""
            difference = f"{name} {last.get(name)}, not {now.get(name)}"
    if difference is not None:
        raise InvalidArgumentError(
            f"out: {folder} holds results of {difference}; choose another folder, or say "
            "--other-code if no result can have changed"
        )
