"""``quasirigid materials``: what ``--material`` knows."""

from __future__ import annotations

import typer
from rich.console import Console
from rich.table import Table


def materials() -> None:
    """List the materials that --material knows."""
    from quasirigid._quasirigid import Material

    table = Table(title="Materials", title_justify="left", header_style="bold", box=None, pad_edge=False)
    table.add_column("name", style="cyan", no_wrap=True)
    for heading in (
        "density\nkg/m³",
        "friction\non itself",
        "Young's\nMPa",
        "Poisson's\nratio",
        "layer\nmm",
        "relaxation\nms",
    ):
        table.add_column(heading, justify="right")
    for name in Material.preset_names():
        m = Material.preset(name)
        figures = (m.density, m.friction, 1e-6 * m.young_modulus, m.poisson_ratio, 1e3 * m.layer_thickness, 1e3 * m.relaxation_time)
        table.add_row(name, *(f"{figure:,.4g}" if figure < 1e4 else f"{figure:,.0f}" for figure in figures))
    Console().print(table)
    Console().print("[dim]Two materials have the geometric mean of their frictions. The fingers are of fingertip_pulp.[/dim]")


def add_to(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command()(materials)
