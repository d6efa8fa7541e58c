"""Small valid files of every format that is read, made anew in every run: what the mutations begin with. The same bytes every time."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import quasirigid as qr
from quasirigid import mocap


def make_seeds(kind: str, folder: Path) -> None:
    """Write the files of a kind to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    MAKERS[kind](folder)


def _ball(count: int = 60) -> np.ndarray[Any, Any]:
    """Even points on a ball of 40 mm, (n, 3) m."""
    z = (2.0 * np.arange(count) + 1.0) / count - 1.0
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    return 0.02 * np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def _ply(head: str, *blocks: bytes) -> bytes:
    return ("ply\n" + head + "end_header\n").encode() + b"".join(blocks)


def _objects(folder: Path) -> None:
    box = trimesh.creation.box((0.06, 0.05, 0.08))
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.03)
    for mesh, name in ((box, "box"), (ball, "ball")):
        for extension, options in (("obj", {}), ("off", {}), ("stl", {}), ("ply", {}), ("glb", {})):
            mesh.export(folder / f"{name}.{extension}", **options)
    box.export(folder / "box-ascii.stl", file_type="stl_ascii")
    box.export(folder / "box-ascii.ply", encoding="ascii")
    parts = trimesh.Scene([box, ball.copy().apply_translation((0.0, 0.0, 0.1))])
    parts.export(folder / "scene.glb")
    (folder / "scene.gltf").write_bytes(_one_gltf(parts))

    points = _ball()
    normals = points / 0.02
    both = np.hstack([points, normals])
    (folder / "quads.obj").write_text(
        "# a box\nmtllib box.mtl\no box\n"
        + "".join(f"v {x} {y} {z} 0.5 0.5 0.5\n" for z in (0, 0.05) for x, y in ((0, 0), (0.04, 0), (0.04, 0.03), (0, 0.03)))
        + "vt 0 0\nvt 1 1\nvn 0 0 1\ng sides\nusemtl grey\ns 1\n"
        + "f 4/1/1 3/1/1 2/1/1 1/2/1\nf 5//1 6//1 7//1 8//1\nf 1 2 6 5\nf 2/1 3/1 7/1 6/2\nf -6 -5 -1 -2\nf 4 1 5 8\n"
    )
    (folder / "colours.off").write_text(
        "COFF\n# a box\n8 6 12\n"
        + "".join(f"{x} {y} {z} 9 9 9 255\n" for z in (0, 0.05) for x, y in ((0, 0), (0.04, 0), (0.04, 0.03), (0, 0.03)))
        + "4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
    )
    corners = np.array([[x, y, z] for z in (0, 0.05) for x, y in ((0, 0), (0.04, 0), (0.04, 0.03), (0, 0.03))])
    strip = [3, 2, 0, 1, 5, 2, 6, 3, 7, 0, 4, 5, 7, 6]
    vertex = "element vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head = f"format binary_little_endian 1.0\ncomment strips\n{vertex}element tristrips 1\nproperty list int int vertex_indices\n"
    packed = np.array([len(strip), *strip], "<i4").tobytes()
    (folder / "strips.ply").write_bytes(_ply(head, corners.astype("<f4").tobytes(), packed))
    faces = np.array([[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    head = f"format binary_big_endian 1.0\n{vertex}element face 6\nproperty list uchar int vertex_indices\n"
    (folder / "quads.ply").write_bytes(_ply(head, corners.astype(">f4").tobytes(), *(b"\x04" + f.astype(">i4").tobytes() for f in faces)))

    head = "format ascii 1.0\nelement vertex 60\n" + "".join(f"property double {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    (folder / "cloud-ascii.ply").write_bytes(_ply(head, "".join(" ".join(f"{v:.5f}" for v in row) + "\n" for row in both).encode()))
    head = head.replace("ascii", "binary_little_endian") + "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    rows = np.zeros(60, [("p", "<f8", 6), ("c", "u1", 3)])
    rows["p"] = both
    (folder / "cloud.ply").write_bytes(_ply(head, rows.tobytes()))
    (folder / "three.xyz").write_text("60\n" + "".join(" ".join(f"{v:.5f}" for v in row) + "\n" for row in points))
    (folder / "six.xyz").write_text("x,y,z,nx,ny,nz\n# a ball\n" + "".join(",".join(f"{v:.5f}" for v in row) + "\n" for row in both))
    np.save(folder / "three.npy", points)
    np.save(folder / "six.npy", both.astype(np.float32))
    np.save(folder / "turned.npy", np.asfortranarray(both))


def _one_gltf(scene: trimesh.Scene) -> bytes:
    """A glTF file that holds its own buffers."""
    files = trimesh.exchange.gltf.export_gltf(scene)
    tree = json.loads(files["model.gltf"])
    for buffer in tree["buffers"]:
        buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(files[buffer["uri"]]).decode()
    return json.dumps(tree).encode()


def _recordings(folder: Path) -> None:
    """A hand that closes on a box, and a box that falls on a table: a few steps each."""
    world = qr.World(dt=2e-3)
    wood = qr.Material.preset("wood")
    world.add_body(qr.Surface.box((0.06, 0.06, 0.08), points=300), wood, mass=0.2, position=(0.0, 0.0, 0.04), name="box")
    hand = world.add_hand(position=(0.0, 0.0, 0.125), points=200, control_points=30)
    starts = [(-0.031, 0.0, -0.085), (0.031, 0.012, -0.085), (0.031, -0.012, -0.085)]
    grip = hand.grip(starts, [(1, 0, 0), (-1, 0, 0), (-1, 0, 0)], squeeze=4.0)

    def close() -> str:
        grip.update()
        return grip.state

    _record(folder / "hand.h5", world, 24, close)
    world = qr.World(dt=2e-3)
    world.add_body(qr.Surface.box((0.03, 0.03, 0.03), points=200), wood, mass=0.05, position=(0.0, 0.0, 0.0152), name="box")
    world.add_body(qr.Surface.box((0.06, 0.06, 0.01), points=300), wood, motion="fixed", position=(0.0, 0.0, -0.005), name="table")
    _record(folder / "box.h5", world, 15, lambda: "")


def _record(path: Path, world: qr.World, steps: int, act: Callable[[], str]) -> None:
    # Without the reports, which have the times that the steps took.
    with qr.record(world, path) as recording:
        for _ in range(steps):
            phase = act()
            world.step()
            recording.append(phase=phase)


def _takes(folder: Path) -> None:
    take = mocap.Take.pinch(rate=60.0)
    for name, start, count in (("short.take", 0, 8), ("middle.take.gz", 200, 8)):
        with mocap.TakeWriter(folder / "part.take") as writer:
            writer.note("a part")
            first = take.packets[start].arrival
            for packet in take.packets[start : start + count]:
                writer.packet(packet.arrival - first, packet.data)
        data = (folder / "part.take").read_bytes()
        (folder / name).write_bytes(gzip.compress(data, mtime=0) if name.endswith(".gz") else data)
    (folder / "part.take").unlink()
    # Packets as a capture of the network has them, without the heads of a take.
    (folder / "bare.txt").write_bytes(b"".join(packet.data for packet in take.packets[:5]))


def _contact_problems(folder: Path) -> None:
    rng = np.random.default_rng(5)
    half = rng.normal(size=(9, 9))
    dense = half @ half.T + 0.1 * np.eye(9)
    q, mu = rng.normal(size=9), np.array([0.5, 0.0, 1.2])
    reactions = qr.solve_contacts(dense, q, mu).reactions
    qr.ContactProblem(dense, q, mu, reactions).save(folder / "dense.npz")
    from scipy.sparse import block_diag

    sparse = block_diag([dense[:3, :3], dense[3:6, 3:6], dense[6:, 6:]], format="csr")
    qr.ContactProblem(sparse, q, mu).save(folder / "sparse.npz")
    for path in folder.iterdir():  # without the time of day in it
        with np.load(path) as file:
            np.savez(path, **{name: file[name] for name in file.files})


def _calibrations(folder: Path) -> None:
    mocap.Calibration((0.1, -0.2, 0.3), (1.0, 0.0, 0.0, 0.0)).write(folder / "room.toml")
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.1]])
    mocap.Calibration.from_points(corners, corners + 0.01 * corners[::-1]).write(folder / "fitted.toml")


def _snapshots(folder: Path) -> None:
    rubber = qr.Material.preset("rubber")
    half_space = rubber.replace(compliance="half-space")
    world = qr.World(collision_every=2)
    floor = qr.Surface.half_space(0.1, points=120, control_points=16)
    cube = qr.Surface.box((0.02, 0.02, 0.02), points=120, control_points=16)
    world.add_body(floor, half_space.replace(friction=qr.Friction(0.5, kinetic=0.3)), motion="fixed")
    bodies = [
        world.add_body(cube, material, mass=0.05, position=(0.018 * k, 0, 0.0101 + 0.001 * k))
        for k, material in enumerate((rubber, half_space, rubber))
    ]
    world.set_friction(bodies[0], bodies[1], 0.2)
    bodies[2].set_drive((0.03, 0, 0.01), stiffness=(50.0, 0.05), damping=(1.0, 0.001))
    world.step(10)
    (folder / "heap.bin").write_bytes(world.snapshot().to_bytes())
    world = qr.World()
    hand = world.add_hand(points=60, control_points=10)
    tips = hand.tip_poses()[0]
    world.add_body(cube, rubber, mass=0.05, position=tips[0])
    hand.joint_targets = hand.joint_positions + 0.1
    world.step(5)
    hand.move_to((0, 0, 0.001))
    (folder / "hand.bin").write_bytes(world.snapshot().to_bytes())


MAKERS: dict[str, Callable[[Path], None]] = {
    "objects": _objects,
    "recordings": _recordings,
    "takes": _takes,
    "contact_problems": _contact_problems,
    "calibrations": _calibrations,
    "snapshots": _snapshots,
}
