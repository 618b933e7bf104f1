"""The line of a rotor out of balance in a spectrum of the yaw rate, of one swim.

A damaged propeller is out of balance: its pull on the hull turns with it. The logger samples too
slowly for it and shows it at a low frequency, which moves with the thruster's voltage and PWM as
the rotor's rate does. Healthy rotors are slightly out of balance, too, and tell that rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal.windows import dpss
from scipy.special import digamma, gammaincinv, logsumexp

from experiments.real.haizhe import IDLE_PWM, RATE_HZ, Floats, Swim

SPIN_UP_SECONDS = 0.5
TAPERS = 2
TIME_BANDWIDTH = 2.0  # of the tapers
SPACING_HZ = 0.05
# Of the mean of that many exponential powers of mean 1: minus its mean logarithm, and its median.
MEAN_OVER_LOG = float(np.log(TAPERS) - digamma(TAPERS))
MEDIAN_POWER = float(gammaincinv(TAPERS, 0.5)) / TAPERS
FREQUENCIES = np.arange(0.6, 9.8, SPACING_HZ)
BROAD = FREQUENCIES > 3.0  # above the robot's own motion: the level of a swim's noise
LINES = (FREQUENCIES > 1.6) & (FREQUENCIES < 9.6)  # where lines are sought in healthy swims
FLOOR_BINS = 9  # over which the floor is averaged
WHITENING_BINS = 25
MOST_POWER = 6.0  # over the floor, of one swim in the search for the rotor's rate

USUAL_PWM = 98.0  # over idle
USUAL_VOLTS = 11.85
RATES_HZ = np.arange(10.0, 30.0, 0.05)  # of thrusters in water at an eighth of their throttle
EXPONENTS = np.arange(0.1, 1.05, 0.1)

#: How much faster a damaged propeller turns, as a share. Healthy rotors turn in proportion to the
#: voltage: the water slows them little, so losing its load can speed one up little.
FASTER = 0.05
BLUR_HZ = 0.15  # of the rotor's rate, known from voltage and PWM
LEAST_PROBABILITY = 1e-100  # of a line's frequency
HEIGHTS = 10.0 ** np.arange(0.0, 2.3, 0.25)  # of a line over the floor, in power; each as probable


@dataclass(frozen=True)
class Spectra:
    """The yaw rates of N swims."""

    power: Floats  #: (N, len(FREQUENCIES)), mean over the tapers
    pwm: Floats  #: (N,), over idle
    volts: Floats  #: (N,)

    def take(self, rows: np.ndarray) -> Spectra:
        """Return those of some swims."""
        return Spectra(self.power[rows], self.pwm[rows], self.volts[rows])


@dataclass(frozen=True)
class Rotor:
    """The rate of a rotor: ``rate_hz`` at the usual PWM and voltage."""

    rate_hz: float
    exponent: float  #: of PWM over idle; that of voltage is 1
    clearance: float  #: how far its line stands out, in standard deviations of chance

    def folded(self, swims: Spectra, faster: float = 0.0) -> Floats:
        """Return the frequency (N,) in Hz at which the rate of a swim is seen in its samples."""
        return _fold(self.rate_hz * _relative(swims, self.exponent) * (1.0 + faster))

    def log_rate(self, swims: Spectra) -> Floats:
        """Return the log (N,) of a swim's rate over that at the usual PWM and voltage."""
        return np.asarray(np.log(_relative(swims, self.exponent)))


def spectra(swims: Sequence[Swim]) -> Spectra:
    """Return the swims' spectra from the spin-up on, without drifts slower than a cubic."""
    first = round(SPIN_UP_SECONDS * RATE_HZ)
    rates = np.array([swim.thrust["w_yaw"][first:] for swim in swims])
    count = rates.shape[1]
    rates = np.nan_to_num(rates - np.nanmean(rates, axis=1, keepdims=True))
    drifts, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 4))
    rates = rates - (rates @ drifts) @ drifts.T
    waves = np.exp(-2j * np.pi * np.outer(np.arange(count) / RATE_HZ, FREQUENCIES))
    tapers = dpss(count, TIME_BANDWIDTH, TAPERS)
    power = np.mean([np.abs((rates * taper) @ waves) ** 2 for taper in tapers], axis=0)
    pwm = [np.nanmean(swim.thrust["pwm1"][first:]) for swim in swims]
    volts = [np.nanmean(swim.thrust["voltage"][first:]) for swim in swims]
    return Spectra(power / RATE_HZ, np.array(pwm) - IDLE_PWM, np.array(volts))


