"""Joint inference as a method of its own: ask, fit everything at once, say how sure it is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from eea.core.angles import Floats
from eea.core.behavior import similarity, summarize
from eea.core.checks import ConfigurationError, choice, finite
from eea.core.config import EEAConfig
from eea.core.experiment import Context, Target
from eea.core.fitness import model_fitness
from eea.core.replay import RecordedLog
from eea.core.result import RoundRecord
from eea.core.session import Answer, Conclusion, Session
from eea.joint.commands import fast_command
from eea.joint.goodness_of_fit import Goodness, effective_count, goodness_of_fit
from eea.joint.initialization import pose
from eea.joint.joint_posterior import JointPosterior, groups, weigh
from eea.joint.least_squares import Observed
from eea.joint.parameters import SURE, Parameters
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import AS_COMMANDED, Hypothesis, JointProblem
from eea.joint.search import Optima, halved, improved, search

FEWEST_STEPS = 32
ABSENT = 0.02  # of a range: a part this small may as well be one that does not move
HOPELESS = 50.0  # in log evidence: what is so much worse is not fitted again


class JointInference(Session):
    """Fits body, nuisances and every trial's hidden angles together, trial by trial.

    Parameters
    ----------
    target
        What is to be modelled; it is asked once a round.
    joint
        The robot.
    config, seed
        Settings, of which ``joint`` and ``exploration`` have a say, and the replicate's seed.
    truth
        The target's dimensions (n,) if known: only for OBJ_FIT in the records.

    Raises
    ------
    ConfigurationError
        If a setting is wrong or names a nuisance that the robot has not, or the truth has another
        shape.

    Examples
    --------
    ``for record in JointInference(...)`` yields a record as each round ends, as ``EEA`` does, and
    ``run`` is that loop.

    >>> from eea.core.bits import action_layout, model_layout
    >>> from eea.core.problem import Problem
    >>> def wheel(bodies, nuisances, commands, angles, fine):
    ...     turned = 0.1 * commands * np.arange(64) + angles
    ...     return (bodies * np.sin(turned))[:, :, None]
    >>> class Robot:
    ...     def perform(self, command):
    ...         felt = wheel(np.array([[0.6]]), None, command, np.array([[0.5]]), True)
    ...         return RecordedLog(gyro=felt + np.random.default_rng(0).normal(0, 0.01, felt.shape))
    >>> problem = Problem(
    ...     model_layout([("radius", 1.0, 6)]), action_layout([("speed", 0.0, 2.0)]), ("angle",), 1
    ... )
    >>> config = EEAConfig("joint", steps=64, rounds=1)
    >>> result = JointInference(Robot(), JointProblem(problem, wheel), config).run()
    >>> low, high = result.interval(0.9)
    >>> bool(low[0] < 0.6 < high[0]), bool(high[0] - low[0] < 0.01)
    (True, True)
    """

    def __init__(
        self,
        target: Target,
        joint: JointProblem,
        config: EEAConfig,
        seed: int = 0,
        truth: Floats | None = None,
    ) -> None:
        super().__init__(target, joint.problem, config, seed, truth)
        settings = config.joint
        if config.steps < FEWEST_STEPS:
            raise ConfigurationError(
                f"steps must be at least {FEWEST_STEPS} under the joint condition; "
                f"got {config.steps}"
            )
        if config.behavior.signal != "body_rates":
            raise ConfigurationError(
                "behavior.signal must be body_rates under the joint condition, which compares the "
                f"gyroscope; got {config.behavior.signal}"
            )
        for argument, names in (
            ("joint.nuisances", settings.nuisances or ()),
            ("joint.per_trial", settings.per_trial),
        ):
            for name in names:
                choice(argument, name, joint.groups)
        self._joint = replace(joint, simulate=self._counted)
        self._simulate = joint.simulate
        self._simulated = 0
        self._groups = joint.groups if settings.nuisances is None else settings.nuisances
        self._observed = Observed(
            np.empty((0, len(joint.problem.actions))),
            np.empty((0, config.steps, joint.problem.axes)),
        )
        self._optima: dict[str, Optima] = {}  # by the hypothesis's name
        self._dropped: set[str] = set()
        self._unexplained = False  # whether no body explained the trials so far

    def _counted(
        self, bodies: Floats, nuisances: Floats, commands: Floats, angles: Floats, fine: bool
    ) -> NDArray[Any]:
        self._simulated += len(bodies)
        return self._simulate(bodies, nuisances, commands, angles, fine)

    @property
    def _belief(self) -> JointPosterior | None:
        belief = self.result.belief
        assert belief is None or isinstance(belief, JointPosterior)
        return belief

    @contextmanager
    def _undone_if_broken_off(self) -> Iterator[None]:
        before = self._observed, dict(self._optima), set(self._dropped), self._unexplained
        belief = self.result.belief
        try:
            yield
        except BaseException:
            self._observed, self._optima, self._dropped, self._unexplained = before
            self.result.belief = belief
            raise

    def _round(self) -> tuple[Answer, Conclusion]:
        performed, rng = self._observed.commands, self._rngs["exploration"]
        answer = self._perform(fast_command(self._problem.actions, performed, rng))
        return answer, self._concluded(answer.command[None], answer.samples[None])

    def observe(self, commands: NDArray[Any], signal: Floats, told: Floats) -> RoundRecord:
        """Conclude from what the robot did by itself, in one round, without asking it.

        Parameters
        ----------
        commands
            (E, c), or another array of E that the robot's ``simulate`` takes.
        signal
            (E, T, axes), finite, T being ``config.steps``.
        told
            (c,), the command that the record is to show.

        Returns
        -------
        RoundRecord
            As after a trial; ``result`` has it too.

        Raises
        ------
        ConfigurationError
            If the signal has another shape or holds NaN.
        """
        wanted = (len(commands), self.result.config.steps, self._problem.axes)
        signal = finite("signal", signal, wanted)
        began = time.monotonic()
        with self._undone_if_broken_off():
            concluded = self._concluded(commands, signal)
            answer = Answer(told, RecordedLog(gyro=signal[-1:]), signal[-1], None)
            record = self._record(answer, concluded, began)
            self.result.rounds.append(record)
        return record

    def _concluded(self, commands: NDArray[Any], signal: Floats) -> Conclusion:
        """Conclude from all trials so far and these."""
        simulated = self._simulated
        if len(self._observed):
            commands = np.concatenate([self._observed.commands, commands])
            signal = np.concatenate([self._observed.signal, signal])
        self._observed = Observed(commands, signal)
        belief = self._conclude()
        self.result.belief = belief
        ends = belief.angles(len(self._observed) - 1)
        context = Context(*ends, confidence=0.9)
        return Conclusion(
            None,
            belief.model,
            self._model_fitness(self._optima[belief.branches[0].hypothesis.name]),
            context,
            belief.spread,
            self._simulated - simulated,
        )

    def _conclude(self) -> JointPosterior:
        """Fit every hypothesis that is worth it, and weigh them."""
        plain = self._fit(AS_COMMANDED)
        alone = posterior_of(plain, plain)
        likely = self._likely(plain, alone)
        others = [(h, self._fit(h)) for h in likely]
        lowest = min((o for _, o in others), key=lambda o: o.squares[0], default=plain)
        if lowest.squares[0] < plain.squares[0]:  # was it the hypothesis, or a better search?
            again = _carried_over(lowest, plain.parameters)[:1]
            plain = improved(plain, again, self.result.config.joint.noise)
            self._optima[AS_COMMANDED.name], alone = plain, posterior_of(plain, plain)
        fitted = [(AS_COMMANDED, plain), *others]
        best = min((optima for _, optima in fitted), key=lambda optima: optima.sigma)
        fits = []
        for hypothesis, optima in fitted:
            posterior = alone if optima is best is plain else posterior_of(optima, best)
            evidence = posterior.log_evidence + prior_constant(optima.parameters)
            fits.append((hypothesis, optima.parameters, posterior, evidence))
        most = max(evidence for *_, evidence in fits)
        self._dropped |= {h.name for h, *_, evidence in fits if evidence < most - HOPELESS}
        self._dropped -= {AS_COMMANDED.name}
        branches = weigh(fits)
        judged = self._judged(self._optima[branches[0].hypothesis.name])
        count = 0 if self.result.config.joint.noise else self._observed.signal.size
        return JointPosterior(branches, judged, best.sigma, count)

    def _likely(self, plain: Optima, alone: Posterior) -> list[Hypothesis]:
        """Return the other hypotheses to weigh, given the best fits as commanded."""
        when = self.result.config.joint.alternatives
        if when == "never":
            return []
        names = {h.name for h in self._joint.hypotheses} - self._dropped
        if when == "doubt" and self._judged(plain).good:
            # What was probable is weighed on: a small fin explains a missing one nearly as well.
            probable = {b.hypothesis.name for b in self._belief.branches} if self._belief else set()
            absent = self._perhaps_absent(plain, alone)
            names &= probable | {h.name for h in self._joint.hypotheses if h.part in absent}
        return [h for h in self._joint.hypotheses if h.name in names]

    def _fit(self, hypothesis: Hypothesis) -> Optima:
        """Fit all trials under a hypothesis, also from what the trials before have taught."""
        settings, rng = self.result.config.joint, self._rngs["estimation"]
        parameters = Parameters.of(
            self._joint, len(self._observed), self._groups, hypothesis, settings.per_trial
        )
        # A world that no body explains is not searched through again and again, nor are the
        # alternatives: most of them are wrong.
        once = self._unexplained or hypothesis is not AS_COMMANDED
        earlier, known = self._optima.get(hypothesis.name), None
        if earlier is not None:
            known = _carried_over(earlier, parameters)
            posed = pose(parameters, self._observed, known, settings.poses, rng)
            for trial in range(earlier.parameters.trials, len(self._observed)):
                entries = parameters.own_entries(trial)
                known[:, entries] = posed[:, entries]
        if hypothesis is not AS_COMMANDED:
            # Without a fin that does nothing all else is as it was.
            as_commanded = _carried_over(self._optima[AS_COMMANDED.name], parameters)
            known = as_commanded if known is None else np.concatenate([known, as_commanded])
            if earlier is not None:  # most of them are wrong, and each takes its time
                settings = halved(settings)
        found = search(
            parameters,
            self._observed,
            rng,
            settings,
            known,
            lambda optima: once or self._judged(optima).good,
        )
        if hypothesis is AS_COMMANDED:
            self._unexplained = not self._judged(found).good
        self._optima[hypothesis.name] = found
        return found

    def _judged(self, optima: Optima) -> Goodness:
        return goodness_of_fit(
            optima.residuals, len(optima.parameters), self.result.config.joint.noise
        )

    def _perhaps_absent(self, plain: Optima, alone: Posterior) -> set[str]:
        """Return the names of parts that may have next to no area, as if they did nothing."""
        least = np.minimum(plain.theta[0], alone.interval(0.9)[0])
        return {
            name
            for name, part in zip(self._joint.parts, groups(self._joint), strict=True)
            if part.area and least[[part.indices[side] for side in part.area]].min() < ABSENT
        }

    def _model_fitness(self, best: Optima) -> float:
        """Return the MOD_FIT (Eq. 3) of the best fit, its angles and nuisances included."""
        config = self.result.config
        simulated = summarize(
            RecordedLog(gyro=self._observed.signal + best.residuals), config.behavior
        )
        observed = summarize(RecordedLog(gyro=self._observed.signal), config.behavior)
        return float(model_fitness(similarity(simulated, observed, config.behavior)))

    def _stopped(self) -> str | None:
        """Return ``"narrow"`` once every interval is, and the fit leaves nothing but noise."""
        belief, narrow = self._belief, self.result.config.joint.narrow
        if narrow is None or belief is None or not belief.good:
            return None
        low, high = belief.interval(0.9)
        wide = ((high - low) / self._problem.models.span).max()
        return "narrow" if wide <= narrow else None


def posterior_of(optima: Optima, best: Optima) -> Posterior:
    """Return the posterior that optima mean at the noise that the best of all fits leaves.

    Where its residuals hang together, only a share of the samples counts.
    """
    residuals = best.residuals
    weight = effective_count(residuals) / residuals.size / best.sigma**2
    parameters, linear = optima.parameters, optima.linear()
    away = optima.theta - parameters.prior_mean
    modes = tuple(
        Mode(
            theta,
            weight * linear.normal[k] + parameters.prior_information,
            float(0.5 * weight * optima.squares[k] + parameters.prior_cost(theta)),
            weight * linear.gradient[k] + parameters.prior_information @ away[k],
        )
        for k, theta in enumerate(optima.theta)
    )
    return Posterior(parameters.names, parameters.low, parameters.high, parameters.circular, modes)


def prior_constant(parameters: Parameters) -> float:
    """Return the constant of the log prior, by which layouts of other parameters compare."""
    told = parameters.prior_precision > 0.0
    sd, mean = parameters.prior_precision[told] ** -0.5, parameters.prior_mean[told]
    high, low = log_ndtr((1.0 - mean) / sd), log_ndtr(-mean / sd)
    mass = high + np.log1p(-np.exp(low - high))
    normal = -(0.5 * np.log(2.0 * np.pi) + np.log(sd) + mass).sum()
    return float(normal - np.count_nonzero(parameters.circular) * np.log(2.0 * np.pi))


def _carried_over(earlier: Optima, parameters: Parameters) -> Floats:
    """Return what was found of fewer trials or another hypothesis, as vectors (K, P).

    What a hypothesis fixes stays so. An angle that all trials share is that of the first, and
    where each has its own, each begins with the one that was shared.
    """
    theta: Floats = np.tile(parameters.prior_mean, (len(earlier.theta), 1))
    column = {name: i for i, name in enumerate(earlier.parameters.names)}
    for i, name in enumerate(parameters.names):
        sources = (name, name.partition("@")[0], f"{name}@1")
        source = next((column[source] for source in sources if source in column), None)
        if source is not None and parameters.prior_precision[i] < SURE:
            theta[:, i] = earlier.theta[:, source]
    return theta
