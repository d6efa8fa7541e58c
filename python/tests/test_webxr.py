"""WebXR without a browser: joints become hand frames, the world lies where it was put, what no hand sends is refused."""

from __future__ import annotations

import ssl
import subprocess
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.sync.client import connect

from quasirigid.errors import InvalidValueError, NetworkError, PacketError
from quasirigid.mocap.webxr import JOINTS, Placement, XrServer, hand_frame
from quasirigid.mocap.webxr.messages import HANDS_SIZE, HEAD, MAGIC, read_hands, read_text
from quasirigid.net.serving import netloc

RNG = np.random.default_rng(5)


def stretched(side: str) -> np.ndarray:
    """A flat hand, back up, fingers along -z of the room: (25, 8)."""
    joints = np.zeros((25, 8))
    joints[:, 6], joints[:, 7] = 1.0, 0.008
    right = 1.0 if side == "right" else -1.0
    for i, name in enumerate(JOINTS):
        if name == "wrist":
            continue
        finger, part = name.split("-", 1)
        place = ["thumb", "index", "middle", "ring", "pinky"].index(finger)
        along = ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"].index(part.removeprefix("finger-"))
        joints[i, :3] = right * 0.02 * (place - 2.0), 1.0, -0.04 - 0.03 * along
    joints[0, :3] = 0.0, 1.0, 0.0
    return joints


def hands_message(joints: np.ndarray, there: int = 3, time: float = 1.0) -> bytes:
    return HEAD.pack(MAGIC, there, time) + np.stack([joints, joints]).astype("<f4").tobytes()


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_stretched_hand_has_palm_and_tips_along_its_fingers(side: str) -> None:
    joints = stretched(side)
    frame = hand_frame(side, joints, time=1.0, arrival=2.0)
    tips = [i for i, name in enumerate(JOINTS) if name.endswith("tip")]
    assert np.allclose(frame.positions[:5], joints[tips, :3])
    assert np.allclose(frame.positions[5], joints[JOINTS.index("index-finger-phalanx-proximal"), :3])
    world_from_room = frame.transformed(Placement((0.0, 0.0, 0.0)).calibration())
    # Ahead of the user is x of the world, up is z; a hand held so has our axes along the world's.
    for quaternion in world_from_room.quaternions:
        assert abs(abs(quaternion[0]) - 1.0) < 1e-9, quaternion
    assert np.allclose(world_from_room.positions[5], [0.07, 0.02 if side == "right" else -0.02, 1.0])


def test_what_is_not_tracked_is_not_invented() -> None:
    joints = stretched("right")
    joints[JOINTS.index("thumb-tip")] = np.nan
    joints[JOINTS.index("wrist")] = np.nan
    frame = hand_frame("right", joints, time=0.0, arrival=0.0)
    assert list(frame.tracked) == [False, True, True, True, True, False]


def test_recentred_the_table_is_ahead_of_the_eyes_and_below() -> None:
    eyes, forward = np.array([1.0, 1.5, 2.0]), np.array([-1.0, -0.2, 0.0])
    place = Placement.before(eyes, forward)
    assert place.position[0] < 0.7
    assert abs(place.position[2] - 2.0) < 1e-12
    assert place.position[1] < 1.2
    with pytest.raises(InvalidValueError, match="vertical"):
        Placement.before(eyes, np.array([0.0, -1.0, 0.0]))


def test_a_place_that_is_none_is_refused() -> None:
    assert Placement.parse("0.1,0.8,-0.5,90").heading == pytest.approx(np.pi / 2)
    for text in ("", "1,2", "1,2,3,4,5", "a,b,c", "nan,0,0", "1e9,0,0"):
        with pytest.raises(InvalidValueError):
            Placement.parse(text)


def test_a_message_comes_out_as_it_went_in() -> None:
    joints = stretched("right")
    joints[3] = np.nan
    time, hands = read_hands(hands_message(joints, there=2, time=12.5))
    assert time == 12.5
    assert list(hands) == ["right"]
    assert np.array_equal(hands["right"], joints.astype(np.float32), equal_nan=True)


def test_random_messages_are_refused_or_finite() -> None:
    good = hands_message(stretched("right"))
    refused = 0
    for _ in range(3_000):
        data = bytearray(good)
        for at in RNG.integers(0, len(data), RNG.integers(1, 6)):
            data[at] = RNG.integers(256)
        if RNG.random() < 0.2:
            data = data[: RNG.integers(0, HANDS_SIZE)]
        try:
            time, hands = read_hands(bytes(data))
        except PacketError:
            refused += 1
            continue
        assert np.isfinite(time)
        for side, joints in hands.items():
            frame = hand_frame(side, joints, time=time, arrival=0.0)
            assert np.isfinite(frame.positions[list(frame.tracked)]).all()
    assert refused > 500, refused


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"type": "recentre"}', '{"type": "recentre", "position": [1, 2], "forward": [0, 0, 1]}', "[" * 900]
)
def test_a_text_that_is_no_recentring_is_refused(text: str) -> None:
    with pytest.raises(PacketError):
        read_text(text)


def test_the_page_is_served_over_https_with_a_certificate(tmp_path: Path) -> None:
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1"]
    make += ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(certificate)]
    try:
        subprocess.run(make, check=True, capture_output=True)
    except FileNotFoundError:
        pytest.skip("no openssl to make a certificate with")
    with XrServer(0, certificate=certificate, key=key) as server:
        trust = ssl.create_default_context(cafile=str(certificate))
        with urllib.request.urlopen(f"https://127.0.0.1:{server.address[1]}/", context=trust, timeout=20) as answer:
            assert answer.status == 200
            assert b"<html" in answer.read()
        at = f"127.0.0.1:{server.address[1]}"
        with connect(f"wss://{at}/socket", ssl=trust, origin=f"https://{at}", proxy=None) as page:  # type: ignore[arg-type]
            assert '"hello"' in page.recv(timeout=20)


def test_an_address_that_is_none_and_a_port_in_use_are_said_to_be_so() -> None:
    for host in ("300.1.1.1", "192.168.1..20", "x" * 64, "192.0.2.77"):
        with pytest.raises(InvalidValueError, match="address to listen on: expected one of this machine's"):
            XrServer(0, host=host)
    with XrServer(0) as server, pytest.raises(NetworkError, match=str(server.address[1])):
        XrServer(server.address[1])


def test_opened_to_the_network_it_names_an_address_that_others_can_use() -> None:
    with XrServer(0, host="0.0.0.0") as server:
        host = urlsplit(server.url).hostname
        assert host not in ("localhost", "0.0.0.0", None)
    with XrServer(0) as server:
        assert urlsplit(server.url).hostname == "localhost"


def test_an_address_of_the_new_kind_has_brackets() -> None:
    assert netloc("::1", 8082) == "[::1]:8082"
    assert netloc("127.0.0.1", 8082) == "127.0.0.1:8082"


def test_a_certificate_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.pem").write_text("")
    with pytest.raises(InvalidValueError, match="certificate"), XrServer(0, certificate=tmp_path / "empty.pem"):
        pass
