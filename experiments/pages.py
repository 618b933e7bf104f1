"""Fill the tables of the pages: ``make pages``, or ``python -m experiments.pages``.

GitHub shows a page as it is committed. So a table that a command measured stands in the page
itself, between two comments, of which the first names its source::

    <!-- make pages: results/league/table.md -->
    <!-- end -->

A source is a Markdown file under ``docs/``, a name in ``TEXTS``, a report in ``REPORTS`` and the
name of one of its tables, as in ``physics/report.json: strokes``, or the folder of a study and the
heading of one of its tables, as in ``results/method: Paired differences``.
"""

from __future__ import annotations

import ast
import json
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from aquafish.recovery.treatment import TREATMENTS
from aquafish_gym.damage import TIERS
from aquafish_gym.plans import PLANS, BodyPlan
from aquafish_gym.runs.markdown import markdown_table
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.study.arms import ARMS
from eea.study.report import markdown
from eea.study.results import read_study
from eea.study.summary import summarize_study
from experiments.league.thresholds import meanings
from experiments.real.auv_report import auv_called
from experiments.real.drones_report import drones_cuts
from experiments.real.fish_report import fish_errors
from experiments.results import provenance
from instruments.inference.summary import join_times
from instruments.inference.tables import make_tables
from instruments.verification.report import tables_of
from instruments.verification.tables import Table

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BEGIN = re.compile(r"^<!-- make pages: (.+) -->$", re.MULTILINE)
PART = re.compile(
    r"^<!-- make pages: (?P<source>.+) -->\n(?:(?!<!-- make pages:).*\n)*?<!-- end -->$",
    re.MULTILINE,
)


def servos(plan: BodyPlan) -> str:
    """Return the table of a plan's actions."""
    rows = [["action", "of", "drive", "at -1", "at 1", "hinge (x, y, z), units"]]
    for i, fin in enumerate(plan.fins):
        turning = f"sweeps by {math.degrees(fin.sweep):.0f} degrees either way"
        unit = "rev/s" if fin.turns else "Hz"
        low, high = plan.command_low[i], plan.command_high[i]
        hinge = ", ".join(f"{x:g}" for x in fin.hinge)
        drive = "turns" if fin.turns else turning
        rows.append([f"{i}", f"`{fin.name}`", drive, f"{low:g} {unit}", f"{high:g} {unit}", hinge])
    return markdown_table(rows)


def environment() -> str:
    """Return the description of AquaFish-v0, which is the docstring of AquaFishEnv."""
    source = (ROOT / "aquafish_gym" / "envs" / "env.py").read_text(encoding="utf-8")
    found = (
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == "AquaFishEnv"
    )
    text = (ast.get_docstring(next(found)) or "").partition("\n")[2]
    return text.partition("\nExamples\n")[0].strip()


def tiers() -> str:
    """Return the tiers of random damage as a table."""
    words = dict.fromkeys(chance.word for tier in TIERS.values() for chance in tier.chances)
    rows = [["", *TIERS]]
    for word in words:
        row = [f"`{word}`"]
        for tier in TIERS.values():
            found = next((chance for chance in tier.chances if chance.word == word), None)
            numbers = f", {found.low:g} to {found.high:g}" if found and found.high else ""
            row.append(f"{found.weight:.0%}{numbers}" if found else "")
        rows.append(row)
    return markdown_table(rows)


#: Rows of the README's first table: treatments of docs/recovery/report.json.
RECOVERED = ("undamaged", "randomised", "out-of-band", "joint-fins", "swims-on", "oracle-fins")
OURS = ("joint-fins", "swims-on")  # in bold
#: Rows of its second: entrants of docs/results/league/league.json, and what they are.
PLAYED = {
    "PPO, fins": "the gait for the whole robot",
    "trial and error": "Intelligent Trial and Error, given its true position",
    "RMA": "a learned policy that estimates what broke",
    "blind": "the same agent, which never looks for damage",
    "self-model": "the agent, charged for its thinking",
    "oracle": "the same, given the truth at once",
}
CM_PER_UNIT = 5.0


