"""Recordings: what happened in every step, in an HDF5 file. ``quasirigid.recording.reader`` says what is in one."""

from quasirigid.recording.reader import Column, Recording

__all__ = ["Column", "Recording"]
