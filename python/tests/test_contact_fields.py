"""The fields of a contact are written down once: scenes, recordings and tables agree with the table."""

from dataclasses import fields
from pathlib import Path

import numpy as np
from recorded import pinch

import quasirigid as qr
from quasirigid.recording.export import tables
from quasirigid.recording.scene import SceneRecording
from quasirigid.recording.scene_columns import contact_column
from quasirigid.scene.contact_fields import CONTACT_FIELDS, EXPORTED_FIRST
from quasirigid.scene.model import ContactsState


def test_every_reader_and_writer_of_contacts_has_the_fields_of_the_table(tmp_path: Path) -> None:
    names = {field.name for field in CONTACT_FIELDS}
    assert {field.name for field in fields(ContactsState)} == names
    assert set(EXPORTED_FIRST) < names
    world, _, grip = pinch()
    with qr.record(world, tmp_path / "run.h5") as recording:
        for _ in range(3):
            grip.update()
            recording.append(world.step())
    contacts = world.contacts()
    assert len(contacts) > 0
    with SceneRecording(tmp_path / "run.h5") as recorded:
        state, stored = recorded.state(2).contacts, recorded.columns
        table = tables(recorded)["contacts"](np.array([2]))
        exported = {"step", "time_s"}
        for field in CONTACT_FIELDS:
            live = getattr(contacts, field.name)
            assert live.shape == (len(contacts), *field.shape), f"Contacts.{field.name}: {live.shape}"
            read = getattr(state, field.name)
            assert (read.shape, read.dtype) == (live.shape, np.dtype(field.dtype)), field.name
            if not field.counts_bodies:
                np.testing.assert_allclose(read, live, rtol=1e-6, atol=field.resolution, err_msg=field.name)
            column = contact_column(field, len(recorded.model.bodies))
            found = stored.column(column.name)
            assert (found.shape, found.unit, found.frame, found.what) == (column.shape, column.unit, column.frame, column.what), field.name
            assert len(field.exported) == int(np.prod(field.shape)), field.name
            exported |= set(field.exported)
    assert set(table) == exported
    held = {name for name in stored.names if name.startswith("contacts/")} - {"contacts/end"}
    assert held == {f"contacts/{field.column}" for field in CONTACT_FIELDS}
    told = {name for name in dir(qr.Contacts) if not name.startswith("_")}
    assert names <= told
