"""Bodies and fingers with several colliders: every one is recorded, comes back, is in pictures and on the page, with its contacts."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

import quasirigid as qr
from quasirigid.errors import InvalidValueError
from quasirigid.live.draw import SceneDrawing
from quasirigid.recording.export import export_tables
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.render.pictures import Renderer, RenderOptions
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.palette import PAD
from quasirigid.scene.world import WorldScene

RADIUS = 0.01
APART = 0.05
"""Between the middles of the two spheres of a dumbbell, m."""
RUBBER, SILICONE = qr.Material.preset("rubber"), qr.Material.preset("silicone")


def sphere(x: float = 0.0) -> qr.Surface:
    made = qr.Surface.sphere(RADIUS, points=600)
    return qr.Surface.from_points(made.points + (x, 0.0, 0.0), made.normals, areas=made.areas, control_points=240)


def scene() -> tuple[qr.World, qr.Body, qr.Hand]:
    """A dumbbell of one body and two colliders on a plate; above it a hand with a collider on the second link of a finger, and a ball on
    it.
    """
    world = qr.World(gravity=(0.0, 0.0, -1.0))
    world.add_body(qr.Surface.half_space(0.15, points=900, control_points=90), RUBBER, motion="fixed", name="plate")
    dumbbell = world.add_body(sphere(), RUBBER, mass=0.1, position=(-APART / 2, 0.0, 0.95 * RADIUS), name="dumbbell")
    world.add_collider(dumbbell, sphere(APART), SILICONE)
    hand = world.add_hand(position=(0.0, 0.0, 0.2), points=300, control_points=50, motion="quasi-static")
    world.add_collider(hand, sphere(), RUBBER, finger=1, link=2)
    place = hand.link_poses[1, 2, :3] + (0.0, 0.0, 1.9 * RADIUS)
    world.add_body(sphere(), RUBBER, mass=0.1, position=place, name="ball")
    return world, dumbbell, hand


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SceneModel, list[SceneState]]:
    path = tmp_path_factory.mktemp("colliders") / "run.h5"
    world, _, _ = scene()
    live = WorldScene(world)
    states = []
    with qr.record(world, path, deformation_rate=np.inf) as recording:
        for _ in range(4):
            report = world.step()
            recording.append(report)
            states.append(live.state(report))
    return path, live.model, states


def named(model: SceneModel, name: str) -> int:
    return [body.name for body in model.bodies].index(name)


def test_every_collider_has_a_view_with_its_surface_material_and_link() -> None:
    world, dumbbell, hand = scene()
    model, state = WorldScene(world).model, WorldScene(world).state()
    (second,) = (i for i, body in enumerate(model.bodies) if body.name == "dumbbell/collider 1")
    (knuckle,) = (i for i, body in enumerate(model.bodies) if body.name.endswith("/collider 1") and body.kind == "link")
    assert [i for i, body in enumerate(model.bodies) if body.part_of is not None] == [second, knuckle]
    for place, collider in ((second, dumbbell.colliders[1]), (knuckle, hand.colliders(1)[1])):
        view = model.bodies[place]
        np.testing.assert_array_equal(view.points, collider.surface.points)
        np.testing.assert_array_equal(view.control.areas, collider.surface.control_areas)
        assert view.material is not None
        assert (view.material["name"], view.link) == (collider.material.name, collider.link)
        posed = rotate(state.quaternions[place], view.points) + state.positions[place]
        np.testing.assert_allclose(posed, collider.deformed_points(), atol=1e-12)
    assert model.bodies[second].part_of == named(model, "dumbbell")
    assert model.bodies[knuckle].part_of == model.fingertips()[1]
    assert len(model.fingertips()) == len(model.fingers) == 3


def test_contacts_of_every_collider_come_back_with_it(run: tuple[Path, SceneModel, list[SceneState]]) -> None:
    path, model, states = run
    with SceneRecording(path) as recording:
        assert [(body.name, body.part_of, body.link) for body in recording.model.bodies] == [
            (body.name, body.part_of, body.link) for body in model.bodies
        ]
        for step, live in enumerate(states):
            back = recording.state(step)
            np.testing.assert_array_equal(back.positions, live.positions)
            np.testing.assert_array_equal(back.quaternions, live.quaternions)
            for name in ("body_a", "body_b", "collider_a", "collider_b", "control_point", "status"):
                np.testing.assert_array_equal(getattr(back.contacts, name), getattr(live.contacts, name), name)
            assert back.moved.keys() == live.moved.keys()
            for place, moved in live.moved.items():
                assert np.abs(back.moved[place].points - moved.points).max() < 1e-9
        contacts = back.contacts
        first, second = named(model, "dumbbell"), named(model, "dumbbell/collider 1")
        for collider, x in ((first, -APART / 2), (second, APART / 2)):
            mine = contacts.on(collider)
            assert mine.sum() > 3
            np.testing.assert_array_equal(np.where(contacts.collider_a == collider, contacts.body_a, contacts.body_b)[mine], first)
            off = np.abs(contacts.points[mine].mean(axis=0)[0] - x)
            assert off < 0.1 * RADIUS, f"contacts of {model.bodies[collider].name} are {1e3 * off:.2f} mm from it"
            on_a = contacts.collider_a == collider
            assert contacts.control_point[on_a].max(initial=-1) < len(model.bodies[collider].control.points)
            assert collider in back.moved, "it is dented"
        knuckle = next(i for i, body in enumerate(model.bodies) if body.kind == "link" and body.part_of is not None)
        assert contacts.on(knuckle).sum() > 3
        tip = model.fingertips()[1]
        assert set(np.where(contacts.collider_a == knuckle, contacts.body_a, contacts.body_b)[contacts.on(knuckle)]) == {tip}
        assert (back.finger_forces[1] == 0.0).all(), "what presses on a link does not press on the fingertip"


def test_tables_name_the_collider_of_a_contact(run: tuple[Path, SceneModel, list[SceneState]], tmp_path: Path) -> None:
    export_tables(run[0], tmp_path, "csv")
    head, *lines = ((tmp_path / "contacts.csv").read_text()).splitlines()
    rows = [dict(zip(head.split(","), line.split(","), strict=True)) for line in lines]
    ends = {(row[f"body_{side}"], row[f"collider_{side}"]) for row in rows for side in "ab"}
    assert {("dumbbell", "dumbbell"), ("dumbbell", "dumbbell/collider 1"), ("plate", "plate")} <= ends


def test_pictures_show_every_collider(run: tuple[Path, SceneModel, list[SceneState]], tmp_path: Path) -> None:
    with SceneRecording(run[0]) as recording:
        renderer = Renderer(recording, RenderOptions(size=(640, 480), labels=False, camera="back"))
        picture, state = renderer.frame(3).astype(float), recording.state(3)
        Image.fromarray(picture.astype(np.uint8)).save(tmp_path / "all.png")

        def seen(place: int, beside: float = 0.0) -> np.ndarray:
            """The colours at the middle of a surface, or ``beside`` it, m, (pixels, 3)."""
            middle = rotate(state.quaternions[place], run[1].bodies[place].points.mean(axis=0)) + state.positions[place]
            x, y = (renderer.camera.project(middle[None])[0, :2] + [beside, 0.0]) * renderer.camera.scale * [1.0, -1.0] + [320, 240]
            return picture[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3].reshape(-1, 3)

        for name in ("dumbbell", "dumbbell/collider 1"):
            colour = seen(named(run[1], name)).mean(axis=0)
            assert colour.max() < 235, f"{name} is not in the picture: {colour}"
        knuckle = next(i for i, body in enumerate(run[1].bodies) if body.kind == "link" and body.part_of is not None)
        colour = seen(knuckle, 0.6 * RADIUS).mean(axis=0)  # beside the axle of the joint
        off = np.abs(colour / colour.max() - np.array(PAD) / max(PAD)).max()
        assert off < 0.06, f"the collider on the link has colour {colour}, not that of a pad"


class Page:
    """Stands for a server: keeps the nodes by their paths."""

    def __init__(self) -> None:
        self.scene = self
        self.nodes: dict[str, Any] = {}

    def atomic(self) -> Any:
        return self

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def flush(self) -> None: ...

    def __getattr__(self, kind: str) -> Any:
        def make(path: str, *given: Any, **named: Any) -> Any:
            self.nodes[path] = SimpleNamespace(kind=kind, vertices=given[0] if given else None, visible=True, remove=lambda: None, **named)
            return self.nodes[path]

        return make


def test_the_page_holds_every_collider_where_it_is() -> None:
    world, dumbbell, hand = scene()
    live, page = WorldScene(world), Page()
    server: Any = page
    drawing = SceneDrawing(server, live.model)
    world.step(3)
    state = live.state()
    drawing.draw(state, exact=True)
    paths = {path for path in page.nodes if path.startswith("/bodies/dumbbell/")}
    assert len(paths) == 2, f"one node for each collider, under that of the body: {sorted(page.nodes)}"
    frame = page.nodes["/bodies/dumbbell"]
    np.testing.assert_array_equal(frame.position, dumbbell.position)
    for place, collider in (
        (named(live.model, "dumbbell"), dumbbell.colliders[0]),
        (named(live.model, "dumbbell/collider 1"), dumbbell.colliders[1]),
    ):
        mesh = drawing.meshes[place]
        assert mesh is not None
        shown = rotate(frame.wxyz, np.asarray(mesh.vertices, float)) + frame.position
        off = np.abs(shown - collider.deformed_points()).max()
        assert off < 1e-5, f"{live.model.bodies[place].name} is {off} m from where it is"
    knuckle = hand.colliders(1)[1].deformed_points()
    vertices = np.concatenate([group.world for group in drawing._hand])
    nearest = np.linalg.norm(vertices[None] - knuckle[:, None], axis=2).min(axis=1).max()
    assert nearest < 1e-5, f"the collider on the link is {nearest} m from where it is"


def test_a_recording_ends_where_colliders_come_or_go(tmp_path: Path) -> None:
    world, dumbbell, _ = scene()
    with qr.record(world, tmp_path / "run.h5") as recording:
        recording.append(world.step())
        dumbbell.colliders[1].remove()
        with pytest.raises(InvalidValueError, match="bodies and colliders"):
            recording.append(world.step())


def test_recordings_from_before_colliders_have_those_of_the_bodies(run: tuple[Path, SceneModel, list[SceneState]], tmp_path: Path) -> None:
    old = tmp_path / "version-3.h5"
    old.write_bytes(run[0].read_bytes())
    with h5py.File(old, "r+") as file:
        for side in "ab":
            del file[f"contacts/collider_{side}"]
        described = json.loads(file.attrs["scene"])
        for body in described["bodies"]:
            del body["part_of"], body["link"]
        file.attrs.modify("scene", np.bytes_(json.dumps(described)))
        file.attrs.modify("version", 3)
    with SceneRecording(old) as recording:
        contacts = recording.state(3).contacts
        assert len(contacts) > 0
        np.testing.assert_array_equal(contacts.collider_a, contacts.body_a)
        assert recording.peak_pressure() >= 0.0
