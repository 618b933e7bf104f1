"""Classes of controllers of a fixed shape, each a vector of free numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from gait.controller import INTERVAL, Controller
from gait.network import OUTPUTS, Senses

CLOCKS = 1 / 16, 16.0  # times the first one: how far a clock may be tuned
# Of random weights: enough that nodes saturate, and fins turn. A memory is 0 at first, and comes in
# the search: from a random one it climbs to worse gaits, or sticks.
SPREAD = 0.5


@dataclass(frozen=True, eq=False)
class Template:
    """Which numbers of a controller are free; all other weights are zero.

    A vector holds log2 of how much faster the clock is than at first, the biases, and the free
    weights. Responses are 1, where no ``like`` says otherwise.

    Examples
    --------
    >>> Template.of_class("linear", Senses(), 0).size
    37
    """

    senses: Senses
    layers: tuple[int, ...] | None
    free: NDArray[np.bool_]  #: (N, I + N).
    response: NDArray[np.float64]  #: (N,).
    interval: int = INTERVAL  #: Steps of 0.01 s.

    @classmethod
    def of_class(cls, name: str, senses: Senses, hidden: int, interval: int = INTERVAL) -> Self:
        """Return the template of a class of controllers.

        Parameters
        ----------
        name
            ``"linear"`` and ``"fourier"``: each output hears all inputs, which of the latter are
            harmonics of the clock alone. ``"mlp"``: hidden nodes between them. ``"recurrent"``:
            these remember, and hear each other too (Elman's network).
        senses
            What it feels.
        hidden
            How many nodes there are between, of the latter two.
        interval
            For how many steps of 0.01 s an action is held.
        """
        inputs, outputs = len(senses.names), len(OUTPUTS)
        between = hidden if name in ("mlp", "recurrent") else 0
        nodes = between + outputs
        free = np.zeros((nodes, inputs + nodes), bool)
        free[:between, :inputs] = True
        free[between:, inputs : inputs + between] = True
        if name == "recurrent":
            free[:between, inputs : inputs + between] = True
        if not between:
            free[:, :inputs] = True
        layers = (between, outputs) if between else (outputs,)
        return cls(senses, layers, free, np.ones(nodes), interval)

    @classmethod
    def like(cls, controller: Controller) -> Self:
        """Return the template of all controllers with the connections of one.

        Each output may hear each input, too: those that NEAT began with and lost are weights of 0.
        """
        free = controller.weights != 0.0
        free[-len(OUTPUTS) :, : len(controller.senses.names)] = True
        return cls(
            controller.senses, controller.layers, free, controller.response, controller.interval
        )

    @property
    def size(self) -> int:
        """How many numbers are free."""
        return 1 + len(self.free) + int(self.free.sum())

    def vector(self, controller: Controller) -> NDArray[np.float64]:
        """Return a controller of this shape as a vector, its clock being the first."""
        return np.concatenate([[0.0], controller.bias, controller.weights[self.free]])

    def random(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return vectors (count, size) to begin with."""
        inputs, nodes = len(self.senses.names), len(self.free)
        remembers = np.zeros_like(self.free)
        remembers[: -len(OUTPUTS), inputs : inputs + nodes - len(OUTPUTS)] = True
        found = SPREAD * rng.standard_normal((count, self.size))
        found[:, 1 + nodes :][:, remembers[self.free]] = 0.0
        return found

    def controller(
        self, vector: NDArray[np.float64], clock: float, morphology: Morphology, seed: int
    ) -> Controller:
        """Return the controller that a vector is, where ``clock`` is the first, in Hz."""
        nodes = len(self.free)
        weights = np.zeros(self.free.shape)
        weights[self.free] = vector[1 + nodes :]
        return Controller(
            weights=weights,
            bias=vector[1 : 1 + nodes],
            response=self.response,
            clock=clock * float(np.clip(2.0 ** np.clip(vector[0], -9.0, 9.0), *CLOCKS)),
            morphology=morphology,
            seed=seed,
            senses=self.senses,
            layers=self.layers,
            interval=self.interval,
        )
