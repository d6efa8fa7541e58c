"""Open doors: no page of another origin, and no name that only leads here, gets anything but 403 from a server of ours."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import viser
from browser import running_browser
from recorded import record_pinch
from websockets import ConnectionClosed, Origin, Subprotocol
from websockets.sync.client import connect

import quasirigid as qr
from quasirigid.cli.app import main
from quasirigid.errors import InvalidValueError
from quasirigid.live.stage import close_server, free_port, open_server
from quasirigid.live.viewer_process import ViewerProcess
from quasirigid.mocap.feedback_server import WebsocketFeedback
from quasirigid.mocap.webxr import XrServer
from quasirigid.net.access import Access, is_local
from quasirigid.net.checked_server import checked_server

HUB = "https://hub.example.org"
FOREIGN = (
    "https://attacker.example",
    "null",
    "http://localhost.attacker.example:{port}",
    "http://localhost:1",
    "http://localhost:{port}@attacker.example",
)
"""Origins of pages that are not ours: of the world, of a sandbox or a file, of names that look like ours, of another server on this
machine.
"""
REBOUND = (
    "attacker.example:{port}",
    "attacker.example",
    "127.0.0.1.attacker.example:{port}",
    "localhost@attacker.example",
    "192.0.2.7:{port}",
    "][",
    "",
)
"""Names in ``Host`` that are not this machine's, though they led here; 192.0.2.7 is of no machine (RFC 5737)."""


@contextmanager
def view(allow_origins: Any = (), host: str = "127.0.0.1") -> Iterator[int]:
    server = open_server(host, 8460, "test", allow_origins)
    yield server.get_port()
    close_server(server)


@contextmanager
def page_apart(allow_origins: Any = ()) -> Iterator[int]:
    with ViewerProcess(port=8465, allow_origins=allow_origins) as page:
        yield page.port


@contextmanager
def webxr(allow_origins: Any = (), host: str = "127.0.0.1") -> Iterator[int]:
    with XrServer(0, host=host, allow_origins=allow_origins) as server:
        yield server.address[1]


@contextmanager
def feedback(allow_origins: Any = ()) -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = WebsocketFeedback(f"ws:{port}", allow_origins=allow_origins)
    yield port
    server.close()


def answer(port: int, path: str, lines: list[str], *, opens: bool, address: str = "127.0.0.1") -> tuple[int, str]:
    """Status and head of the answer to a request with these ``lines`` in its head."""
    upgrade = ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="]
    text = "\r\n".join([f"GET {path} HTTP/1.1", *lines, *(upgrade if opens else []), "", ""])
    with socket.create_connection((address, port), timeout=20.0) as connection:
        connection.sendall(text.encode())
        head = b""
        while b"\r\n\r\n" not in head:
            part = connection.recv(4096)
            if not part:
                break
            head += part
    words = head.split(maxsplit=2)
    return (int(words[1]) if len(words) > 1 else 0), head.decode(errors="replace")


def status(port: int, path: str, *, opens: bool, host: str | None = None, origin: str | None = None) -> int:
    lines = [f"Host: {'localhost:{port}' if host is None else host}", *([] if origin is None else [f"Origin: {origin}"])]
    return answer(port, path, [line.format(port=port) for line in lines], opens=opens)[0]


DOORS: list[tuple[Callable[..., AbstractContextManager[int]], str, str | None]] = [
    (view, "/", "/index.html"),
    (page_apart, "/", "/"),
    (webxr, "/socket", "/app.js"),
    (feedback, "/", None),
]


