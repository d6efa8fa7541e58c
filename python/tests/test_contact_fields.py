"""The fields of a contact are written down once: binding, stubs, scenes, recordings and tables agree with the table."""

import ast
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from recorded import pinch

import quasirigid as qr
from quasirigid.recording.export import tables
from quasirigid.recording.scene_columns import contact_column
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.scene.contact_fields import CONTACT_FIELDS, EXPORTED_FIRST, RECORDED_FIELDS, ContactField
from quasirigid.scene.model import ContactsState

STUBS = Path(qr.__file__).with_name("_quasirigid.pyi")
BINDING = {"f8": np.dtype(np.float64), "u1": np.dtype(np.uint8), "i8": np.dtype(np.uint32)}
"""The types of ``Contacts`` by those of the table: what counts from 0 has no sign there."""
ANNOTATED = {"f8": "FloatArray", "u1": "npt.NDArray[np.uint8]", "i8": "npt.NDArray[np.uint32]"}


def properties(of: str) -> dict[str, tuple[str, str | None]]:
    """The type and the docstring of every property of a class in the stubs."""
    (found,) = (node for node in ast.parse(STUBS.read_text()).body if isinstance(node, ast.ClassDef) and node.name == of)
    methods = [node for node in found.body if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]
    return {node.name: (ast.unparse(node.returns) if node.returns else "", ast.get_docstring(node)) for node in methods}


def test_the_stubs_of_contacts_say_what_the_table_says() -> None:
    assert properties("Contacts") == {field.name: (ANNOTATED[field.dtype], field.docstring) for field in CONTACT_FIELDS}


@pytest.mark.parametrize("field", CONTACT_FIELDS, ids=lambda field: field.name)
def test_a_getter_of_the_binding_has_shape_type_and_docstring_of_the_table(field: ContactField) -> None:
    world, _, grip = pinch()
    for _ in range(3):
        grip.update()
        world.step()
    contacts = world.contacts()
    values = getattr(contacts, field.name)
    assert len(contacts) > 0
    assert (values.shape, values.dtype) == ((len(contacts), *field.shape), BINDING[field.dtype]), f"{values.shape} {values.dtype}"
    assert getattr(qr.Contacts, field.name).__doc__ == field.docstring


def test_the_binding_has_no_other_fields_than_the_table() -> None:
    assert {name for name in dir(qr.Contacts) if not name.startswith("_")} == {field.name for field in CONTACT_FIELDS}


def test_scenes_recordings_and_tables_have_the_recorded_fields_of_the_table(tmp_path: Path) -> None:
    names = {field.name for field in RECORDED_FIELDS}
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
        for field in RECORDED_FIELDS:
            live = getattr(contacts, field.name)
            read = getattr(state, field.name)
            assert (read.shape, read.dtype) == (live.shape, np.dtype(field.dtype)), field.name
            if not field.counts:
                np.testing.assert_allclose(read, live, rtol=1e-6, atol=field.resolution, err_msg=field.name)
            column = contact_column(field, len(recorded.model.bodies))
            found = stored.column(column.name)
            assert (found.shape, found.unit, found.frame, found.what) == (column.shape, column.unit, column.frame, column.what), field.name
            assert len(field.exported) == int(np.prod(field.shape)), field.name
            exported |= set(field.exported)
    assert set(table) == exported
    held = {name for name in stored.names if name.startswith("contacts/")} - {"contacts/end"}
    assert held == {f"contacts/{field.column}" for field in RECORDED_FIELDS}
