"""Exported C files compile without a warning and are the lanes to the bit: controllers, models."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.bodies import write_bodies
from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.__main__ import main
from gait.controllers import export
from gait.controllers.controller import SCHEMA, Controller, program_of
from gait.controllers.export_model import export_model, model_texts
from gait.controllers.network import Senses
from gait.learning.train import dense_network
from gait.search.templates import Template
from gait_fakes import make_controller

BODY = Morphology.nominal()
BROKEN = Morphology.coerce({"left_pectoral": (0.4, 0.0, 0.1), "caudal": (0.1, 1.0, 0.3)})
BODIES = [BROKEN, BODY]
STRICT = (
    "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-pedantic", "-std=c99"
)  # fmt: skip
STRICT_CPP = ("-Wall", "-Wextra", "-Wconversion", "-Wold-style-cast", "-Werror", "-pedantic")
CC = shutil.which("cc")
needs_cc = pytest.mark.skipif(CC is None, reason="there is no C compiler, cc")


def searched(kind: str, senses: Senses, interval: int = 5, plan: BodyPlan = AQUAFISH) -> Controller:
    """Return a random controller of a class that CMA-ES searches."""
    template = Template.of_class(kind, senses, 6, interval, plan)
    vector = 0.5 * np.random.default_rng(1).standard_normal(template.size)
    return template.controller(vector, 0.7, Morphology.nominal(plan), 0)


def learned(senses: Senses) -> Controller:
    """Return a random controller of the shape that PPO learns."""
    rng, inputs = np.random.default_rng(2), len(senses.names())
    shapes = [(64, inputs), (64, 64), (3, 64)]
    layers = [
        (rng.standard_normal(s) / s[1] ** 0.5, 0.1 * rng.standard_normal(s[0])) for s in shapes
    ]
    weights, bias = dense_network(layers, np.zeros(inputs), np.ones(inputs))
    ones = np.ones(len(bias))
    return Controller(
        weights, bias, ones, 0.7, BODY, 0, senses=senses, layers=(64, 64, 3), output="clip",
        interval=20,
    )  # fmt: skip


def silent() -> Controller:
    """Return a controller without a sense or a connection."""
    return Controller(
        np.zeros((3, 3)), np.full(3, 0.1), np.ones(3), 0.0, BODY, 0,
        senses=Senses(imu=False, clock=0), output="clip",
    )  # fmt: skip


KINDS = {
    "clock": searched("linear", Senses(imu=False, clock=8)),
    "linear": searched("linear", Senses(clock=2)),
    "mlp": searched("mlp", Senses(fins=True, goal=True)),
    "recurrent": searched("recurrent", Senses(clock=1)),
    "recurrent_fins": searched("recurrent", Senses(clock=0, fins=True)),
    "recurrent_goal": searched("recurrent", Senses(imu=False, clock=32, fins=True, goal=True), 10),
    "neat": make_controller(3, 60),
    "ppo": learned(Senses(fins=True)),
    "ppo_goal": learned(Senses(clock=0, goal=True)),
    "silent": silent(),
    "four_fins": searched("recurrent", Senses(fins=True), plan=FOUR_FINS),
    "tail_fish": searched("mlp", Senses(fins=True, goal=True), plan=TAIL_FISH),
}


def middle_and_reach(controller: Controller) -> tuple[np.ndarray, np.ndarray]:
    """Return the commands of the action 0, and how far those of 1 lie from them, in float32."""
    low, high = controller.plan.command_low, controller.plan.command_high
    return ((low + high) / 2).astype(np.float32), ((high - low) / 2).astype(np.float32)


def build(source: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    """Compile an exported file and run its self-test on the vectors beside it."""
    program = source.with_suffix("")
    command = [str(CC), *STRICT, *flags, f"-D{source.stem}_TEST", str(source), "-o", str(program)]
    subprocess.run([*command, "-lm"], check=True)
    with source.with_suffix(".csv").open(encoding="utf-8") as vectors:
        return subprocess.run([program], stdin=vectors, capture_output=True, text=True, check=False)


@needs_cc
@pytest.mark.parametrize("kind", KINDS)
def test_two_thousand_steps_are_equal_to_the_bit(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "VECTOR_COUNT", 2_000)
    source, _, table = export.export_c(KINDS[kind], tmp_path / f"{kind}.c")
    different = set(table.read_text(encoding="utf-8").splitlines())
    assert len(different) > (1 if kind == "silent" else 1000)
    # Without main: neither a function nor a constant is unused.
    subprocess.run([str(CC), *STRICT, "-c", str(source), "-o", str(tmp_path / "a.o")], check=True)
    for flags in (("-O0",), ("-O3", "-march=native")):  # the next test has -O2
        ran = build(source, *flags)
        assert ran.stdout == "2000 steps, 0 numbers differ, by at most 0\n"
        assert ran.returncode == 0


@needs_cc
@pytest.mark.parametrize("kind", KINDS)
def test_a_reading_that_cannot_be_is_not_observed(kind: str, tmp_path: Path) -> None:
    """It neither reaches the memory nor the reckoned fins: the last one is held."""
    controller = KINDS[kind]
    source, _, table = export.export_c(controller, tmp_path / f"{kind}.c")
    rng, steps = np.random.default_rng(1), 500
    whole = rng.uniform(-1.0, 1.0, (steps, 12)).astype(np.float32)
    broken = whole.copy()
    where = rng.random(whole.shape) < 0.1
    where[0, 6], where[1] = True, True
    broken[where] = rng.choice(
        np.array([np.nan, np.inf, -np.inf, 1e30, -3000.0], np.float32), where.sum()
    )
    held = np.zeros_like(whole)
    for t in range(steps):
        held[t] = np.where(where[t], held[t - 1] if t else 0.0, whole[t])
    senses = controller.senses
    columns = [*range(9 * senses.imu), *range(9, 9 + 3 * senses.goal)]
    rows = np.concatenate([broken[:, columns], export.answers(controller, held)], axis=1)
    first = table.read_text(encoding="utf-8").splitlines()[0]
    lines = [first, *(",".join(map(str, row)) for row in rows)]
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert build(source, "-O2").stdout == "500 steps, 0 numbers differ, by at most 0\n"


def make_wrong(table: Path, kind: type[np.floating[Any]], column: int) -> None:
    """Change a number of the 500th test vector to the next one."""
    lines = table.read_text(encoding="utf-8").splitlines()
    numbers = lines[500].split(",")
    numbers[column] = repr(float(np.nextafter(kind(numbers[column]), kind(1000))))
    lines[500] = ",".join(numbers)
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")


@needs_cc
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_the_self_test_sees_a_wrong_number(kind: Any, tmp_path: Path) -> None:
    """Of a controller, and of a model, which has double precision."""
    path = tmp_path / "fish.c"
    files = export.export_c(KINDS["neat"], path) if kind is np.float32 else export_model(BODY, path)
    make_wrong(files[2], kind, -2)
    ran = build(files[0])
    assert ran.returncode == 1
    assert ran.stdout.startswith("1000 steps, 1 numbers differ, by at most ")


@needs_cc
def test_the_self_test_refuses_what_is_no_test_vector(tmp_path: Path) -> None:
    source, _, table = export.export_c(KINDS["neat"], tmp_path / "fish.c")
    text = table.read_text(encoding="utf-8")
    lines = text.splitlines()
    for broken, row in (
        ("", 1),
        (lines[0], 1),
        (text[: -len(lines[-1]) // 2], 1000),
        (text + "a", 1001),
    ):
        table.write_text(broken, encoding="utf-8")
        ran = build(source)
        assert (ran.returncode, ran.stdout) == (
            1, f"row {row} on standard input is no test vector\n"
        )  # fmt: skip


def test_exported_files_are_replaced_and_no_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, source = tmp_path / "controller.json", tmp_path / "new" / "fish.c"
    KINDS["neat"].save(file)
    files = [source.with_suffix(f".{end}") for end in ("c", "h", "csv")]
    assert main(["export", str(file), "--c", str(source)]) == 0
    before = [file.read_bytes() for file in files]
    said = [f"wrote {p} ({len(b)} bytes)" for p, b in zip(files, before, strict=True)]
    assert capsys.readouterr().out.splitlines() == said
    assert b"$" not in before[0]
    assert b"NAME" not in before[0]
    files[0].unlink()
    assert main(["export", str(file), "--c", str(source)]) == 0
    assert [file.read_bytes() for file in files] == before
    for file, content in zip(files, before, strict=True):
        file.write_text("mine", encoding="utf-8")
        with pytest.raises(InvalidArgumentError, match=rf"{re.escape(file.name)} exists"):
            export.export_c(KINDS["linear"], files[0])
        assert file.read_text(encoding="utf-8") == "mine"
        file.write_bytes(content)


@needs_cc
@pytest.mark.parametrize("includes", ["h", "c"])
def test_two_controllers_go_into_one_program(includes: str, tmp_path: Path) -> None:
    names = ("neat", "recurrent_fins", "ppo_goal")
    for name in names:
        export.export_c(KINDS[name], tmp_path / f"{name}.c")
    both = "".join(f'#include "{n}.{includes}"\n' for n in names) + "int main(void) { return 0; }\n"
    (tmp_path / "main.c").write_text(both)
    sources = ["main.c", *(f"{name}.c" for name in names if includes == "h")]
    subprocess.run([str(CC), *STRICT, *sources, "-lm", "-o", "a"], cwd=tmp_path, check=True)


MAIN = """#include "fish.h"
#include "fish.h"
int main(void)
{
    fish_state state;
    const float imu[9] = {0.0f};
    float command[3];
    fish_reset(&state);
    fish_step(&state, imu, command);
    return command[0] < -0.5f;
}
"""


@needs_cc
@pytest.mark.parametrize("name", ["main.c", "sketch.cpp"])
def test_projects_that_compile_every_file_link(name: str, tmp_path: Path) -> None:
    """Two sources include the header, one of them C or C++."""
    compiler = shutil.which("cc" if name == "main.c" else "c++")
    if compiler is None:
        pytest.skip("there is no compiler of C++, c++")
    export.export_c(KINDS["neat"], tmp_path / "fish.c")
    (tmp_path / name).write_text(MAIN)
    (tmp_path / "other.c").write_text('#include "fish.h"\nconst int nodes = fish_nodes;\n')
    every = [str(CC), *STRICT, "-Wmissing-prototypes", "-c", "fish.c", "other.c"]
    subprocess.run(every, cwd=tmp_path, check=True)
    strict = STRICT if name == "main.c" else STRICT_CPP
    linked = [compiler, *strict, name, "fish.o", "other.o", "-lm", "-o", "a"]
    subprocess.run(linked, cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "a"], check=True)


def refused(source: Path, *flags: str) -> str:
    """Return what the compiler says of a file that it must not compile."""
    command = [str(CC), "-std=c99", *flags, "-c", str(source), "-o", str(source.with_suffix(".o"))]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert made.returncode != 0
    return made.stderr


@needs_cc
def test_a_header_of_another_export_is_refused(tmp_path: Path) -> None:
    source, header, _ = export.export_c(KINDS["linear"], tmp_path / "fish.c")
    other = export.export_c(KINDS["mlp"], tmp_path / "other" / "fish.c")[1]
    both = tmp_path / "both.c"
    both.write_text(f'#include "fish.h"\n#include "{other}"\n')
    assert "fish_inputs" in refused(both)
    header.write_bytes(other.read_bytes())
    assert "fish.h and fish.c are of two exports" in refused(source)


LIMITS_OF_AVR = "#include_next <float.h>\n#undef DBL_MANT_DIG\n#define DBL_MANT_DIG 24\n"
LIMITS_OF_X87 = "#include_next <float.h>\n#undef FLT_EVAL_METHOD\n#define FLT_EVAL_METHOD 2\n"


@needs_cc
@pytest.mark.parametrize("kind", ["mlp", "clock", "ppo_goal", "silent"])
def test_a_file_does_not_compile_where_its_arithmetic_is_another(kind: str, tmp_path: Path) -> None:
    """A controller without a clock and fins does without double."""
    source = export.export_c(KINDS[kind], tmp_path / "fish.c")[0]
    for flag in ("-ffast-math", "-ffinite-math-only", "-Ofast"):
        assert "compile this file with -fno-fast-math" in refused(source, flag)
    folder = tmp_path / "include"
    folder.mkdir()
    (folder / "float.h").write_text(LIMITS_OF_X87)
    assert "compile this file with -msse2 -mfpmath=sse" in refused(source, f"-isystem{folder}")
    (folder / "float.h").write_text(LIMITS_OF_AVR)
    single = "-fsingle-precision-constant"
    if kind in ("mlp", "clock"):
        assert "needs a double of 64 bits" in refused(source, f"-isystem{folder}")
        assert "compiled_without_single_precision_constants" in refused(source, single)
    else:
        assert build(source, f"-isystem{folder}", single).returncode == 0
    assert build(source, "-ffast-math", "-fno-fast-math").returncode == 0


@pytest.mark.parametrize("kind", [k for k, c in KINDS.items() if not c.senses.goal])
def test_vectors_are_what_the_time_loop_commands(kind: str) -> None:
    controller = KINDS[kind]
    senses = controller.senses
    observations, commands = export.make_vectors(controller, 200)
    lanes = LaneBatch(Scenario.create(controller.morphology, plan=controller.plan), np.float32)
    program = program_of([controller])
    loop = ClosedLoop(1, len(lanes.plan.fins), lanes.width, np.float32, program.scratch)
    fins = len(controller.plan.fins)
    loop["fins"] = np.resize(export.VECTOR_FIN_ANGLES, (fins, 1)) / (2 * np.pi)
    loop["gain"] = np.resize(export.VECTOR_SERVO_GAIN, (fins, 1))
    loop.broken = True
    loop["stuck"] = 1.0  # so that the sensors say what they held before: the observations
    weights = pack_rows(program.weights, np.float32, lanes.width)
    middle, reach = middle_and_reach(controller)
    for observed, expected in zip(observations, commands, strict=True):
        if senses.imu:
            loop["latched"] = observed[:, None]
        lanes.run(
            program.function, weights, program.layout, controller.interval, controller.interval,
            loop,
        )  # fmt: skip
        action = loop["action"][:, 0].astype(np.float32)
        assert (middle + reach * action).tolist() == expected.tolist()


@pytest.mark.parametrize("kind", KINDS)
def test_vectors_are_near_those_of_the_policy_in_double_precision(kind: str) -> None:
    controller = KINDS[kind]
    observations, commands = export.make_vectors(controller, 50)
    fins = len(controller.plan.fins)
    act = controller.policy(
        np.resize(export.VECTOR_FIN_ANGLES, fins), np.resize(export.VECTOR_SERVO_GAIN, fins)
    )
    middle, reach = middle_and_reach(controller)
    for step, (observed, expected) in enumerate(zip(observations, commands, strict=True)):
        imu = observed if controller.senses.imu else np.concatenate([np.zeros(9), observed])
        action = np.asarray(act(imu, step * controller.interval * 0.01))
        np.testing.assert_allclose(middle + reach * action, expected, atol=1e-3)


@needs_cc
@pytest.mark.parametrize(
    ("bodies", "reactive"),
    [
        (BODIES, False),
        (BODIES, True),
        (Morphology.nominal(FOUR_FINS), False),
        (Morphology.nominal(TAIL_FISH), True),
    ],
)
def test_a_thousand_commands_of_a_model_are_equal_to_the_bit(
    bodies: Any, reactive: bool, tmp_path: Path
) -> None:
    source, _, table = export_model(bodies, tmp_path / "fish.c", reactive)
    different = set(table.read_text(encoding="utf-8").splitlines())
    assert len(different) == 1001
    # Without main: neither a function nor a constant is unused.
    strict = [*STRICT, "-Wmissing-prototypes"]
    subprocess.run([str(CC), *strict, "-c", str(source), "-o", str(tmp_path / "a.o")], check=True)
    (tmp_path / "float.h").write_text(LIMITS_OF_AVR)
    assert "needs a double of 64 bits" in refused(source, f"-isystem{tmp_path}")
    (tmp_path / "float.h").unlink()
    assert "without_single_precision_constants" in refused(source, "-fsingle-precision-constant")
    for flags in (("-O0",), ("-O2", "-march=native")):
        ran = build(source, *flags)
        assert ran.stdout == "1000 steps, 0 numbers differ, by at most 0\n"
        assert ran.returncode == 0


def test_the_head_counts_the_operations() -> None:
    code, head = model_texts(AQUAFISH, BODY.to_array()[None], "fish")
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
    export.export_c(searched("recurrent", Senses()), tmp_path / "fish.c")
    export_model(BODIES, tmp_path / "model.c")
    (tmp_path / "main.c").write_text(code, encoding="utf-8")
    sources = ["main.c", "fish.c", "model.c"]
    subprocess.run([str(CC), *STRICT, *sources, "-lm", "-o", "main"], cwd=tmp_path, check=True)
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
    ("words", "sentence"),
    [
        ("", "give --c FILE.c, --model FILE.c or both"),
        ("--c fish.c", "--c needs a controller.json or a policy's .zip before it"),
        ("none.json --c fish.c", "controller must be a file that can be read"),
        ("empty.json --c fish.c", "must be of schema gait.controller/2"),
        ("huge.json --c fish.c", "must keep every node's sum within 1e+30"),
        ("overflow.json --c fish.c", "node 0 reaches"),
        ("ok.json --c my-fish.c", "c must be a file name FILE.c"),
        ("ok.json --c 2fish.c", "c must be a file name FILE.c"),
        ("ok.json --c fish.txt", "c must be a file name FILE.c"),
        ("ok.json --c mine.c", "c must not overwrite a file that no export wrote"),
        ("ok.json --c heading.c", "c must not overwrite a file that no export wrote"),
        ("ok.json --c vectors.c", "c must not overwrite a file that no export wrote"),
        ("ok.json --c math.c", "its header math.h would hide C's own <math.h>"),
        ("ok.json --c Float.c", "its header Float.h would hide C's own <float.h>"),
        ("ok.json --c file/fish.c", "the folder of c must be a directory"),
        ("ok.json --c a.c --model a.c", "must have two names"),
        ("ok.json --c a/fish.c --model b/Fish.c", "must have two names"),
        ("ok.json --c a.c --reactive", "--reactive has no effect without"),
        ("ok.json --c a.c --morphology b", "--morphology has no effect"),
        ("ok.json --c a.c --normalize none", "--normalize has no effect without the .zip of a"),
        ("ok.json --c a.c --activation none", "--activation has no effect without the .zip of a"),
        ("--model my-fish.c", "model must be a file name FILE.c"),
        ("--model mine.c", "model must not overwrite a file that no export wrote"),
        ("--model fish.c --morphology none.json", "morphology must be a file that can"),
        # Nothing is written where one of two files is refused.
        ("ok.json --c fish.c --model mine.c", "model must not overwrite"),
        ("ok.json --c new/a.c --model mine.c/b.c", "the folder of model must"),
        ("ok.json --c a.c --model b.c --morphology no", "morphology"),
    ],
)
def test_a_wrong_export_is_refused_and_writes_nothing(
    words: str,
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    silent().save("ok.json")
    # Of the first, one number does not fit float32; of the second, only a sum does not.
    for name, numbers in (("huge", [1e40] + [0.0] * 13), ("overflow", [3.4e38] * 14)):
        data = KINDS["linear"].to_dict()
        data["weights"][0] = [*numbers, *data["weights"][0][14:]]
        write_document(Path(f"{name}.json"), data, SCHEMA)
    Path("empty.json").write_text("{}")
    for precious in ("mine.c", "heading.h", "vectors.csv", "file"):
        Path(precious).write_text("mine")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert main(["export", *words.split()]) == 2
    assert sentence in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
