"""Does a function return the same bytes on another machine? Ask this one to be others.

    python examples/answers/same_bytes.py --out out/answers/same_bytes.png
    python examples/answers/same_bytes.py my_module:my_function

A function is called in new processes, each with the settings by which libraries believe to run on
another processor, with other threads or other hashes. It takes no argument, seeds itself, and
returns numbers, arrays, text, or lists and dictionaries of these. Without a function, some are
shown that differ, and one that does not. The second part shows a compiled function that is stale.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.utils.storage import ensure_writable_directory
from aquafish_gym.utils.validation import InvalidArgumentError

Settings = dict[str, str]  # environment variables
FOLDER = Path(__file__).resolve().parent
CHILD = (
    "import sys; sys.path[:0] = sys.argv[1:3]; from same_bytes import record; record(*sys.argv[3:])"
)
DIFFERENT_NUMBERS = "other numbers"  # of another count, so that no difference can be told


def emulations() -> dict[str, list[Settings]]:
    """Return settings by which this machine is taken for others, by what they change."""
    found = {
        "hash seed": [{"PYTHONHASHSEED": seed} for seed in ("1", "2")],
        "threads": [
            {f"{library}_NUM_THREADS": count for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
            for count in ("1", "2", "3")
        ],
    }
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return found
    avx512 = "X86_V4" in simd() or "AVX512F" in simd()
    cores = ["Nehalem", "Haswell", *(["SkylakeX"] if avx512 else [])]
    cpus = ["haswell", *(["skylake-avx512"] if avx512 else [])]
    return found | {
        "BLAS kernels": [
            *({"OPENBLAS_CORETYPE": core} for core in cores),
            {"MKL_ENABLE_INSTRUCTIONS": "SSE4_2"},
        ],
        "SIMD of NumPy": [
            {"NPY_DISABLE_CPU_FEATURES": " ".join(simd()[first:])} for first in range(len(simd()))
        ],
        "PyTorch and XLA": [
            {"ATEN_CPU_CAPABILITY": "default", "XLA_FLAGS": "--xla_cpu_max_isa=SSE4_2"}
        ],
        # The names of old and new versions; each ignores those of the others.
        "C library": [
            {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable"}
        ],
        "CPU of numba": [
            {"NUMBA_CPU_NAME": "generic"},
            *({"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""} for cpu in cpus),
        ],
    }


def simd() -> list[str]:
    """Return the instruction sets that NumPy chooses to use here, the oldest first."""
    umath: Any = import_module("numpy._core._multiarray_umath")
    return [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]


def sum_over_a_set() -> float:
    """Add numbers in the order of a set of text, which Python's hashes decide."""
    return sum(1.0 / int(name) for name in {str(i) for i in range(1, 1000)})


def dot_product() -> float:
    """Add many products: OpenBLAS gives each thread a part, and adds their sums."""
    a, b = np.random.default_rng(0).normal(size=(2, 100_000))
    return float(a @ b)


def matrix_product() -> NDArray[np.float64]:
    """Multiply matrices by the kernels that BLAS has for the processor."""
    a, b = np.random.default_rng(0).normal(size=(2, 200, 200))
    product: NDArray[np.float64] = a @ b
    return product


def tanh_of_numpy() -> NDArray[np.float64]:
    """Take hyperbolic tangents, for which NumPy has vector instructions of its own."""
    found: NDArray[np.float64] = np.tanh(np.random.default_rng(0).normal(size=20_000))
    return found


def sines_of_python() -> list[float]:
    """Take sines and powers by the C library, which has functions with fused multiply-adds."""
    return [math.sin(0.37 * i) + math.pow(1.0 + 0.01 * i, 1.3) for i in range(5000)]


def fast_loop_of_numba() -> float:
    """Add by a loop that numba may reorder and fuse, as fastmath=True allows."""
    from numba import njit

    def total(x: NDArray[np.float64]) -> float:
        found = 0.0
        for each in x:
            found += each * each
        return found

    return float(njit(fastmath=True)(total)(np.random.default_rng(0).normal(size=1000)))


def this_project() -> list[NDArray[np.float64]]:
    """Swim 32 robots for 5 s with the compiled engine, and infer nothing."""
    from aquafish_gym import Morphology, simulate

    rng = np.random.default_rng(0)
    bodies = np.tile(Morphology.nominal().to_array(), (32, 1))
    logs = simulate(bodies, rng.uniform(0, 0.5, (32, 3)), rng.uniform(-1, 1, (32, 3)), 500, "numba")
    return [np.asarray(logs.gyro)]


SHOWN = (
    sum_over_a_set,
    dot_product,
    matrix_product,
    tanh_of_numpy,
    sines_of_python,
    fast_loop_of_numba,
    this_project,
)


