"""The ten held-out damages, which no method was developed on."""

from __future__ import annotations

from aquafish_gym import Damage

# All development used left_pectoral:length=0.5.
DAMAGES: tuple[str, ...] = (
    "right_pectoral:length=0.35",
    "caudal:width=0.55",
    "left_pectoral:missing",
    "right_pectoral:width=0.4",
    "caudal:length=0.6",
    "left_pectoral:width=0.5;caudal:length=0.75",
    "right_pectoral:missing",
    "left_pectoral:length=0.7;right_pectoral:length=0.4",
    "left_pectoral:thickness=4;right_pectoral:length=0.7",
    "caudal:length=0.45;caudal:width=0.7",
)


def damage_of(seed: int) -> Damage:
    """Return the damage of a replicate: number ``seed`` modulo ten."""
    return Damage.parse(DAMAGES[seed % len(DAMAGES)])
