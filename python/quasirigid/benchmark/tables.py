"""What ``quasirigid bench`` prints: the paper's two tables beside ours, and the scaling."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

COLLISION = (
    ("traverse_ms", "traverse hierarchy"),
    ("interpenetration_ms", "interpenetration"),
    ("hierarchy_update_ms", "hierarchy update"),
)
RESOLUTION = (("w_rigid_ms", "fill W rigid"), ("w_deform_ms", "fill W deform"), ("gauss_seidel_ms", "Gauss-Seidel"))


def tables(results: dict[str, Any]) -> RenderableType:
    """All tables of one run."""
    return Group(
        _phases(results["phases"]),
        "",
        _contacts(results["scaling"]["contacts"]),
        _growth(results["scaling"]["growth"]),
        "",
        _points(results["scaling"]["points"]),
        *_notes(results),
    )


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)


def _phases(phases: list[dict[str, Any]]) -> Table:
    table = _table("The paper's grasp, ms a step: paper (2 GHz Pentium 4), ours with the hand shaken, ours at rest")
    table.add_column("")
    for number in range(1, len(phases) + 1):
        for heading in (f"step {number}\npaper", "\nmotion", "\nrest"):
            table.add_column(heading, justify="right", style="dim" if "paper" in heading else "")

    def row(label: str, key: str, form: str = ".3f", style: str = "") -> None:
        cells = []
        for phase in phases:
            for figures in (phase["paper"], phase, phase["at_rest"]):
                cells.append(format(figures[key], form) if key in figures else "")
        table.add_row(label, *cells, style=style)

    row("contacts", "contacts", "d")
    for key, label in COLLISION:
        row(label, key)
    for key, label in RESOLUTION:
        row(label, key)
    row("sweeps", "sweeps", "d")
    row("whole step, median", "total_ms", style="bold")
    row("whole step, p99", "total_p99_ms")
    row("CPU time, p99", "cpu_p99_ms")
    row("residual, largest", "residual", ".1e")
    ratios = []
    for phase in phases:
        ratios += ["", f"{phase['ratio_to_paper']:.0f} x", f"{phase['paper']['total_ms'] / phase['at_rest']['total_ms']:.0f} x"]
    table.add_row("paper / ours", *ratios, style="cyan")
    return table


def _contacts(rows: list[dict[str, Any]]) -> Table:
    table = _table("Two conforming surfaces, shaken and at rest")
    for heading in (
        "contacts",
        "threads",
        "sweeps",
        "ms\nmotion",
        "µs/contact\nmotion",
        "ms\nrest",
        "µs/contact\nrest",
        "residual\nlargest",
    ):
        table.add_column(heading, justify="right")
    for r in rows:
        rest = r["at_rest"]
        speed = (f"{r['total_ms']:.3f}", f"{r['us_per_contact']:.2f}", f"{rest['total_ms']:.3f}", f"{rest['us_per_contact']:.2f}")
        table.add_row(f"{r['contacts']:,}", str(r["threads"]), str(r["sweeps"]), *speed, f"{r['residual']:.1e}")
    return table


def _growth(growth: dict[str, Any]) -> Text:
    few, most = growth["from_contacts"], growth["to_contacts"]
    return Text(
        f"A contact among {most:,} costs {growth['in_motion']:.2f} times what it costs among {few:,} in motion, "
        f"{growth['at_rest']:.2f} times at rest.",
        style="cyan",
    )


def _points(rows: list[dict[str, Any]]) -> Table:
    table = _table("From points to a surface ready for contact: seconds, wall-clock (CPU)")
    for heading in ("points", "threads", "array: normals\nand areas", "array:\nnormals", "array:\nbare", "file:\nnormals", "file:\nbare"):
        table.add_column(heading, justify="right")
    ways = ("build", "build_with_normals", "build_from_bare_points", "file_with_normals", "file_of_bare_points")
    for r in rows:
        cells = (f"{r[f'{way}_s']:.2f} ({r[f'{way}_cpu_s']:.2f})" for way in ways)
        table.add_row(f"{r['points']:,}", str(r["threads"]), *cells)
    return table


def _notes(results: dict[str, Any]) -> list[RenderableType]:
    machine = results["machine"]
    notes: list[RenderableType] = [
        "",
        Text(f"{machine['processor']}, {machine['cores']} cores; quasirigid {results['quasirigid']}", style="dim"),
    ]
    if machine["load"] > 0.5 * machine["cores"]:
        load = machine["load"]
        text = f"The machine was busy (load {load:.1f} before the run): wall-clock times, p99 above all, include waiting for a core."
        notes.append(Text(text, style="yellow"))
    return notes