class Outcome(NamedTuple):
    """What a function returned under some settings, against what it returns without."""

    settings: Settings
    same: bool
    difference: str | float  #: the largest relative one of the numbers, or why there is none


def record(out: str, *functions: str) -> None:
    """Call functions, each MODULE:FUNCTION, and write what they return as hashes and numbers."""
    document = {}
    for name in functions:
        module, _, function = name.partition(":")
        parts = list(_parts(getattr(import_module(module), function)()))
        digest = hashlib.sha256()
        numbers = []
        for part in parts:
            digest.update(part if isinstance(part, bytes) else part.tobytes())
            if isinstance(part, np.ndarray) and part.dtype.kind == "f":
                numbers.append(part.astype(np.float64).ravel())
        document[name] = digest.hexdigest()
        with Path(out, f"{functions.index(name)}.npy").open("wb") as file:
            np.save(file, np.concatenate([np.zeros(0), *numbers]))
    Path(out, "hashes.json").write_text(json.dumps(document), "utf-8")


def _parts(value: Any) -> Iterator[bytes | NDArray[Any]]:
    """Yield a value's arrays and text, in order."""
    if isinstance(value, dict):
        value = [part for item in value.items() for part in item]
    if isinstance(value, list | tuple):
        yield f"{len(value)} of".encode()
        for each in value:
            yield from _parts(each)
    elif isinstance(value, bytes | str | None):
        yield value if isinstance(value, bytes) else str(value).encode()
    else:
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise InvalidArgumentError(
                "function must return numbers, arrays, text, or lists and dictionaries of these; "
                f"it returned {type(value).__name__}"
            )
        yield f"{array.dtype} {array.shape}".encode()
        yield array


def outcomes(functions: list[str]) -> dict[str, dict[str, list[Outcome]]]:
    """Return the outcomes of functions: by function, by what the settings change."""
    groups = emulations()
    everything = [{}, *(settings for several in groups.values() for settings in several)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        places = [Path(folder, str(i)) for i in range(len(everything))]
        list(pool.map(lambda one: _run(functions, *one), zip(everything, places, strict=True)))
        hashes = [json.loads((place / "hashes.json").read_text("utf-8")) for place in places]
        found: dict[str, dict[str, list[Outcome]]] = {}
        for i, name in enumerate(functions):
            numbers = [np.load(place / f"{i}.npy") for place in places]
            each = iter(range(1, len(everything)))
            found[name] = {
                group: [
                    Outcome(
                        settings, hashes[k][name] == hashes[0][name], _away(numbers[k], numbers[0])
                    )
                    for settings, k in zip(several, each, strict=False)
                ]
                for group, several in groups.items()
            }
    return found


def _run(functions: list[str], settings: Settings, place: Path) -> None:
    """Call functions in a new process with settings."""
    place.mkdir()
    emulated = {name for several in emulations().values() for one in several for name in one}
    known = {name: value for name, value in os.environ.items() if name not in emulated}
    environment = known | {"PYTHONHASHSEED": "0"} | settings
    command = [sys.executable, "-c", CHILD, str(Path.cwd()), str(FOLDER), str(place), *functions]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["nothing was said"])[-1]
        raise InvalidArgumentError(
            f"function must run with {settings or 'no settings'}; it ended with "
            f"{done.returncode}: {last}"
        )


def _away(numbers: NDArray[np.float64], wanted: NDArray[np.float64]) -> str | float:
    if numbers.shape != wanted.shape:
        return DIFFERENT_NUMBERS
    size = np.abs(wanted).max(initial=0.0)
    return float(np.abs(numbers - wanted).max(initial=0.0) / size) if size else 0.0


STALE = {
    "robot/__init__.py": "",
    "robot/gains.py": "from numba import njit\n\n@njit\ndef double(x):\n    return {factor} * x\n",
    "robot/by_numba.py": (
        "from numba import njit\nfrom robot.gains import double\n\n"
        "@njit(cache=True)\ndef command(x):\n    return double(x)\n"
    ),
    "robot/by_us.py": (
        "from aquafish_gym.physics.compiling import compiled\nfrom robot.gains import double\n\n"
        "def _command(x):\n    return double(x)\n\ncommand = compiled(_command)\n"
    ),
}


def stale() -> list[tuple[float, float]]:
    """Return what numba's cache and ours call 1.0, before and after an imported file is edited."""
    program = "from robot import by_numba, by_us; print(by_numba.command(1.0), by_us.command(1.0))"
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, text in STALE.items():
            path = Path(folder, name)
            path.parent.mkdir(exist_ok=True)
            path.write_text(text.replace("{factor}", "2.0"), "utf-8")
        environment = os.environ | {"NUMBA_CACHE_DIR": str(Path(folder, "cache"))}
        paths = [folder, *filter(None, [os.environ.get("PYTHONPATH")])]
        environment["PYTHONPATH"] = os.pathsep.join(paths)
        for factor in ("2.0", "3.0"):
            text = STALE["robot/gains.py"].replace("{factor}", factor)
            Path(folder, "robot/gains.py").write_text(text, "utf-8")
            done = subprocess.run(
                [sys.executable, "-c", program], env=environment, capture_output=True, text=True,
                check=True,
            )  # fmt: skip
            one, two = done.stdout.split()
            found.append((float(one), float(two)))
    return found


