"""No circle between source files: what a file needs can be read before it, in the engine, in the binding and in the package.

An arrow goes from a file to each file that it names in an import (Rust: also in a path in the code). That a folder's own file (`mod.rs`,
`__init__.py`) names its children is no arrow: that is how a folder lists what is in it.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

Arrows = dict[str, set[str]]


def circles(arrows: Arrows) -> list[list[str]]:
    """Strongly connected components of more than one file (Tarjan), each sorted."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(file: str) -> None:
        index[file] = low[file] = len(index)
        stack.append(file)
        for other in sorted(arrows.get(file, ())):
            if other not in index:
                visit(other)
                low[file] = min(low[file], low[other])
            elif other in stack:
                low[file] = min(low[file], index[other])
        if low[file] == index[file]:
            circle = stack[stack.index(file) :]
            del stack[stack.index(file) :]
            if len(circle) > 1:
                found.append(sorted(circle))

    for file in sorted(arrows):
        if file not in index:
            visit(file)
    return found


def without_comments(text: str) -> str:
    return re.sub(r"//[^\n]*", "", text)


def rust_module(file: Path, source: Path) -> tuple[str, ...]:
    parts = file.relative_to(source).with_suffix("").parts
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


def rust_uses(text: str, module: tuple[str, ...]) -> set[tuple[str, ...]]:
    """The paths that a file names, absolute, without `crate`."""
    paths: set[tuple[str, ...]] = set()

    def expand(prefix: tuple[str, ...], tree: str) -> None:
        tree = tree.strip()
        if tree.startswith("{"):
            depth, start = 0, 1
            for k, letter in enumerate(tree):
                depth += (letter == "{") - (letter == "}")
                if (letter == "," and depth == 1) or (letter == "}" and depth == 0):
                    if tree[start:k].strip():
                        expand(prefix, tree[start:k])
                    start = k + 1
            return
        head, *rest = tree.split("::", 1)
        head = head.split(" as ")[0].strip()
        step = {"crate": (), "super": prefix[:-1] if prefix else module[:-1], "self": prefix or module}.get(head, (*prefix, head))
        if rest:
            expand(step, rest[0])
        else:
            paths.add(step)

    for use in re.findall(r"^\s*(?:pub(?:\([^)]*\))? )?use ((?:crate|super|self)\b[^;]*);", text, flags=re.MULTILINE):
        expand((), use)
    for path in re.findall(r"\bcrate(?:::\w+)+", re.sub(r"^\s*(?:pub(?:\([^)]*\))? )?use [^;]*;", "", text, flags=re.MULTILINE)):
        paths.add(tuple(path.split("::")[1:]))
    return paths


def rust_arrows(source: Path) -> Arrows:
    modules = {rust_module(file, source): file for file in source.rglob("*.rs")}
    reexports = {module: rust_reexports(file, module, modules) for module, file in modules.items()}
    arrows: Arrows = {}
    for module, file in modules.items():
        if file.stem == "tests":
            continue
        code = without_comments(file.read_text()).split("#[cfg(test)]")[0]
        to: set[str] = set()
        for path in rust_uses(code, module):
            target = resolve(path, modules, reexports)
            child_of_own_folder = file.name in ("mod.rs", "lib.rs") and target[: len(module)] == module
            if target and target != module and target in modules and not child_of_own_folder:
                to.add(str(modules[target].relative_to(source)))
        arrows[str(file.relative_to(source))] = to
    return arrows


def rust_reexports(file: Path, module: tuple[str, ...], modules: dict[tuple[str, ...], Path]) -> dict[str, tuple[str, ...]]:
    """Names that a folder's file hands on, with the file that has them."""
    found: dict[str, tuple[str, ...]] = {}
    for use in re.findall(r"^pub(?:\([^)]*\))? use ([^;]*);", without_comments(file.read_text()), flags=re.MULTILINE):
        for path in rust_uses(f"use self::{use};", module):
            if path[:-1] in modules:
                found[path[-1]] = path
    return found


def resolve(
    path: tuple[str, ...], modules: dict[tuple[str, ...], Path], reexports: dict[tuple[str, ...], dict[str, tuple[str, ...]]]
) -> tuple[str, ...]:
    """The module that a path leads to: the deepest that there is, through what folders hand on."""
    for _ in range(5):
        k = len(path)
        while k and path[:k] not in modules:
            k -= 1
        module, rest = path[:k], path[k:]
        if rest and rest[0] in reexports.get(module, {}):
            path = (*reexports[module][rest[0]], *rest[1:])
            continue
        return module
    return path


