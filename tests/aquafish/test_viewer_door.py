"""Only the viewer's own page may drive it, and nothing that it sends ends or freezes it."""

from __future__ import annotations

import asyncio
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

pytest.importorskip("viser", reason="needs the extra view")

import msgspec
import viser
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

from aquafish.viewer import door
from aquafish.viewer.command import View
from aquafish.viewer.live import MAXIMUM_VIEWED_FAULTS, LiveSwim, pilot_of
from aquafish.viewer.page import Viewer
from aquafish_gym.utils.validation import InvalidArgumentError
from tests.browser import browser

NAN = math.nan


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    pilots = View().pilots()
    view = Viewer(LiveSwim(pilots["gait"], 1), pilots, 8360)
    view.update()
    yield view
    view.close()


def enter(viewer: Viewer, **options: Any) -> Any:
    """Open a connection as the page does; one that is not read to its end is closed at once."""
    return connect(
        viewer.url.replace("http", "ws"),
        subprotocols=[f"viser-v{viser.__version__}"],
        compression=None,
        close_timeout=0.1,
        **options,
    )


def send(socket: Any, kind: str, **fields: Any) -> None:
    socket.send(msgspec.msgpack.encode({"type": kind, **fields}))


def look(socket: Any) -> None:
    """Send where the camera is, as the page does first: viser answers no other client."""
    numbers = {name: [0.0] * count if count else 1.0 for name, count in door.CAMERA.items()}
    send(socket, "ViewerCameraMessage", **{**numbers, "wxyz": [1.0, 0.0, 0.0, 0.0]})


def settle(viewer: Viewer) -> None:
    """Wait until what was sent has arrived, and let the viewer do it."""
    for _ in range(10):
        time.sleep(0.05)
        viewer.update()


@pytest.mark.parametrize(
    ("host", "origins", "expected"),
    [
        ("127.0.0.1:8080", [], True),
        ("127.0.0.1:8080", ["http://127.0.0.1:8080"], True),
        ("localhost:9000", ["http://localhost:9000"], True),  # a forwarded port
        ("[::1]:8080", ["http://[::1]:8080"], True),
        ("127.0.0.1:8080", ["http://127.0.0.1:3000"], False),
        ("127.0.0.1:8080", ["http://localhost:8080"], False),
        ("127.0.0.1:8080", ["http://evil.example"], False),
        ("127.0.0.1:8080", ["null"], False),
        ("127.0.0.1:8080", ["http://127.0.0.1:8080", "http://evil.example"], False),
        ("evil.example:8080", ["http://evil.example:8080"], False),  # a name that leads here
        ("127.0.0.1.evil.example", [], False),
        ("[", [], False),
    ],
)
def test_only_the_own_page_enters(host: str, origins: list[str], expected: bool) -> None:
    assert door.is_own_page([host], origins) is expected
    assert not door.is_own_page([], origins)
    assert not door.is_own_page([host, host], origins)


def test_other_pages_are_refused_at_the_handshake(viewer: Viewer) -> None:
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1"):
        with pytest.raises(InvalidStatus, match="403"):
            enter(viewer, origin=origin)
    with enter(viewer, origin=f"http://{urlsplit(viewer.url).netloc}") as socket:
        assert socket.recv(timeout=10)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("/:secret/", "/"),
        ("/:secret", "/"),
        ("/:secret/a/b?c", "/a/b?c"),
        *((wrong, None) for wrong in ("/", "", "/:", "/:/", "/secret/", "/:secre/", "/:secrets/")),
        *(
            (wrong, None)
            for wrong in ("/?token=secret", "/:s\xe9cret/", "/:\udcff/", "/a/:secret/")
        ),
    ],
)
def test_a_path_needs_the_token(path: str, expected: str | None) -> None:
    assert door.path_behind("secret", path) == expected


def test_another_user_of_the_machine_does_not_enter(viewer: Viewer) -> None:
    place = urlsplit(viewer.url)
    for path in ("", "/", "/:wrong/", place.path[:-2], f"/?token={place.path.strip('/:')}"):
        with pytest.raises(HTTPError, match="403") as refused:
            urlopen(f"http://{place.netloc}{path}")
        assert b"address that aquafish view printed" in refused.value.read()
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{place.netloc}{path}", subprotocols=["viser-v" + viser.__version__])
    with urlopen(viewer.url) as page:
        assert b"Viser client" in page.read()
        assert page.headers["Referrer-Policy"] == "no-referrer"
    with enter(viewer) as socket:
        assert socket.recv(timeout=10)


def test_a_token_is_long_and_of_one_viewer() -> None:
    pilots = View().pilots()
    views = [Viewer(LiveSwim(pilots["gait"], 1), pilots, 8370) for _ in range(2)]
    tokens = {urlsplit(view.url).path for view in views}
    assert len(tokens) == 2
    assert min(map(len, tokens)) > 20
    for view in views:
        view.close()


