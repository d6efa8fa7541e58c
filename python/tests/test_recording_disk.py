"""A recording that cannot be written is a typed error, and what was there before stays until there is something better in its place."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from test_recording import COLUMNS, check, row
from test_recording_writer import child

from quasirigid.recording.reader import Recording
from quasirigid.recording.recorder import Recorder

NO_ROOM = """
    import resource, sys
    import numpy as np
    from pathlib import Path
    from test_recording import COLUMNS, Recorder, row
    from quasirigid.errors import RecordingError
    path = Path(sys.argv[1])
    old, rng = path.read_bytes(), np.random.default_rng(0)
    rows = [{**row(i), "contacts/point": rng.normal(size=(80, 3)), "contacts/gap": rng.normal(size=80)} for i in range(350)]
    for room in [*range(0, 120_000, 8_000), *range(120_000, 1_200_000, 90_000)]:
        path.write_bytes(old)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))  # as a disk with so much room
        try:
            with Recorder(path, COLUMNS) as recorder:
                for values in rows:
                    recorder.append(values)
            end = "whole"
        except RecordingError as error:
            end = "full" if "free some space on the disk" in str(error) else str(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        left = [file.name for file in path.parent.iterdir() if file != path]
        print(room, end, "old" if path.read_bytes() == old else "new", *left, flush=True)
        if path.read_bytes() != old:
            Path(sys.argv[2], f"{room}.h5").write_bytes(path.read_bytes())
"""


def write(path: Path, steps: int) -> None:
    with Recorder(path, COLUMNS) as recorder:
        for i in range(steps):
            recorder.append(row(i))


def test_a_disk_without_room_is_told_wherever_it_ends_and_the_old_recording_stays(tmp_path: Path) -> None:
    """From no room at all to room enough."""
    for directory in ("here", "kept"):
        (tmp_path / directory).mkdir()
    path = tmp_path / "here" / "r.h5"
    write(path, 5)
    done = child(NO_ROOM, str(path), str(tmp_path / "kept"))
    assert done.returncode == 0, f"it died (exit {done.returncode}) after {done.stdout[-200:]}: {done.stderr[-500:]}"
    ends = [line.split() for line in done.stdout.splitlines()]
    assert len(ends) == 27
    wrong = [line for line in ends if line[1] not in ("full", "whole") or line[3:]]
    assert wrong == [], "an error that does not say what is wrong, or something that is left lying about"
    assert [line[1] for line in ends] == sorted(line[1] for line in ends), "with more room it fares no worse"
    begun = [line for line in ends if line[2] == "new"]
    assert {line[1] for line in begun} == {"full", "whole"}, "no run reached its first block, or none reached its end"
    for room, end, _ in (begun[0], begun[len(begun) // 2], begun[-1]):
        with Recording(tmp_path / "kept" / f"{room}.h5") as recording:
            assert recording.steps >= 100, f"with {room} bytes there is no block on disk, and the old recording is gone"
            assert recording.complete == (end == "whole")
            assert recording["time"].tolist() == [row(i)["time"] for i in range(recording.steps)]


def killed(path: Path, steps: int) -> None:
    """A run that is killed after so many steps."""
    program = "import os, signal, sys; from test_recording import COLUMNS, Recorder, row; recorder = Recorder(sys.argv[1], COLUMNS)\n"
    program += f"for i in range({steps}): recorder.append(row(i))\nos.kill(os.getpid(), signal.SIGKILL)"
    assert child(program, str(path)).returncode == -signal.SIGKILL


def test_a_run_that_is_killed_before_its_first_block_leaves_the_old_recording(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write(path, 120)
    before = path.read_bytes()
    for steps in (0, 99):
        killed(path, steps)
        assert path.read_bytes() == before, f"killed after {steps} steps"
    # What it left is used by the next one, which leaves nothing.
    write(path, 7)
    assert check(path, 7) == 7
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_of_many_that_begin_at_once_where_a_killed_run_left_its_lock_one_records(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    program = """
import sys
from test_recording import COLUMNS, Recorder, row
from quasirigid.errors import RecordingError
print("ready", flush=True)
for _ in range(12):
    sys.stdin.readline()
    try:
        recorder = Recorder(sys.argv[1], COLUMNS)
        print("mine", flush=True)
        sys.stdin.readline()
        recorder.discard()
    except RecordingError as error:
        print("another's" if "being recorded to" in str(error) else error, flush=True)
        sys.stdin.readline()
    print("done", flush=True)
"""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    command = [sys.executable, "-c", program, str(path)]
    runs = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=env) for _ in range(3)]

    def ask() -> list[str]:
        for run in runs:
            assert run.stdin is not None
            run.stdin.write("\n")
        return [run.stdout.readline().strip() for run in runs if run.stdout is not None]

    try:
        assert [run.stdout.readline().strip() for run in runs if run.stdout is not None] == ["ready"] * 3
        for _ in range(12):
            (tmp_path / ".r.h5.lock").touch()
            (tmp_path / ".r.h5.new").write_text("what a killed run left")
            assert sorted(ask()) == ["another's", "another's", "mine"]
            assert ask() == ["done"] * 3
            assert list(tmp_path.iterdir()) == [], "nothing stays"
    finally:
        for run in runs:
            run.kill()
            run.communicate()
