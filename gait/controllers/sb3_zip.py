"""Read policies of stable-baselines3 from its zip files, without loading a pickle of theirs.

A file of ``model.save`` has the weights in ``policy.pth``, which PyTorch reads with
``weights_only=True``, and the rest in ``data``: JSON with base64 pickles, and their plain text
beside them. Of ``data``, only the plain text is read.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from itertools import count, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.runs.arrays import read_arrays
from aquafish_gym.utils.storage import MAXIMUM_DOCUMENT_BYTES, open_regular
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    MissingExtraError,
    brief,
    install_advice,
    one_of,
    parse_json,
)
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

MOST_BYTES = 256 * 2**20  # of a policy's file, and of what it holds
MOST_NUMBERS = 10**6  # weights or biases of a layer

# Keywords of a policy that do not change what it does without noise.
_HARMLESS = (
    "activation_fn", "clip_mean", "features_extractor_class", "features_extractor_kwargs",
    "full_std", "log_std_init", "n_critics", "net_arch", "normalize_images", "optimizer_class",
    "optimizer_kwargs", "ortho_init", "share_features_extractor", "squash_output", "use_expln",
    "use_sde",
)  # fmt: skip

_FLATTEN = "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"


@dataclass(frozen=True)
class _Kind:
    """Where an algorithm's ``policy.pth`` has its actor."""

    name: str
    hidden: str  # of the hidden layers, followed by 0, 2, 4: the activations are between
    last: str
    others: tuple[str, ...]  # what is there besides the actor
    activation: str  # by default


KINDS = (
    _Kind(
        "PPO or A2C", "mlp_extractor.policy_net", "action_net",
        ("mlp_extractor.value_net", "value_net", "log_std"), "Tanh",
    ),
    _Kind(
        "SAC", "actor.latent_pi", "actor.mu", ("actor.log_std", "critic", "critic_target"), "ReLU"
    ),
    _Kind("TD3", "actor.mu", "", ("actor_target", "critic", "critic_target"), "ReLU"),
)  # fmt: skip


def read_policy(path: Path, normalize: Path | None = None) -> SB3Policy:
    """Read the file of ``model.save``, and the numbers of VecNormalize.

    Parameters
    ----------
    path
        The zip file.
    normalize
        An npz file with VecNormalize's ``mean`` and ``var`` of the shape of the observation,
        and its ``epsilon`` and ``clip``. Its own file is a pickle, which is never loaded.

    Raises
    ------
    InvalidArgumentError
        If the policy is none of dense layers; the message names the layer or the setting.
    MissingExtraError
        If PyTorch is not installed.
    """
    data, weights = _read_zip(path)
    if data.get("use_sde") and "actor.mu.0.weight" in weights:
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
    output, low, high, first = _action(data, kind, layers[-1])
    scaled = None if normalize is None else _normalization(normalize, shape)
    activation = kind.activation
    if "activation_fn" in keywords:
        text = str(keywords["activation_fn"])
        named = re.fullmatch(r"<class 'torch\.nn\.modules\.activation\.(\w+)'>", text)
        activation = one_of("activation_fn", named[1] if named else text, ACTIVATIONS)
    return SB3Policy(kind.name, layers, activation, output, low, high, first, scaled)


