"""What each command refuses: with one line on stderr, exit code 2, and nothing written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from aquafish.cli import main
from aquafish_gym import Morphology
from gait import Controller

SWIM = Path(__file__).parents[1] / "examples" / "logs" / "swim.csv"
#: Of each command, its words and what is said (a regular expression). ``{out}`` is a folder that
#: must stay away, ``{file}`` a file without JSON, and ``{good}`` a controller.
REFUSED: dict[str, list[tuple[str, str]]] = {
    "run --condition none --out {out}": [
        ("--steps 100", "steps must be a power of two; got 100"),
        ("--condition joint --steps 8", "at least 16"),
        ("--condition joint --exploration.population 6", "is for the condition ideal or none"),
        ("--joint.bodies 96", "joint.bodies is for the condition joint; got"),
        ("--out-of-band.revisit 0", "out_of_band.revisit is for the condition out-of-band"),
        ("--in-band.best 3", "in_band.best is for the condition in-band; got"),
        ("--in-band.k 5", "unknown option --in-band.k"),
        ("--genetic.elite 3", "unknown option --genetic.elite; did you mean --genetic.elites?"),
        ("--exploration.population 1", "exploration.population must be a whole number of at"),
        ("--seed 1" + 400 * "0", "seed must be a whole number"),
        ("--out=", "--out must not be empty"),
        ("--target-damage left_pectoral:lenght=0.5", "did you mean 'length'"),
        ("--target-morphology /nowhere.json", "target_morphology must be a file"),
        ("--current 0 nan 0", "current must be finite"),
        ("--out /proc/nothing/here", "out must be a directory that can be written"),
        ("--condition joint --joint.nuisances curent", "did you mean 'current'"),
    ],
    "study --out {out}": [
        ("", "either --figure or"),
        ("--conditions", "either --figure or"),
        ("--figure 5 --steps 100", "steps must be a power of two; got 100"),
        ("--figure 5 --steps 64 64", "steps must differ from each other"),
        ("--figure 5 --replicates 1" + 400 * "0", "replicates must be .* at most 10000"),
        ("--figure 5 --held-out --replicates 11", "replicates with held_out must .* at most 10"),
        ("--figure 5 --workers 0", "workers must be a whole number"),
        ("--conditions joint --joint.nuisances cure", "did you mean 'current'"),
        ("--figure 5 9 --in-band.best 5", "in_band.best is for the condition in-band"),
        (
            "--figure 7 --preset smoke --in-band.best 7",
            "in_band.best must be at most estimation.population, 6; got 7",
        ),
        (
            "--figure 5 --out-of-band.period 4",
            "out_of_band.period is for the condition out-of-band",
        ),
        (
            "--conditions out-of-band --out-of-band.sampled-models 26",
            "sampled_models must be at most estimation",
        ),
        ("--figure 5 --current 0 0 nan", "current must be finite"),
        ("--figure 7 --in-band.best x", "--in-band.best must have values .*; got 'x'"),
        ("--figure 7 --rounds x", "--rounds must have values .*; got 'x'"),
        ("--figure 12", "--figure must be one of 5, 6, 7, 8, 9, 10, all; got '12'"),
        ("--conditions in-bnd", "must be one of ideal, none, in-band, .*; got 'in-bnd'; did you"),
        ("--figure 5 --step 64", "unknown option --step; did you mean --steps"),
        ("--xyzzy 3", "unknown option --xyzzy: see --help"),
    ],
    f"infer --log {SWIM}": [
        ("--out {out} --nuisances gyro_bia", r"did you mean 'gyro_bias'\?"),
        ("--start moving --nuisances current", "must be one of drag, servo_gain"),
        ("--noise -1", "noise must be a finite number of at least 1e-09; got -1.0"),
        ("--nuisances curent", r"did you mean 'current'\?"),
        ("--truth nothing.json", "truth must be a file that can be read"),
        ("--seed -1", "seed must be a whole number"),
        ("--between 3", "between must be two times, s, the second later; got 3"),
        ("--out {out} --threads 0", "threads must be a whole number of at least 1"),
        ("--out /dev/null/x", "out must be a directory that can be written"),
    ],
    "recover --out {out}": [
        ("--damage left_pectorl:length=0.5", "did you mean 'left_pectoral'"),
        ("--steps 100", "steps must be a power of two; got 100"),
        ("--models 0", "estimation.population must be"),
        ("--replicates 0", "replicates must be a whole number of at least 1"),
        ("--held-out --replicates 11", "replicates with --held-out must .* at most 10"),
        ("--scheduler 127.0.0.1", "such as tcp://host:8786; got '127.0.0.1'"),
    ],
    "evolve --out {out}": [
        ("--out {file}", "out must be a directory that can be written"),
        ("--damage caudal:lenth=1", "did you mean 'length'"),
        ("--morphology {out}/no.json", "No such file"),
        ("--generations 0", "generations must be"),
        ("--out=", "--out must not be empty"),
        ("--cma-generations 9", "has an effect only with"),
        ("--paper --search cma", "paper has an effect only with"),
        ("--paper --controller recurrent", "controller has an effect only with"),
        ("--task station --seconds 20", "--seconds has no"),
        ("--senses imu --harmonics 3", "harmonics has an effect only with"),
        ("--controller linear --hidden 6", "hidden has an effect only with"),
        ("--world.lag 1.1", "lag must"),
    ],
    "transfer": [
        ("--controller {file}", "is not JSON"),
        ("--controller {good} --target-engine bullet", "'pybullet'"),
    ],
    "baseline --out {out}": [
        ("--interval 7", "the nearest is 5"),
        ("--steps 0", "steps must be"),
    ],
    "film {good}": [
        ("--html {out}/a.html --fps 20", "--fps has no effect"),
        ("--html /dev/null", "html must be a file that can be written; '/dev/null': it exists"),
        ("--out /dev/null", "out must be a file that can be written; '/dev/null': it exists"),
        ("--out {out}/film.webp --damage tail:missing", "damage part"),
        ("--damage", "damage must have one value or more; got none"),
        ("--label a b --damage none none none", "label must be 1 or 3"),
        ("--out a.avi", "suffix"),
    ],
    "view": [
        ("--robots 65", "robots"),
        ("--robots 2 --gyro-only", "gyro_only must be false with 2 robots"),
    ],
    "evolv": [("", "did you mean 'evolve'")],
    "--hlep": [("", r"unknown option --hlep; did you mean --help\?")],
    "page --out {out}": [("", "unknown option --out; must be --html or")],
}
ROWS = [
    pytest.param(f"{command} {words}", said, id=f"{command.split()[0]}-{words[:40]}")
    for command, rows in REFUSED.items()
    for words, said in rows
]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a controller."""
    path = tmp_path_factory.mktemp("good") / "controller.json"
    weights = [[0.0] * 14] * 3
    Controller(weights, [0.0] * 3, [1.0] * 3, 0.7, Morphology.nominal(), seed=0).save(path)
    return path


@pytest.mark.parametrize(("line", "said"), ROWS)
def test_a_command_is_refused_in_one_line_and_writes_nothing(
    line: str,
    said: str,
    good: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "file"
    file.write_text("fish")
    monkeypatch.chdir(tmp_path)
    words = [word.format(out=tmp_path / "out", file=file, good=good) for word in line.split()]
    assert main(words) == 2
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err.count("\n") == 1
    assert re.search(said, found.err), found.err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
