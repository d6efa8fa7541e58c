"""Where feedback goes: what ``--feedback`` names."""

from __future__ import annotations

from collections.abc import Sequence

from quasirigid.mocap.feedback import RATE, Feedback, UdpFeedback
from quasirigid.mocap.feedback_server import WebsocketFeedback


def open_feedback(text: str, *, rate: float = RATE, allow_origins: Sequence[str] = ()) -> Feedback:
    """What ``--feedback`` names; ``allow_origins`` are pages of other machines that may listen at ``ws``. Raises ``InvalidValueError``, or
    ``NetworkError`` for a port in use.
    """
    if text.partition(":")[0] == "ws":
        return WebsocketFeedback(text, rate=rate, allow_origins=allow_origins)
    return UdpFeedback(text, rate=rate)