def _read_zip(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return the plain text of ``data``, and the tensors of ``policy.pth`` by name."""
    try:
        torch = import_module("torch")
    except ImportError as error:
        raise MissingExtraError(
            f"a policy of stable-baselines3 is read by PyTorch, which is not installed here "
            f"({error}): {install_advice('rl')}"
        ) from None
    named = f"controller: {path}"
    try:
        with open_regular(path, "controller", MOST_BYTES) as file, zipfile.ZipFile(file) as whole:
            text = _member(whole, "data", MAXIMUM_DOCUMENT_BYTES)
            content = _member(whole, "policy.pth", MOST_BYTES)
        with zipfile.ZipFile(io.BytesIO(content)) as inner:
            if sum(member.file_size for member in inner.infolist()) > MOST_BYTES:
                raise ValueError(f"policy.pth holds more than {MOST_BYTES} bytes")
        weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except InvalidArgumentError:
        raise
    except Exception as error:  # zipfile and PyTorch raise a dozen kinds of errors
        reason = str(error).partition("\n")[0]
        raise InvalidArgumentError(
            f"{named} must be a file of stable-baselines3, by model.save: a zip with data and "
            f"policy.pth, which torch.load reads with weights_only=True; {brief(reason)}"
        ) from None
    data = parse_json(f"{named}: data", text)
    if not (
        isinstance(data, dict)
        and isinstance(weights, dict)
        and all(isinstance(name, str) for name in weights)
    ):
        raise InvalidArgumentError(f"{named} must hold settings and weights by name; it does not")
    return data, weights


def _member(archive: zipfile.ZipFile, name: str, most_bytes: int) -> bytes:
    if archive.getinfo(name).file_size > most_bytes:
        raise ValueError(f"{name} has more than {most_bytes} bytes")
    return archive.read(name)


def _actor(weights: Mapping[str, Any]) -> tuple[_Kind, tuple[Layer, ...]]:
    """Return the algorithm and the layers of its actor; refuse what is no dense layer."""
    kinds = [kind for kind in KINDS if f"{kind.last or kind.hidden + '.0'}.weight" in weights]
    if not kinds:
        raise InvalidArgumentError(
            f"the policy must be one of {', '.join(kind.name for kind in KINDS)}, of dense layers; "
            f"it has {brief(', '.join(map(str, weights)))}"
        )
    (kind,) = kinds
    places = (f"{kind.hidden}.{i}" for i in count(step=2))
    names = list(takewhile(lambda name: f"{name}.weight" in weights, places))
    names += [kind.last] * bool(kind.last)
    known = {f"{name}.{part}" for name in names for part in ("weight", "bias")}
    for name in weights:
        if name not in known and not any(
            name == other or name.startswith(f"{other}.") for other in kind.others
        ):
            raise InvalidArgumentError(
                f"{name} is no dense layer of {kind.name} between observation and action, and "
                f"cannot be exported; those are {', '.join(names)}"
            )
    layers = tuple(
        Layer(name, *(_tensor(weights, f"{name}.{part}") for part in ("weight", "bias")))
        for name in names
    )
    sources = None
    for layer in layers:
        shape = (*layer.biases.shape, *layer.weights.shape[1:])
        if layer.weights.ndim != 2 or layer.weights.shape != shape or not layer.weights.size:
            raise InvalidArgumentError(
                f"{layer.name} must have weights (out, in) and biases (out,), as a dense layer; "
                f"got {layer.weights.shape} and {layer.biases.shape}"
            )
        if sources is not None and layer.weights.shape[1] != sources:
            raise InvalidArgumentError(
                f"{layer.name} must have {sources} inputs, the outputs of the layer before; got "
                f"{layer.weights.shape[1]}"
            )
        sources = len(layer.biases)
    return kind, layers


def _tensor(weights: Mapping[str, Any], name: str) -> Floats:
    """Return a tensor of finite float32."""
    found = weights.get(name)
    kind = " ".join(str(getattr(found, part, None)) for part in ("dtype", "layout", "device"))
    if found is None or kind != "torch.float32 torch.strided cpu":
        raise InvalidArgumentError(f"{name} must be a tensor of float32; got {kind}")
    if found.numel() > MOST_NUMBERS:
        raise InvalidArgumentError(
            f"{name} must have at most {MOST_NUMBERS} numbers; it has {found.numel()}"
        )
    array: Floats = found.detach().contiguous().numpy()
    if not np.isfinite(array).all():
        raise InvalidArgumentError(f"{name} must be finite; it is not")
    return array


def _keywords(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the policy's keywords; refuse those that put something else than dense layers."""
    whole = _plain(data, "policy_class")
    module = str(whole.get("__module__"))
    if not module.startswith("stable_baselines3."):
        raise InvalidArgumentError(
            f"policy_class must be one of stable_baselines3; it is of {brief(module)}"
        )
    keywords = _plain(data, "policy_kwargs")
    for name in keywords:
        one_of("policy_kwargs", name, _HARMLESS)
    if keywords.get("squash_output"):
        raise InvalidArgumentError("squash_output must be False with PPO and A2C; got True")
    extractor = keywords.get("features_extractor_class", _FLATTEN)
    if extractor != _FLATTEN:
        raise InvalidArgumentError(
            f"features_extractor_class must be FlattenExtractor; got {brief(extractor)}"
        )
    return keywords


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
    of = re.fullmatch(
        r"<class '(?:gymnasium|gym)\.spaces\.\w+\.(\w+)'>", str(data[name].get(":type:"))
    )
    return one_of(f"the class of {name}", of[1] if of else data[name].get(":type:"), kinds), found


def _observation_shape(data: Mapping[str, Any]) -> tuple[int, ...]:
    """Return the shape of the observation, of real numbers that no one scales or encodes."""
    _, space = _space(data, "observation_space", ("Box",))
    shape = space.get("_shape")
    if not isinstance(shape, list) or not all(type(n) is int and n > 0 for n in shape) or not shape:
        raise InvalidArgumentError(f"observation_space must have a shape; got {brief(shape)}")
    if space.get("dtype") == "uint8" and len(shape) == 3:
        raise InvalidArgumentError("observation_space must be of real numbers; it is of images")
    return tuple(shape)


def _action(data: Mapping[str, Any], kind: _Kind, last: Layer) -> tuple[str, Floats, Floats, int]:
    """Return what becomes of the outputs, the bounds, and the first choice's number."""
    of, space = _space(data, "action_space", ("Box", "Discrete"))
    outputs = len(last.biases)
    if of == "Discrete":
        if kind is not KINDS[0]:
            raise InvalidArgumentError(f"action_space must be a Box with {kind.name}; got Discrete")
        if str(space.get("n")) != str(outputs):
            raise InvalidArgumentError(
                f"{last.name} must have {space.get('n')} outputs, the choices of action_space; it "
                f"has {outputs}"
            )
        first = re.fullmatch(r"-?\d{1,9}", str(space.get("start", 0)))
        if first is None:
            raise InvalidArgumentError(
                f"action_space's start must be a whole number; got {brief(space['start'])}"
            )
        return CHOSEN, np.empty(0, np.float32), np.empty(0, np.float32), int(first[0])
    low, high = (_bounds(space, name, outputs, last.name) for name in ("low", "high"))
    if not (low < high).all():
        raise InvalidArgumentError("action_space must have each bound low below high; it has not")
    return CLIPPED if kind is KINDS[0] else SQUASHED, low, high, 0


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
