"""The directory that a run of the command line fills, and what it may not overwrite."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.storage import (
    DamagedFileError,
    append_record,
    ensure_writable_directory,
    read_records,
    write_bytes,
    write_json,
)
from aquafish_gym.validation import InvalidArgumentError
from eea.algorithm import Result

RUN, ROUNDS, RESULT, PICTURE = "run.json", "rounds.jsonl", "result.json", "rounds.png"
MODEL = "morphology.json"
OUTPUTS = (ROUNDS, RESULT, MODEL, PICTURE)
GAIT_FILES = ("checkpoint.json", "controller.json")


class RunFolder:
    """A directory that a run fills, round by round.

    The files of an earlier run of the same settings stay until this run has as many rounds, or
    has ended by a stop rule: breaking off the repetition of a run loses nothing.

    Parameters
    ----------
    out
        The directory; made if need be.
    header
        What is run, ready for JSON; it goes into run.json.

    Attributes
    ----------
    path
        The directory.
    earlier
        Rounds of the earlier run in it; ``None`` if there is none.

    Raises
    ------
    InvalidArgumentError
        If the directory cannot be written, or holds anything but an earlier run of the same
        settings; nothing has been changed then.
    """

    def __init__(self, out: Path, header: dict[str, Any]) -> None:
        self.path = ensure_writable_directory(out)
        self._refuse_others(json.loads(json.dumps(header)))
        self.earlier: int | None = None
        self._taken = False
        if (self.path / RUN).exists():
            self.earlier = _count_rounds(self.path / ROUNDS)
        else:
            write_json(self.path / RUN, header)

    def add(self, result: Result) -> None:
        """Write a result that has one round more than before."""
        if self._taken:
            append_record(self.path / ROUNDS, result.rounds[-1].to_dict())
            self._write_model(result)
        elif len(result.rounds) >= (self.earlier or 0):
            self._take(result)

    def conclude(self, result: Result) -> bool:
        """Write what is known at the end, also after Ctrl-C; return whether it was written.

        It is not if it was broken off before it had as many rounds as the earlier run.
        """
        if self._taken:
            self._write_model(result)
        elif result.stopped == "interrupted" and len(result.rounds) < (self.earlier or 0):
            return False
        else:
            self._take(result)
        if result.rounds:
            from eea.plots import save_fitness_figure

            save_fitness_figure(result, self.path / PICTURE)
        return True

    def _take(self, result: Result) -> None:
        """Put all of this run's rounds in the place of the earlier run's."""
        log = self.path / f".{ROUNDS}.new"
        log.unlink(missing_ok=True)
        for record in result.rounds:
            append_record(log, record.to_dict())
        with contextlib.suppress(FileNotFoundError):  # a run may end before its first round
            log.replace(self.path / ROUNDS)
        if not result.rounds:
            for name in OUTPUTS:
                (self.path / name).unlink(missing_ok=True)
        self._write_model(result)
        self._taken = True

    def _write_model(self, result: Result) -> None:
        write_json(self.path / RESULT, result.to_dict())
        if result.rounds:
            model = Morphology.from_array(result.model)
            write_bytes(self.path / MODEL, model.to_json().encode())

    def _refuse_others(self, header: dict[str, Any]) -> None:
        rule = "out must be a new directory or hold an earlier run of the same settings"
        gait = [name for name in GAIT_FILES if (self.path / name).exists()]
        if gait:
            raise InvalidArgumentError(f"{rule}; {self.path} holds a gait run ({gait[0]})")
        if (self.path / "config.json").exists() and any(self.path.glob("seed-*")):
            raise InvalidArgumentError(f"{rule}; {self.path} holds a case study (config.json)")
        path = self.path / RUN
        if not path.exists():
            present = [name for name in OUTPUTS if (self.path / name).exists()]
            if present:
                raise InvalidArgumentError(
                    f"{rule}; {self.path} holds {' and '.join(present)} but no {RUN}, so they are "
                    "not a run's"
                )
            return
        try:
            held = _flat(json.loads(path.read_bytes()))
        except (ValueError, AttributeError):
            raise InvalidArgumentError(
                f"{rule}; {path} is damaged, so what the directory holds is not known"
            ) from None
        asked = _flat(header)
        # The target's body is what the damage made of it: the damage says it better.
        for name in sorted((*asked, *held), key=lambda name: name.startswith("target_morphology")):
            if held.get(name) != asked.get(name):
                raise InvalidArgumentError(
                    f"{rule}; {self.path} holds another run, with {name} "
                    f"{_spell(name, held.get(name))}, not {_spell(name, asked.get(name))}"
                )


def _count_rounds(log: Path) -> int:
    try:
        return len(read_records(log))
    except DamagedFileError as error:
        return len(error.records)
    except FileNotFoundError:
        return 0


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings under dotted names; the algorithm's are named as the options."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        inner = "" if (prefix, name) == ("", "config") else f"{prefix}{name}."
        found |= _flat(value, inner) if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def _spell(name: str, value: Any) -> str:
    if name == "target_damage" and isinstance(value, list):
        with contextlib.suppress(InvalidArgumentError):
            return str(Damage.from_json(json.dumps(value)))
    return str(value)
