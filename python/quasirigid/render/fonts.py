"""What matplotlib says of fonts when it first runs on a machine is not passed on by a program of ours."""

from __future__ import annotations

import logging

FONT_TALK = ("findfont: ", "Matplotlib is building the font cache")
"""What matplotlib says of fonts when it first runs on a machine: pictures have the font that it ships, and need no other."""


def _not_of_fonts(record: logging.LogRecord) -> bool:
    return not record.getMessage().startswith(FONT_TALK)


def quiet_fonts() -> None:
    """Leave out ``FONT_TALK``, and nothing else. For programs: a library leaves the logs of others alone."""
    logging.getLogger("matplotlib.font_manager").addFilter(_not_of_fonts)
