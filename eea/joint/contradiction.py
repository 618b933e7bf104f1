"""Which of several trials is not of the same body as the others?"""

from __future__ import annotations

from collections.abc import Callable, Sequence


def contradiction(names: Sequence[str], fits: Callable[[tuple[int, ...]], bool]) -> str:
    """Return in a sentence why no body explains all of some trials.

    Parameters
    ----------
    names
        What each trial is called.
    fits
        Whether a body explains these trials, from 0, together. All of them together none does.

    Examples
    --------
    >>> three = ("trial 1", "trial 2", "trial 3")
    >>> contradiction(three, lambda some: 1 not in some)
    'trial 2 fits no body even alone; one body explains the others'
    >>> contradiction(three, lambda some: len(some) == 1 or 1 not in some)
    'trial 2 does not fit with the others, which one body explains: it may be of another body'
    """
    everyone = tuple(range(len(names)))
    alone = [fits((trial,)) for trial in everyone] if len(names) > 1 else [False]
    odd = tuple(trial for trial in everyone if not alone[trial])
    if len(odd) == len(names):
        return "no body explains even one of the trials alone"
    others = tuple(trial for trial in everyone if alone[trial])
    if odd:
        agree = len(others) == 1 or fits(others)
        rest = "one body explains" if agree else "a body explains each, none all, of"
        plural = "" if len(odd) > 1 else "s"
        listed = " and ".join(names[trial] for trial in odd)
        return f"{listed} fit{plural} no body even alone; {rest} the others"
    for trial in everyone if len(names) > 2 else ():
        if fits(everyone[:trial] + everyone[trial + 1 :]):
            return (
                f"{names[trial]} does not fit with the others, which one body explains: "
                "it may be of another body"
            )
    return (
        "each trial alone is explained by a body, but all together by none: "
        "they may be of several bodies"
    )
