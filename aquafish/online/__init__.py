"""An agent that models itself as it swims: see docs/swimming_on.md."""

from aquafish.online.agent import AgentConfig, SelfModelAgent

__all__ = ["AgentConfig", "SelfModelAgent"]