def find_rotor(healthy: Spectra) -> Rotor:
    """Return the rotors' rate that explains lines of healthy swims best.

    The rate is proportional to the voltage and to a power of PWM over idle. Where it is seen moves
    from swim to swim as no other frequency does: many weak lines add up at the right rate.
    """
    power = healthy.power / _smooth(healthy.power, WHITENING_BINS)
    power /= np.median(power[:, BROAD], axis=1, keepdims=True)
    power = np.minimum(power, MOST_POWER)
    power = (power - power[:, LINES].mean()) / power[:, LINES].std()
    best = Rotor(np.nan, np.nan, -np.inf)
    for exponent in EXPONENTS:
        seen = _fold(RATES_HZ[:, None] * _relative(healthy, exponent))
        inside = (seen > FREQUENCIES[LINES][0]) & (seen < FREQUENCIES[LINES][-1])
        bins = np.rint((seen - FREQUENCIES[0]) / SPACING_HZ).astype(int)
        bins = bins.clip(0, len(FREQUENCIES) - 1)
        lines = np.where(inside, power[np.arange(len(power)), bins], 0.0).sum(axis=1)
        count = inside.sum(axis=1)
        clearance = np.where(count >= len(power) / 2, lines / np.sqrt(count.clip(1)), 0.0)
        most = int(clearance.argmax())
        if clearance[most] > best.clearance:
            best = Rotor(float(RATES_HZ[most]), float(exponent), float(clearance[most]))
    return best


@dataclass(frozen=True)
class Healthy:
    """The spectrum of healthy swims: a floor, and the rotors' own line on it."""

    rotor: Rotor
    floor: Floats  #: (len(FREQUENCIES),)
    line: float  #: power over the floor where healthy rotors turn

    def strength(self, swims: Spectra) -> Floats:
        """Return how strong a damaged rotor's line is (N,), in standard deviations of noise.

        It is the root of twice the log Bayes factor of a line over none, from its least value on.
        The line's rate is a healthy rotor's or up to about ``FASTER`` above it; its height is one
        of ``HEIGHTS``.
        """
        own = np.exp(-0.5 * ((FREQUENCIES - self.rotor.folded(swims)[:, None]) / BLUR_HZ) ** 2)
        power = _level(swims.power / (self.floor * (1.0 + self.line * own)))
        heights = 1.0 + HEIGHTS[:, None, None]
        # Each taper's power is exponential; a line raises its mean.
        factors = TAPERS * (power * (1.0 - 1.0 / heights) - np.log(heights))
        factor = logsumexp(factors, axis=0) - np.log(len(HEIGHTS))
        prior = np.zeros_like(power)
        for faster in np.linspace(0.0, 3.0 * FASTER, 60):
            seen = self.rotor.folded(swims, float(faster))[:, None]
            probable = np.exp(-0.5 * (faster / FASTER) ** 2)
            prior += probable * np.exp(-0.5 * ((FREQUENCIES - seen) / BLUR_HZ) ** 2)
        prior /= prior.sum(axis=1, keepdims=True)
        evidence = logsumexp(factor + np.log(np.maximum(prior, LEAST_PROBABILITY)), axis=1)
        least = logsumexp(-TAPERS * np.log(heights)) - np.log(len(HEIGHTS))  # of no power at all
        return np.asarray(np.sqrt(2.0 * (evidence - least)))


def learn_spectrum(healthy: Spectra, rotor: Rotor) -> Healthy:
    """Return the floor that healthy swims have in common, and their own rotors' line."""
    floor = _smooth(healthy.power, FLOOR_BINS)
    over = _level(healthy.power / floor)
    near = np.abs(FREQUENCIES - rotor.folded(healthy)[:, None]) < BLUR_HZ
    return Healthy(rotor, floor, max(float(over[near].mean() / over[:, LINES].mean()) - 1.0, 0.0))


def _relative(swims: Spectra, exponent: float) -> Floats:
    """Return a rotor's rate (N,) over the one at the usual PWM and voltage."""
    return np.asarray((swims.pwm / USUAL_PWM) ** exponent * swims.volts / USUAL_VOLTS)


def _fold(rate: Floats) -> Floats:
    """Return the frequency at which a rate is seen in samples, Hz."""
    return np.asarray(np.abs((rate + RATE_HZ / 2.0) % RATE_HZ - RATE_HZ / 2.0))


def _smooth(power: Floats, bins: int) -> Floats:
    """Return the geometric mean over swims and neighbouring frequencies, as a mean power."""
    mean = np.log(power).mean(axis=0)
    wide = np.pad(mean, bins // 2, mode="edge")
    return np.exp(np.convolve(wide, np.ones(bins) / bins, mode="valid") + MEAN_OVER_LOG)


def _level(power: Floats) -> Floats:
    """Return powers over the floor, each swim's noise at the level of one."""
    return power / (np.median(power[:, BROAD], axis=1, keepdims=True) / MEDIAN_POWER)
