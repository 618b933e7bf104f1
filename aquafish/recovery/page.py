"""The case study's page: what broke and what happened, in one HTML file that opens by itself."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence
from string import Template
from typing import Any

import numpy as np

from aquafish.recovery.report import Outcomes, headline, shown_replicate, water_line
from aquafish.recovery.treatment import TREATMENTS, Treatment, path_from_dict
from aquafish_gym import Damage, Morphology
from aquafish_gym.rendering.course import TRAILS, FilmedSwim
from aquafish_gym.rendering.replay import css, replay_fragment, whole_page
from aquafish_gym.rendering.scene import CM_PER_UNIT
from gait.film import filmed

SWIMS = ("healthy", "damaged, old gait", "damaged, new gait")
_STYLE = Template("""
main { max-width: 1060px; margin: auto; padding: 0 16px 32px; }
h1 { font-size: clamp(1.5em, 4vw, 2.2em); line-height: 1.2; margin: 0.6em 0 0.3em; }
h2 { margin: 1.4em 0 0.4em; }
.replay { height: min(600px, 85dvh); border-radius: 12px; overflow: hidden; }
.numbers { display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); }
.numbers div { padding: 10px 14px; border-left: 6px solid $known; border-radius: 8px;
  background: #fff; }
.numbers div:nth-child(1) { border-color: $healthy; }
.numbers div:nth-child(2) { border-color: $damaged; }
.numbers div:nth-child(3) { border-color: $recovered; }
.numbers b { display: block; font-size: 1.8em; line-height: 1.3; }
figure { margin: 0 0 12px; padding: 12px; border-radius: 12px; background: #fff; }
figure img { width: 100%; }
pre { padding: 12px; border-radius: 8px; background: #fff; white-space: pre-wrap; }
@media print { .replay { display: none; } }
""").substitute(
    healthy=css(TRAILS[0]), damaged=css(TRAILS[1]), recovered=css(TRAILS[2]), known="#882255"
)
_BODY = Template("""<main>
<h1>$title</h1>
<p>$lead</p>
<div class="numbers">$numbers</div>
<h2>The three swims</h2>
$replay
<p>$shown</p>
<h2>What the robot knows of itself</h2>
<figure>$sizes<figcaption>$knowledge</figcaption></figure>
<h2>How far each gait swims</h2>
<figure>$distances<figcaption>Each row is another way to a gait, on the damaged robot. All start at
rest, except that the robot of "swims on" breaks at full speed: its distance counts from the damage
on. The oracles know the true body, which no robot does.</figcaption></figure>
<h2>All replicates</h2>
$sentences
<h2>Do it again</h2>
<pre>$commands</pre>
<p>$versions. All numbers and tables: report.md and report.json beside this page.</p>
</main>""")
NARROW_SCREEN = "(max-width: 600px)"
_PICTURES = {
    "sizes": "The sizes of each self-model, with posterior intervals",
    "distances": "The distances of all methods on the damaged robot",
}


def report_page(
    job: Treatment,
    outcomes: Outcomes,
    report: Mapping[str, Any],
    figures: Mapping[str, bytes],
    commands: Sequence[str],
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    job
        A treatment of the shown replicate, see ``shown_replicate``.
    figures
        SVG of ``sizes`` and ``distances``, and of both for narrow screens, ``sizes-narrow`` and
        ``distances-narrow``.
    commands
        The command lines that make the study and its replay again.
    """
    shown = {name: several[shown_replicate(outcomes)] for name, several in outcomes.items()}
    old, ours = shown["undamaged"], shown["joint-fins"]
    seconds, count = job.transfer.seconds, len(report["seeds"])
    trials, duration = report["config"]["joint_rounds"], report["config"]["eea"]["steps"] / 100
    distances = (old["native_distance"], old["target_distance"], ours["target_distance"])
    healthy, damaged, recovered = (f"{CM_PER_UNIT * each:z.0f}\u00a0cm" for each in distances)
    title = (
        f"{job.damage.said().capitalize()}. With the gait of "
        f"{TREATMENTS['joint-fins'].label} the robot swims {recovered} in {seconds:g}\u00a0s "
        f"instead of {damaged}."
    )
    numbers = (
        (healthy, f"healthy, in {seconds:g} s"),
        (damaged, "damaged, with its old gait"),
        (recovered, "damaged, with the gait for its self-model"),
        (f"{trials * duration:.1f} s", f"of movement in {trials} trials"),
    )
    rule = (
        f"Shown is seed {job.seed} of {count} replicates, by a rule: the one with the median gain "
        f"of the new gait ({TREATMENTS['joint-fins'].label}) over the old one, from the zero pose "
        "on the damaged robot."
    )
    estimates, knowledge = _self_knowledge(job, ours)
    plain = {
        "title": title,
        "lead": "The robot does not see its fins; it measures how its body turns. From "
        f"{trials} trials of {duration:g} s it estimates {estimates}. "
        "It then searches a gait for that body in simulation, without further trials."
        f"{water_line(report['config'])}",
        "shown": rule if count > 1 else f"Shown is seed {job.seed}, the only replicate.",
        "knowledge": knowledge,
        "commands": "\n".join(commands),
        "versions": "; then ".join(
            ", ".join(f"{name} {of}" for name, of in versions.items())
            for versions in report["code"]
        ),
    }
    parts = {name: html.escape(text) for name, text in plain.items()} | {
        "numbers": "".join(
            f"<div><b>{value}</b>{html.escape(label)}</div>" for value, label in numbers
        ),
        "replay": replay_fragment(shown_swims(job, outcomes)),
        "sentences": "".join(
            re.sub("[*][*](.+?)[*][*]", r"<b>\1</b>", f"<p>{html.escape(sentence)}</p>")
            for sentence in headline(dict(report))
        ),
    }
    pictures = {
        name: f'<picture><source media="{NARROW_SCREEN}" '
        f'srcset="{_svg(figures[f"{name}-narrow"])}">'
        f'<img alt="{caption}" src="{_svg(figures[name])}"></picture>'
        for name, caption in _PICTURES.items()
    }
    return whole_page(title, _BODY.substitute(parts | pictures), _STYLE)


def _svg(content: bytes) -> str:
    """Return a picture as an address that contains it."""
    return f"data:image/svg+xml;base64,{base64.b64encode(content).decode()}"


def shown_swims(job: Treatment, outcomes: Outcomes) -> list[FilmedSwim]:
    """Return the swims of the healthy, the damaged and the recovered robot of one replicate."""
    i = shown_replicate(outcomes)
    old, new = outcomes["undamaged"][i]["swims"], outcomes["joint-fins"][i]["swims"]
    paths = map(path_from_dict, (old["native"], old["target"], new["target"]))
    damages = (Damage(), job.damage, job.damage)
    several = zip(SWIMS, paths, damages, strict=True)
    return [filmed(label, path, job.morphology, damage) for label, path, damage in several]


def _self_knowledge(job: Treatment, outcome: Mapping[str, Any]) -> tuple[str, str]:
    """Return the estimates of the sizes that changed, in words, and how many intervals hold."""
    plan = job.morphology.plan
    interval = outcome["interval"]
    middle = Morphology.coerce(outcome["morphology"], plan).to_array()
    whole, true = job.morphology.to_array(), job.target.to_array()
    estimates = [
        f"the {d.size} of the {plan.words[d.fin]} at {middle[i] / whole[i]:.0%} of what it was"
        for i, d in enumerate(plan.dimensions)
        if true[i] != whole[i]
    ]
    if interval is None:
        return ", ".join(estimates), (f"Joint inference gives no intervals: {outcome['verdict']}.")
    ends = (Morphology.coerce(interval[end], plan).to_array() for end in ("low", "high"))
    low, high = next(ends), next(ends)
    low, high = np.minimum(low, middle), np.maximum(high, middle)
    changed = [i for i in range(len(whole)) if true[i] != whole[i]]
    estimates = [
        f"{estimate} ({interval['mass']:.0%} interval {low[i] / whole[i]:.0%} to "
        f"{high[i] / whole[i]:.0%})"
        for i, estimate in zip(changed, estimates, strict=True)
    ]
    held = np.count_nonzero((low <= true) & (true <= high))
    return ", ".join(estimates), (
        f"The {interval['mass']:.0%} intervals of joint inference hold the true size for {held} "
        f"of {len(true)} sizes. Fit: {outcome['verdict']}."
    )
