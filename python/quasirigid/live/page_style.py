"""How the page looks in a narrow window, such as that of a phone: a style sheet for viser's panel, which is a sheet at the bottom there."""

from __future__ import annotations

from quasirigid.live.framing import SHEET

NARROW = "36em"
"""Up to this width viser shows one sheet at the bottom in place of panels at the sides."""
PANEL = '[aria-label$="panel Sensors"]'
"""The header of the panel of the sensors in the sheet."""

SHEET_CONTENT = f".mantine-Paper-root:has({PANEL}) .mantine-ScrollArea-content > div"

STYLE = f"""<style>
@media (max-width: {NARROW}) {{
  .mantine-Paper-root:has({PANEL}) {{ width: 100% !important; max-height: {100 * SHEET:.0f}% !important; }}
  .mantine-Paper-root:has({PANEL}) .mantine-ScrollArea-content {{ display: block !important; min-width: 0 !important; }}
  .mantine-Paper-root:has({PANEL}) .mantine-ScrollArea-viewport {{ overflow-x: hidden !important; }}
  {SHEET_CONTENT} {{ width: 100vw !important; }}
  {SHEET_CONTENT} > div:has({PANEL}) {{ display: flex; flex-direction: column; }}
  {SHEET_CONTENT} > div > div:has({PANEL}) {{ order: -1; }}
}}
</style>"""
"""HTML that makes the sheet as wide as the window and no higher than what the camera leaves free, with the sensors above the controls."""