def test_rust_paths_are_read_as_the_compiler_reads_them() -> None:
    text = "use crate::{a::B, c};\nuse super::d::{E, f::{self, G}};\nfn x() { crate::h::i(); }"
    expected = {("a", "B"), ("c",), ("m", "d", "E"), ("m", "d", "f"), ("m", "d", "f", "G"), ("h", "i")}
    assert rust_uses(text, ("m", "n")) == expected, rust_uses(text, ("m", "n"))


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == [["b", "c"]]


NOT_YET = pytest.mark.xfail(strict=True, reason="has circles that are still to be opened")


@pytest.mark.parametrize("crate", ["quasirigid", "quasirigid-python", "quasirigid-mocap"])
def test_no_circle_between_the_files_of_a_crate(crate: str) -> None:
    found = circles(rust_arrows(ROOT / "crates" / crate / "src"))
    assert not found, "\n".join(" <-> ".join(circle) for circle in found)


# What may know what, in the engine: each folder only folders to its right. The order of `docs/architecture.md`.
ORDER = [
    "scenes",
    "control",
    "step",
    "world",
    "constrained_motion",
    "collision",
    "contact_problem",
    "pair",
    "free_motion",
    "objects",
    "params",
    "body",
    "collider",
    "solve_system",
    "gauss_seidel",
    "delassus",
    "linear",
    "surface",
    "slots",
    "threads",
    "interrupt",
    "math",
    "error",
]


def test_arrows_between_the_engines_folders_point_one_way() -> None:
    backwards = set()
    for file, others in rust_arrows(ROOT / "crates" / "quasirigid" / "src").items():
        for other in others:
            here, there = (path.split("/")[0].removesuffix(".rs") for path in (file, other))
            if "lib" not in (here, there) and ORDER.index(here) > ORDER.index(there):
                backwards.add(f"{file} -> {other}")
    assert not backwards, "\n".join(sorted(backwards))


def python_arrows(package: Path) -> Arrows:
    files = {
        ".".join(("quasirigid", *file.relative_to(package).with_suffix("").parts)).removesuffix(".__init__"): file
        for file in package.rglob("*.py")
    }
    arrows: Arrows = {}
    for name, file in files.items():
        to: set[str] = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                targets = [f"{node.module}.{alias.name}" if f"{node.module}.{alias.name}" in files else node.module for alias in node.names]
            elif isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            else:
                continue
            is_folder = file.name == "__init__.py"
            to |= {t for t in targets if t in files and t != name and not (is_folder and t.startswith(name + "."))}
        arrows[name] = to
    return arrows


def test_no_circle_between_the_files_of_the_package() -> None:
    found = circles(python_arrows(ROOT / "python" / "quasirigid"))
    assert not found, "\n".join(" <-> ".join(circle) for circle in found)


# What may know what, in the package: each folder only folders to its right. The order of `docs/architecture.md`.
PACKAGE_ORDER = [
    "cli",
    "benchmark",
    "view",
    "live",
    "mocap",
    "grasp",
    "render",
    "recording",
    "scene",
    "objects",
    "solver",
    "pads",
    "net",
    "system",
    "units",
    "rotation",
    "arrays",
    "errors",
    "_moved",
]


def test_arrows_between_the_packages_folders_point_one_way() -> None:
    backwards = set()
    for name, others in python_arrows(ROOT / "python" / "quasirigid").items():
        for other in others:
            here, there = ((*path.split("."), "")[1] for path in (name, other))
            if here and there and PACKAGE_ORDER.index(here) > PACKAGE_ORDER.index(there):
                backwards.add(f"{name} -> {other}")
    assert not backwards, "\n".join(sorted(backwards))


def test_types_of_arrays_and_rotations_are_defined_once() -> None:
    package = ROOT / "python" / "quasirigid"
    again = []
    for file in package.rglob("*.py"):
        name, text = str(file.relative_to(package)), file.read_text()
        if name != "arrays/types.py":
            again += [
                f"{name}: {line}" for line in re.findall(r"^\w+ = (?:npt\.)?NDArray\[(?:np\.float64|np\.int64|np\.bool_)\]", text, re.M)
            ]
        if name != "rotation.py":
            words = "quaternion_product|quaternion_of|conjugate|rotate|rotation_angle|rotation_vector|matrix_of|pose_in"
            again += [f"{name}: {line}" for line in re.findall(rf"^def (?:{words})\b", text, re.M)]
    assert not again, "\n".join(again)
