"""The directory that a run of the command line fills, and what it may not overwrite."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import (
    DamagedFileError,
    append_record,
    ensure_writable_directory,
    read_records,
    write_bytes,
    write_json,
)
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.algorithm import EEA, Result
from eea.core.checks import ConfigurationError

RUN, ROUNDS, RESULT, PICTURE = "run.json", "rounds.jsonl", "result.json", "rounds.png"
MODEL, STATE = "morphology.json", "rounds.state"
OUTPUTS = (ROUNDS, RESULT, MODEL, PICTURE)
GAIT_FILES = ("checkpoint.json", "controller.json")


class RunFolder:
    """A directory that a run fills, round by round.

    An earlier run of the same settings that was broken off is gone on with. The files of one that
    has ended stay until this run has as many rounds, or has ended by a stop rule: breaking off the
    repetition of a run loses nothing.

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
            self.earlier = len(_sound_records(self.path / ROUNDS))
        else:
            write_json(self.path / RUN, header)

    def resume(self, eea: EEA) -> bool:
        """Bring the algorithm to where an earlier run was broken off; return whether one was."""
        self._taken = resume_log(eea, self.path / ROUNDS, self.path / STATE)
        return self._taken

    def add(self, eea: EEA) -> None:
        """Write the result of a run that has one round more than before."""
        result = eea.result
        if self._taken:
            append_record(self.path / ROUNDS, result.rounds[-1].to_dict())
            self._write_model(result)
        elif len(result.rounds) >= (self.earlier or 0):
            self._take(result)
        if self._taken:
            write_state(self.path / STATE, eea.save())

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
        if result.stopped != "interrupted":
            (self.path / STATE).unlink(missing_ok=True)
        if result.rounds:
            from eea.report import save_fitness_figure

            save_fitness_figure(result, self.path / PICTURE)
        return True

    def _take(self, result: Result) -> None:
        """Put all of this run's rounds in the place of the earlier run's."""
        (self.path / STATE).unlink(missing_ok=True)
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
        if (self.path / "study.json").exists():
            raise InvalidArgumentError(f"{rule}; {self.path} holds a study (study.json)")
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
            held = flat(json.loads(path.read_bytes()))
        except (ValueError, AttributeError):
            raise InvalidArgumentError(
                f"{rule}; {path} is damaged, so what the directory holds is not known"
            ) from None
        asked = flat(header)
        # The target's body is what the damage made of it: the damage says it better.
        for name in sorted((*asked, *held), key=lambda name: name.startswith("target_morphology")):
            if held.get(name) != asked.get(name):
                raise InvalidArgumentError(
                    f"{rule}; {self.path} holds another run, with {name} "
                    f"{spell(name, held.get(name))}, not {spell(name, asked.get(name))}"
                )


def _sound_records(log: Path) -> list[Any]:
    try:
        return read_records(log)
    except DamagedFileError as error:
        return error.records
    except FileNotFoundError:
        return []


def resume_log(eea: EEA, log: Path, state: Path) -> bool:
    """Bring the algorithm to where a run was broken off; return whether one was.

    The state is written after a round's line in the log, so it is of the last line or of the one
    before, and the log is cut to it. A state that is not the log's is not gone on from.
    """
    saved = read_state(state)
    try:
        if saved is None:
            return False
        logged = _sound_records(log)[: len(saved["rounds"])]
        if not logged or logged != saved["rounds"]:
            return False
        eea.restore(saved)
    except (ConfigurationError, KeyError, TypeError):
        return False
    keep_lines(log, len(logged))
    return True


def flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings under dotted names; the algorithm's are named as the options."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        inner = "" if (prefix, name) == ("", "config") else f"{prefix}{name}."
        found |= flat(value, inner) if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def spell(name: str, value: Any) -> str:
    """Return a setting's value as people say it."""
    if name == "target_damage" and isinstance(value, list):
        with contextlib.suppress(InvalidArgumentError):
            return str(Damage.from_json(json.dumps(value)))
    return str(value)


def keep_lines(log: Path, count: int) -> None:
    """Cut a log to its first lines, at once or not at all."""
    content = log.read_bytes()
    kept = b"".join(line + b"\n" for line in content.split(b"\n")[:count])
    if kept != content:
        write_bytes(log, kept)


def write_state(path: Path, saved: dict[str, Any]) -> None:
    """Replace a state at once or not at all, with a checksum."""
    text = json.dumps(saved).encode()
    write_bytes(path, _digest(text) + b"\n" + text + b"\n")


def read_state(path: Path) -> dict[str, Any] | None:
    """Return a state; ``None`` if there is none or it is not what was written."""
    try:
        digest, text, end = path.read_bytes().split(b"\n")
    except (FileNotFoundError, ValueError):
        return None
    if end or digest != _digest(text):
        return None
    saved: dict[str, Any] = json.loads(text)
    return saved


def state_complaint(path: Path) -> str | None:
    """Return what is wrong with a state's file; ``None`` for none, or no file."""
    try:
        damaged = path.exists() and read_state(path) is None
    except OSError as error:
        return f"{path}: {error.strerror}"
    return f"{path} does not match its checksum" if damaged else None


def _digest(text: bytes) -> bytes:
    return hashlib.sha256(text).hexdigest().encode()