@pytest.mark.parametrize(("serving", "socket_path", "file_path"), DOORS, ids=lambda value: getattr(value, "__name__", ""))
def test_a_page_of_another_origin_and_a_rebound_name_get_403_on_every_socket_and_file(
    serving: Callable[..., AbstractContextManager[int]], socket_path: str, file_path: str | None
) -> None:
    ways = [(socket_path, True), *([] if file_path is None else [("/", False), (file_path, False)])]
    with serving() as port:
        for path, opens in ways:
            for origin in FOREIGN:
                if serving is feedback and origin == "http://localhost:1":
                    continue  # it has no page of its own: pages of this machine may listen, whoever serves them
                assert status(port, path, opens=opens, origin=origin) == 403, (path, opens, origin)
            for host in REBOUND:
                own = f"http://{host}".format(port=port)
                for origin in (own, "http://localhost:{port}"):
                    assert status(port, path, opens=opens, host=host, origin=origin) == 403, (path, opens, host, origin)
            two = ["Host: localhost", "Host: attacker.example", "Origin: http://localhost"]
            assert answer(port, path, two, opens=opens)[0] == 403, "two names"
            assert answer(port, path, ["Host: localhost", "Origin: http://localhost", f"Origin: {HUB}"], opens=opens)[0] == 403, (
                "two origins"
            )
            assert status(port, path, opens=opens, host=HUB[8:], origin=HUB) == 403, "not yet allowed"
        if file_path is None:
            return
        for host in REBOUND:
            assert status(port, file_path, opens=False, host=host) == 403, host


@pytest.mark.parametrize(("serving", "socket_path", "file_path"), DOORS, ids=lambda value: getattr(value, "__name__", ""))
def test_our_own_page_connects_under_every_name_of_this_machine_and_others_when_they_are_allowed(
    serving: Callable[..., AbstractContextManager[int]], socket_path: str, file_path: str | None
) -> None:
    with serving([HUB, "http://phone.lan:8080/"]) as port:
        # Through a tunnel the port is another one; the page comes through the tunnel, too.
        for host in ("localhost:{port}", "127.0.0.1:{port}", "[::1]:{port}", "LOCALHOST:9000", "localhost"):
            assert status(port, socket_path, opens=True, host=host, origin=f"http://{host}") == 101, host
            if file_path is not None:
                assert status(port, file_path, opens=False, host=host) == 200, host
        for host, origin in (("localhost:{port}", HUB), ("hub.example.org", HUB), ("phone.lan:8080", "http://phone.lan:8080")):
            assert status(port, socket_path, opens=True, host=host, origin=origin) == 101, (host, origin)
        assert status(port, socket_path, opens=True, origin="http://hub.example.org") == 403, "https was allowed, and not http"
        assert status(port, socket_path, opens=True, origin="http://phone.lan") == 403, "another port"
        # Browsers send an origin with every websocket; programs have no business where a page acts, and are welcome to feedback.
        assert status(port, socket_path, opens=True) == (101 if serving is feedback else 403)


