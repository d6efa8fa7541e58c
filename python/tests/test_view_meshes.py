"""The meshes of the view, and the parts of a drawing that change often."""

from __future__ import annotations

from io import BytesIO
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import quasirigid as qr
from quasirigid.grasp.options import GraspOptions
from quasirigid.live.batched_nodes import OUT_OF_SIGHT, Joined, LinePool, PatchPool
from quasirigid.live.pad_detail import FAR, PadDetail
from quasirigid.live.play import Play
from quasirigid.live.unlit import unlit_glb
from quasirigid.objects.sampling import sample_mesh
from quasirigid.rotation import matrix_of, rotate
from quasirigid.scene.meshes import SAGITTA, in_drawing_order, is_convex, mirrored, tapered_capsule, thinned, triangulate
from quasirigid.scene.model import Moved
from quasirigid.scene.sharp_edges import divided, sharpened

OPTIONS = GraspOptions(points=4_000)


def enclosed(points: Any, faces: Any) -> Any:
    return trimesh.Trimesh(points, faces, process=False)


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(size=st.tuples(*[st.floats(0.01, 0.2)] * 3), n=st.integers(400, 3000))
def test_a_box_is_closed_and_encloses_nearly_its_volume(size: tuple[float, float, float], n: int) -> None:
    surface = qr.Surface.box(size, points=n)
    faces = triangulate(surface.points, surface.normals)
    mesh = enclosed(surface.points, faces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert len(np.unique(faces)) == n
    # What is missing is the bevel along the edges, half a spacing wide.
    lost = sum(size) * 4 * surface.spacing**2
    assert np.prod(size) - lost <= mesh.volume <= np.prod(size) * (1 + 1e-9), (mesh.volume, np.prod(size))


@pytest.mark.parametrize(
    ("surface", "volume"),
    [
        (qr.Surface.sphere(0.03, points=12_000), 4 / 3 * np.pi * 0.03**3),
        (qr.Surface.capsule(0.02, 0.05, points=12_000), np.pi * 0.02**2 * (0.05 + 4 / 3 * 0.02)),
        (qr.Surface.cylinder(0.03, 0.08, points=12_000), np.pi * 0.03**2 * 0.08),
    ],
    ids=["sphere", "capsule", "cylinder"],
)
def test_round_shapes_are_closed_and_enclose_their_volume_with_fewer_triangles_too(surface: qr.Surface, volume: float) -> None:
    mesh = enclosed(surface.points, triangulate(surface.points, surface.normals))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.01)
    few = thinned(surface.points, surface.normals)
    assert few is not None
    coarse = enclosed(surface.points[few[0]], few[1])
    assert coarse.is_watertight
    assert len(few[0]) < 0.8 * len(surface.points)
    # A shell of the thickness that is promised is the most that may be missing.
    assert abs(mesh.volume - coarse.volume) < SAGITTA * mesh.area, (mesh.volume, coarse.volume)


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(size=st.tuples(*[st.floats(0.01, 0.2)] * 3), n=st.integers(2000, 8000))
def test_of_a_box_the_corners_are_enough(size: tuple[float, float, float], n: int) -> None:
    surface = qr.Surface.box(size, points=n)
    few = thinned(surface.points, surface.normals)
    assert few is not None
    kept, faces = few
    mesh = enclosed(surface.points[kept], faces)
    assert mesh.is_watertight
    assert len(kept) < 0.05 * n, len(kept)
    # Convex: how deep a point is, is its distance to the nearest of the planes.
    broad = mesh.area_faces > 1e-6 * mesh.area  # the hull of points in a row has triangles without area, which have no plane
    normals, corners = mesh.face_normals[broad], mesh.triangles[broad, 0]
    depth = -(normals @ surface.points.T - np.einsum("ij,ij->i", normals, corners)[:, None]).max(axis=0)
    assert depth.max() <= SAGITTA * (1 + 1e-9), depth.max()
    assert depth.min() > -1e-7, depth.min()


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(size=st.tuples(*[st.floats(0.02, 0.1)] * 3), n=st.integers(1500, 5000))
def test_a_sharpened_box_is_the_box(size: tuple[float, float, float], n: int) -> None:
    surface = qr.Surface.box(size, points=n)
    points, normals, faces = sharpened(surface.points, surface.normals, triangulate(surface.points, surface.normals))
    mesh = trimesh.Trimesh(points, faces)  # vertices of the two sides of an edge are one again
    # Closed. Where two vertices on an edge fall on one place, four triangles may meet in a line.
    assert (np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1] % 2 == 0).all()
    assert mesh.volume == pytest.approx(np.prod(size), rel=1e-6), mesh.volume / np.prod(size)
    # Every triangle lies in a face of the box, and so do the normals of its corners.
    area = trimesh.triangles.area(points[faces])
    broad = area > 1e-12
    flat, _ = trimesh.triangles.normals(points[faces][broad])
    turn = np.einsum("ij,ikj->ik", flat, normals[faces][broad])
    off = np.abs(turn).min()
    assert off > 1.0 - 1e-6, f"a corner's normal is {np.degrees(np.arccos(off)):.2f} degrees off"
    # Vertices that change places along an edge fold a small triangle over, within its face.
    folded = area[broad][turn.min(axis=1) < 0.0].sum() / area.sum()
    assert folded < 1e-3, f"{folded:.1e} of the area is folded over"