def centimetres(middle: float, interval: Sequence[float]) -> str:
    """Return a distance in units with its interval, in cm."""
    low, high = (f"{CM_PER_UNIT * end:z.0f}" for end in interval)
    return f"{CM_PER_UNIT * middle:z.0f} [{low}, {high}]"


def recovery() -> str:
    """Return how far robots swim after damage, and how good their models are."""
    treatments = _read("recovery/report.json")["treatments"]
    best = treatments["oracle-fins"]["target_distance_random_poses"]
    rows = [["gait", "trials", "OBJ_FIT", "cm in 20 s", "share of the last row's"]]
    for name in RECOVERED:
        found, label = treatments[name], TREATMENTS[name].label
        fitness = ""
        if found["objective_fitness"] is not None:
            fitness = f"{found['objective_fitness']:.3f}"
            if found["objective_fitness"] < 1.0:
                low, high = found["spread"]["objective_fitness"]["interval"]
                fitness += f" [{low:.3f}, {high:.3f}]"
        distance = found["target_distance_random_poses"]
        interval = found["spread"]["target_distance_random_poses"]["interval"]
        rows.append([f"**{label}**" if name in OURS else label, str(found["trials"]), fitness,
                     centimetres(distance, interval), f"{distance / best:.0%}"])  # fmt: skip
    return markdown_table(rows, words=1)


def league() -> str:
    """Return how far agents swim after something breaks in mid-swim, and the gain over blind."""
    played = _read("results/league/league.json")
    names = ("severe", "moderate", "mild")
    rows = [["agent", *names]]
    for entrant, words in PLAYED.items():
        ways = [played[entrant][tier]["way_after_onset"] for tier in names]
        bold = "**" if entrant == "self-model" else ""
        rows.append(
            [f"{bold}{entrant}{bold}: {words}", *(centimetres(way[0], way[1:]) for way in ways)]
        )
    gains = [played["self-model"][tier]["over"]["blind"]["mean"] for tier in names]
    rows.append(["*what recognising is worth*: mean of self-model less blind, episode by episode",
                 *(centimetres(gain[0], gain[1:]) for gain in gains)])  # fmt: skip
    return markdown_table(rows, words=1)


#: What the paper says of the conditions of its figures, from the best to the worst.
IN_THE_PAPER = {
    "ideal": "about 1.0",
    "out-of-band-100": "the best of the unknown angles",
    "out-of-band": "about 0.90, rising",
    "in-band-200": "slightly below 0.90, SD under 0.10",
    "in-band": "0.10 to 0.15 above None",
    "none": "at most 0.75, often falling",
}
GUESSES = {
    "quantisation limit": "the quantisation limit: the nearest body that the genome has",
    "mid-range body": "a body in the middle of all ranges",
    "random bodies": "a random body",
}


def figures() -> str:
    """Return how well the conditions of the paper's figures infer the body."""
    summary = _read("results/figs-5-to-10/summary.json")
    rows = [["condition", "figure", "OBJ_FIT, mean of four durations", "SD within a duration",
             "the paper"]]  # fmt: skip
    for name, paper in IN_THE_PAPER.items():
        arm = ARMS[name]
        own = [one for one in summary["fitness"] if one["arm"] == name]
        within = [one["objective_fitness"]["sd"] for one in own if len(one["durations"]) == 1]
        (found,) = (one["objective_fitness"] for one in own if len(one["durations"]) > 1)
        low, high = found["interval"]
        label = (
            f"{arm.label.format(models=name.rpartition('-')[2])}, {found['replicates']} replicates"
        )
        rows.append([label, f"{arm.figure}", f"{found['mean']:.3f} [{low:.3f}, {high:.3f}]",
                     f"{sum(within) / len(within):.3f}", paper])  # fmt: skip
    for name, words in GUESSES.items():
        rows.append([words, "", f"{summary['guesses'][name]:.3f}", "", "not given"])
    return markdown_table(rows)


