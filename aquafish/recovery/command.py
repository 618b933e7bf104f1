"""The case study as a command: its options, its run in a folder, and the files it publishes."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from rich.console import Console
from rich.markdown import Markdown
from tyro.conf import arg

from aquafish.online.gaits import PACKAGED
from aquafish.recovery.report import (
    HELD_OUT,
    Outcomes,
    build_report,
    shown_replicate,
    to_markdown,
)
from aquafish.recovery.treatment import TREATMENTS, Treatment, treat, warm_up_treatments
from aquafish_gym import BodyPlan, Damage, Morphology
from aquafish_gym.bodies import body_document, plan_key, write_bodies
from aquafish_gym.damage.held_out import held_out, recovery_list
from aquafish_gym.engines.api import check_engine
from aquafish_gym.rendering.scene import CM_PER_UNIT
from aquafish_gym.runs.command_line import (
    BodyFile,
    FirstFinDamage,
    Given,
    Out,
    Plan,
    Reactive,
    TargetEngine,
    read_morphology,
)
from aquafish_gym.runs.jobs import exit_if_failed, finished, read_result, run_jobs
from aquafish_gym.runs.manifest import check_manifest, lock, read_manifest, write_manifest
from aquafish_gym.runs.markdown import shown_format
from aquafish_gym.runs.workers import check_workers
from aquafish_gym.scenario import MAXIMUM_SPIN
from aquafish_gym.utils.storage import (
    encode_document,
    ensure_writable_directory,
    write_bytes,
    write_document,
)
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    finite_array,
    flag,
    integer,
    printable,
)
from eea.core.config import MAXIMUM_ROUNDS, RECOVERY, JointConfig, PaperConfig, recovery_config
from gait.controllers.controller import Controller
from gait.search.evolve import EvolveConfig
from gait.swims.transfer import TransferConfig

REPORT_SCHEMA = "aquafish.recovery/1"
REPORT, PAGE = "report.json", "report.html"
ELSEWHERE = ("out", "workers", "scheduler", "redraw")  # options that the results do not depend on


@dataclass(frozen=True)
class CaseStudy(Given):
    """The case study: damage a fish, infer its body, evolve a gait for it, and score the gait.

    Eleven treatments differ in the body that the gait is evolved for and in the search; to swim on
    takes a library of gaits, which not every plan has. DIR holds
    report.html, report.md, report.json, figures, a film, and for each treatment of each replicate
    its outcome.json, morphology.json and controller.json (bodies.json with joint inference). The
    same command resumes.
    """

    example: ClassVar[str] = "--damage left_pectoral:length=0.5 --replicates 3 --out out/recovery"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "plan", "damage", "held_out", "reactive", "seed", "replicates", "gyro_noise",
        "target_engine", "workers", "redraw",
    )  # fmt: skip

    out: Out = Path("out/recovery")
    plan: Plan = "aquafish"
    damage: FirstFinDamage = None
    held_out: bool = False
    """Give each replicate one of the ten held-out damages instead of --damage."""
    morphology: BodyFile = None
    reactive: Reactive = False
    seed: int = 0
    """Seed of the first replicate."""
    replicates: Annotated[int, arg(aliases=("--seeds",))] = 1
    """Replicates, with seeds from --seed upwards; at most ten with --held-out."""
    rounds: int = RECOVERY.rounds
    """Trials of the EEA on the damaged robot, one a round."""
    joint_rounds: int = 2
    """Trials of joint inference, which needs fewer."""
    steps: int = RECOVERY.steps
    """Length of a trial in steps of 0.01 s, a power of two."""
    models: int = RECOVERY.estimation.population
    """Population of candidate bodies in the EEA."""
    angle_sets: int = RECOVERY.out_of_band.inner_population
    """Population of Out-of-Band's inner search for the fin angles."""
    gyro_noise: float = 0.01
    """Standard deviation of the robot's gyroscope noise, rad/s."""
    generations: int = 60
    """Generations of NEAT, in the paper's treatments."""
    population: int = 150
    """Gaits a generation of NEAT."""
    search_generations: int = 740
    """Generations of the recommended search, CMA-ES."""
    search_population: int = 24
    """Gaits a generation of CMA-ES."""
    search_restarts: int = 6
    """Starts of CMA-ES."""
    random_candidates: int = 1200
    """Random gaits that the starts are chosen from."""
    direct_generations: int = 400
    """Generations of the search on the robot itself: 24 gaits of two swims each."""
    gait_poses: int = 6
    """Random initial poses that a gait is evolved from, besides the zero pose. With none, joint
    inference's gait is for its median body alone."""
    poses: int = 16
    """Random initial poses that a finished gait is scored from, besides the zero pose."""
    seconds: float = 20.0
    """Length of a swim."""
    target_engine: Annotated[TargetEngine, arg(aliases=("--engine",))] = "auto"
    workers: Annotated[int | None, arg(metavar="INT")] = None
    """Processes; every core if not given. No result depends on it."""
    scheduler: Annotated[str | None, arg(metavar="ADDRESS")] = None
    """Address of a dask scheduler whose workers run the treatments, such as tcp://host:8786."""
    format: tuple[Literal["png", "pdf", "svg"], ...] = ("png",)
    """File formats of the figures."""
    film: bool = True
    """Also draw the film, which takes some seconds."""
    redraw: bool = False
    """Only write the report and figures of a finished folder again."""

    def execute(self) -> None:
        """Run the missing treatments, then write and print the report.

        A wrong option or a folder of something else is refused before anything changes. SystemExit
        has the code 1 if a treatment failed; the others are finished.
        """
        if self.held_out:
            self.refuse_given(("damage",), "with --held-out, which has damages of its own")
        if self.redraw:
            self.refuse_given(("workers", "scheduler"), "with --redraw, which runs nothing")
        jobs = self.treatments()
        if self.redraw and len(finished(self.out, jobs)) < len(jobs):
            read_outcomes(self.out, jobs)  # names the first that is missing
        folder, settings = ensure_writable_directory(self.out), _settings(jobs)
        with lock(folder):
            if self.redraw:
                check_manifest(folder, "a case study", settings, (REPORT,))
            else:
                write_manifest(folder, "a case study", settings, (REPORT,), treat)
                failures = run_jobs(
                    jobs, treat, folder, count=self.workers, scheduler=self.scheduler,
                    warm_up=warm_up_treatments, describe=_distances,
                )  # fmt: skip
                exit_if_failed(failures)
            self._publish(jobs, folder, settings)

    def treatments(self) -> list[Treatment]:
        """Return every treatment of every replicate, the longest first."""
        integer("seed", self.seed, 0)
        integer("replicates", self.replicates, 1, 100_000)
        check_workers(self.workers, self.scheduler)
        if not self.format:
            raise InvalidArgumentError("format must be one or more of png, pdf, svg; got none")
        body = read_morphology(self.morphology, "morphology", self.plan)
        if self.held_out:
            damages = [Damage.parse(text) for text in held_out(recovery_list(body.plan))]
            integer("replicates with --held-out", self.replicates, 1, len(damages))
        else:
            text = f"{body.plan.names[0]}:length=0.5" if self.damage is None else self.damage
            damages = [Damage.parse(text)]
            damages[0].apply(body)
        finite_array("gyro_noise", self.gyro_noise, (), 0.0, MAXIMUM_SPIN, "rad/s")
        flag("reactive", self.reactive)
        engine = check_engine(self.target_engine)
        swims = TransferConfig(poses=self.poses, seconds=self.seconds, target_engine=engine)
        eea, gaits = self._eea(), self._gaits(body.plan)
        integer("joint_rounds", self.joint_rounds, 1, MAXIMUM_ROUNDS)
        joint = JointConfig(steps=self.steps, rounds=self.joint_rounds)
        longest_first = sorted(TREATMENTS.items(), key=lambda one: one[1].model != "out-of-band")
        return [
            Treatment(
                treatment=name,
                seed=seed,
                morphology=body,
                damage=damages[seed % len(damages)],
                eea=joint if spec.model == "joint" else eea,
                gait=replace(gaits[spec.search], seed=seed),
                transfer=replace(swims, seed=seed),
                gyro_noise=self.gyro_noise,
                reactive=self.reactive,
            )
            for seed in range(self.seed, self.seed + self.replicates)
            for name, spec in longest_first
            if not spec.online or body.plan in PACKAGED  # to swim on takes a library of gaits
        ]

    def _eea(self) -> PaperConfig:
        """Return the settings of the paper's self-models, except the condition."""
        eea = recovery_config(self.steps, self.rounds)
        out_of_band = replace(eea.out_of_band, inner_population=self.angle_sets)
        estimation = replace(eea.estimation, population=self.models)
        return replace(eea, condition="out-of-band", estimation=estimation, out_of_band=out_of_band)

    def _gaits(self, plan: BodyPlan) -> dict[str, EvolveConfig]:
        """Return each search: the paper's NEAT, CMA-ES, with known fins, and on the robot."""
        common: dict[str, Any] = {
            "seconds": self.seconds, "threads": 1, "poses": self.gait_poses, "plan": plan,
        }  # fmt: skip
        best = EvolveConfig(
            search="cma",
            generations=self.search_generations,
            population=self.search_population,
            restarts=self.search_restarts,
            random_candidates=self.random_candidates,
            **common,
        )
        neat = EvolveConfig(
            paper=True, generations=self.generations, population=self.population, **common
        )
        fins = replace(best, senses=("imu", "clock", "fins"))
        # Few swims: on the robot, each of them takes its time.
        direct = replace(
            best,
            generations=self.direct_generations,
            restarts=1,
            random_candidates=24,
            population=24,
            poses=1,
        )
        return {"neat": neat, "best": best, "fins": fins, "direct": direct}

    def _publish(self, jobs: list[Treatment], folder: Path, settings: dict[str, Any]) -> None:
        """Write the report, the figures and each treatment's files, and print the report."""
        from aquafish.recovery.figures import draw_all
        from aquafish.recovery.page import report_page

        outcomes = read_outcomes(folder, jobs)
        seed = jobs[0].seed + shown_replicate(outcomes)
        job_shown = next(job for job in jobs if job.seed == seed)
        versions = (read_manifest(folder) or {}).get("versions", [])
        report = build_report(settings, versions, outcomes)
        content = encode_document(report, REPORT_SCHEMA)
        # The report is written after the films: where it stands already, they are of its swims.
        known = (folder / REPORT).exists() and (folder / REPORT).read_bytes() == content
        pictures, svgs = draw_all(
            folder, job_shown, outcomes, self.format, self.film, keep_film=known and not self.redraw
        )
        write_bytes(folder / REPORT, content)
        shown = shown_format(self.format)
        text = to_markdown(report, [name for name in pictures if name.endswith((shown, "webp"))])
        write_bytes(folder / "report.md", text.encode())
        page = report_page(job_shown, outcomes, report, svgs, self._commands(job_shown))
        write_bytes(folder / PAGE, page.encode())
        for job in jobs:
            outcome = outcomes[job.treatment][job.seed - jobs[0].seed]
            body = Morphology.coerce(outcome["morphology"], job.morphology.plan)
            write_document(folder / job.folder / "morphology.json", body_document(body))
            if "bodies" in outcome:
                plan = job.morphology.plan
                write_bodies(folder / job.folder / "bodies.json", outcome["bodies"], plan)
            controller = Controller.from_dict(outcome["controller"])
            controller.save(folder / job.folder / "controller.json")
        console = Console()
        console.print(Markdown(to_markdown(report, short=True)))
        shown = f"{printable(str(folder))}\n{printable(str(folder / PAGE))}"
        console.print(f"Report and figures: {shown}", soft_wrap=True)

    def _commands(self, shown: Treatment) -> list[str]:
        """Return the command lines that repeat the study and replay the shown robot."""
        from aquafish.recovery.page import SWIMS

        words = ["aquafish", "recover"]
        for field in fields(self):
            value = getattr(self, field.name)
            option = field.name.replace("_", "-")
            if value == field.default or field.name in ELSEWHERE:
                continue
            if isinstance(value, bool):
                words.append(f"--{'' if value else 'no-'}{option}")
            else:
                words += [f"--{option}", *([*value] if isinstance(value, tuple) else [str(value)])]
        folder, damage = f"seed-{shown.seed:03d}", str(shown.damage)
        old = f"{folder}/undamaged/controller.json"
        replay = [
            *("aquafish", "film", old, old, f"{folder}/joint-fins/controller.json"),
            *("--morphology", f"{folder}/undamaged/morphology.json"),
            *("--damage", "none", damage, damage, "--label", *SWIMS, "--html", "swim.html"),
            *(["--reactive"] if shown.reactive else []),
        ]
        return [shlex.join(words), shlex.join(replay)]


