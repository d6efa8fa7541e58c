"""How deep pads are pressed in, and what to say where that is too deep for the stiffness that they have."""

from __future__ import annotations

TRUSTED_INDENTATION = 0.5
"""Indentation over the thickness of a layer up to which small strains are trusted."""


def indentation_note(indentation: float | None) -> list[str]:
    """What to say of the deepest indentation over the thickness of its layer: a note, or none."""
    if indentation is None or indentation <= TRUSTED_INDENTATION:
        return []
    said = f"a pad is pressed in by {100 * indentation:.0f} % of its thickness: beyond {100 * TRUSTED_INDENTATION:.0f} % its stiffness"
    return [f"{said} is not to be trusted, a real one is stiffer"]
