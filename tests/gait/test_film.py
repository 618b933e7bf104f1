"""The command ``film`` swims what it is given; stages follow the damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.world_config import WorldConfig
from gait.__main__ import main
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.film import Film, filmed
from gait.swims.evaluation import evaluate
from gait.swims.swim import swim
from gait_fakes import make_controller

NOMINAL = Morphology.nominal()
SMALL = ("--seconds", "1", "--width", "160", "--height", "96", "--fps", "10", "--engine", "numba")


@pytest.fixture
def controller_file(tmp_path: Path) -> Path:
    """Return the file of a small network."""
    path = tmp_path / "controller.json"
    make_controller().save(path)
    return path


def test_bodies_and_broken_fins_follow_the_damage() -> None:
    damage = Damage.parse("caudal:missing@4; left_pectoral:weak=0.5@6+2; gyro:noise=0.1")
    still = swim(lambda _observation, _time: (0, 0, 0), NOMINAL, engine="numba", seconds=10)
    found = filmed("", still, NOMINAL, damage)
    assert (found.broken[:, 2] == (still.time > 3.99)).all()
    assert (found.broken[:, 0] == (still.time > 5.99) & (still.time < 7.99)).all()
    assert not found.broken[:, 1].any()
    assert ((found.bodies[:, 6:] == 0).all(axis=1) == found.broken[:, 2]).all()
    assert (found.bodies[:, :6] == NOMINAL.to_array()[:6]).all()


def test_a_servo_that_follows_late_is_broken() -> None:
    damage = Damage.parse("left_pectoral:delay=0.1@0.5; caudal:hold=0.2")
    still = swim(lambda _observation, _time: (0, 0, 0), NOMINAL, engine="numba", seconds=1)
    found = filmed("", still, NOMINAL, damage)
    assert (found.broken[:, 0] == (still.time > 0.49)).all()
    assert not found.broken[:, 1].any()
    assert found.broken[:, 2].all()


def test_one_controller_swims_with_several_damages(
    controller_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "films" / "a.webp"
    damages = ("none", "caudal:missing@0.5", "gyro:noise=0.1")
    assert (
        main(["film", str(controller_file), "--out", str(out), "--damage", *damages, *SMALL]) == 0
    )
    with Image.open(out) as film:
        assert film.size == (160, 96)
    lines = capsys.readouterr().out.splitlines()
    assert [line.rpartition(":")[0] for line in lines] == [
        "undamaged", "caudal:missing@0.5", "gyro:noise=0.1", "Film"
    ]  # fmt: skip
    far = [float(line.rpartition(": ")[2].split()[0]) for line in lines[:3]]
    assert len(set(far)) == 3


def test_a_film_in_reactive_water_shows_that_swim(controller_file: Path) -> None:
    films = [
        Film((controller_file,), seconds=2.0, engine="numba", reactive=reactive)
        for reactive in (False, True)
    ]
    plain, reactive = (film._swims()[0].position[-1] for film in films)
    world = WorldConfig(reactive=True)
    direct = swim(make_controller(), NOMINAL, engine="numba", seconds=2.0, world=world)
    assert reactive.tolist() == direct.position[-1].tolist() != plain.tolist()


@pytest.mark.parametrize(("kind", "engine"), [("film", "numba"), ("replay", "pybullet")])
def test_a_dead_servo_is_filmed(
    kind: str,
    engine: str,
    controller_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "dead.webp"
    words = ["--out", str(out), *SMALL[2:8]] if kind == "film" else ["--html", str(out)]
    given = ["--damage", "caudal:dead", "--seconds", "1", "--engine", engine]
    assert main(["film", str(controller_file), *given, *words]) == 0
    assert out.exists()
    assert "nan" not in capsys.readouterr().out


def test_a_film_begins_where_the_controller_believes_its_fins_to_be(controller_file: Path) -> None:
    """As in an environment, whose agents are given the true angles."""
    senses = Senses(fins=True)
    weights = np.zeros((3, len(senses.names()) + 3))
    weights[:, :-3] = np.random.default_rng(0).normal(size=(3, len(senses.names())))
    feeling = Controller(
        weights, np.zeros(3), np.ones(3), 0.7, NOMINAL, 0, senses=senses, interval=20
    )
    damage = Damage.parse("caudal:seized=1.5; left_pectoral:length=0.5@0.5")
    film = Film((controller_file,), seconds=20.0, engine="numba")
    swum = film._swim(0, feeling, None, damage, "").position[-1, 1]
    played = evaluate(
        feeling, episodes=1, damage=damage, fin_angles="zero", frame_skip=20, dtype="float64"
    )
    assert swum == pytest.approx(played.y_position[-1, 0], abs=1e-4)


@pytest.mark.parametrize(
    "damage", ["left_pectoral:delay=0.3", "caudal:hold=0.25", "gyro:delay=0.3", "gyro_y:stuck@0.6"]
)
def test_a_film_counts_delays_in_actions_as_a_swim_does(damage: str) -> None:
    """An action is held for 20 steps here, of which a film shows every fifth."""
    senses = Senses()
    inputs = np.random.default_rng(1).normal(size=(3, len(senses.names())))
    weights = np.hstack([inputs, np.zeros((3, 3))])
    seeing = Controller(
        weights, np.zeros(3), np.ones(3), 0.7, NOMINAL, 0, senses=senses, interval=20
    )
    film = Film((), seconds=4.0, engine="numba")
    swum = film._swim(0, seeing, None, Damage.parse(damage), "").position[-1]
    alone = swim(seeing, NOMINAL, damage=damage, engine="numba", seconds=4.0)
    assert swum.tolist() == alone.position[-1].tolist()
