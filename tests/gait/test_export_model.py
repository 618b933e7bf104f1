"""Exported models compile without a warning and swim as float64 lanes do, to the bit."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.bodies import write_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.__main__ import main
from gait.controllers.export import export_c
from gait.controllers.export_model import export_model, model_texts, model_vectors
from gait.controllers.network import Senses
from test_export import KINDS, LIMITS_OF_AVR, STRICT, build, needs_cc, refused, searched

BODY = Morphology.nominal()
BROKEN = Morphology.coerce({"left_pectoral": (0.4, 0.0, 0.1), "caudal": (0.1, 1.0, 0.3)})
BODIES = [BROKEN, BODY]


@needs_cc
@pytest.mark.parametrize("reactive", [False, True])
def test_a_thousand_commands_are_equal_to_the_bit(reactive: bool, tmp_path: Path) -> None:
    source, _, table = export_model(BODIES, tmp_path / "fish.c", reactive)
    different = set(table.read_text(encoding="utf-8").splitlines())
    assert len(different) == 1001
    # Without main: neither a function nor a constant is unused.
    cc = str(shutil.which("cc"))
    strict = [*STRICT, "-Wmissing-prototypes"]
    subprocess.run([cc, *strict, "-c", str(source), "-o", str(tmp_path / "a.o")], check=True)
    (tmp_path / "float.h").write_text(LIMITS_OF_AVR)
    assert "needs a double of 64 bits" in refused(source, f"-isystem{tmp_path}")
    (tmp_path / "float.h").unlink()
    assert "without_single_precision_constants" in refused(source, "-fsingle-precision-constant")
    for flags in (("-O0",), ("-O2", "-march=native")):
        ran = build(source, *flags)
        assert ran.stdout == "1000 steps, 0 numbers differ, by at most 0\n"
        assert ran.returncode == 0


@needs_cc
def test_the_self_test_sees_a_wrong_number(tmp_path: Path) -> None:
    source, _, table = export_model(BODY, tmp_path / "fish.c")
    lines = table.read_text(encoding="utf-8").splitlines()
    numbers = lines[500].split(",")
    numbers[-2] = repr(float(np.nextafter(float(numbers[-2]), 1000.0)))
    lines[500] = ",".join(numbers)
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    ran = build(source)
    assert ran.returncode == 1
    assert ran.stdout.startswith("1000 steps, 1 numbers differ, by at most ")


def test_the_vectors_depend_on_the_body_and_on_the_law() -> None:
    sizes = BODY.to_array()
    swims = [model_vectors(*case) for case in ((sizes, 20), (BROKEN.to_array(), 20))]
    swims += [model_vectors(sizes, 20, reactive=True), model_vectors(sizes, 20, seed=1)]
    ends = {tuple(seen[-1].tolist()) for _, seen in swims}
    assert len(ends) == len(swims)


def test_the_head_counts_the_operations() -> None:
    code, head = model_texts(BODY.to_array()[None], "fish")
    step = code.partition("void fish_step(")[2].partition("}")[0]
    computed = re.findall(r"const double t\d+ = (fma)?", step)
    assert f"is {len(computed)} operations" in " ".join(head.split(" *"))
    assert f" {computed.count('fma')} fused multiply-adds" in head
    assert "malloc" not in code


@needs_cc
def test_a_robot_imagines(tmp_path: Path) -> None:
    """The program on the page, with a controller and a sample of bodies, runs."""
    page = Path(__file__).parents[2] / "docs" / "howto" / "export.md"
    code = page.read_text(encoding="utf-8").split("```c\n")[2].split("```")[0]
    export_c(searched("recurrent", Senses()), tmp_path / "fish.c")
    export_model(BODIES, tmp_path / "model.c")
    (tmp_path / "main.c").write_text(code, encoding="utf-8")
    cc = str(shutil.which("cc"))
    sources = ["main.c", "fish.c", "model.c"]
    subprocess.run([cc, *STRICT, *sources, "-lm", "-o", "main"], cwd=tmp_path, check=True)
    ran = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    lines = ran.stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["body 0", "body 1"]
    assert lines[0].partition(":")[2] != lines[1].partition(":")[2]


def test_the_command_takes_the_controllers_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, bodies = tmp_path / "controller.json", tmp_path / "bodies.json"
    KINDS["neat"].save(file)
    write_bodies(bodies, BODIES)
    sizes = ", ".join(map(str, KINDS["neat"].morphology.to_array().tolist()))
    for arguments, held in (
        ([str(file)], (sizes, "[fish_body_count][9]", "= 1\n")),
        ([str(file), "--c", str(tmp_path / "swim.c")], (sizes,)),
        ([], (sizes,)),
        (["--morphology", str(bodies)], ("= 2\n", "2 bodies")),
        (["--reactive"], ("with the added mass",)),
    ):
        assert main(["export", *arguments, "--model", str(tmp_path / "fish.c")]) == 0
        text = "".join((tmp_path / f"fish.{end}").read_text(encoding="utf-8") for end in "ch")
        assert [words for words in held if words not in text] == []
        assert "$" not in text
        assert "NAME" not in text
        said = capsys.readouterr().out.splitlines()
        assert len(said) == (6 if "--c" in arguments else 3)
    assert (tmp_path / "swim.c").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give --c FILE.c, --model FILE.c or both"),
        (["--c", "fish.c"], "--c needs a controller.json or a policy's .zip before it"),
        (["controller.json", "--c", "a.c", "--model", "a.c"], "must have two names"),
        (["controller.json", "--c", "a/fish.c", "--model", "b/Fish.c"], "must have two names"),
        (["controller.json", "--c", "a.c", "--reactive"], "--reactive has no effect without"),
        (["controller.json", "--c", "a.c", "--morphology", "b"], "--morphology has no effect"),
        (["--model", "my-fish.c"], "model must be a file name FILE.c"),
        (["--model", "mine.c"], "model must not overwrite a file that no export wrote"),
        (["--model", "fish.c", "--morphology", "none.json"], "morphology must be a file that can"),
        # Nothing is written where one of two files is refused.
        (["controller.json", "--c", "fish.c", "--model", "mine.c"], "model must not overwrite"),
        (
            ["controller.json", "--c", "new/a.c", "--model", "mine.c/b.c"],
            "the folder of model must",
        ),
        (["controller.json", "--c", "a.c", "--model", "b.c", "--morphology", "no"], "morphology"),
    ],
)
def test_a_wrong_export_is_refused(
    arguments: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    KINDS["neat"].save(tmp_path / "controller.json")
    (tmp_path / "mine.c").write_text("mine")
    assert main(["export", *arguments]) == 2
    assert sentence in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["controller.json", "mine.c"]
    assert (tmp_path / "mine.c").read_text() == "mine"


def test_what_is_no_body_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="bodies must"):
        export_model([[1.0] * 8], tmp_path / "fish.c")  # type: ignore[list-item]
    with pytest.raises(InvalidArgumentError, match="bodies must be one or more; got none"):
        export_model(np.empty((0, 9)), tmp_path / "fish.c")
    assert list(tmp_path.iterdir()) == []
