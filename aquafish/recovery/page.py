"""The case study's page: what broke and what happened, in one HTML file that opens by itself."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence
from string import Template
from typing import Any

from aquafish.recovery.report import Outcomes, headline, shown_replicate
from aquafish.recovery.treatment import Treatment, path_from_dict
from aquafish_gym import DIMENSIONS, Damage, Morphology
from aquafish_gym.morphology import FIN_WORDS, FINS
from aquafish_gym.rendering.course import TRAILS, FilmedSwim
from aquafish_gym.rendering.replay import css, replay_fragment, whole_page
from aquafish_gym.rendering.scene import CM_PER_UNIT
from gait.film import filmed

SWIMS = ("healthy", "damaged, old gait", "damaged, new gait")
_STYLE = """
main { max-width: 1060px; margin: auto; padding: 0 16px 32px; }
h1 { font-size: clamp(1.5em, 4vw, 2.2em); line-height: 1.2; margin: 0.6em 0 0.3em; }
h2 { margin: 1.4em 0 0.4em; }
.replay { height: min(600px, 85dvh); border-radius: 12px; overflow: hidden; }
.numbers { display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); }
.numbers div { padding: 10px 14px; border-left: 6px solid; border-radius: 8px; background: #fff; }
.numbers b { display: block; font-size: 1.8em; line-height: 1.3; }
figure { margin: 0 0 12px; padding: 12px; border-radius: 12px; background: #fff; overflow: auto; }
figure img { width: 100%; min-width: 620px; }
pre { padding: 12px; border-radius: 8px; background: #fff; white-space: pre-wrap; }
@media print { .replay { display: none; } }
"""
_BODY = Template("""<main>
<h1>$title</h1>
<p>$lead</p>
<div class="numbers">$numbers</div>
<h2>The three swims</h2>
$replay
<p>$shown</p>
<h2>What the robot knows of itself</h2>
<figure>$sizes<figcaption>$knowledge</figcaption></figure>
<figure>$fitness<figcaption>OBJ_FIT is 1 minus the mean error of the nine sizes, so 1 is the true
body; it needs the true body, which the robot does not know. MOD_FIT is the fit to the gyroscope,
which the robot measures. Thin lines are replicates, thick lines their mean.</figcaption></figure>
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
_CAPTIONS = {
    "sizes": "The sizes of each self-model, with posterior intervals",
    "fitness": "OBJ_FIT and MOD_FIT by trial",
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
        SVG of ``sizes``, ``fitness`` and ``distances``.
    commands
        The command lines that make the study and its replay again.
    """
    shown = {name: several[shown_replicate(outcomes)] for name, several in outcomes.items()}
    config, seconds = report["config"], job.transfer.seconds
    healthy, old, new = (
        CM_PER_UNIT * shown[name][field]
        for name, field in (
            ("undamaged", "native_distance"),
            ("undamaged", "target_distance"),
            ("joint-fins", "target_distance"),
        )
    )
    trials, duration = config["joint_rounds"], config["eea"]["steps"] / 100
    title = (
        f"{damage_in_words(job.morphology, job.target)}. With a new gait the robot swims "
        f"{new:.0f}\u00a0cm in {seconds:g}\u00a0s instead of {old:.0f}\u00a0cm."
    )
    numbers = (
        (css(TRAILS[0]), f"{healthy:.0f} cm", f"healthy, in {seconds:g} s"),
        (css(TRAILS[1]), f"{old:.0f} cm", "damaged, with its old gait"),
        (css(TRAILS[2]), f"{new:.0f} cm", "damaged, with the gait for its self-model"),
        ("#882255", f"{trials * duration:.1f} s", f"of movement in {trials} trials"),
    )
    text = {
        "title": title,
        "lead": "The robot does not see its fins; it measures how its body turns. From "
        f"{trials} trials of {duration:g} s it estimates {_estimates(job, shown['joint-fins'])}. "
        "It then searches a gait for that body in simulation, without further trials.",
        "numbers": "".join(
            f'<div style="border-color: {colour}"><b>{value}</b>{label}</div>'
            for colour, value, label in numbers
        ),
        "replay": replay_fragment(shown_swims(job, outcomes)),
        "shown": _rule(job.seed, len(report["seeds"])),
        "knowledge": _knowledge(job, shown["joint-fins"]),
        "sentences": "".join(
            re.sub("[*][*](.+?)[*][*]", r"<b>\1</b>", f"<p>{html.escape(sentence)}</p>")
            for sentence in headline(dict(report))
        ),
        "commands": html.escape("\n".join(commands)),
        "versions": ", ".join(f"{name} {of}" for name, of in report["code"][0].items()),
    }
    pictures = {
        name: f'<img alt="{_CAPTIONS[name]}" src="data:image/svg+xml;base64,'
        f'{base64.b64encode(figures[name]).decode()}">'
        for name in _CAPTIONS
    }
    return whole_page(title, _BODY.substitute(text | pictures), _STYLE)


def shown_swims(job: Treatment, outcomes: Outcomes) -> list[FilmedSwim]:
    """Return the swims of the healthy, the damaged and the recovered robot of one replicate."""
    i = shown_replicate(outcomes)
    old, new = outcomes["undamaged"][i]["swims"], outcomes["joint-fins"][i]["swims"]
    paths = map(path_from_dict, (old["native"], old["target"], new["target"]))
    return [
        filmed(label, path, job.morphology, damage)
        for label, path, damage in zip(
            SWIMS, paths, (Damage(), job.damage, job.damage), strict=True
        )
    ]


def broken_fins(job: Treatment) -> tuple[str, ...]:
    """Return the names of the fins that the damage changes."""
    before, after = job.morphology, job.target
    return tuple(fin for fin in FINS if getattr(before, fin) != getattr(after, fin))


def damage_in_words(before: Morphology, after: Morphology) -> str:
    """Return what is left of each fin that broke, such as "The tail has 60% of its length"."""
    clauses = []
    for fin in FINS:
        left = _broken_sizes(before, after, fin)
        if not left:
            continue
        if sum(size > 0 for size in getattr(after, fin)) < 2:
            clauses.append(f"the {FIN_WORDS[fin]} is missing")
        else:
            parts = " and ".join(f"{share:.0%} of its {size}" for size, share in left.items())
            clauses.append(f"the {FIN_WORDS[fin]} has {parts}")
    text = " and ".join(clauses) or "nothing is broken"
    return text[0].upper() + text[1:]


def _broken_sizes(before: Morphology, after: Morphology, fin: str) -> dict[str, float]:
    """Return each changed size of a fin as a share of what it was."""
    pairs = {
        d.size: (getattr(before, fin)[d.axis], getattr(after, fin)[d.axis])
        for d in DIMENSIONS
        if d.fin == fin
    }
    return {size: now / was for size, (was, now) in pairs.items() if now != was}


def _estimates(job: Treatment, outcome: Mapping[str, Any]) -> str:
    """Return the estimate of each size that changed, with its interval, in words."""
    bodies = (outcome["morphology"], outcome["interval"]["low"], outcome["interval"]["high"])
    mass = f"{outcome['interval']['mass']:.0%} interval"
    found = []
    for d in DIMENSIONS:
        was = getattr(job.morphology, d.fin)[d.axis]
        if getattr(job.target, d.fin)[d.axis] != was:
            middle, low, high = (body[d.fin][d.axis] / was for body in bodies)
            found.append(
                f"the {d.size} of the {FIN_WORDS[d.fin]} at {middle:.0%} of what it was "
                f"({mass} {low:.0%} to {high:.0%})"
            )
    return ", ".join(found)


def _knowledge(job: Treatment, outcome: Mapping[str, Any]) -> str:
    """Return the caption of the sizes: how many intervals hold the truth, and the fit."""
    low, high = (Morphology.coerce(outcome["interval"][end]).to_array() for end in ("low", "high"))
    true = job.target.to_array()
    held = int(((low <= true) & (true <= high)).sum())
    return (
        f"The {outcome['interval']['mass']:.0%} intervals of joint inference hold the true size "
        f"for {held} of {len(true)} sizes. Fit: {html.escape(outcome['verdict'])}."
    )


def _rule(seed: int, count: int) -> str:
    if count == 1:
        return f"Shown is seed {seed}, the only replicate."
    return (
        f"Shown is seed {seed} of {count} replicates, by a rule: the one with the median gain of "
        "the new gait (joint-fins) over the old one, from the zero pose on the damaged robot."
    )