def test_divided_triangles_cover_the_same_surface() -> None:
    surface = qr.Surface.sphere(0.03, points=500)
    faces = triangulate(surface.points, surface.normals)
    points, normals, fine = divided(surface.points, surface.normals, faces)
    whole, small = enclosed(surface.points, faces), enclosed(points, fine)
    assert len(fine) == 4 * len(faces)
    assert small.is_watertight
    assert small.volume == pytest.approx(whole.volume, rel=1e-12)
    np.testing.assert_allclose(normals, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-3)


@pytest.mark.parametrize("n", [300, 3000])
def test_the_drawing_order_has_the_same_triangles_and_computes_few_vertices_twice(n: int) -> None:
    surface = qr.Surface.sphere(0.03, points=n)
    faces = triangulate(surface.points, surface.normals)
    ordered = in_drawing_order(faces, n)
    assert sorted(map(tuple, ordered.tolist())) == sorted(map(tuple, faces.tolist()))
    recent: list[int] = []
    computed = 0
    for vertex in ordered.ravel().tolist():
        if vertex not in recent:
            computed += 1
            recent = [vertex, *recent[:31]]
    assert computed < 0.85 * len(faces), computed / len(faces)  # in the order of the hull nearly three for each triangle
    assert len(in_drawing_order(np.zeros((0, 3), np.int64), n)) == 0


def test_a_body_with_dents_is_told_from_one_without() -> None:
    torus = trimesh.creation.torus(0.04, 0.015)
    assert not is_convex(np.asarray(torus.vertices), np.asarray(torus.faces))
    for surface in (qr.Surface.box((0.06, 0.06, 0.08), points=3000), qr.Surface.sphere(0.03, points=1000)):
        assert is_convex(surface.points, triangulate(surface.points, surface.normals))


class Recorder:
    """Stands for a server: keeps what nodes were made with and what was assigned to them."""

    def __init__(self) -> None:
        self.scene = self
        self.made: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        def make(_path: str, *given: Any, **named: Any) -> Any:
            self.made.append(SimpleNamespace(kind=name, given=[np.array(g) for g in given], visible=True, **named))
            return self.made[-1]

        return make


