"""What users install: the wheel."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
MATURIN = shutil.which("maturin", path=str(Path(sys.executable).parent))


def tracked_files() -> set[str]:
    """Files of the package, by their names in the wheel."""
    listed = subprocess.run(["git", "ls-files", "-z", "python/quasirigid"], cwd=REPOSITORY, capture_output=True, timeout=30, check=True)
    names = listed.stdout.decode().split("\0")
    return {name.removeprefix("python/") for name in names if name and (REPOSITORY / name).exists()}


@pytest.mark.skipif(MATURIN is None or shutil.which("cargo") is None, reason="needs maturin and cargo")
@pytest.mark.skipif(not (REPOSITORY / ".git").exists() or shutil.which("git") is None, reason="needs a clone and git")
def test_the_wheel_holds_every_tracked_file_of_the_package(tmp_path: Path) -> None:
    assert MATURIN is not None
    # What `make setup` has built is packed as it is, in a second.
    command = [MATURIN, "build", "--release", "--locked", "--quiet", "--out", str(tmp_path)]
    built = subprocess.run(
        command, cwd=REPOSITORY, capture_output=True, text=True, timeout=600, env={**os.environ, "VIRTUAL_ENV": sys.prefix}
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = tracked_files()
    assert len(wanted) > 100, wanted
    missing = wanted - held
    assert not missing, f"{len(missing)} of {len(wanted)} files are not in the wheel: {', '.join(sorted(missing))}"
    other = {name for name in held if name.split("/")[0] != "quasirigid" and ".dist-info/" not in name}
    assert not other, f"the wheel holds more than the package: {', '.join(sorted(other))}"
    assert any(name.endswith("/THIRD-PARTY-LICENSES") for name in held), "the licenses of the crates are not in the wheel"
