"""The server of the WebXR page, talked to without a browser: who is listened to, what survives, how little is sent."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import wait_until
from hand_frames import part
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from xr_hand import hand

from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap import HandTracker, shipped_take
from quasirigid.mocap.session import MocapOptions, MocapSession
from quasirigid.mocap.source import TakeSource
from quasirigid.mocap.webxr import XrServer
from quasirigid.mocap.webxr.messages import HEAD, MAGIC
from quasirigid.mocap.webxr.server import CLIENTS, SILENT
from quasirigid.mocap.webxr.wire import LEVELS, SEEN, SceneWire
from quasirigid.scene.model import SceneModel, SceneState


class Page:
    """What a page does, as far as the server can see."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.clock = 1000.0 * np.random.default_rng().random()
        """A page's clock begins anywhere."""

    def send(self, frames: int = 1, *, height: float = 1.0) -> None:
        for _ in range(frames):
            self.clock += 1 / 72
            self.connection.send(message(self.clock, height))

    def hears(self, kind: str, timeout: float = 5.0) -> dict[str, Any]:
        """The next text of this kind."""
        while True:
            data = self.connection.recv(timeout=timeout)
            if isinstance(data, str) and json.loads(data)["type"] == kind:
                found: dict[str, Any] = json.loads(data)
                return found


def message(moment: float, height: float = 1.0, there: int = 3) -> bytes:
    """Both hands, or those whose bits are set in ``there``: 1 is the left one, 2 the right one."""
    joints = np.zeros((25, 8))
    joints[:, :3], joints[:, 6], joints[:, 7] = hand(0.03, 0.0)[0] + [0.0, height, 0.0], 1.0, 0.008
    left = joints * [-1.0, 1, 1, 1, 1, 1, 1, 1]
    return HEAD.pack(MAGIC, there, moment) + np.stack([left, joints]).astype("<f4").tobytes()


@contextmanager
def page_of(server: XrServer) -> Iterator[Page]:
    port = server.address[1]
    with connect(f"ws://127.0.0.1:{port}/socket", origin=f"http://127.0.0.1:{port}", proxy=None) as connection:  # type: ignore[arg-type]
        yield Page(connection)


@pytest.fixture
def server() -> Iterator[XrServer]:
    with XrServer(0) as running:
        yield running


def drained(server: XrServer, enough: Callable[[list[Any]], bool]) -> list[Any]:
    """The frames until there are enough of them."""
    frames: list[Any] = []

    def come() -> bool:
        frames.extend(server.take())
        return enough(frames)

    wait_until(come, "frames", 10.0)
    return frames


def test_of_two_pages_the_first_is_listened_to_and_the_other_is_told_so(server: XrServer) -> None:
    with page_of(server) as first, page_of(server) as second:
        first.send()
        assert first.hears("writer")["yours"] is True
        second.send(5)
        assert second.hears("writer")["yours"] is False
        first.send(3)
        frames = drained(server, lambda found: len(found) >= 4)
        assert len(frames) == 4
        assert server.statistics()["refused"] == 5


def test_recentred_the_hand_glides_to_where_the_table_now_says_it_is(server: XrServer) -> None:
    frames: list[Any] = []
    with page_of(server) as page:
        for k in range(44):
            if k == 22:
                page.connection.send(json.dumps({"type": "recentre", "position": [0.3, 1.2, 0.0], "forward": [0.0, 0.0, -1.0]}))
            page.send()
            time.sleep(1 / 72)
        frames = drained(server, lambda found: len(found) >= 45)
    places = [frame.positions[0] for frame in frames if frame.tracked[0]]
    away = float(np.linalg.norm(places[-1] - places[0]))
    assert away > 0.2, "or this tests nothing"
    tracker, shown, dt = HandTracker("right"), [], 1e-3
    for now in np.arange(frames[0].arrival, frames[-1].arrival, dt):
        while frames and frames[0].arrival <= now:
            tracker.push(frames.pop(0))
        targets = tracker.sample(float(now))
        assert targets is not None
        shown.append(targets.positions[0])
    fastest = float(np.linalg.norm(np.diff(shown, axis=0), axis=1).max()) / dt
    assert fastest < 0.55, f"{fastest:.1f} m/s: the table moved by {away:.2f} m"
    assert np.linalg.norm(shown[-1] - shown[0]) > 0.05, "it is on its way"


