"""A pad of finite elements as a compliance of its surface.

`condense` makes a mesh of your own into what ``Material.replace(compliance=...)`` takes.
"""

from quasirigid.pads.condensation import condense

__all__ = ["condense"]
