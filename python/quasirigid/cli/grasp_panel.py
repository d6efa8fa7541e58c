"""How a grasp went, as the command line shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from quasirigid.units import in_small_units, mass_words, percent, plain

if TYPE_CHECKING:
    from quasirigid.grasp.run import GraspResult


def grasp_panel(result: GraspResult) -> Panel:
    """The figures of a grasp, framed in green if the object was held and in red if not."""
    s = result.summary
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim", min_width=16)
    table.add_column()

    def per_finger(key: str) -> str:
        return "  ".join(f"{name.replace('_', ' ')} {force:.2f}" for name, force in zip(s["fingers"], s[key], strict=True)) + " N"

    table.add_row(
        "object", f"{escape(s['object'])}, {mass_words(s['object_mass_kg'])}, taken {s['approach']}, {1e3 * s['grasp_width_m']:.0f} mm wide"
    )
    table.add_row(
        "squeeze",
        f"{in_small_units(s['squeeze_n'], 'N')}, friction {plain(s['friction'], 2)}, "
        f"{s['compliance']} compliance, {s['object_motion']} bodies",
    )
    if s["drift_m_per_s"] is not None:
        drift = f"{in_small_units(s['drift_m_per_s'], 'm/s')}, {in_small_units(s['spin_rad_per_s'], 'rad/s')}"
        table.add_row("drift", drift + " in the hand, over the last second of the hold")
    if s["normal_force_n"] is not None:
        table.add_row("pressing", per_finger("normal_force_n") + ", mean of the last second of the hold")
        table.add_row("friction", per_finger("tangential_force_n") + ", mean of the same second")
        table.add_row("slip margin", f"{100 * s['slip_margin']:.0f} % of the friction limit left on the weakest finger")
        table.add_row("balance", f"weight and contact forces agree within {percent(s['support_error'])}")
        table.add_row("overlap", f"{in_small_units(s['overlap_max_m'], 'm')} left at the deepest contact")
    if s["indentation_max"] > 0.0:
        table.add_row("indentation", f"up to {percent(s['indentation_max'])} of the thickness of a pad")
    missed = f", [red]{s['unconverged_steps']} steps did not converge[/red]" if s["unconverged_steps"] else ", every step converged"
    table.add_row("contacts", f"up to {s['contacts']}, residual up to {s['residual_max']:.1e}{missed}")
    speed = f"{s['step_ms_median']:.3f} ms median, {s['step_ms_p99']:.3f} ms p99"
    table.add_row("step", f"{speed}, {plain(s['real_time_factor'], 2)} x real time, {s['steps']} steps")
    notes = [f"[yellow]note[/yellow] {escape(note)}" for note in s["warnings"]]
    where = f"[dim]summary, recording and {len(result.plots)} plots in[/dim] {escape(str(result.summary_file.parent))}"
    verdict = "[bold green]held[/bold green]" if s["held"] else f"[bold red]dropped[/bold red] in the phase [bold]{_last_phase(s)}[/bold]"
    return Panel(
        Group(verdict, "", table, "", *notes, where),
        title="grasp",
        title_align="left",
        border_style="green" if s["held"] else "red",
        expand=False,
    )


def _last_phase(summary: dict[str, Any]) -> str:
    names = [phase["name"] for phase in summary["phases"] if phase["name"] != "fall"]
    return str(names[-1]) if names else "close"
