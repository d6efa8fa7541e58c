"""Recordings of 0.1.0 open: `recordings/recording-0.1.0.h5.gz` was written by that version (four steps of a fingertip on a rubber ball on a
table).
"""

import gzip
from pathlib import Path

import numpy as np
import pytest

import quasirigid as qr
from quasirigid.cli.app import main
from quasirigid.recording.reader import VERSION


@pytest.fixture
def old(tmp_path: Path) -> Path:
    file = tmp_path / "old.h5"
    file.write_bytes(gzip.decompress((Path(__file__).parent / "recordings" / "recording-0.1.0.h5.gz").read_bytes()))
    return file


def test_a_recording_of_0_1_0_opens_as_a_scene(old: Path) -> None:
    with qr.SceneRecording(old) as recording:
        assert recording.columns.version == 2 < VERSION
        assert recording.columns.attributes["quasirigid_version"] == "0.1.0"
        assert [body.name for body in recording.model.bodies] == ["ball", "table", "tip"]
        assert recording.model.fingers == ("tip",)
        assert [name for _, _, name in recording.phases()] == ["press", "hold"]
        assert len(recording) == 4
        state = recording.state(3)
        contacts = state.contacts
        assert len(contacts) == 2
        assert (contacts.control_point == -1).all(), "0.1.0 did not record which control point it was"
        np.testing.assert_array_equal(contacts.collider_a, contacts.body_a, "0.1.0 recorded one surface of a body")
        np.testing.assert_array_equal(contacts.collider_b, contacts.body_b)
        assert set(state.moved) == {0, 1, 2}, "all three are deformed"
        tip = recording.model.fingertips()[0]
        sign = np.where(contacts.body_a == tip, -1.0, 1.0) * ((contacts.body_a == tip) | (contacts.body_b == tip))
        off = np.abs(sign @ contacts.forces - state.finger_forces[0]).max()
        assert off < 1e-5 * np.abs(state.finger_forces).max(), f"the contacts of the fingertip miss its force by {off} N"


def test_a_recording_of_0_1_0_becomes_tables_and_pictures(old: Path, tmp_path: Path) -> None:
    assert main(["export", str(old), "--csv", str(tmp_path / "tables")]) == 0
    rows = (tmp_path / "tables" / "contacts.csv").read_text().splitlines()
    assert len(rows) == 1 + 8, "a line for each contact of each step"
    assert main(["render", str(old), "--out", str(tmp_path / "old.png"), "--size", "320x180"]) == 0
    assert (tmp_path / "old.png").stat().st_size > 1000