def test_joined_bodies_are_where_their_poses_and_the_deformed_points_say() -> None:
    rng = np.random.default_rng(5)
    tip = qr.Surface.fingertip((0.009, 0.009, 0.008))
    faces = triangulate(tip.points, tip.normals)
    server: Any = Recorder()
    group = Joined(server, "/pads", [(2, tip.points, faces), (0, tip.points, faces)], (1.0, 1.0, 1.0))
    quaternions = rng.normal(size=(3, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    positions = rng.normal(size=(3, 3))
    moved = Moved(np.array([3, 5, 8]), tip.points[[3, 5, 8]] * 0.9)
    group.deform(0, moved)
    assert group.place(positions, matrix_of(quaternions), np.zeros(3, bool))
    assert not group.place(positions, matrix_of(quaternions), np.zeros(3, bool))  # nothing has changed
    yielded = tip.points.copy()
    yielded[moved.indices] = moved.points
    for part, (body, points) in enumerate([(2, yielded), (0, tip.points)]):
        wanted = rotate(quaternions[body], points) + positions[body]
        off = np.abs(group.world[group.rows[part]] - wanted).max()
        assert off < 1e-6, off
    np.testing.assert_array_equal(group.handle.vertices, group.world[group.sent])
    # Triangles are those of the surface.
    drawn = group.sent[server.made[0].given[1]]
    back = np.argsort(group.rows[0])
    assert sorted(map(tuple, back[drawn[: len(faces)]].tolist())) == sorted(map(tuple, faces.tolist()))
    # What has no triangle is not sent.
    group.retriangulate({0: faces[:7]})
    assert set(group.sent) == {*group.rows[0][faces[:7]].flat, *group.rows[1]}
    np.testing.assert_array_equal(group.handle.vertices, group.world[group.sent])
    np.testing.assert_array_equal(group.sent[group.handle.faces[:7]], group.rows[0][faces[:7]])


def test_coloured_points_move_without_new_colours() -> None:
    server: Any = Recorder()
    pool = PatchPool(server, "/patches", 1e-3)
    table = np.arange(12, dtype=np.uint8).reshape(4, 3)
    rng = np.random.default_rng(3)
    for n in (10, 12, 0, 9):
        levels, points = rng.integers(0, 4, n), rng.normal(size=(n, 3)).astype(np.float32)
        pool.arrange(levels, table)
        pool.move(points)
        cloud = server.made[-1]
        places = getattr(cloud, "points", cloud.given[0])
        seen = (places != np.float32(OUT_OF_SIGHT)).any(axis=1)
        shown = sorted((*p, *c) for p, c in zip(places[seen].tolist(), cloud.given[1][seen].tolist(), strict=True))
        assert shown == sorted((*p, *c) for p, c in zip(points.tolist(), table[levels].tolist(), strict=True))
    assert len(server.made) == 1
    pool.arrange(np.zeros(100, np.int64), table)
    pool.move(np.ones((100, 3), np.float32))
    assert len(server.made) == 2  # more of one colour than there was room for


def test_lines_keep_little_room() -> None:
    server: Any = Recorder()
    pool = LinePool(server, "/lines", 1.0)
    for n, room in ((100, 128), (120, 128), (3, 16), (0, 16)):
        pool.show(np.ones((n, 2, 3)), np.zeros((n, 3), np.uint8))
        assert len(server.made[-1].given[0]) == room
    assert not server.made[-1].visible


def test_flat_colour_is_a_file_that_others_read() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]])
    file = unlit_glb(points, np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.2, 0.4, 0.6], np.float32))
    mesh = trimesh.load(BytesIO(file), file_type="glb", force="mesh")
    assert mesh.area == pytest.approx(trimesh.Trimesh(points, [[0, 1, 2], [0, 2, 3]]).area)
    assert np.abs(mesh.bounds - [[0, 0, 0], [1, 1, 0.5]]).max() < 1e-6
    lines = unlit_glb(points, np.array([[0, 1], [2, 3], [1, 2]]), np.ones((4, 4), np.float32), see_through=True)
    paths = trimesh.load(BytesIO(lines), file_type="glb")
    assert sum(path.length for path in paths.geometry.values()) == pytest.approx(1.0 + np.sqrt(1.25) + 1.0)


