"""Who may talk to the viewer, and what they may say.

Any page in the user's browser and any user of the machine can reach a server at 127.0.0.1. The door
lets only those in who know the address with its token, no other page, and only messages that one of
the page's controls can send.
"""

from __future__ import annotations

import logging
import math
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch
from urllib.parse import urlsplit

from aquafish_gym.utils.validation import MissingExtraError, install_advice

LOOPBACK = ("127.0.0.1", "localhost", "::1")
LONGEST_MESSAGE = 16 * 1024  # bytes: the page sends a few hundred, and no files
LONGEST_TEXT = 500  # characters of a control
REFUSAL = "Open the whole address that aquafish view printed: it ends with a token.\n"
CLOSING_SECONDS = 0.5  # a tab that does not answer is not waited for longer
CAMERA = {
    "wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3, "fov": 0, "near": 0, "far": 0,
    "image_height": 0, "image_width": 0,
}  # fmt: skip
CLICK = {"ray_origin": 3, "ray_direction": 3, "screen_pos": 2}

Message = dict[str, Any]


def viser_module() -> Any:
    """Return the package viser; MissingExtraError without it."""
    try:
        import viser
        import viser.uplot
    except ImportError as error:
        raise MissingExtraError(
            f"the viewer needs the extra view ({error}): {install_advice('view')}"
        ) from None
    return viser


def is_own_page(hosts: list[str], origins: list[str]) -> bool:
    """Return whether a request comes from the viewer's own page, or from no page at all.

    ``hosts`` and ``origins`` are the values of the headers Host and Origin. The host must be this
    machine, also through a forwarded port, so that no other name can be made to lead here. A
    browser states the page that opens a connection as its origin.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return False
    try:
        name = urlsplit(f"//{hosts[0]}").hostname
    except ValueError:
        return False
    own = (f"http://{hosts[0]}", f"https://{hosts[0]}")
    return name in LOOPBACK and all(origin in own for origin in origins)


def checked_value(control: Any, value: Any) -> Any:
    """Return a value for a control of viser, clipped to its range; None if it can have no such."""
    present = control.value
    if hasattr(control, "options"):
        return value if value in control.options else None
    if isinstance(present, bool):
        return value if isinstance(value, bool) else None
    if isinstance(present, str):
        return value if isinstance(value, str) and len(value) <= LONGEST_TEXT else None
    if not _finite(value):
        return None
    clipped = min(max(value, control.min), control.max)
    return round(clipped) if isinstance(present, int) else float(clipped)


def checked_message(
    message: object, controls: Mapping[str, Any], clickable: Mapping[str, int]
) -> Message | None:
    """Return a message of the page as viser may have it; None if no page sends it.

    Parameters
    ----------
    message
        What the page sent, decoded.
    controls
        The handles of viser's controls by their identifiers.
    clickable
        The numbers of instances of what may be clicked, by names of nodes.
    """
    if not isinstance(message, dict):
        return None
    kind = message.get("type")
    if kind == "GuiUpdateMessage":
        uuid, updates = message.get("uuid"), message.get("updates")
        if not isinstance(updates, dict) or list(updates) != ["value"]:
            return None
        control = controls.get(uuid) if isinstance(uuid, str) else None
        if control is None or control.disabled or not control.visible:
            return None
        value = checked_value(control, updates["value"])
        return None if value is None else {"type": kind, "uuid": uuid, "updates": {"value": value}}
    if kind == "ViewerCameraMessage":
        return _with_numbers(message, CAMERA, {"type": kind})
    if kind == "SceneNodeClickMessage":
        name, instance = message.get("name"), message.get("instance_index")
        count = clickable.get(name, 0) if isinstance(name, str) else 0
        if type(instance) is not int or not 0 <= instance < count:
            return None
        kept = {"type": kind, "name": name, "instance_index": instance, "modifier": None}
        return _with_numbers(message, CLICK, kept)
    return None


def _with_numbers(message: Message, counts: Mapping[str, int], kept: Message) -> Message | None:
    """Return ``kept`` with finite numbers of a message: ``counts`` of each, 0 for a bare one."""
    for name, count in counts.items():
        value = message.get(name)
        if count and not (isinstance(value, list) and len(value) == count):
            return None
        if not all(map(_finite, value if isinstance(value, list) else [value])):
            return None
        kept[name] = value
    return kept


def _finite(value: object) -> bool:
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and abs(value) < 1e12
        and math.isfinite(value)
    )


def _is_no_knock(record: logging.LogRecord) -> bool:
    """Return False for a connection that asks nothing, as browsers open them in advance."""
    return record.msg != "opening handshake failed"


def as_code(text: object) -> str:
    """Return text for viser's Markdown, which runs HTML and expressions in braces, as a span.

    In a span nothing is read as markup, but for the backquote that ends it.
    """
    return "`" + " ".join(str(text).replace("`", "'").split()) + "`"


def path_behind(token: str, path: str) -> str | None:
    """Return the path that a requested path has behind the token, ``/:token/path``.

    None if the token is missing or wrong.
    """
    given, _, rest = path.removeprefix("/:").partition("/")
    known = given.isascii() and secrets.compare_digest(given, token)
    return f"/{rest}" if known else None


@contextmanager
def guarded(token: str, check: Callable[[object], Message | None]) -> Iterator[None]:
    """Let servers of viser that start in this context have a door.

    Viser has no setting for it, so the function that opens its socket is replaced for a moment.

    Parameters
    ----------
    token
        Who asks for ``/:token/`` enters. Viser's page opens its connection at its own path.
    check
        Returns a message as it may pass, or None.

    Raises
    ------
    RuntimeError
        If no server was opened in the context by that function: then it would have no door.
    """
    import msgspec
    from websockets.asyncio import server

    serve, opened = server.serve, []
    logging.getLogger("websockets.server").addFilter(_is_no_knock)

    class Connection(server.ServerConnection):
        """A connection that only receives messages that pass."""

        async def recv(self, *_: Any, **__: Any) -> Any:
            while True:
                raw = await super().recv()
                try:
                    message = check(msgspec.msgpack.decode(raw)) if type(raw) is bytes else None
                except (msgspec.DecodeError, RecursionError, ValueError):
                    continue
                if message is not None:
                    return msgspec.msgpack.encode(message)

    def serve_guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            headers = request.headers
            own = is_own_page(headers.get_all("Host"), headers.get_all("Origin"))
            path = path_behind(token, request.path)
            if path is None or not own:
                return connection.respond(403, REFUSAL)
            request.path = path
            response = process_request(connection, request)
            if response is not None:  # a file, which no other page may show in a frame
                response.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                response.headers["Referrer-Policy"] = "no-referrer"  # which has the token
            return response

        opened.append(arguments)
        own = {"max_size": LONGEST_MESSAGE, "close_timeout": CLOSING_SECONDS}
        return serve(
            *arguments,
            process_request=answer,
            create_connection=Connection,
            **(options | own),
        )

    with patch.object(server, "serve", serve_guarded):
        yield
    if not opened:
        raise RuntimeError("this version of viser opens its socket in another way: no door is set")
