"""Writes THIRD-PARTY-LICENSES: the crates that are linked into the compiled module, with their licenses. Prints what would change with --check.

After a change of Cargo.lock: python tools/third_party_licenses.py
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
FILE = REPOSITORY / "THIRD-PARTY-LICENSES"
ROOT = "quasirigid-python"
TARGETS = ("x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu", "x86_64-apple-darwin", "aarch64-apple-darwin", "x86_64-pc-windows-msvc")
"""Wheels can be built for these."""
NAMES = ("LICEN", "COPYING", "NOTICE", "UNLICENSE")
"""Beginnings of the names of files with licenses."""
HEAD = """The compiled module of quasirigid contains the following Rust packages (crates), each under its own license; where there are several to choose
from, all are given; and parts of Rust's standard library (MIT OR Apache-2.0). Made by tools/third_party_licenses.py. The page for headsets contains three.js, whose license is beside it in the package.
"""


def metadata(target: str) -> dict[str, Any]:
    """What cargo knows of the packages for a target, without a network if they are there."""
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", target]
    found: dict[str, Any] = json.loads(subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True).stdout)
    return found


def linked(target: str) -> dict[str, dict[str, Any]]:
    """Packages whose code is in the module by their ids. What runs while it is compiled (macros, build scripts, tests) is not in it."""
    found = metadata(target)
    packages = {package["id"]: package for package in found["packages"]}
    needs = {node["id"]: node["deps"] for node in found["resolve"]["nodes"]}
    waiting = [name for name, package in packages.items() if package["name"] == ROOT]
    reached: dict[str, dict[str, Any]] = {}
    while waiting:
        name = waiting.pop()
        package = packages[name]
        if name in reached or any("proc-macro" in part["kind"] for part in package["targets"]):
            continue
        reached[name] = package
        waiting += [need["pkg"] for need in needs[name] if any(kind["kind"] is None for kind in need["dep_kinds"])]
    return {name: package for name, package in reached.items() if package["source"] is not None}


def written() -> str:
    """The file."""
    crates: dict[str, dict[str, Any]] = {}
    for target in TARGETS:
        crates |= linked(target)
    texts: dict[str, tuple[str, list[str]]] = {}
    lines = [HEAD]
    for crate in sorted(crates.values(), key=lambda crate: (crate["name"], crate["version"])):
        title = f"{crate['name']} {crate['version']}"
        lines.append(f"{title}: {crate['license']}")
        files = sorted(
            path for path in Path(crate["manifest_path"]).parent.iterdir() if path.is_file() and path.name.upper().startswith(NAMES)
        )
        if not files and "Apache-2.0" in crate["license"].replace("/", " OR ").split(" OR "):
            files = [REPOSITORY / "LICENSE"]  # taken under that one, whose text is the same for everybody
        if not files:
            raise SystemExit(f"{title} ships no license; add the text of its repository by hand")
        for path in files:
            text = "\n".join(line.rstrip() for line in path.read_text(encoding="utf-8").strip().splitlines())
            texts.setdefault(" ".join(text.split()), (text, []))[1].append(title)
    for text, titles in texts.values():
        lines += ["", "=" * 100, f"Of {', '.join(dict.fromkeys(titles))}:", "", text]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Write the file, or say whether it is as it should be."""
    text = written()
    if "--check" in sys.argv[1:]:
        same = FILE.exists() and FILE.read_text(encoding="utf-8") == text
        print(f"{FILE.name}: {'up to date' if same else 'out of date; run python tools/third_party_licenses.py'}")
        return 0 if same else 1
    FILE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