@dataclass(frozen=True)
class SameBytes:
    """Call functions as on other machines, and compare what they return byte by byte."""

    example: ClassVar[str] = "my_module:my_function"

    functions: Annotated[
        tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="MODULE:FUNCTION ...")
    ] = ()
    """Functions to check, found from this folder; without any, some are shown."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A picture to write, such as out/answers/same_bytes.png."""

    def execute(self) -> None:
        """Call, print and draw; end with 1 where a function that was named differs."""
        for name in self.functions:
            if not all(name.partition(":")):
                raise InvalidArgumentError(f"functions must be MODULE:FUNCTION; got {name!r}")
        if self.out is not None:
            ensure_writable_directory(self.out.parent, "out")
        names = list(self.functions) or [f"same_bytes:{one.__name__}" for one in SHOWN]
        found = outcomes(names)
        print(table(found))
        if self.out is not None:
            draw(found, self.out)
        if not self.functions:
            (_, _), (numba, ours) = stale()
            print(f"\nan imported file now triples: numba's cache gives {numba}, this one {ours}")
            return
        for name, groups in found.items():
            for one in (one for several in groups.values() for one in several if not one.same):
                words = " ".join(f"{key}={value!r}" for key, value in one.settings.items())
                print(f"{name} differs by {_spelled(one)} with {words}")
        if any(not one.same for groups in found.values() for s in groups.values() for one in s):
            raise SystemExit(1)


def _spelled(one: Outcome) -> str:
    return one.difference if isinstance(one.difference, str) else f"{one.difference:.0e}"


def _titles(names: Iterable[str]) -> list[str]:
    """Return names of functions for readers: those of this file in words."""
    own = "same_bytes:"
    return [n.removeprefix(own).replace("_", " ") if n.startswith(own) else n for n in names]


def table(found: dict[str, dict[str, list[Outcome]]]) -> str:
    """Return a line of text for each function: what makes its bytes differ."""
    groups = list(next(iter(found.values())))
    widths = [max(len(group), 6) for group in groups]
    names = _titles(found)
    first = max(map(len, names))
    lines = ["  ".join([" " * first, *(f"{g:>{w}}" for g, w in zip(groups, widths, strict=True))])]
    for name, outcome in zip(names, found.values(), strict=True):
        words = ["same" if all(one.same for one in outcome[group]) else "OTHER" for group in groups]
        cells = (f"{word:>{width}}" for word, width in zip(words, widths, strict=True))
        lines.append("  ".join([f"{name:{first}}", *cells]))
    return "\n".join(lines)


def draw(found: dict[str, dict[str, list[Outcome]]], path: Path) -> None:
    """Draw which settings make bytes differ, and by how much the numbers do."""
    from matplotlib.figure import Figure

    names = _titles(found)
    groups = next(iter(found.values()))
    figure = Figure((9.0, 1.6 + 0.42 * len(names)), layout="constrained")
    axes = figure.subplots()
    starts = np.cumsum([0, *(len(several) for several in groups.values())])
    for row, outcome in enumerate(found.values()):
        cells = [one for several in outcome.values() for one in several]
        for column, one in enumerate(cells):
            colour = "#d9efe5" if one.same else "#D55E00"
            axes.add_patch(_cell(column, row, colour))
            if not one.same:
                text = "?" if isinstance(one.difference, str) else f"{one.difference:.0e}"
                axes.text(
                    column + 0.5, row + 0.5, text.replace("e-", "e\N{MINUS SIGN}"), ha="center",
                    va="center", fontsize=6.5, color="white",
                )  # fmt: skip
    for start in starts[1:-1]:
        axes.axvline(start, color="black", lw=1.2)
    axes.set_xlim(0, starts[-1])
    axes.set_ylim(len(names), 0)
    axes.set_yticks(np.arange(len(names)) + 0.5, names)
    axes.set_xticks(
        0.5 * (starts[1:] + starts[:-1]), [group.replace(" ", "\n") for group in groups], fontsize=8
    )
    axes.tick_params(length=0)
    axes.set_title(
        "green: the same bytes; red: others, and the largest difference over the largest number",
        fontsize=9,
    )
    figure.savefig(path, dpi=120, metadata={"Software": None})


def _cell(column: int, row: int, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((column, row), 1, 1, facecolor=colour, edgecolor="white", lw=0.8)


if __name__ == "__main__":
    sys.exit(run_command_line("same_bytes", SameBytes))
