"""The files of a search or a training run: their names, a history as CSV, and the run's folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import write_bodies
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.runs.manifest import result_folder
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import file_path

CONTROLLER_FILE = "controller.json"
BODIES_FILE = "bodies.json"


@contextmanager
def run_folder(
    out: Path | str | None,
    kind: str,
    settings: Mapping[str, Any],
    outputs: Iterable[str],
    bodies: NDArray[np.float64],
    work: Callable[..., Any] | None = None,
    plan: BodyPlan = AQUAFISH,
) -> Iterator[Path | None]:
    """Yield the folder ``out``, locked and with the manifest of a run; None if ``out`` is None.

    A sample of bodies (M, S) of a plan is written to ``bodies.json``. For the other parameters see
    ``aquafish_gym.runs.manifest.write_manifest``. InvalidArgumentError if the folder
    cannot be written, is in use, or holds another run.
    """
    place = None if out is None else file_path("out", out)
    with result_folder(place, kind, settings, outputs, work) as folder:
        if folder is not None and len(bodies) > 1:
            write_bodies(folder / BODIES_FILE, bodies, plan)
        yield folder


def write_rows(path: Path, rows: Sequence[Any]) -> None:
    """Write dataclasses of one type as CSV, whole or not at all; numbers read back exactly."""
    lines = [",".join(field.name for field in fields(rows[0]))]
    lines += [",".join(map(json.dumps, asdict(row).values())) for row in rows]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
