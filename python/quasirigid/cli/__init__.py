"""The command line, one file for each family of commands. ``main`` is the program ``quasirigid``."""

from quasirigid.cli.app import main

__all__ = ["main"]
