"""Objects from files: every format, even points, right mass, and a word on whatever is wrong with the file."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from elsewhere import DATA, missing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from quasirigid.errors import (
    SurfaceWarning,
)
from quasirigid.objects import ObjectGeometry, load_object
from quasirigid.objects.mass import MOST_HULL_POINTS, solid_of_hull, solid_of_mesh
from quasirigid.objects.mesh import clean_mesh, corner_normals
from quasirigid.objects.sampling import has_duplicates, sample_mesh, thin_out

BOX = (0.06, 0.05, 0.08)


def quiet(path: Path, **keywords: object) -> ObjectGeometry:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)
        return load_object(path, **keywords)  # type: ignore[arg-type]


def save(mesh: trimesh.Trimesh, path: Path) -> Path:
    mesh.export(path)
    return path


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def sphere_cloud(count: int = 400, radius: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), math.pi * (1.0 + math.sqrt(5.0)) * k
    normals = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return radius * normals, normals


# Formats ------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("extension", ["obj", "ply", "stl", "off", "glb", "gltf", "STL"])
def test_every_mesh_format_gives_the_same_box(tmp_path: Path, extension: str) -> None:
    if extension == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box(BOX))).items():
            (tmp_path / ("box.gltf" if name.endswith(".gltf") else name)).write_bytes(data)
        file = tmp_path / "box.gltf"
    else:
        file = tmp_path / f"box.{extension}"
        file.write_bytes(_bytes(trimesh.creation.box(BOX), extension.lower()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        box = load_object(file, points=600)
    assert (box.name, box.kind, box.watertight, box.mass_source, box.warnings) == ("box", "mesh", True, "volume", ())
    assert box.points.shape == (600, 3)
    np.testing.assert_allclose(box.extents, BOX, rtol=1e-6)
    assert box.mass == pytest.approx(1000.0 * math.prod(BOX), rel=1e-5)
    assert box.areas is not None
    assert box.areas.sum() == pytest.approx(trimesh.creation.box(BOX).area, rel=1e-5)


def _bytes(mesh: trimesh.Trimesh, extension: str) -> bytes:
    data = mesh.export(file_type=extension)
    return data.encode() if isinstance(data, str) else data


def test_scene_is_concatenated_with_its_transforms_mirrors_too(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((0.02, 0.02, 0.02)), transform=trimesh.transformations.translation_matrix([0.03, 0, 0]))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = -0.03
    scene.add_geometry(trimesh.creation.icosphere(2, 0.01), transform=mirror)
    scene.export(tmp_path / "two.glb")
    both = quiet(tmp_path / "two.glb", points=500, centre=False)
    np.testing.assert_allclose(both.extents, (0.08, 0.02, 0.02), atol=1e-6)
    expected = 0.02**3 + trimesh.creation.icosphere(2, 0.01).volume
    assert both.volume == pytest.approx(expected, rel=1e-5)
    assert any("2 separate parts" in note for note in both.warnings)


@pytest.mark.parametrize("kind", ["npy3", "npy6", "xyz3", "xyz6", "csv", "ply3", "ply6"])
def test_point_clouds_keep_their_points_and_normals(tmp_path: Path, kind: str) -> None:
    points, normals = sphere_cloud()
    table = np.hstack([points, normals]) if "6" in kind or kind == "csv" else points
    if kind.startswith("npy"):
        file = tmp_path / "ball.npy"
        np.save(file, table)
    elif kind.startswith("ply"):
        file = tmp_path / "ball.ply"
        names = ("x", "y", "z", "nx", "ny", "nz")[: table.shape[1]]
        head = ["ply", "format ascii 1.0", f"element vertex {len(table)}", *(f"property double {name}" for name in names), "end_header"]
        file.write_text("\n".join([*head, *(" ".join(f"{value:.17g}" for value in row) for row in table)]) + "\n")
    else:
        file = tmp_path / "ball.xyz"
        head, gap = ("x, y, z, nx, ny, nz", ", ") if kind == "csv" else ("# scan\n400", "\t")
        file.write_text("\n".join([head, *(gap.join(f"{value:.17g}" for value in row) for row in table), "// end", ""]))
    ball = quiet(file, centre=False)
    assert (ball.kind, ball.areas, ball.faces, ball.mass_source) == ("points", None, None, "hull")
    np.testing.assert_allclose(ball.points, points, atol=1e-9)
    if table.shape[1] == 6:
        assert ball.normals is not None
        np.testing.assert_allclose(ball.normals, normals, atol=1e-6)
    else:
        assert ball.normals is None
    sphere = 4.0 / 3.0 * math.pi * 0.03**3
    assert 0.95 * sphere < ball.volume < sphere
    assert any("convex hull" in note for note in ball.warnings)


def test_inward_normals_of_a_cloud_are_turned_and_colours_are_not_normals(tmp_path: Path) -> None:
    points, normals = sphere_cloud()
    np.save(tmp_path / "inside_out.npy", np.hstack([points, -2.0 * normals]))
    ball = quiet(tmp_path / "inside_out.npy")
    assert ball.normals is not None
    np.testing.assert_allclose(ball.normals, normals, atol=1e-9)
    assert any("turned outward" in note for note in ball.warnings)
    np.save(tmp_path / "coloured.npy", np.hstack([points, np.random.default_rng(0).integers(0, 256, points.shape)]))
    coloured = quiet(tmp_path / "coloured.npy")
    assert coloured.normals is None
    assert any("colours" in note for note in coloured.warnings)


def test_large_cloud_is_thinned_out_evenly(tmp_path: Path) -> None:
    points, normals = sphere_cloud(6000)
    np.save(tmp_path / "dense.npy", np.hstack([points, normals]))
    ball = quiet(tmp_path / "dense.npy", points=1000)
    assert ball.points.shape == (1000, 3)
    gaps = cKDTree(ball.points).query(ball.points, k=2)[0][:, 1]
    assert gaps.min() / gaps.mean() > 0.6, f"least / mean distance {gaps.min() / gaps.mean():.3f}"
    assert len(np.unique(thin_out(points, None, 1000))) == 1000


# Sampling -----------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [50, 777, 5000])
def test_samples_are_blue_noise_and_exactly_as_many_as_asked(count: int) -> None:
    mesh = trimesh.creation.icosphere(4, 0.03)
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    points, face, weights = sample_mesh(vertices, faces, count, np.random.default_rng(0))
    assert points.shape == (count, 3)
    np.testing.assert_allclose(np.einsum("ij,ijk->ik", weights, vertices[faces[face]]), points, atol=1e-15)
    gaps = cKDTree(points).query(points, k=2)[0][:, 1]
    rough, _ = trimesh.sample.sample_surface(mesh, count, seed=0)
    chance = cKDTree(rough).query(rough, k=2)[0][:, 1]
    even, random = gaps.min() / gaps.mean(), chance.min() / chance.mean()
    assert even > 0.75, f"least / mean distance {even:.3f}"
    assert even > 3.0 * random, f"least / mean distance {even:.3f}, by chance {random:.3f}"
    # No gaps either: the farthest place on the surface is less than twice the spacing away.
    assert cKDTree(points).query(vertices)[0].max() < 1.3 * gaps.mean()


def test_samples_are_spread_by_area() -> None:
    mesh = trimesh.creation.box(BOX)
    count = 20_000
    _, face, _ = sample_mesh(
        np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64), count, np.random.default_rng(3)
    )
    share = np.bincount(face, minlength=len(mesh.faces)) / count
    error = np.abs(share * mesh.area / mesh.area_faces - 1.0)
    assert error.max() < 0.03, f"points per area off by {100 * error.max():.2f} %"


def test_both_sides_of_a_thin_sheet_are_covered() -> None:
    mesh = trimesh.creation.box((0.1, 0.1, 0.0005))
    points, _, _ = sample_mesh(
        np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64), 2000, np.random.default_rng(0)
    )
    top, bottom = points[points[:, 2] > 0.00024], points[points[:, 2] < -0.00024]
    for side in (top, bottom):
        gaps = cKDTree(side).query(side, k=2)[0][:, 1]
        assert gaps.min() / gaps.mean() > 0.6, f"{gaps.min() / gaps.mean():.3f}"


def test_same_seed_same_points_other_seed_other_points(tmp_path: Path) -> None:
    file = save(trimesh.creation.icosphere(3, 0.03), tmp_path / "ball.ply")
    first, again, other = (load_object(file, points=400, seed=seed).points for seed in (4, 4, 5))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


# Normals ------------------------------------------------------------------------------------------------------------------------------


def test_box_keeps_flat_faces_and_a_sphere_is_shaded_smoothly(tmp_path: Path) -> None:
    box = load_object(save(trimesh.creation.box(BOX), tmp_path / "box.stl"), points=2000)
    assert box.normals is not None
    assert np.abs(np.abs(box.normals).max(axis=1) - 1.0).max() < 1e-12
    ball = load_object(save(trimesh.creation.icosphere(3, 0.03), tmp_path / "ball.stl"), points=2000)
    assert ball.normals is not None
    radial = ball.points / np.linalg.norm(ball.points, axis=1)[:, None]
    worst = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", radial, ball.normals), -1, 1)).max())
    assert worst < 0.7, f"worst normal {worst:.2f} degrees off; flat triangles would be 4"


def test_cylinder_is_smooth_round_and_sharp_at_its_rim() -> None:
    mesh = trimesh.creation.cylinder(0.02, 0.06, sections=64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    normals = corner_normals(np.asarray(mesh.vertices, dtype=float), faces)
    lid = np.abs(mesh.face_normals[:, 2]) > 0.5
    assert np.abs(np.abs(normals[lid][:, :, 2]) - 1.0).max() < 1e-12
    wall = np.asarray(mesh.vertices)[faces[~lid]] * (1.0, 1.0, 0.0)
    expected = wall / np.linalg.norm(wall, axis=2)[:, :, None]
    assert np.abs(normals[~lid] - expected).max() < 0.03


# Mass ---------------------------------------------------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(0.01, 0.2)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(0.0, 6.0))
def test_mass_of_a_box_anywhere_is_the_closed_form(extents: tuple[float, ...], shift: tuple[float, ...], turn: float) -> None:
    mesh = trimesh.creation.box(extents)
    rotation = trimesh.transformations.rotation_matrix(turn, [1.0, 2.0, 3.0])
    vertices = np.asarray(mesh.vertices) @ rotation[:3, :3].T + shift
    solid = solid_of_mesh(vertices, np.asarray(mesh.faces, dtype=np.int64))
    squares = np.array(extents) ** 2
    volume = math.prod(extents)
    assert solid.volume == pytest.approx(volume, rel=1e-9)
    np.testing.assert_allclose(solid.centre, shift, atol=1e-9)
    expected = rotation[:3, :3] @ np.diag(volume * (squares.sum() - squares) / 12.0) @ rotation[:3, :3].T
    np.testing.assert_allclose(solid.inertia, expected, rtol=1e-7, atol=1e-9 * expected.max())


def test_mass_and_density_scale_and_size(tmp_path: Path) -> None:
    file = save(trimesh.creation.box((60.0, 50.0, 80.0)), tmp_path / "box.stl")
    light = load_object(file, scale=0.001, points=100, density=500.0)
    assert light.mass == pytest.approx(500.0 * math.prod(BOX))
    heavy = load_object(file, size=0.08, points=100, density=500.0, mass=2.0)
    assert heavy.mass == 2.0
    np.testing.assert_allclose(heavy.extents, BOX)
    expected = 2.0 / 12.0 * np.diag([0.05**2 + 0.08**2, 0.06**2 + 0.08**2, 0.06**2 + 0.05**2])
    np.testing.assert_allclose(heavy.inertia, expected, rtol=1e-6, atol=1e-12)


def test_centre_moves_the_centre_of_mass_to_the_origin_and_nothing_else(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(3, 0.03)
    mesh.apply_translation([0.4, -0.3, 0.2])
    file = save(mesh, tmp_path / "ball.ply")
    here, there = load_object(file, points=200), load_object(file, points=200, centre=False)
    np.testing.assert_allclose(here.centre_of_mass, 0.0, atol=1e-15)
    np.testing.assert_allclose(there.centre_of_mass, [0.4, -0.3, 0.2], atol=1e-7)
    np.testing.assert_allclose(there.points - there.centre_of_mass, here.points, atol=1e-12)
    np.testing.assert_allclose(there.inertia, here.inertia, rtol=1e-9, atol=1e-15)
    assert not here.points.flags.writeable


# Surfaces with faults that can be used ------------------------------------------------------------------------------------------------


def test_holes_are_counted_and_capped_for_the_mass(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(4, 0.03)
    centres = mesh.triangles_center
    open_faces = np.asarray(mesh.faces)[(centres[:, 2] > -0.028) & (centres[:, 0] < 0.029)]
    with pytest.warns(SurfaceWarning, match="2 holes"), pytest.warns(SurfaceWarning, match="capped"):
        ball = load_object(write_obj(tmp_path / "holed.obj", np.asarray(mesh.vertices), open_faces), points=500)
    assert (ball.watertight, ball.mass_source) == (False, "capped")
    assert ball.volume == pytest.approx(mesh.volume, rel=0.02)


def test_bowl_too_open_to_cap_takes_the_hull(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(3, 0.03)
    bowl = np.asarray(mesh.faces)[mesh.triangles_center[:, 2] < 0.0]
    item = quiet(write_obj(tmp_path / "bowl.obj", np.asarray(mesh.vertices), bowl), points=500)
    assert item.mass_source == "hull"
    assert any("1 hole " in note for note in item.warnings)
    assert any("convex hull" in note for note in item.warnings)


@pytest.mark.parametrize("fault", ["inside out", "mixed", "duplicate", "degenerate", "non-manifold", "unwelded"])
def test_faults_are_said_and_repaired(tmp_path: Path, fault: str) -> None:
    mesh = trimesh.creation.icosphere(2, 0.03)
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces).copy()
    word = {"inside out": "turned outward", "mixed": "different directions", "duplicate": "3 duplicate faces dropped"}.get(fault, fault)
    if fault == "inside out":
        faces = faces[:, ::-1]
    elif fault == "mixed":
        faces[::3] = faces[::3, ::-1]
    elif fault == "duplicate":
        faces = np.vstack([faces, faces[:3]])
    elif fault == "degenerate":
        faces = np.vstack([faces, [[0, 0, 1], [5, 6, 5]]])
        word = "2 degenerate faces dropped"
    elif fault == "non-manifold":
        vertices = np.vstack([vertices, 1.3 * vertices[faces[0, 0]]])
        faces = np.vstack([faces, [[faces[0, 0], faces[0, 1], len(vertices) - 1]]])
        word = "1 non-manifold edge"
    else:
        vertices, faces = vertices[faces.reshape(-1)], np.arange(faces.size).reshape(-1, 3)
    ball = quiet(write_obj(tmp_path / "ball.obj", vertices, faces), points=300)
    if fault == "unwelded":
        assert ball.warnings == ()
    else:
        assert any(word in note for note in ball.warnings), ball.warnings
    assert ball.normals is not None
    outward = np.einsum("ij,ij->i", ball.points, ball.normals) > 0.0
    assert outward.mean() > 0.98
    if fault != "non-manifold":
        assert ball.watertight
        assert ball.volume == pytest.approx(mesh.volume, rel=1e-6)


def test_vertices_that_are_nearly_one_are_welded_wherever_they_lie() -> None:
    # Of a box whose largest extent is 1, corners are one within 1e-7. On a grid of that width these lie at the border of two cells.
    mesh = trimesh.creation.box((1.0, 0.80000005, 0.60000005))
    soup = np.asarray(mesh.vertices)[np.asarray(mesh.faces).reshape(-1)]
    soup = soup + np.random.default_rng(0).uniform(-2e-8, 2e-8, soup.shape)
    box = clean_mesh(soup, np.arange(len(soup)).reshape(-1, 3), "box")
    assert (len(box.vertices), box.watertight, box.warnings) == (8, True, ())


def test_corners_of_dropped_faces_are_no_part_of_the_object(tmp_path: Path) -> None:
    mesh = trimesh.creation.box(BOX)
    vertices = np.vstack([mesh.vertices, [0.0, 0.0, 0.5]])
    faces = np.vstack([mesh.faces, [[8, 8, 0]]])
    box = quiet(write_obj(tmp_path / "box.obj", vertices, faces), points=100, size=0.08)
    np.testing.assert_allclose(box.extents, BOX, rtol=1e-6)
    assert box.mass == pytest.approx(1000.0 * math.prod(BOX), rel=1e-6)


def test_cavity_stays_a_cavity(tmp_path: Path) -> None:
    shell, hollow = trimesh.creation.icosphere(3, 0.03), trimesh.creation.icosphere(3, 0.02)
    vertices = np.vstack([shell.vertices, hollow.vertices])
    faces = np.vstack([shell.faces, np.asarray(hollow.faces)[:, ::-1] + len(shell.vertices)])
    ball = quiet(write_obj(tmp_path / "hollow.obj", vertices, faces), points=300)
    assert ball.volume == pytest.approx(shell.volume - hollow.volume, rel=1e-6)
    assert clean_mesh(vertices, faces.astype(np.int64), "ball").watertight


# Real scans ---------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "size", "source"),
    [
        ("stanford-bunny", 0.08, "capped"),
        ("rocker-arm", 0.08, "volume"),
        ("ycb-mustardbottle", None, "volume"),
        ("ycb-banana", None, "volume"),
    ],
)
def test_real_scan(name: str, size: float | None, source: str) -> None:
    file = DATA / "objects" / f"{name}.obj"
    if not file.exists():
        pytest.skip(missing(f"objects/{name}.obj"))
    item = quiet(file, size=size)
    assert item.points.shape == (20_000, 3)
    assert item.normals is not None
    assert item.areas is not None
    gaps = cKDTree(item.points).query(item.points, k=2)[0][:, 1]
    print(f"\n{name}: {1e3 * item.mass:.0f} g, least / mean distance {gaps.min() / gaps.mean():.2f}, {item.warnings}")
    assert item.mass_source == source
    assert item.extents.max() == pytest.approx(size or item.extents.max())
    # The divergence theorem over the points: sum of p . n A / 3 is the volume, if normals and areas are right.
    volume = float(np.einsum("ij,ij,i->", item.points, item.normals, item.areas)) / 3.0
    assert volume == pytest.approx(item.volume, rel=0.03), f"volume from the points {volume:.4g}, from the mesh {item.volume:.4g}"


def test_the_hull_of_many_points_is_that_of_their_outermost() -> None:
    rng = np.random.default_rng(1)
    count = 2 * MOST_HULL_POINTS
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    cube = rng.uniform(-0.5, 0.5, (count, 3))
    cube[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-0.5, 0.5], count)
    for name, points, volume, bound in (
        ("ball", ball, 4.0 / 3.0 * np.pi, 1e-3),
        ("thin rod", ball * [0.5, 0.005, 0.005], 4.0 / 3.0 * np.pi * 0.5 * 0.005**2, 1e-3),
        ("cube", cube, 1.0, 1e-4),
        ("plate", cube * [1.0, 1.0, 0.01], 0.01, 1e-4),
    ):
        off = solid_of_hull(points @ turn.T, name).volume / volume - 1.0
        assert -bound < off < 1e-9, f"{name}: volume off by {off:.1e}"


def test_equal_points_are_found_among_many() -> None:
    points = np.random.default_rng(2).normal(size=(10_000, 3))
    assert not has_duplicates(points)
    assert not has_duplicates(np.concatenate([points, points[:, ::-1]]))
    points[17] = [0.0, 1.0, 2.0]
    points[9_000] = [-0.0, 1.0, 2.0]
    assert has_duplicates(points)


def test_a_dense_cloud_is_thinned_out_evenly() -> None:
    ball = np.random.default_rng(3).normal(size=(100_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    kept = thin_out(ball, ball, 1_000)
    assert len(np.unique(kept)) == 1_000
    nearest = cKDTree(ball[kept]).query(ball[kept], k=2)[0][:, 1]
    assert nearest.min() > 0.6 * nearest.mean(), f"least {nearest.min():.4f} m, mean {nearest.mean():.4f} m"
