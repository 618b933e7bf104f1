"""Read policies of stable-baselines3 from its zip files, without loading a pickle of theirs.

A file of ``model.save`` has the weights in ``policy.pth`` (see ``torch_file.py``), and the rest in
``data``: JSON with base64 pickles, and their plain text beside them. Of ``data``, only the plain
text is read.
"""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aquafish_gym.runs.arrays import read_arrays
from aquafish_gym.utils.storage import MAXIMUM_DOCUMENT_BYTES, open_regular
from aquafish_gym.utils.validation import InvalidArgumentError, brief, flag, one_of, parse_json
from gait.controllers.sb3_policy import (
    ACTIVATIONS,
    CHOSEN,
    CLIPPED,
    SQUASHED,
    Floats,
    Layer,
    Normalization,
    SB3Policy,
)
from gait.controllers.torch_file import TorchFile, open_torch_file

MOST_BYTES = 128 * 2**20  # of a policy's file, and of what it holds
MOST_NUMBERS = 2 * 10**6  # weights and biases of all layers
MOST_NODES = 2**14  # entries of an observation, or outputs of a layer
LARGEST_SCALED_BOUND = 1e38  # float32 holds the difference of two such

# Keywords of a policy that do not change what it does without noise, or that are read.
_KEYWORDS = (
    "activation_fn", "clip_mean", "device", "features_extractor_class",
    "features_extractor_kwargs", "full_std", "log_std_init", "n_critics", "n_quantiles",
    "net_arch", "normalize_images", "optimizer_class", "optimizer_kwargs", "ortho_init",
    "sde_net_arch", "share_features_extractor", "squash_output", "use_expln", "use_sde",
)  # fmt: skip

