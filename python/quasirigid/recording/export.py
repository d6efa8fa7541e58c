"""``quasirigid export``: a recording as tidy tables, one row per step, pose, finger or contact, with units in the names of the columns.

``steps``, ``poses``, ``fingers`` and ``contacts`` share ``step`` and ``time_s``: join on these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import STAGES
from quasirigid.errors import MissingPackageError
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.recording.window import window_of
from quasirigid.scene.contact_fields import EXPORTED_FIRST, FIELD_OF, RECORDED_FIELDS, recorded_values

READ = 2**14
"""Rows read at a time."""
XYZ = ("x", "y", "z")
Columns = dict[str, npt.NDArray[Any]]
Progress = Callable[[str, float], None]
Format = Literal["csv", "parquet"]


def tables(recording: SceneRecording) -> dict[str, Callable[[npt.NDArray[np.int64]], Columns]]:
    """The tables by name: each makes its columns for some steps."""
    made: dict[str, Callable[[npt.NDArray[np.int64]], Columns]] = {
        "steps": lambda steps: _steps(recording, steps),
        "poses": lambda steps: _poses(recording, steps),
    }
    if recording.model.fingers:
        made["fingers"] = lambda steps: _fingers(recording, steps)
    made["contacts"] = lambda steps: _contacts(recording, steps)
    return made


def _taken(recording: SceneRecording, name: str, rows: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Some rows of a column, in rising order. What lies between them is read too, but not all of it at a time."""
    columns = recording.columns
    pieces = np.split(rows, np.flatnonzero(np.diff(rows // READ)) + 1) if len(rows) else []
    parts = [columns.slice(name, int(piece[0]), int(piece[-1]) + 1)[piece - piece[0]] for piece in pieces]
    return np.concatenate(parts) if parts else columns.slice(name, 0, 0)


def _key(recording: SceneRecording, steps: npt.NDArray[np.int64], counts: npt.NDArray[np.int64] | int = 1) -> Columns:
    return {"step": np.repeat(steps, counts), "time_s": np.repeat(recording.times[steps], counts)}


def _steps(recording: SceneRecording, steps: npt.NDArray[np.int64]) -> Columns:
    columns: Columns = {**_key(recording, steps), "phase": np.array([recording.phase(int(step)) for step in steps])}
    for name in ("contacts", "sweeps", "residual", "converged", "coarse", "quarantined"):
        columns[name] = _taken(recording, f"report/{name}", steps)
    columns["step_time_s"] = _taken(recording, "report/step_time", steps)
    stages = _taken(recording, "report/stage_times", steps)
    return {**columns, **{f"{name}_s": stages[:, i] for i, name in enumerate(STAGES)}}


def _poses(recording: SceneRecording, steps: npt.NDArray[np.int64]) -> Columns:
    frames = np.array(recording.columns.labels("frames/pose"))
    pose = _taken(recording, "frames/pose", steps).reshape(-1, 7)
    names = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
    return {
        **_key(recording, steps, len(frames)),
        "frame": np.tile(frames, len(steps)),
        **{name: pose[:, i] for i, name in enumerate(names)},
    }


def _fingers(recording: SceneRecording, steps: npt.NDArray[np.int64]) -> Columns:
    fingers = np.array(recording.model.fingers)
    force = _taken(recording, "fingers/force", steps).reshape(-1, 3)
    joints = _taken(recording, "hand/joint_positions", steps)
    columns: Columns = {**_key(recording, steps, len(fingers)), "finger": np.tile(fingers, len(steps))}
    columns |= {f"force_{axis}_n": force[:, i] for i, axis in enumerate(XYZ)}
    columns["normal_force_n"] = _taken(recording, "fingers/normal_force", steps).reshape(-1)
    # Bodies that were named as fingertips come first, and have no joints.
    all_joints = np.full((len(steps), len(fingers), joints.shape[-1]), np.nan)
    all_joints[:, len(fingers) - joints.shape[1] :] = joints
    return {**columns, **{f"joint_{i}_rad": all_joints[..., i].reshape(-1) for i in range(joints.shape[-1])}}


def _contacts(recording: SceneRecording, steps: npt.NDArray[np.int64]) -> Columns:
    bodies = np.array([body.name for body in recording.model.bodies] + [""])  # the last for -1: not drawn
    ends = recording.columns.slice("contacts/end", 0, int(steps[-1]) + 1)
    starts = np.concatenate([[0], ends])[steps]
    counts = ends[steps] - starts
    rows = np.concatenate([np.zeros(0, np.int64), *(np.arange(a, a + n) for a, n in zip(starts, counts, strict=True))])

    columns: Columns = _key(recording, steps, counts)
    others = [field.name for field in RECORDED_FIELDS if field.name not in EXPORTED_FIRST]
    for field in (FIELD_OF[name] for name in (*EXPORTED_FIRST, *others)):
        values = recorded_values(field, recording.contact_columns, lambda column: _taken(recording, f"contacts/{column}", rows), len(rows))
        if field.counts:
            values = bodies[values.astype(int)]
        elif field.labels:
            values = np.array(field.labels)[values]
        columns |= {name: values.reshape(len(rows), len(field.exported))[:, i] for i, name in enumerate(field.exported)}
    return columns


class _Sink(Protocol):
    def write(self, columns: Columns) -> None: ...


class _Csv:
    def __init__(self, file: Any) -> None:
        self._file = file
        self._begun = False

    def write(self, columns: Columns) -> None:
        if not self._begun:
            self._begun = True
            self._file.write(",".join(columns) + "\n")
        # As many digits as bring the same number back; names hold no comma that would need care.
        forms = {"f": {4: "%.9g", 8: "%r"}, "i": {}, "u": {}}
        line = ",".join(forms[v.dtype.kind].get(v.dtype.itemsize, "%d") if v.dtype.kind in forms else "%s" for v in columns.values()) + "\n"
        lists = [_quoted(values).tolist() for values in columns.values()]
        self._file.writelines(line % row for row in zip(*lists, strict=True))


def _quoted(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Texts as CSV wants them: in quotes where they hold a comma, a quote or a line break."""
    if values.dtype.kind != "U":
        return values
    unique, which = np.unique(values, return_inverse=True)
    safe = ['"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text for text in unique.tolist()]
    return np.array(safe, dtype=object)[which] if len(safe) else values


class _Parquet:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: Any = None

    def write(self, columns: Columns) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        # Texts need their type said: there may be none of them before the first contact.
        table = pa.table(
            {
                name: pa.array(values.tolist(), pa.string()) if values.dtype.kind == "U" else pa.array(values)
                for name, values in columns.items()
            }
        )
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, table.schema, compression="zstd")
        self._writer.write_table(table.cast(self._writer.schema))

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()


@contextmanager
def _csv_sink(path: Path) -> Iterator[_Sink]:
    with path.open("w", encoding="utf-8", newline="") as file:
        yield _Csv(file)


@contextmanager
def _parquet_sink(path: Path) -> Iterator[_Sink]:
    sink = _Parquet(path)
    try:
        yield sink
    finally:
        sink.close()


def export_tables(
    path: str | Path,
    out: str | Path,
    kind: Format,
    *,
    every: int = 1,
    start: float | None = None,
    end: float | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write the tables of the recording at ``path`` to the directory ``out`` as ``"csv"`` or ``"parquet"``; return their paths.

    ``every`` takes each n-th step, ``start`` and ``end`` (s) bound the time. Raises ``MissingPackageError`` if Parquet is asked for
    without pyarrow.
    """
    sinks: dict[Format, Callable[[Path], AbstractContextManager[_Sink]]] = {"csv": _csv_sink, "parquet": _parquet_sink}
    if kind == "parquet":
        try:
            import pyarrow.parquet  # noqa: F401
        except ImportError:
            raise MissingPackageError.of("pyarrow", "to write Parquet", "parquet") from None
    out = Path(out)
    written: list[Path] = []
    with SceneRecording(path) as recording:
        window = window_of(recording, every, start, end)
        out.mkdir(parents=True, exist_ok=True)
        made = tables(recording)
        for i, (name, columns_of) in enumerate(made.items()):
            file = out / f"{name}.{kind}"
            with sinks[kind](file) as sink:
                for steps in window.blocks():
                    sink.write(columns_of(steps))
                    if progress is not None:
                        done = (int(steps[-1]) - window.first + 1) / (window.last - window.first + 1)
                        progress(file.name, (i + done) / len(made))
            written.append(file)
    return written


__all__ = ["export_tables", "tables"]
