"""What comes from others is the very thing that was chosen: packages by their hashes, crates with their licenses, three.js by its digest;
and what is not known of them is said.
"""

import base64
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import running_browser

from quasirigid.mocap.webxr import XrServer

REPOSITORY = Path(__file__).resolve().parents[2]
STATIC = REPOSITORY / "python" / "quasirigid" / "mocap" / "webxr" / "static"
LOCKS = ("requirements.lock", "tools/audit/requirements.lock")


def pinned(lock: str) -> dict[str, list[tuple[str, int]]]:
    """Versions and numbers of hashes by the names in a lock file; every line of it is one of them, or a comment."""
    text = re.sub(r" *\\\n +", " ", (REPOSITORY / lock).read_text())
    found: dict[str, list[tuple[str, int]]] = {}
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = re.fullmatch(r"([a-z0-9-]+)==([^ ;]+)( ; .*?)?((?: --hash=sha256:[0-9a-f]{64})*)", line)
        assert match, f"{lock}: {line[:100]}"
        found.setdefault(match[1], []).append((match[2], match[4].count("--hash")))
    return found


@pytest.mark.parametrize("lock", LOCKS)
def test_every_package_is_pinned_to_a_version_and_to_hashes(lock: str) -> None:
    found = pinned(lock)
    without = [name for name, versions in found.items() if any(hashes == 0 for _, hashes in versions)]
    assert not without, f"{lock}: {without}"
    wanted = [
        re.match(r"[a-z0-9-]+", line) for line in (REPOSITORY / lock).with_suffix(".in").read_text().splitlines() if line and line[0] != "#"
    ]
    assert wanted
    for name in wanted:
        assert name
        assert name[0] in found, f"{lock} is older than its .in: {name[0]}"
    assert "://" not in (REPOSITORY / lock).read_text(), "where packages come from is the reader's choice"


def test_what_the_package_needs_is_in_the_lock_file() -> None:
    found = pinned("requirements.lock")
    needed = re.findall(r'^    "([a-z0-9-]+)[><=]', (REPOSITORY / "pyproject.toml").read_text(), re.MULTILINE)
    assert len(needed) > 8
    assert not [name for name in needed if name not in found]


def test_make_installs_nothing_without_its_hash() -> None:
    installs = [line for line in (REPOSITORY / "Makefile").read_text().splitlines() if "pip install" in line]
    assert len(installs) >= 2
    assert all("--require-hashes" in line for line in installs), installs


def test_licenses_of_all_linked_crates_are_in_the_package_and_of_no_others() -> None:
    if subprocess.run(
        ["cargo", "metadata", "--no-deps", "--format-version", "1"], cwd=REPOSITORY, capture_output=True, check=False
    ).returncode:
        pytest.skip("no cargo")
    sys.path.insert(0, str(REPOSITORY / "tools"))
    try:
        import third_party_licenses as tool
    finally:
        sys.path.pop(0)
    host = re.search(r"host: (\S+)", subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout)
    assert host
    crates = {f"{crate['name']} {crate['version']}" for crate in tool.linked(host[1]).values()}
    text = (REPOSITORY / "THIRD-PARTY-LICENSES").read_text()
    listed = set(re.findall(r"^([\w-]+ \d[^: ]*): ", text, re.MULTILINE))
    texts = {title for line in re.findall(r"^Of (.*):$", text, re.MULTILINE) for title in line.split(", ")}
    locked = set(map(" ".join, re.findall(r'name = "(.*)"\nversion = "(.*)"', (REPOSITORY / "Cargo.lock").read_text())))
    again = "run python tools/third_party_licenses.py"
    assert len(crates) > 30
    assert not crates - listed, f"{again}: {sorted(crates - listed)}"
    assert not listed - locked, f"{again}: {sorted(listed - locked)}"
    assert not listed - texts, f"without a text: {sorted(listed - texts)}"
    assert '"THIRD-PARTY-LICENSES"' in (REPOSITORY / "pyproject.toml").read_text(), "it goes into the wheel"


def digest(content: bytes) -> str:
    return "sha384-" + base64.b64encode(hashlib.sha384(content).digest()).decode()


