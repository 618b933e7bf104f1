"""Imports: light, and without cycles."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import grimp
import pytest
from packaging.requirements import Requirement

from tests.bare import project, run_bare

PACKAGES = ("aquafish", "aquafish_gym", "eea", "gait")
IN_A_CLONE = ("experiments", "instruments")  # packages that the wheel does not contain
LAZY = ("eea", "eea.fish", "gait")
HEAVY = ("matplotlib", "mujoco", "pybullet", "stable_baselines3", "torch")
# Programs and modules that use a heavy library only when they are asked to.
MODULES = (
    "aquafish_gym",
    "aquafish_gym.engines.bullet.world",
    "aquafish_gym.envs.env",
    "eea",
    "eea.__main__",
    "gait",
    "gait.__main__",
    "gait.learning.train",
    "gait.plots",
)


def test_importing_loads_nothing_heavy() -> None:
    """One after another in one process, which names the first that does."""
    code = f"""
import importlib, sys
for module in {MODULES!r}:
    importlib.import_module(module)
    print(module, *sorted({set(HEAVY)!r} & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.split() == [*MODULES]


STEPS = """
import sys, gymnasium, aquafish_gym
for name in ("AquaFish-v0", "AquaFishRecovery-v0"):
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
batch = gymnasium.make_vec("AquaFish-v0", num_envs=2)
batch.reset(seed=0)
batch.step(batch.action_space.sample())
print("aquafish_gym.runs" in sys.modules, *{name.partition(".")[0] for name in sys.modules})
"""


def test_environments_need_what_the_package_depends_on_and_nothing_else() -> None:
    done = run_bare(STEPS)
    assert done.returncode == 0, done.stderr
    commands, *loaded = done.stdout.split()
    assert commands == "False"
    direct = {Requirement(line).name for line in project()["dependencies"]}
    # The packages eea and gait need lazy-loader, to say what they lack.
    assert direct - {"lazy-loader"} <= set(loaded)


#: The extras that are there -> imports, and what is said of the extra that they need.
NEEDED: dict[tuple[str, ...], list[tuple[str, str]]] = {
    (): [
        ("import eea", 'Error: eea needs matplotlib: pip install "aquafish-gym[eea]"'),
        ("import eea.core", 'pip install "aquafish-gym[eea]"'),
        ("from gait import evaluate", 'Error: gait needs cma: pip install "aqua'),
        (
            "import aquafish_gym, gymnasium; gymnasium.make('AquaFish-v0', engine='pybullet')",
            'pip install "aquafish-gym[pybullet]" on Linux',
        ),
        (
            "from aquafish_gym.rendering import film; film([], 'film.webp')",
            'MissingExtraError: a film needs the extra film: pip install "aquafish-gym[film]"',
        ),
    ],
    ("eea",): [
        ("import gait", 'pip install "aquafish-gym[gait]"'),
        ("import aquafish.online", 'pip install "aquafish-gym[gait]"'),
        ("import eea.__main__", 'pip install "aquafish-gym[cli]"'),
    ],
    ("gait",): [("import gait.sb3_env", 'pip install "aquafish-gym[rl]"')],
}
TRY_EACH = """
for code in {codes!r}:
    try:
        exec(code, {{}})
        print("no error")
    except Exception as error:
        print(f"{{type(error).__name__}}: {{error}}".splitlines()[-1])
"""


@pytest.mark.parametrize("extras", NEEDED)
def test_what_needs_an_extra_names_it(extras: tuple[str, ...]) -> None:
    codes = [code for code, _ in NEEDED[extras]]
    done = run_bare(TRY_EACH.format(codes=codes), *extras)
    assert done.returncode == 0, done.stderr
    for said, (code, message) in zip(done.stdout.splitlines(), NEEDED[extras], strict=True):
        assert message in said, code


@pytest.mark.parametrize("extras", [(), ("eea", "gait")])
def test_the_command_says_in_a_line_that_it_needs_an_extra(extras: tuple[str, ...]) -> None:
    done = run_bare("from aquafish.cli import main; sys.exit(main(['--version']))", *extras)
    assert done.returncode == 2
    assert done.stdout == ""
    assert re.fullmatch(
        r'aquafish: commands need the extra cli \(.*\): pip install "aquafish-gym\[cli\]"\n',
        done.stderr,
    )


@pytest.mark.parametrize(("library", "package"), [("pandas", "eea"), ("neat-python", "gait")])
def test_the_command_says_so_too_where_others_brought_what_commands_need(
    library: str, package: str
) -> None:
    code = "from aquafish.cli import main; sys.exit(main(['--version']))"
    done = run_bare(code, "cli", without=library)
    assert done.returncode == 2
    assert re.fullmatch(
        rf'aquafish: {package} needs \w+: pip install "aquafish-gym\[{package}\]"\n', done.stderr
    )


@pytest.mark.parametrize(
    ("extra", "code"),
    [
        pytest.param(
            "eea",
            "import eea, eea.study.figures; [getattr(eea, name) for name in eea.__all__]",
            marks=pytest.mark.slow,
        ),
        ("gait", "import gait, gait.plots; [getattr(gait, name) for name in gait.__all__]"),
        pytest.param(
            "cli",
            "from aquafish.cli import main; sys.exit(main(['recover', '--help']))",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_an_extra_is_enough_for_what_it_is_named_for(extra: str, code: str) -> None:
    done = run_bare(code, extra)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_extra_test_is_enough_to_collect_all_tests() -> None:
    code = (
        "import pytest; sys.exit(pytest.main(['--collect-only', '-q', '-p', 'no:cacheprovider']))"
    )
    done = run_bare(code, "test")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr


def stub(package: str) -> list[ast.ImportFrom]:
    """Return the imports in a package's stub, all of which are relative."""
    path = Path(__file__).parents[1] / package.replace(".", "/") / "__init__.pyi"
    return [line for line in ast.parse(path.read_text()).body if isinstance(line, ast.ImportFrom)]


@pytest.mark.parametrize("package", LAZY)
def test_a_stub_has_the_names_that_are_imported_when_first_used(package: str) -> None:
    lazy, names = import_module(package), set()
    for line in stub(package):
        module = import_module(f"{package}.{line.module}")
        found = [alias.name for alias in line.names]
        for name in module.__all__ if found == ["*"] else found:
            assert getattr(lazy, name) is getattr(module, name)
            names.add(name)
    assert sorted(names) == sorted(lazy.__all__)


# An answer makes what is known (``answer.known()``), and what is known an answer: deferred.
VERBS = {"eea.infer.answer": {"eea.infer.known"}}


def test_no_imports_form_a_cycle() -> None:
    """Deferred and type-only imports included but for VERBS; the error names the cycle."""
    graph = grimp.build_graph(*PACKAGES, *IN_A_CLONE, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    imports = {name: found - VERBS.get(name, set()) for name, found in imports.items()}
    for package in LAZY:  # grimp reads no stubs
        imports[package] = imports[package] | {f"{package}.{line.module}" for line in stub(package)}
    TopologicalSorter(imports).prepare()
