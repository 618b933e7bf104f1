"""Classes of controllers with a fixed network, as vectors of their free numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from gait.controllers.controller import INTERVAL, Controller
from gait.controllers.network import Senses

CLOCK_OCTAVES = 4.0  # bounds of a tuned clock, relative to the initial one
# Standard deviation of random weights, at which nodes saturate and fins turn. Memory weights start
# at 0: from random ones the search ends at worse gaits.
WEIGHT_SD = 0.5


@dataclass(frozen=True, eq=False)
class Template:
    """The free numbers of a class of controllers; all other weights are zero.

    A vector holds log2 of the clock relative to the initial one, the biases, and the free weights.

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
    output: Literal["tanh", "clip"] = "tanh"
    plan: BodyPlan = AQUAFISH

    @classmethod
    def of_class(
        cls,
        name: str,
        senses: Senses,
        hidden: int,
        interval: int = INTERVAL,
        plan: BodyPlan = AQUAFISH,
    ) -> Self:
        """Return the template of a class of controllers.

        In a ``"linear"`` one each output has all inputs. ``"mlp"`` has ``hidden`` nodes in between;
        in ``"recurrent"`` (Elman's network) these also have each other's previous values.
        """
        inputs, outputs = len(senses.names(plan)), len(plan.fins)
        between = 0 if name == "linear" else hidden
        nodes = between + outputs
        free = np.zeros((nodes, inputs + nodes), bool)
        free[: between or outputs, :inputs] = True
        free[between:, inputs : inputs + between] = True
        if name == "recurrent":
            free[:between, inputs : inputs + between] = True
        layers = (between, outputs) if between else (outputs,)
        return cls(senses, layers, free, np.ones(nodes), interval, plan=plan)

    @classmethod
    def like(cls, controller: Controller) -> Self:
        """Return the template of a controller's connections, and of any from input to output."""
        free = controller.weights != 0.0
        c = controller
        free[-len(c.plan.fins) :, : len(c.inputs)] = True
        return cls(c.senses, c.layers, free, c.response, c.interval, c.output, c.plan)

    @property
    def size(self) -> int:
        """Number of free numbers."""
        return 1 + len(self.free) + int(self.free.sum())

    def vector(self, controller: Controller) -> NDArray[np.float64]:
        """Return a controller as a vector, whose initial clock is its own."""
        return np.concatenate([[0.0], controller.bias, controller.weights[self.free]])

    def random(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return random vectors (count, size) without memory."""
        nodes, columns = self.free.shape
        inputs = columns - nodes
        hidden = nodes - len(self.plan.fins)
        memory = np.zeros_like(self.free)
        memory[:hidden, inputs : inputs + hidden] = True
        found = WEIGHT_SD * rng.standard_normal((count, self.size))
        found[:, 1 + nodes :][:, memory[self.free]] = 0.0
        return found

    def controller(
        self, vector: NDArray[np.float64], clock: float, morphology: Morphology, seed: int
    ) -> Controller:
        """Return the controller of one vector, as of :meth:`silent` and :meth:`controllers`."""
        return self.controllers(vector[None], self.silent(clock, morphology, seed))[0]

    def silent(self, clock: float, morphology: Morphology, seed: int) -> Controller:
        """Return the controller of this class whose free numbers are 0; ``clock`` is in Hz."""
        return Controller(
            weights=np.zeros(self.free.shape),
            bias=np.zeros(len(self.free)),
            response=self.response,
            clock=clock,
            morphology=morphology,
            seed=seed,
            senses=self.senses,
            layers=self.layers,
            output=self.output,
            interval=self.interval,
        )

    def controllers(self, vectors: NDArray[np.float64], first: Controller) -> list[Controller]:
        """Return the controllers of vectors (P, size), with the body and seed of ``first``.

        That is of this class, and its clock is the initial one: a vector's own clock stays within
        :data:`CLOCK_OCTAVES` of it.
        """
        nodes = len(self.free)
        weights = np.zeros((len(vectors), *self.free.shape))
        weights[:, self.free] = vectors[:, 1 + nodes :]
        octaves = np.clip(vectors[:, 0], -CLOCK_OCTAVES, CLOCK_OCTAVES)
        # Powers one by one: numpy's differ in the last digit between processors.
        clocks = [first.clock * 2.0**octave for octave in octaves.tolist()]
        return first.variants(weights, vectors[:, 1 : 1 + nodes], clocks)
