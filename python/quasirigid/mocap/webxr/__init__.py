"""Hands from a WebXR device: a page that streams their joints and shows the scene, and the server behind it.

``docs/webxr.md`` goes through it step by step.
"""

from quasirigid.mocap.webxr.joints import JOINTS, hand_frame
from quasirigid.mocap.webxr.placement import Placement
from quasirigid.mocap.webxr.server import IDLE, PORT, XrServer

__all__ = ["IDLE", "JOINTS", "PORT", "Placement", "XrServer", "hand_frame"]