def own_address() -> str:
    """An address of this machine in its network; skips where it is in none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way, suppress(OSError):
        way.connect(("192.0.2.1", 9))
        return str(way.getsockname()[0])
    pytest.skip("this machine is in no network")


@pytest.mark.parametrize(("serving", "path"), [(view, "/"), (webxr, "/socket")])
def test_a_server_of_the_network_answers_to_the_addresses_and_the_name_of_its_machine(
    serving: Callable[..., AbstractContextManager[int]], path: str
) -> None:
    address, name = own_address(), socket.gethostname()
    with serving(host="0.0.0.0") as port:
        for host in (f"{address}:{port}", f"{name}:{port}", f"{name}.local:{port}"):
            lines = [f"Host: {host}", f"Origin: http://{host}"]
            assert answer(port, path, lines, opens=True, address=address)[0] == 101, host
        for host in ("192.0.2.7", "attacker.example"):
            assert answer(port, path, [f"Host: {host}", f"Origin: http://{host}"], opens=True, address=address)[0] == 403, host
    with serving() as port:
        assert status(port, path, opens=True, host=f"{name}.local", origin=f"http://{name}.local") == 403, "nobody else can be meant by it"


def test_other_pages_may_not_put_the_view_in_a_frame_nor_load_its_parts() -> None:
    """A click on a page that lies under another one presses Run just as well."""
    with view([HUB]) as port:
        code, head = answer(port, "/", ["Host: localhost"], opens=False)
        assert code == 200
        assert "frame-ancestors 'self' https://hub.example.org:443\r\n" in head, head
        assert "Cross-Origin-Resource-Policy: same-origin\r\n" in head, head
        assert "nosniff" in answer(port, "/", ["Host: attacker.example"], opens=False)[1]


def test_a_page_of_another_version_leaves_standard_output_to_the_results(capfd: pytest.CaptureFixture[str]) -> None:
    with view() as port:
        url, own = f"ws://localhost:{port}", Origin(f"http://localhost:{port}")
        with (
            connect(url, origin=own, subprotocols=[Subprotocol("viser-v0.0.1")]) as stale,
            pytest.raises(ConnectionClosed, match="Version mismatch"),
        ):
            stale.recv(timeout=20.0)
        with connect(url, origin=own, subprotocols=[Subprotocol(f"viser-v{viser.__version__}")]) as ours:
            assert ours.recv(timeout=20.0)
    assert capfd.readouterr().out == ""


def test_a_server_that_is_left_open_says_nothing_on_standard_output_at_exit() -> None:
    """One that was interrupted while its page was made: what a program prints for others must stay whole."""
    program = "from quasirigid.live.stage import open_server; server = open_server('127.0.0.1', 8475, 'left'); print('result')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "result\n", "")


ATTACK = """<!doctype html><title>attack</title><iframe src="http://localhost:{port}/"></iframe><script>
const said = [];
const socket = new WebSocket('ws://localhost:{port}/', 'viser-v{version}');
socket.onopen = () => said.push('open');
socket.onerror = () => said.push('refused');
fetch('http://localhost:{port}/', {{ mode: 'no-cors' }}).then(() => said.push('read'), () => said.push('refused'));
</script>"""


def test_in_a_browser_a_page_of_another_server_of_this_machine_neither_connects_nor_shows_the_view() -> None:
    with view() as port, running_browser() as browser:
        content = ATTACK.format(port=port, version=viser.__version__).encode()

        class Attacker(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "text/html")
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *_: Any) -> None:
                pass

        with ThreadingHTTPServer(("127.0.0.1", 0), Attacker) as server:
            serving = threading.Thread(target=server.serve_forever, args=(0.05,))
            serving.start()
            page = browser.new_page()
            page.goto(f"http://127.0.0.1:{server.server_port}/")
            page.wait_for_function("said.length >= 2", timeout=30_000)
            assert page.evaluate("said") == ["refused", "refused"]
            frame = page.frames[1]
            assert "chrome-error" in frame.url or not frame.content().count("<canvas"), frame.url
            page.close()
            own = browser.new_page()
            own.goto(f"http://localhost:{port}/")
            own.wait_for_selector("canvas", timeout=45_000)
            own.close()
            server.shutdown()
            serving.join()


@pytest.mark.parametrize(
    "text",
    [
        "*",
        "null",
        "",
        "hub.example.org",
        "ftp://hub.example.org",
        "https://",
        "https://a.example/page",
        "http://a.example:99999",
        "http://me@a.example",
    ],
)
def test_what_is_no_origin_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InvalidValueError, match=r"--allow-origin: expected http://NAME.*such as http://"):
        Access("127.0.0.1", [text])
    with pytest.raises(InvalidValueError, match="a list of origins"):
        Access("127.0.0.1", HUB)
    with pytest.raises(InvalidValueError, match="allow-origin"):
        ViewerProcess(allow_origins=["*"])


def test_a_viser_that_opens_its_server_in_another_way_is_not_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """A check that is not asked must not pass for one that is: closed, rather than open."""
    stopped = []

    class Other:
        def __init__(self, **_: Any) -> None:
            pass

        def stop(self) -> None:
            stopped.append(True)

    monkeypatch.setattr("viser.ViserServer", Other)
    with pytest.raises(RuntimeError, match="no request would be checked"):
        checked_server(Access("127.0.0.1"), "127.0.0.1", 8470, "test")
    assert stopped


@pytest.mark.parametrize(
    ("host", "local"),
    [
        ("127.0.0.1", True),
        ("127.0.0.2", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("", False),
        ("lab", False),
    ],
)
def test_what_the_network_can_reach_is_known_from_the_address(host: str, local: bool) -> None:
    assert is_local(host) is local


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("access") / "run.h5"
    record_pinch(path, 5)
    return path


QUICK = ("--points", "2000", "--dt", "0.005")
COMMANDS = {
    "view": ("view", "--points", "2000"),
    "replay": ("replay", "RECORDING"),
    "grasp --view": ("grasp", *QUICK, "--hold", "60", "--out", "OUT", "--view"),
    "mocap grasp take --view": ("mocap", "grasp", "take", *QUICK, "--out", "OUT", "--view"),
    "mocap grasp webxr": ("mocap", "grasp", "webxr:PORT", *QUICK, "--out", "OUT"),
    "mocap grasp --feedback ws": ("mocap", "grasp", "dtrack:0", *QUICK, "--out", "OUT", "--bind", "127.0.0.1", "--feedback", "ws:PORT"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_serves_refuses_foreign_pages_and_lets_in_those_of_allow_origin(
    name: str, tmp_path: Path, recording: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    port = free_port("127.0.0.1", 8480)
    known = {"RECORDING": str(recording), "OUT": str(tmp_path), "webxr:PORT": f"webxr:{port}", "ws:PORT": f"ws:{port}"}
    command = [known.get(word, word) for word in COMMANDS[name]]
    if "ws:PORT" not in COMMANDS[name] and "webxr:PORT" not in COMMANDS[name]:
        command += ["--no-browser", "--port", str(port)]
    path = "/socket" if "webxr" in name else "/"
    found: list[int] = []

    def ask() -> None:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and not found:
            time.sleep(0.05)
            with suppress(OSError):
                found.append(status(port, path, opens=True, origin="https://attacker.example"))
        with suppress(OSError):
            found.append(status(port, path, opens=True, host="attacker.example", origin="http://attacker.example"))
            found.append(status(port, path, opens=True, origin=HUB))
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    asking = threading.Thread(target=ask)
    asking.start()
    with suppress(KeyboardInterrupt):
        main([*command, "--allow-origin", HUB])
    asking.join()
    assert found == [403, 403, 101], capfd.readouterr().err


def test_allow_origin_is_refused_where_nothing_is_served_and_where_it_is_none(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["grasp", "--allow-origin", HUB, "--out", str(tmp_path)]) == 2
    assert "--view beside it" in capfd.readouterr().err
    assert main(["view", "--allow-origin", "hub.example.org"]) == 2
    assert "http://NAME" in capfd.readouterr().err
    with pytest.raises(InvalidValueError, match="allow-origin"):
        qr.view(qr.World(), browser=False, allow_origins=["hub.example.org"])


@pytest.mark.parametrize(
    ("arguments", "open_says"),
    [
        (("mocap", "monitor", "-c", "0", "--seconds", "0.1"), "send packets"),
        (("mocap", "replay", "--greeted", "--source-port", "0"), "greet"),
        (("mocap", "grasp", "dtrack:0", "--out", "OUT"), "move the hand"),
        (("mocap", "grasp", "webxr:0", "--bind", "0.0.0.0", "--out", "OUT"), "drive the hand"),
        (("mocap", "grasp", "dtrack:0", "--bind", "127.0.0.1", "--feedback", "ws:0.0.0.0:PORT", "--out", "OUT"), "listen"),
    ],
)
def test_a_socket_that_the_network_can_reach_is_said_to_be_open(
    arguments: tuple[str, ...], open_says: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = [word.replace("PORT", str(free_port("0.0.0.0", 8490))).replace("OUT", str(tmp_path)) for word in arguments]
    ending = threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT))
    ending.start()
    with suppress(KeyboardInterrupt):
        main(words)
    ending.cancel()
    said = capfd.readouterr().err
    assert f"open to the network (0.0.0.0): whoever reaches this port can {open_says}" in said, said