def read_outcomes(folder: Path, jobs: Sequence[Treatment]) -> Outcomes:
    """Return the outcomes by treatment, in the order of the seeds.

    Raises InvalidArgumentError if one is missing or damaged.
    """
    treated = {job.treatment for job in jobs}
    outcomes: dict[str, list[dict[str, Any]]] = {n: [] for n in TREATMENTS if n in treated}
    for job in jobs:
        outcome = read_result(folder, job)
        if outcome is None:
            raise InvalidArgumentError(f"redraw needs a finished folder; {folder} lacks {job.name}")
        outcomes[job.treatment].append(outcome)
    return outcomes


def _settings(jobs: Sequence[Treatment]) -> dict[str, Any]:
    """Return all settings that the results depend on, ready for JSON."""
    first = {job.treatment: job for job in reversed(jobs)}
    job = jobs[0]
    gaits = {TREATMENTS[name].search: one.gait for name, one in first.items()}
    parts = {"eea": first["out-of-band"].eea.to_dict(), "transfer": asdict(job.transfer)}
    parts |= {
        f"gait_{name}": {**gait.settings, "generations": gait.choices.generations}
        for name, gait in sorted(gaits.items())
    }
    for part in parts.values():
        for name in ("condition", "seed", "threads"):  # each treatment's own
            part.pop(name, None)
    several = len({one.damage for one in jobs}) > 1
    return {
        "damage": HELD_OUT if several else str(job.damage),
        **plan_key(job.morphology.plan),
        "morphology": job.morphology.to_dict(),
        "first_seed": job.seed,
        "gyro_noise": job.gyro_noise,
        **({"reactive": True} if job.reactive else {}),
        "joint_rounds": first["joint"].eea.rounds,
        **parts,
    }


def _distances(outcome: dict[str, Any]) -> str:
    """Return the distances that a treatment's gait swims, for the progress bar."""
    native, target = (
        CM_PER_UNIT * outcome[field] for field in ("native_distance", "target_distance")
    )
    return f"{native:z.0f} cm on its model, {target:z.0f} cm on the damaged robot"