def gap() -> str:
    """Return how well each method infers bodies in worlds that it does not simulate."""
    report = _read("gap/report.json")
    found = {(one["world"], one["method"]): one for one in report["summary"]}
    methods = ("none", "in-band", "out-of-band", "joint")
    rows = [["world", "differs from the models in", *methods, "intervals of joint that hold"]]
    for world, words in report["worlds"].items():
        cells = [f"{found[world, method]['obj_fit']['mean']:.3f}" for method in methods]
        held = found[world, "joint"]["covered"]["90%"]["mean"]
        rows.append([f"`{world}`", words, *cells, f"{held:.0%}"])
    return markdown_table(rows, words=2)


def _read(path: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((DOCS / path).read_text(encoding="utf-8"))
    return document


def inference_tables(report: Mapping[str, Any]) -> Mapping[str, Table]:
    """Return the tables of joint inference, whose CPU times have a file of their own."""
    times = json.loads((DOCS / "inference" / "times.json").read_text(encoding="utf-8"))
    return make_tables(join_times(report, times))


TEXTS: dict[str, Callable[[], str]] = {
    "AquaFishEnv": environment,
    **{plan.name: partial(servos, plan) for plan in PLANS.values()},
    "figures": figures,
    "gap": gap,
    "league": league,
    "provenance": provenance,
    "real AUV": lambda: auv_called(_read("real/auv.json")),
    "real drones": lambda: drones_cuts(_read("real/drones.json")),
    "real fish": lambda: fish_errors(_read("real/fish.json")),
    "recovery": recovery,
    "thresholds": meanings,
    "tiers": tiers,
}
REPORTS: dict[str, Callable[[dict[str, Any]], Mapping[str, Table]]] = {
    "physics/report.json": tables_of,
    "inference/report.json": inference_tables,
}


@cache
def _tables(report: str) -> Mapping[str, Table]:
    return REPORTS[report](_read(report))


@cache
def _tables_of_study(folder: str) -> Mapping[str, str]:
    """Return the tables of a study's summary, by heading."""
    results = read_study(DOCS / folder)
    sections = markdown(results, summarize_study(results), []).split("\n## ")[1:]
    found = {}
    for section in sections:
        heading, _, text = section.partition("\n")
        found[heading] = "\n".join(line for line in text.splitlines() if line.startswith("|"))
    return found


def text_of(source: str) -> str:
    """Return what a source writes into a page.

    Raises
    ------
    InvalidArgumentError
        If there is no such file, text, report, study or table.
    """
    if source in TEXTS:
        return TEXTS[source]()
    report, _, name = source.partition(": ")
    if report in REPORTS and name in _tables(report):
        return _tables(report)[name].markdown()
    if source.endswith(".md") and (DOCS / source).is_file():
        return (DOCS / source).read_text(encoding="utf-8").strip()
    if (DOCS / report / "study.json").is_file() and name in _tables_of_study(report):
        return _tables_of_study(report)[name]
    known = [*TEXTS, *(f"{report}: TABLE" for report in REPORTS)]
    raise InvalidArgumentError(
        f"make pages must name a Markdown file or a study's table under docs/, or one of "
        f"{', '.join(known)}; "
        f"got {source!r}"
    )


def fill_page(text: str) -> str:
    """Return a page with each of its marked parts filled.

    Raises
    ------
    InvalidArgumentError
        If a part names no source, or has no end.
    """

    def fill(part: re.Match[str]) -> str:
        source = part["source"]
        return f"<!-- make pages: {source} -->\n\n{text_of(source)}\n\n<!-- end -->"

    filled, count = PART.subn(fill, text)
    begun = BEGIN.findall(text)
    if count < len(begun):
        raise InvalidArgumentError(
            f"each of {', '.join(begun)} must end with a line <!-- end -->; {count} of them do"
        )
    return filled


def pages() -> list[Path]:
    """Return the pages that people write: not the results that commands write whole."""
    written = ("_build", "results", "recovery", "gap")
    under_docs = (
        page
        for page in DOCS.rglob("*.md")
        if not set(page.relative_to(DOCS).parts[:-1]).intersection(written)
    )
    others = ("README.md", "CONTRIBUTING.md", "paper/paper.md")
    return [*(ROOT / other for other in others), *sorted(under_docs)]


def main() -> int:
    """Fill every page and print the names of those that changed."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        filled = fill_page(text)
        if filled != text:
            write_bytes(page, filled.encode())
            print(page.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
