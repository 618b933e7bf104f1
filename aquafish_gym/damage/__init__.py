"""What can break, and how it edits a robot's scenario."""

from aquafish_gym.damage.damage import Damage, edit_each
from aquafish_gym.damage.faults import Fault
from aquafish_gym.damage.tiers import TIERS, Chance, Tier
from aquafish_gym.scenario import CHANNELS

__all__ = ["CHANNELS", "TIERS", "Chance", "Damage", "Fault", "Tier", "edit_each"]