def test_when_the_first_page_closes_the_other_takes_over_and_time_goes_on(server: XrServer) -> None:
    with page_of(server) as second:
        with page_of(server) as first:
            first.send(3)
            first.hears("writer")
            second.send()
            second.hears("writer")
        wait_until(lambda: len(server._clients) == 1, "the server to see that the page has gone", 10.0)
        second.send(3)
        assert second.hears("writer")["yours"] is True
    frames = drained(server, lambda found: len(found) >= 7)
    assert [any(frame.tracked) for frame in frames[:7]] == [True] * 3 + [False] + [True] * 3, "one frame without the hand between the two"
    times = [frame.time for frame in frames]
    assert times == sorted(times), times


def test_a_page_that_fell_silent_is_replaced_and_comes_back_when_the_other_has_gone(server: XrServer) -> None:
    with page_of(server) as first:
        first.send(2)
        assert first.hears("writer")["yours"] is True
        with page_of(server) as second:
            second.send()
            assert second.hears("writer")["yours"] is False
            time.sleep(SILENT + 0.1)
            second.send()
            assert second.hears("writer")["yours"] is True
            assert first.hears("writer")["yours"] is False
        wait_until(lambda: len(server._clients) == 1, "the server to see that the page has gone", 10.0)
        first.send(2)
        assert first.hears("writer")["yours"] is True
    times = [frame.time for frame in drained(server, lambda found: len(found) >= 7)]
    assert times == sorted(times), times


def test_a_connection_that_breaks_off_loses_the_hand_at_once(server: XrServer) -> None:
    with page_of(server) as page:
        page.send(2)
        page.hears("writer")
        page.connection.socket.close()  # no goodbye
        frames = drained(server, lambda found: len(found) >= 3)
    assert [any(frame.tracked) for frame in frames] == [True, True, False]


def test_more_pages_than_there_is_room_for_are_turned_away(server: XrServer) -> None:
    pages = [page_of(server) for _ in range(CLIENTS)]
    for page in pages:
        page.__enter__().hears("hello")
    with pytest.raises(InvalidStatus, match="503"), page_of(server):
        pass
    for page in pages:
        page.__exit__(None, None, None)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_hand_that_was_chosen_is_the_one_that_is_listened_to(side: Any) -> None:
    with XrServer(0, side=side) as server, page_of(server) as page:
        assert page.hears("hello")["hand"] == side
        page.send()
        (frame,) = drained(server, bool)
        assert frame.side == side
        # World y is to the left; the thumb of the message is at x = -+ of the room.
        thumb = hand(0.03, 0.0)[0][4]
        assert frame.positions[0][1] == pytest.approx((1.0 if side == "left" else -1.0) * thumb[0], abs=1e-6)


def test_a_reset_is_heard_from_the_page_that_is_listened_to_alone(server: XrServer) -> None:
    assert not server.reset_asked()
    with page_of(server) as first, page_of(server) as second:
        first.send()
        assert first.hears("writer")["yours"] is True
        second.connection.send(json.dumps({"type": "reset"}))
        wait_until(lambda: server.statistics()["refused"] == 1, "the other page to be refused", 10.0)
        assert not server.reset_asked()
        first.connection.send(json.dumps({"type": "reset"}))
        wait_until(server.reset_asked, "the reset", 10.0)
        assert not server.reset_asked(), "once"