def test_a_surface_that_is_not_seen_from_within_is_triangulated_by_its_cocone() -> None:
    torus = trimesh.creation.torus(0.04, 0.015, major_sections=80, minor_sections=36)
    points, face, _ = sample_mesh(torus.vertices, torus.faces, 4000, np.random.default_rng(0))
    surface = qr.Surface.from_points(points, torus.face_normals[face])
    assert thinned(surface.points, surface.normals) is None
    faces = triangulate(surface.points, surface.normals)
    mesh = enclosed(surface.points, faces)
    assert len(np.unique(faces)) > 0.99 * len(points)
    assert mesh.area == pytest.approx(4 * np.pi**2 * 0.04 * 0.015, rel=0.02)
    # All look outwards.
    centres = mesh.triangles_center
    ring = 0.04 * centres[:, :2] / np.linalg.norm(centres[:, :2], axis=1)[:, None]
    outward = centres - np.column_stack([ring, np.zeros(len(ring))])
    assert (np.einsum("ij,ij->i", outward, mesh.face_normals) > 0).all()


def test_a_pad_stays_open_and_its_back_closes_it() -> None:
    tip = qr.Surface.fingertip((0.009, 0.009, 0.008))
    faces = triangulate(tip.points, tip.normals)
    mesh = enclosed(tip.points, faces)
    assert not mesh.is_watertight
    assert (np.einsum("ij,ikj->ik", mesh.face_normals, tip.normals[faces]) > 0.5).all()
    up = np.array([0.0, 0.0, 1.0])
    back, _, back_faces = mirrored(tip.points, tip.normals, faces, up, thickness=1.0)
    assert back[:, 2].max() <= tip.points[:, 2].min() + 1e-9
    assert len(back_faces) < 0.5 * len(faces)


def test_a_tapered_capsule_is_closed() -> None:
    points, normals, faces = tapered_capsule(np.zeros(3), np.array([0.0, 0.0, 0.05]), 0.01, 0.006)
    mesh = trimesh.Trimesh(points, faces)  # ends are merged
    assert mesh.volume == pytest.approx(np.pi * 0.05 / 3 * (1e-4 + 6e-5 + 3.6e-5) + 2 / 3 * np.pi * (1e-6 + 2.16e-7), rel=0.06)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(points)))


def test_pads_have_all_their_triangles_where_they_yield_and_few_elsewhere() -> None:
    play = Play(OPTIONS)
    model = play.scene.model
    body = model.bodies[model.fingertips()[0]]
    detail = PadDetail(body)
    at_rest = len(detail.faces)
    assert at_rest < 0.3 * len(body.faces), f"{at_rest} of {len(body.faces)} triangles at rest"
    mesh = trimesh.Trimesh(body.points, detail.faces, process=False)
    # A pad is convex: how deep a point is, is its distance to the nearest of the planes.
    depth = -(mesh.face_normals @ body.points.T - np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])[:, None]).max(axis=0)
    assert depth.max() < 1.2 * FAR, f"{1e3 * depth.max():.3f} mm from the triangles"
    top = body.points[(body.points @ body.normals.mean(axis=0)).argmax()]
    for radius in (1e-3, 2e-3, 4e-3):
        near = np.flatnonzero(np.linalg.norm(body.points - top, axis=1) < radius)
        moved = Moved(near, body.points[near] - 2e-4 * body.normals[near])
        detail.follow(moved)
        yielded = body.points.copy()
        yielded[near] = moved.points
        # Every point that yields is a corner of a triangle, so the page shows it where it is.
        missing = np.setdiff1d(near, detail.faces)
        assert len(missing) == 0, f"{len(missing)} of {len(near)} points that yield have no triangle"
        assert len(detail.faces) < len(body.faces)
    assert not detail.follow(moved), "nothing has changed"
    assert detail.follow(None)
    assert len(detail.faces) == at_rest