def test_three_js_is_the_file_that_the_page_asks_for_of_the_version_that_is_named() -> None:
    content = (STATIC / "three.js").read_bytes()
    page = (STATIC / "index.html").read_text()
    link = re.search(r'<link rel="modulepreload" href="three.js" integrity="(.*?)" />', page)
    assert link
    assert link[1] == digest(content), "after a new build, write this into index.html"
    assert link.start() < page.index("<script"), "it must be known before a module imports it"
    chosen = json.loads((REPOSITORY / "tools" / "webxr" / "package.json").read_text())["devDependencies"]
    assert f"three.js {chosen['three']}," in (REPOSITORY / "NOTICE").read_text()
    assert chosen["three"].split(".")[1].encode() in re.findall(rb'"(\d+)"', content), "the revision in the file itself"
    packages = json.loads((REPOSITORY / "tools" / "webxr" / "package-lock.json").read_text())["packages"]
    for name, version in chosen.items():
        assert packages[f"node_modules/{name}"]["version"] == version, f"{name} is not pinned to one version"
    loose = [name for name, package in packages.items() if name and not package.get("integrity", "").startswith("sha512-")]
    assert not loose, loose


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


@pytest.mark.parametrize("changed", [False, True])
def test_a_browser_runs_three_js_only_if_it_is_the_one_that_was_chosen(browser: Any, changed: bool) -> None:
    with XrServer(0) as server:
        if changed:
            kind, content = server._files["/three.js"]
            server._files["/three.js"] = kind, content + b"\n"
        page = browser.new_page()
        said: list[str] = []
        page.on("console", lambda message: said.append(message.text))
        page.goto(server.url)
        end = time.monotonic() + (5.0 if changed else 45.0)
        while time.monotonic() < end and not page.locator("canvas").count():
            page.wait_for_timeout(100)
        assert page.locator("canvas").count() == (0 if changed else 1), said
        if changed:
            assert any("integrity" in text for text in said), said
        page.close()


TOOLS = {
    "cargo-deny": 'case "$*" in *"fetch db"*) exit $FETCH;; *advisories*) exit $ADVISORIES;; *) exit $RULES;; esac',
    "pip-audit": 'printf "%s" "$ANSWER"; echo "$TROUBLE" >&2; exit $AUDIT',
}
FINE = '{"dependencies": [{"name": "numpy", "version": "2.4.6", "vulns": []}]}'
SKIPPED = '{"dependencies": [{"name": "numpy", "skip_reason": "Dependency not found on PyPI"}]}'
BAD = '{"dependencies": [{"name": "numpy", "version": "1", "vulns": [{"id": "PYSEC-1"}]}, {"name": "rich", "skip_reason": "not found"}]}'


@pytest.mark.parametrize(
    ("code", "says", "changes"),
    [
        (0, "nothing found", {}),
        (1, "licenses and sources of crates: FOUND", {"RULES": "1"}),
        (1, "advisories on crates: FOUND", {"ADVISORIES": "1"}),
        (3, "advisories on crates: NOT CHECKED: the database could not be reached", {"FETCH": "1"}),
        (3, "requirements.lock: NOT CHECKED: the database could not be reached", {"ANSWER": "", "AUDIT": "1"}),
        (3, "requirements.lock: NOT CHECKED: the database could not be reached", {"ANSWER": SKIPPED}),
        (1, "requirements.lock: FOUND", {"ANSWER": BAD, "AUDIT": "1", "FETCH": "1"}),
        (4, "crates: NOT CHECKED: the tool is missing", {"WITHOUT": "cargo-deny"}),
    ],
)
def test_an_audit_that_reached_no_database_does_not_pass_for_one_that_found_nothing(
    tmp_path: Path, code: int, says: str, changes: dict[str, str]
) -> None:
    for name, script in TOOLS.items():
        if name != changes.get("WITHOUT"):
            (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
            (tmp_path / name).chmod(0o755)
    usual = {"FETCH": "0", "ADVISORIES": "0", "RULES": "0", "AUDIT": "0", "ANSWER": FINE, "TROUBLE": "no route"}
    # The interpreter under a name of its own: beside it there is no pip-audit that would come first.
    (tmp_path / "python").symlink_to(os.path.realpath(sys.executable))
    done = subprocess.run(
        [str(tmp_path / "python"), "-S", str(REPOSITORY / "tools" / "audit" / "audit.py")],
        env={"PATH": f"{tmp_path}:/usr/bin:/bin", **usual, **changes},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == code, done
    assert says in done.stdout, done.stdout
    assert ("NOT CHECKED" in done.stdout) == (code in (3, 4) or changes.get("FETCH") == "1"), done.stdout