def test_a_page_that_sends_the_other_hand_alone_is_told_so_within_two_seconds(server: XrServer) -> None:
    session = MocapSession(GraspOptions(points=3_000, dt=0.004), MocapOptions(idle=1.0), server, server)
    said: list[tuple[float, str]] = []
    began = time.monotonic()
    session.log = lambda line: said.append((time.monotonic() - began, line))
    server.ended = lambda: len(said) >= 2 or time.monotonic() - began > 20.0  # type: ignore[method-assign]
    running = threading.Thread(target=session.wait_for_hand)
    running.start()
    try:
        # Nobody is there yet.
        wait_until(lambda: len(said) == 1, "the session to miss a page", 10.0)
        with page_of(server) as page:
            start = time.monotonic()
            while len(said) < 2 and time.monotonic() - start < 10.0:
                page.clock += 1 / 72
                page.connection.send(message(page.clock, there=1))
                time.sleep(1 / 72)
    finally:
        running.join(timeout=30.0)
    assert server.url in said[0][1], "where to go"
    assert "mocap monitor" not in said[0][1], "that one hears no headset"
    assert said[0][0] < 2.0, said
    assert "only a left hand" in said[1][1], said
    assert "--hand left" in said[1][1]
    assert said[1][0] - (start - began) < 2.0, said


class Weighing:
    """A viewer that measures what a page would be sent."""

    def __init__(self) -> None:
        self.sizes: list[int] = []
        self.models: list[int] = []
        self.error = 0.0

    def begin(self, model: SceneModel) -> None:
        self.wire = SceneWire(model)
        self.models.append(len(self.wire.model_message()))

    def wants_state(self) -> bool:
        return True

    def reset_asked(self) -> bool:
        return False

    def draw(self, state: SceneState) -> None:
        assert not self.wire.outgrown(state), "wood does not yield visibly"
        data = self.wire.state_message(state)
        self.sizes.append(len(data))
        if len(self.sizes) % 50 == 0:
            self.error = max(self.error, deformation_error(self.wire, state, data))


def deformation_error(wire: SceneWire, state: SceneState, data: bytes) -> float:
    """Largest distance between a pad's deformed point and where the page puts it, m."""
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])

    def array(name: str) -> Any:
        kind, at, items = header["arrays"][name]
        return np.frombuffer(data, kind, items, 4 + length + at)

    error = 0.0
    for i in wire.model.fingertips():
        body, moved = wire.model.bodies[i], state.moved.get(i)
        if moved is None:
            continue
        shown, true = body.points.copy(), body.points.copy()
        true[moved.indices] = moved.points
        if f"at{i}" in header["arrays"]:
            shown[array(f"at{i}")] += header["quanta_m"][str(i)] * array(f"by{i}").reshape(-1, 3)
        error = max(error, float(np.abs(shown - true).max()))
    return error


def test_a_state_is_small_and_what_it_shows_is_where_it_is() -> None:
    seen = Weighing()
    session = MocapSession(GraspOptions(dt=0.004), MocapOptions(idle=0.3), TakeSource(shipped_take()), seen)
    assert session.wait_for_hand()
    session.run()
    sizes = np.array(seen.sizes)
    print(
        f"state: median {np.median(sizes):.0f}, largest {sizes.max()} bytes; "
        f"models {seen.models} bytes; off by {1e6 * seen.error:.1f} um at most"
    )
    assert np.median(sizes) < 10_000
    assert sizes.max() < 16_000
    assert max(seen.models) < 500_000
    # Half a step of a displacement of at most 3 mm, or one that is not sent.
    assert 0.0 < seen.error <= max(SEEN, 0.5 * 3e-3 / LEVELS), f"{1e6 * seen.error:.1f} um"


def test_an_object_that_yields_visibly_is_sent_again_with_all_of_its_points(tmp_path: Path) -> None:
    class Watching(Weighing):
        grown = 0

        def draw(self, state: SceneState) -> None:
            if self.wire.outgrown(state):
                self.grown += 1
                assert not self.wire.outgrown(state), "once is enough"
                self.models.append(len(self.wire.model_message()))
            self.sizes.append(len(self.wire.state_message(state)))

    seen = Watching()
    options = GraspOptions(dt=0.004, points=6_000, material="silicone")
    session = MocapSession(options, MocapOptions(idle=0.3), TakeSource(part(tmp_path, until=3.0)), seen)
    assert session.wait_for_hand()
    session.run()
    assert seen.grown == 1
    assert seen.models[-1] > seen.models[-2] + 24 * 6_000 // 2, seen.models