def test_viser_s_clients_are_woken_in_its_event_loop_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another thread would meet clients that leave: "deque mutated during iteration"."""
    set_event = asyncio.Event.set
    threads: list[int] = []

    def set_and_note(event: asyncio.Event) -> None:
        threads.append(threading.get_ident())
        set_event(event)

    click = {"ray_origin": [0, 0, 0], "ray_direction": [0, 0, 1], "screen_pos": [0, 0]}
    pilots = View().pilots()
    with (
        closing(Viewer(LiveSwim(pilots["gait"]), pilots, 8380)) as viewer,
        enter(viewer) as socket,
        monkeypatch.context() as patched,
    ):
        patched.setattr(asyncio.Event, "set", set_and_note)
        look(socket)
        for handle in viewer._controls.values():
            value = handle.options[1] if hasattr(handle, "options") else handle.value
            send(socket, "GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})
        settle(viewer)
        name = viewer.robots.boxes.name
        send(socket, "SceneNodeClickMessage", name=name, instance_index=3, **click)
        settle(viewer)
        assert viewer.pilot.value == "random"
        assert viewer.swim.faults(0)  # of the click
        viewer_thread = viewer._on_page(threading.get_ident)
    assert len(threads) > 100
    assert set(threads) == {viewer_thread}


SLIDER = SimpleNamespace(value=1.0, min=0.25, max=4.0)
NUMBER = SimpleNamespace(value=1, min=1, max=64)
CHOICE = SimpleNamespace(value="a", options=("a", "b"))
CHECKBOX, TEXT = SimpleNamespace(value=True), SimpleNamespace(value="")


@pytest.mark.parametrize(
    ("control", "value", "expected"),
    [
        (SLIDER, 2, 2.0),
        (SLIDER, 1e9, 4.0),
        (SLIDER, -1e9, 0.25),
        (NUMBER, 2.6, 3),
        (NUMBER, 10**15, None),
        (CHOICE, "b", "b"),
        (CHECKBOX, False, False),
        (TEXT, "caudal:missing", "caudal:missing"),
        *((SLIDER, bad, None) for bad in (NAN, math.inf, -math.inf, "2", None, [2], {}, True)),
        *((CHOICE, bad, None) for bad in ("c", 1, None, [])),
        *((CHECKBOX, bad, None) for bad in (1, "yes", None)),
        *((TEXT, bad, None) for bad in (1, None, "x" * (door.LONGEST_TEXT + 1))),
    ],
)
def test_values_are_clipped_and_checked(control: Any, value: Any, expected: Any) -> None:
    found = door.checked_value(control, value)
    assert found == expected
    assert type(found) is type(expected)


def test_hostile_messages_neither_end_nor_freeze_the_viewer(viewer: Viewer) -> None:
    def uuid(handle: Any) -> str:
        return str(handle._impl.uuid)

    before = viewer.speed.max, viewer.speed.value
    with enter(viewer) as socket:
        look(socket)
        for handle in viewer._controls.values():
            for value in (NAN, math.inf, 1e308, -(2**60), "<b>", "x" * 9000, None, [[]], {"a": 1}):
                send(socket, "GuiUpdateMessage", uuid=uuid(handle), updates={"value": value})
        for updates in ({"max": 1e9}, {"value": 1.0, "label": "x"}, {}, [], None):
            send(socket, "GuiUpdateMessage", uuid=uuid(viewer.speed), updates=updates)
        click = {"ray_origin": [0, 0, 0], "ray_direction": [0, 0, 1], "screen_pos": [0, 0]}
        for name, instance in (
            (viewer.robots.boxes.name, 10**9),
            (viewer.robots.boxes.name, -1),
            (viewer.robots.boxes.name, None),
            ("/nowhere", 0),
            (None, 0),
        ):
            send(socket, "SceneNodeClickMessage", name=name, instance_index=instance, **click)
        send(socket, "ViewerCameraMessage", wxyz=[NAN] * 4, position="here")
        send(socket, "FileTransferStartUpload", part_count=10**6, size_bytes=10**12)
        send(socket, "NoSuchMessage")
        for raw in (b"", b"\xff" * 100, b"\x91" * 10_000, b"\xc0", "text"):
            socket.send(raw)
        settle(viewer)
        send(socket, "GuiUpdateMessage", uuid=uuid(viewer.speed), updates={"value": 2})
        settle(viewer)
    assert viewer.speed.value == 2.0  # the connection still works
    assert viewer.speed.max == before[0]
    assert viewer.pilot.value in viewer._pilots
    assert viewer.text.value == "<b>"
    viewer.speed.value = before[1]


def test_a_hidden_or_disabled_control_has_no_message(viewer: Viewer) -> None:
    """The slider of one robot, which is hidden, has a range of two."""
    shown = SimpleNamespace(value=1, min=1, max=2, visible=True, disabled=False)
    hidden = SimpleNamespace(**{**vars(shown), "visible": False})
    disabled = SimpleNamespace(**{**vars(shown), "disabled": True})
    controls = {"shown": shown, "hidden": hidden, "disabled": disabled}
    for uuid in controls:
        message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": 2}}
        expected = message if uuid == "shown" else None
        assert door.checked_message(message, controls, {}) == expected
    with enter(viewer) as socket:
        uuid = viewer.number._impl.uuid
        send(socket, "GuiUpdateMessage", uuid=uuid, updates={"value": 2})
        settle(viewer)
    assert viewer.number.value == 1


def test_an_update_that_fails_is_reported_once_and_the_viewer_goes_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    calls = 0

    def policy(_observation: Any, _time: float) -> Any:
        nonlocal calls
        calls += 1
        if calls == 1:
            return (0.0, 0.0, 0.0)
        if calls == 5:
            raise KeyboardInterrupt
        raise ValueError(f"no \x1b[31m action {calls}")

    def fail() -> None:
        raise KeyError("control")

    pilots = {"policy": pilot_of(policy)}
    viewer = Viewer(LiveSwim(pilots["policy"]), pilots, 8390)
    viewer._ask(fail)
    viewer._ask(viewer.swim.repair)
    viewer.run()
    assert calls == 5
    assert viewer._todo.empty()
    assert "ValueError: no [31m action 4" in viewer.damage.content.replace("\x1b", "")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[0] for line in lines] == ["KeyError:", "ValueError:"]
    assert "\x1b" not in "".join(lines)
    assert all("the viewer goes on" in line for line in lines)


def test_a_policy_that_fails_at_once_ends_the_viewer(capsys: pytest.CaptureFixture[str]) -> None:
    pilots = {"policy": pilot_of(lambda _observation, _time: (0.0, 0.0))}
    viewer = Viewer(LiveSwim(pilots["policy"]), pilots, 8390)
    with pytest.raises(InvalidArgumentError, match="actions must"):
        viewer.run()
    assert capsys.readouterr().out == ""


def test_an_upload_ends_its_connection_alone(viewer: Viewer) -> None:
    with enter(viewer) as socket, enter(viewer) as other:
        socket.send(b"x" * (door.LONGEST_MESSAGE + 1))
        with pytest.raises(ConnectionClosedError, match="1009"):
            list(socket)  # all that it still receives
        assert other.recv(timeout=10)


def test_many_strikes_are_bounded(viewer: Viewer) -> None:
    viewer.swim.repair()
    for _ in range(MAXIMUM_VIEWED_FAULTS):
        viewer.swim.strike("gyro:noise=0.1")
    with pytest.raises(InvalidArgumentError, match="repair"):
        viewer.swim.strike("gyro:noise=0.1")
    for _ in range(1000):
        viewer._ask(viewer.swim.repair)
    assert viewer._todo.qsize() < 100
    viewer.update()
    assert viewer.swim.faults(0) == ()


@pytest.mark.parametrize(
    "text", ["<script>a</script>", "{alert(1)}", "`<b>`", "a\n\n# b", "[x](y)"]
)
def test_text_is_shown_as_it_is(text: str) -> None:
    shown = door.as_code(text)
    assert shown[0] == shown[-1] == "`"
    assert "`" not in shown[1:-1]
    assert "\n" not in shown


def test_a_strike_while_the_self_model_calibrates_is_refused_at_the_button(viewer: Viewer) -> None:
    viewer.swim.repair()
    viewer.pilot.value, viewer.play.value = "self-model", False
    viewer.update()
    viewer.strike("caudal:missing")
    viewer._updates = 0
    viewer.draw()
    assert viewer.swim.faults(0) == ()
    assert viewer.break_it.disabled
    assert viewer.break_text.disabled
    assert "measures its own error: break it in 10 s" in viewer.damage.content
    viewer.pilot.value, viewer.play.value = "gait", True
    viewer._updates = 0
    viewer.update()
    assert not viewer.break_it.disabled
    assert "measures" not in viewer.damage.content


def test_without_its_door_the_server_does_not_start() -> None:
    with pytest.raises(RuntimeError, match="no door"), door.guarded("token", lambda _: None):
        pass


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="stops a process")
def test_a_stalled_tab_does_not_hold_ctrl_c() -> None:
    words = [sys.executable, "-m", "aquafish", "view", "--port", "8380"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[0]
        stalled = connect(
            address.replace("http", "ws"),
            subprotocols=[f"viser-v{viser.__version__}"],
            compression=None,
            max_queue=1,
        )  # which never reads
        time.sleep(2)
        began = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
        assert time.monotonic() - began < 8.0  # of websockets' own limit of 10 s
        stalled.socket.close()


@pytest.mark.slow
def test_markup_in_damage_is_not_run(viewer: Viewer, tmp_path: Path) -> None:
    with browser(tmp_path) as page:
        page.open(viewer.url, 900, 700)
        page.wait("document.body?.innerText.includes('Self-model')")
        for text in ('<iframe srcdoc="<script>parent.run=1</script>">', "{window.run = 1}"):
            viewer.strike(text)
            viewer._updates = 0
            viewer.draw()
            page.wait(f"document.body.innerText.includes({text.split('=')[0]!r})")
            assert page.value("window.run") is None
            assert page.value("document.querySelector('iframe')") is None