_POLICIES = re.compile(r"stable_baselines3\..+|sb3_contrib\.tqc\.policies")
_FLATTEN = re.compile(r"<class 'stable_baselines3\.common\.\w+\.FlattenExtractor'>")
_ACTIVATION = re.compile(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>")
_SPACE = re.compile(r"<class '(?:gymnasium|gym)\.spaces\.\w+\.(\w+)'>")


@dataclass(frozen=True)
class _Kind:
    """Where the ``policy.pth`` of some algorithms has the actor."""

    name: str
    hidden: tuple[str, ...]  # each followed by 0, 2, 4: the activations are between
    last: str
    others: tuple[str, ...]  # what is there besides the actor
    activation: str  # by default


_ON_POLICY = _Kind(
    "PPO, A2C or TRPO", ("mlp_extractor.shared_net", "mlp_extractor.policy_net"), "action_net",
    ("mlp_extractor.value_net", "value_net", "log_std", "sde_features_extractor"), "Tanh",
)  # fmt: skip
KINDS = (
    _ON_POLICY,
    _Kind(
        "SAC or TQC", ("actor.latent_pi",), "actor.mu",
        ("actor.log_std", "critic", "critic_target"), "ReLU",
    ),
    _Kind("TD3 or DDPG", ("actor.mu",), "", ("actor_target", "critic", "critic_target"), "ReLU"),
)  # fmt: skip


def read_policy(
    path: Path,
    normalize: Path | Literal["none"] | None = None,
    activation: str | None = None,
) -> SB3Policy:
    """Read the file of ``model.save``, and the numbers of VecNormalize.

    Parameters
    ----------
    path
        The zip file, of any version since 2020.
    normalize
        An npz file with VecNormalize's ``mean`` and ``var`` of the shape of the observation,
        and its ``epsilon`` and ``clip``. Its own file is a pickle, which is never loaded. "none"
        if it scaled rewards alone.
    activation
        The key of ``ACTIVATIONS`` that computes what an ``activation_fn`` of the user's own does.

    Raises
    ------
    InvalidArgumentError
        If the policy is none of dense layers, if its action can exceed float32, or if an argument
        must say what the file does not; the message names the layer, setting or argument.
    """
    data, weights = _read_zip(path)
    if data.get("use_sde") and "actor.mu.0.weight" in weights.tensors:
        raise InvalidArgumentError(
            "actor.mu must be a dense layer; with use_sde, SAC clips its outputs by a Hardtanh, "
            "which is not exported"
        )
    kind, layers = _actor(weights)
    keywords = _keywords(data)
    shape = _observation_shape(data)
    entries = math.prod(shape)
    if layers[0].weights.shape[1] != entries:
        raise InvalidArgumentError(
            f"{layers[0].name} must have {entries} inputs, the entries of the observation; it has "
            f"{layers[0].weights.shape[1]}"
        )
    squashed = kind is not _ON_POLICY or flag("squash_output", keywords.get("squash_output", False))
    output, low, high = _action(data, kind, squashed, layers[-1])
    scaled = _scaled(data, kind, normalize, shape)
    found = _activation(keywords, kind, activation)
    return SB3Policy(kind.name, layers, found, output, low, high, scaled)


def _read_zip(path: Path) -> tuple[Mapping[str, Any], TorchFile]:
    """Return the plain text of ``data``, and the tensors of ``policy.pth``."""
    named = f"controller: {path}"
    try:
        with open_regular(path, "controller", MOST_BYTES) as file, zipfile.ZipFile(file) as whole:
            text = _member(whole, "data", MAXIMUM_DOCUMENT_BYTES)
            weights = open_torch_file(_member(whole, "policy.pth", MOST_BYTES), MOST_BYTES)
    except InvalidArgumentError:
        raise
    except Exception as error:  # a damaged file raises a dozen kinds of errors
        raise InvalidArgumentError(
            f"{named} must be a file of stable-baselines3, by model.save: a zip with data and "
            f"policy.pth, a dictionary of tensors; {brief(str(error))}"
        ) from None
    data = parse_json(f"{named}: data", text)
    if not isinstance(data, dict):
        raise InvalidArgumentError(f"{named} must hold settings by name; got {brief(data)}")
    return data, weights


def _member(archive: zipfile.ZipFile, name: str, most_bytes: int) -> bytes:
    if archive.getinfo(name).file_size > most_bytes:
        raise ValueError(f"{name} has more than {most_bytes} bytes")
    return archive.read(name)


def _actor(weights: TorchFile) -> tuple[_Kind, tuple[Layer, ...]]:
    """Return the algorithm and the layers of its actor; refuse what is no dense layer."""
    tensors = weights.tensors
    kinds = [kind for kind in KINDS if f"{kind.last or kind.hidden[0] + '.0'}.weight" in tensors]
    if not kinds:
        raise InvalidArgumentError(
            f"the policy must be one of {'; '.join(kind.name for kind in KINDS)}, of dense "
            f"layers; it has {brief(', '.join(tensors))}"
        )
    kind = kinds[0]
    names = list(_layer_names(kind, weights))
    parts = {f"{name}.{part}" for name in names for part in ("weight", "bias")}
    others = tuple(f"{other}." for other in kind.others)
    for name in tensors:
        if name not in parts and not f"{name}.".startswith(others):
            raise InvalidArgumentError(
                f"{name} is no dense layer of {kind.name} between observation and action, and "
                f"cannot be exported; those are {brief(', '.join(names))}"
            )
    numbers = sum(tensors[part].size for part in parts if part in tensors)
    if numbers > MOST_NUMBERS:
        raise InvalidArgumentError(
            f"the layers must have at most {MOST_NUMBERS} weights and biases; they have {numbers}"
        )
    layers: list[Layer] = []
    for name in names:
        layer = Layer(name, weights.array(f"{name}.weight"), weights.array(f"{name}.bias"))
        shape = (*layer.biases.shape, *layer.weights.shape[1:])
        if layer.weights.ndim != 2 or layer.weights.shape != shape or not layer.weights.size:
            raise InvalidArgumentError(
                f"{name} must have weights (out, in) and biases (out,), as a dense layer; "
                f"got {layer.weights.shape} and {layer.biases.shape}"
            )
        if max(shape) > MOST_NODES:
            raise InvalidArgumentError(
                f"{name} must have at most {MOST_NODES} inputs and outputs; it has {shape}"
            )
        if layers and shape[1] != len(layers[-1].biases):
            raise InvalidArgumentError(
                f"{name} must have {len(layers[-1].biases)} inputs, the outputs of the layer "
                f"before; got {shape[1]}"
            )
        layers.append(layer)
    return kind, tuple(layers)


def _layer_names(kind: _Kind, weights: TorchFile) -> Iterator[str]:
    for hidden in kind.hidden:
        for i in count(step=2):
            if f"{hidden}.{i}.weight" not in weights.tensors:
                break
            yield f"{hidden}.{i}"
    if kind.last:
        yield kind.last


def _keywords(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the policy's keywords; refuse those that put something else than dense layers."""
    module = str(_plain(data, "policy_class").get("__module__"))
    if not _POLICIES.fullmatch(module):
        raise InvalidArgumentError(
            f"policy_class must be one of stable_baselines3; it is of {brief(module)}"
        )
    keywords = _plain(data, "policy_kwargs")
    for name in keywords:
        one_of("policy_kwargs", name, _KEYWORDS)
    extractor = keywords.get("features_extractor_class")
    if extractor is not None and not _FLATTEN.fullmatch(str(extractor)):
        raise InvalidArgumentError(
            f"features_extractor_class must be FlattenExtractor; got {brief(extractor)}"
        )
    return keywords


def _activation(keywords: Mapping[str, Any], kind: _Kind, given: str | None) -> str:
    """Return the activation of a policy; ``given`` stands for one that is not PyTorch's."""
    if given is not None:
        one_of("activation", given, ACTIVATIONS)
    found: str = kind.activation
    if "activation_fn" in keywords:
        text = str(keywords["activation_fn"])
        named = _ACTIVATION.fullmatch(text)
        if not named and given is None:
            raise InvalidArgumentError(
                f"activation must be one of {', '.join(ACTIVATIONS)}, the one that computes what "
                f"the policy's own activation_fn does, {brief(text)}; got none"
            )
        found = one_of("activation_fn", named[1], ACTIVATIONS) if named else str(given)
    if given not in (None, found):
        raise InvalidArgumentError(f"activation must be {found}, as the policy's; got {given}")
    return found


def _scaled(
    data: Mapping[str, Any],
    kind: _Kind,
    normalize: Path | Literal["none"] | None,
    shape: tuple[int, ...],
) -> Normalization | None:
    """Return VecNormalize's numbers; ask for them where the policy shows that it was there."""
    if normalize == "none":
        return None
    if normalize is not None:
        return _normalization(normalize, shape)
    # PPO, A2C and TRPO keep observations as they were before VecNormalize; the others always.
    if kind is _ON_POLICY and data.get("_last_original_obs") is not None:
        raise InvalidArgumentError(
            "normalize must be an npz file of VecNormalize's mean, var, epsilon and clip, or none "
            "if it scaled rewards alone: the policy was trained in it, and these are not in the "
            "policy's file; got nothing"
        )
    return None


def _plain(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the plain text of an entry of ``data``, without its pickle."""
    found = data.get(name)
    if not isinstance(found, dict):
        raise InvalidArgumentError(
            f"{name} must be an object in the policy's data; got {brief(found)}"
        )
    return {key: value for key, value in found.items() if key not in (":type:", ":serialized:")}


def _space(
    data: Mapping[str, Any], name: str, kinds: tuple[str, ...]
) -> tuple[str, dict[str, Any]]:
    """Return the class of a space, one of ``kinds``, and its attributes as text."""
    found = _plain(data, name)
    text = data[name].get(":type:")
    of = _SPACE.fullmatch(str(text))
    return one_of(f"the class of {name}", of[1] if of else text, kinds), found


def _observation_shape(data: Mapping[str, Any]) -> tuple[int, ...]:
    """Return the shape of the observation, of real numbers that no one scales or encodes."""
    _, space = _space(data, "observation_space", ("Box",))
    shape = space.get("_shape", space.get("shape"))  # the latter before gym 0.21
    if not isinstance(shape, list) or not all(type(n) is int and n > 0 for n in shape) or not shape:
        raise InvalidArgumentError(f"observation_space must have a shape; got {brief(shape)}")
    if space.get("dtype") == "uint8" and len(shape) == 3:
        raise InvalidArgumentError("observation_space must be of real numbers; it is of images")
    return tuple(shape)


def _action(
    data: Mapping[str, Any], kind: _Kind, squashed: bool, last: Layer
) -> tuple[str, Floats, Floats]:
    """Return what becomes of the outputs, and the bounds of the action."""
    of, space = _space(data, "action_space", ("Box", "Discrete"))
    outputs = len(last.biases)
    if of == "Discrete":
        if kind is not _ON_POLICY:
            raise InvalidArgumentError(f"action_space must be a Box with {kind.name}; got Discrete")
        if str(space.get("n")) != str(outputs):
            raise InvalidArgumentError(
                f"{last.name} must have {space.get('n')} outputs, the choices of action_space; it "
                f"has {outputs}"
            )
        return CHOSEN, np.empty(0, np.float32), np.empty(0, np.float32)
    low, high = (_bounds(space, name, outputs, last.name) for name in ("low", "high"))
    if not (low < high).all():
        raise InvalidArgumentError("action_space must have each bound low below high; it has not")
    if not squashed:
        return CLIPPED, low, high
    largest = max(np.abs(low).max(), np.abs(high).max())
    if largest > LARGEST_SCALED_BOUND:
        raise InvalidArgumentError(
            f"action_space must have bounds within {LARGEST_SCALED_BOUND:g} of 0, because "
            f"{kind.name} scales its outputs to them; got {largest:g}"
        )
    return SQUASHED, low, high


def _bounds(space: Mapping[str, Any], name: str, count: int, layer: str) -> Floats:
    """Return the bounds that an array was printed as, such as "[-1. -1.]"."""
    text = str(space.get(name))
    try:
        found = np.array(text.translate({91: " ", 93: " "}).split(), dtype=np.float32)
    except ValueError:
        found = np.empty(0, np.float32)
    if len(found) != count or not np.isfinite(found).all():
        raise InvalidArgumentError(
            f"action_space's {name} must be {count} finite numbers, for the outputs of {layer}; "
            f"got {brief(text)}"
        )
    return found


def _normalization(path: Path, shape: tuple[int, ...]) -> Normalization:
    shapes = {"mean": shape, "var": shape, "epsilon": (), "clip": ()}
    found = {
        name: np.asarray(array, np.float64).ravel()
        for name, array in read_arrays(path, shapes, "normalize").items()
    }
    (epsilon,) = found["epsilon"]
    (limit,) = found["clip"]
    mean = found["mean"].astype(np.float32)
    with np.errstate(invalid="ignore"):
        scale = np.sqrt(found["var"] + epsilon).astype(np.float32)
    if not (np.isfinite(mean).all() and np.isfinite(scale).all() and (scale > 0).all()):
        raise InvalidArgumentError(
            f"normalize: {path} must have finite mean, and var + epsilon above 0; it has not"
        )
    if not limit > 0:
        raise InvalidArgumentError(f"normalize: {path} must have clip above 0; got {limit:g}")
    return Normalization(mean, scale, float(np.float32(limit)))
