"""Options that ``run`` and ``study`` share: settings of the algorithm."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, make_dataclass
from types import GenericAlias
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

from aquafish_gym.runs.command_line import option_name
from eea.core.config import (
    EstimationConfig,
    ExplorationConfig,
    FitConfig,
    GeneticConfig,
    InBandConfig,
    OutOfBandConfig,
)


@dataclass(frozen=True)
class AlgorithmOptions:
    """Settings of the algorithm; settings that are not given keep each condition's default."""

    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: FitConfig = field(default_factory=FitConfig)

    def changes(self, given: Container[str] = ()) -> dict[str, Any]:
        """Return every setting that was given, by name, such as "in_band.best".

        A setting was given if it differs from its default, or if its option, such as
        "out-of-band.revisit", is in ``given``.
        """
        return {name: value for name, value, _ in self._given(given)}

    def values(self, given: Container[str] = ()) -> dict[str, tuple[Any, ...]]:
        """Return the values of every setting that was given, of options made by `several`."""
        found = {}
        for name, value, default in self._given(given):
            if default == (False,):
                found[name] = value or (True,)  # a flag without a word
            else:
                found[name] = value if isinstance(default, tuple) else (value,)
        return found

    def _given(self, given: Container[str]) -> Iterator[tuple[str, Any, Any]]:
        """Yield the name, the value and the default of every setting that was given."""
        for part in fields(self):
            for one in fields(getattr(self, part.name)):
                name = f"{part.name}.{one.name}"
                value = getattr(getattr(self, part.name), one.name)
                if value != one.default or option_name(name) in given:
                    yield name, value, one.default


def several(options: type[Any]) -> type[Any]:
    """Return a class of options whose settings have several values each: tuples of the type.

    A setting that is a tuple itself remains one value. The values are checked where they are used.
    """
    hints = get_type_hints(options)
    made: list[tuple[str, Any, Any]] = []
    for one in fields(options):
        kind = hints[one.name]
        if is_dataclass(kind):
            part = several(kind)  # type: ignore[arg-type]
            made.append((one.name, part, field(default_factory=part)))
        elif any(get_origin(each) is tuple for each in (kind, *get_args(kind))):
            made.append((one.name, kind, field(default=one.default)))
        else:
            several_values = GenericAlias(tuple, (kind, ...))
            made.append((one.name, several_values, field(default=(one.default,))))
    unchecked = {"__post_init__": lambda _self: None}
    found = make_dataclass(
        options.__name__, made, bases=(options,), frozen=True, namespace=unchecked
    )
    found.__module__ = options.__module__  # where tyro finds the comments that explain the options
    return found


if TYPE_CHECKING:
    SeveralOptions = AlgorithmOptions
else:
    SeveralOptions = several(AlgorithmOptions)
