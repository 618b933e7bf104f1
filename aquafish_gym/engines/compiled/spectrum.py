"""Fourier transforms of gyroscope logs, and the distances between them, inside the lanes.

The time loop (``kernel.py``) keeps the rates about x, y and z of each robot's trial side by side in
lanes, and :func:`write_spectrum` transforms them there: a real transform of T samples, T a power of
two, as a complex one of T / 2 by Stockham's algorithm, which needs no bit reversal, in steps of
four (and one of two where T / 2 is no power of four).

A batch's **spectra** are an array (B, 2, F'): real and imaginary parts of the T / 2 + 1
coefficients of each signal in turn, filled up with zeros to a multiple of 16.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Number, fetch, fma, put
from aquafish_gym.physics.compiling import compiled_function

GYRO_AXES = 3
# Sums over coefficients always run in sixteen partial sums, whatever the machine's registers:
# their rounding does not depend on it.
PARTIAL_SUMS = 16


def coefficients(samples: int) -> int:
    """Return how many coefficients a trial has: T / 2 + 1 for each of three signals."""
    return GYRO_AXES * (samples // 2 + 1)


def padded(samples: int) -> int:
    """Return F', the coefficients filled up to a multiple of 16."""
    return -(-coefficients(samples) // PARTIAL_SUMS) * PARTIAL_SUMS


register_jitable(coefficients)
register_jitable(padded)


@functools.cache
def roots_of_unity(samples: int, dtype: str) -> NDArray[np.floating]:
    """Return (cos, -sin) of 2 pi i / T for i < T, flat, in "float32" or "float64"."""
    angles = 2 * np.pi * np.arange(samples) / samples
    table = np.stack([np.cos(angles), -np.sin(angles)], axis=1).reshape(-1).astype(dtype)
    table.setflags(write=False)
    return table


def pack_spectra(behaviors: NDArray[Any], dtype: type[np.floating]) -> NDArray[np.floating]:
    """Return complex coefficients (E, F) in the form of spectra, (E, 2, F')."""
    count = behaviors.shape[-1]
    packed = np.zeros((len(behaviors), 2, -(-count // PARTIAL_SUMS) * PARTIAL_SUMS), dtype)
    packed[:, 0, :count] = behaviors.real
    packed[:, 1, :count] = behaviors.imag
    return packed


@simd.inlined
def _times(re: Number, im: Number, c: Number, s: Number) -> Any:
    """Return (re + i im)(c + i s)."""
    return fma(re, c, -(im * s)), fma(re, s, im * c)


@register_jitable
def _fourfold(x: Any, y: Any, roots: Any, n: int, s: int, zero: Number) -> None:
    """One step of four: complex numbers k of ``x`` stand in its rows 2 k and 2 k + 1."""
    part = n // 4
    for p in range(part):
        i = 4 * s * p
        for q in range(s):
            at = 2 * (q + s * p)
            ar, ai = fetch(x, at, zero), fetch(x, at + 1, zero)
            at += 2 * s * part
            br, bi = fetch(x, at, zero), fetch(x, at + 1, zero)
            at += 2 * s * part
            cr, ci = fetch(x, at, zero), fetch(x, at + 1, zero)
            at += 2 * s * part
            dr, di = fetch(x, at, zero), fetch(x, at + 1, zero)
            sum_r = ar + cr
            sum_i = ai + ci
            gap_r = ar - cr
            gap_i = ai - ci
            other_r = br + dr
            other_i = bi + di
            turn_r = bi - di
            turn_i = dr - br
            to = 2 * (q + s * 4 * p)
            put(y, to, sum_r + other_r)
            put(y, to + 1, sum_i + other_i)
            to += 2 * s
            re, im = _times(gap_r + turn_r, gap_i + turn_i, roots[i], roots[i + 1])
            put(y, to, re)
            put(y, to + 1, im)
            to += 2 * s
            re, im = _times(sum_r - other_r, sum_i - other_i, roots[2 * i], roots[2 * i + 1])
            put(y, to, re)
            put(y, to + 1, im)
            to += 2 * s
            re, im = _times(gap_r - turn_r, gap_i - turn_i, roots[3 * i], roots[3 * i + 1])
            put(y, to, re)
            put(y, to + 1, im)


@register_jitable
def _twofold(x: Any, y: Any, s: int, zero: Number) -> None:
    """The last step where a factor of two is left: pairs that are s apart."""
    for q in range(s):
        a, b = 2 * q, 2 * (q + s)
        for part in range(2):
            one, other = fetch(x, a + part, zero), fetch(x, b + part, zero)
            put(y, a + part, one + other)
            put(y, b + part, one - other)


@register_jitable
def _transform(series: Any, spare: Any, roots: Any, samples: int, zero: Number) -> bool:
    """Transform T / 2 complex numbers; return whether the result ends up in ``spare``."""
    x, y = series, spare
    n, s = samples // 2, 1
    swapped = False
    while n > 1:
        if n % 4 == 0:
            _fourfold(x, y, roots, n, s, zero)
            n, s = n // 4, s * 4
        else:
            _twofold(x, y, s, zero)
            n = 1
        x, y = y, x
        swapped = not swapped
    return swapped


@register_jitable
def _split(z: Any, roots: Any, samples: int, re: Any, im: Any, first: int, zero: Number) -> None:
    """Put the real transform's T / 2 + 1 coefficients into rows ``first`` on of re and im."""
    half = samples // 2
    r, i = fetch(z, 0, zero), fetch(z, 1, zero)
    put(re, first, r + i)
    put(im, first, zero)
    put(re, first + half, r - i)
    put(im, first + half, zero)
    for k in range(1, half // 2 + 1):
        m = half - k
        ar, ai = fetch(z, 2 * k, zero), fetch(z, 2 * k + 1, zero)
        br, bi = fetch(z, 2 * m, zero), fetch(z, 2 * m + 1, zero)
        # Of the even samples, and of the odd ones, turned by a root of unity.
        even_r, even_i = 0.5 * (ar + br), 0.5 * (ai - bi)
        odd_r, odd_i = _times(0.5 * (ai + bi), 0.5 * (br - ar), roots[2 * k], roots[2 * k + 1])
        put(re, first + k, even_r + odd_r)
        put(im, first + k, even_i + odd_i)
        put(re, first + m, even_r - odd_r)
        put(im, first + m, odd_i - even_i)


@register_jitable
def spectrum_rows(samples: int) -> int:
    """Return how many rows of lanes :func:`write_spectrum` needs: series, spare and planes."""
    return (GYRO_AXES + 1) * samples + 2 * padded(samples)


@register_jitable
def write_spectrum(
    work: Any, roots: Any, samples: int, spectra: Any, group: int, zero: Number
) -> None:
    """Transform a group's series and write its robots' rows of ``spectra`` (B, 2, F').

    ``work`` is flat lanes, :func:`spectrum_rows` of them. It begins with the series, T samples of
    each signal in turn, and is overwritten; ``samples`` is T, and ``roots`` is of
    :func:`roots_of_unity`.
    """
    rows = spectra.shape[2]
    width = work.size // spectrum_rows(samples)
    series = work[: GYRO_AXES * samples * width]
    rest = work[GYRO_AXES * samples * width :]
    spare = rest[: samples * width]
    planes = (rest[samples * width : (samples + rows) * width], rest[(samples + rows) * width :])
    for row in range(coefficients(samples), rows):
        put(planes[0], row, zero)
        put(planes[1], row, zero)
    for axis in range(GYRO_AXES):
        one = series[axis * samples * width : (axis + 1) * samples * width]
        found = spare if _transform(one, spare, roots, samples, zero) else one
        first = axis * (samples // 2 + 1)
        _split(found, roots, samples, planes[0], planes[1], first, zero)
    for plane in range(2):
        start = (group * width * 2 + plane) * rows
        for k in range(0, rows, width):
            simd.put_transposed(planes[plane], k, spectra, start + k, 2 * rows, zero)


@register_jitable
def partial_distances(one: Any, i: int, other: Any, j: int, rows: int, zero: Number) -> Number:
    """Return sixteen partial sums of |a - b| over the coefficients of two rows of spectra, flat.

    ``rows`` is how many coefficients are in each sum.
    """
    total = zero
    a = i * 2 * rows
    b = j * 2 * rows
    step = rows
    for k in range(rows):
        re = fetch(one, a + k, zero) - fetch(other, b + k, zero)
        im = fetch(one, a + step + k, zero) - fetch(other, b + step + k, zero)
        total = total + math.sqrt(fma(re, re, im * im))
    return total


@register_jitable
def _distance(one: Any, i: int, other: Any, j: int, rows: int, sums: Any, zero: Number) -> float:
    """Return the sum of |a - b| over the coefficients of two rows of spectra, flat."""
    put(sums, 0, partial_distances(one, i, other, j, rows, zero))
    found = 0.0
    for lane in range(PARTIAL_SUMS):
        found += sums[lane]
    return found


def _to_observed(spectra: Any, observed: Any, which: Any, out: Any) -> None:
    sums = np.empty(PARTIAL_SUMS, spectra.dtype)
    zero = simd.zero_lanes(sums, PARTIAL_SUMS)
    rows = spectra.shape[2] // PARTIAL_SUMS
    one, other = spectra.reshape(-1), observed.reshape(-1)
    for b in range(len(out)):
        out[b] = _distance(one, b, other, which[b], rows, sums, zero)


def _between_pairs(spectra: Any, models: int, out: Any) -> None:
    sums = np.empty(PARTIAL_SUMS, spectra.dtype)
    zero = simd.zero_lanes(sums, PARTIAL_SUMS)
    rows = spectra.shape[2] // PARTIAL_SUMS
    flat = spectra.reshape(-1)
    for action in range(len(out)):
        total, first = 0.0, action * models
        for i in range(first, first + models):
            for j in range(i + 1, first + models):
                total += _distance(flat, i, flat, j, rows, sums, zero)
        out[action] = total


def spectral_distances(
    spectra: NDArray[np.floating], observed: NDArray[np.floating], which: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return sum |a - b| over coefficients, (B,), of spectra (B, 2, F') to observed ones.

    ``observed`` is (E, 2, F'), and ``which`` (B,) says with which of them each is compared.
    """
    out = np.empty(len(spectra))
    compiled_function(_to_observed, nogil=True)(spectra, observed, which, out)
    return out


def disagreements(spectra: NDArray[np.floating], models: int) -> NDArray[np.float64]:
    """Return, for each run of ``models`` rows of spectra, sum |a - b| over all its pairs, (A,)."""
    out = np.empty(len(spectra) // models)
    compiled_function(_between_pairs, nogil=True)(spectra, models, out)
    return out
