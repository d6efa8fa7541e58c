"""Files from the page are refused when they are announced, not after they have arrived.

The page says how large a file is, and then sends it in parts. viser keeps the parts of whatever was announced; here what is too large is
not let in, so that no more than ``AT_ONCE`` files of the largest size are ever in memory. The page sends the parts all the same: they are
dropped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser
from viser._messages import FileTransferPart, FileTransferPartAck, FileTransferStartUpload, RemoveNotificationMessage

from quasirigid.errors import ObjectFileError

NOTICE = 10.0
"""How long the page says that a file was refused, s."""
AGAIN = 1.0
"""When the page's own notice is taken away once more, s."""
AT_ONCE = 3
"""Files of the largest size that may be on their way at once."""


def too_large(name: str, size: int, largest: int) -> ObjectFileError:
    """The error of a file of ``size`` bytes where ``largest`` are allowed."""
    expected, got = f"at most {largest // 1024**2} MB", f"{size / 1024**2:.1f} MB"
    return ObjectFileError(name, expected, got, "reduce the mesh, or use quasirigid view --object FILE")


class UploadGate:
    """Stands between the page and viser's upload button."""

    def __init__(self, server: viser.ViserServer, largest: int, refused: Callable[[str], None]) -> None:
        """``largest`` in bytes; ``refused`` is called with the reason why, on the server's event loop."""
        # viser 1.1 offers no limit: its own handlers are wrapped (pyproject.toml holds it below 1.2).
        self._server = server
        self._gui: Any = server.gui
        self._link: Any = self._gui._websock_interface
        self._largest, self._refused = largest, refused
        self._last: dict[int, str] = {}
        """The last transfer of each client, whose notice of success is still to be seen when the file turns out to be bad."""
        handlers: tuple[tuple[Any, Any, Any], ...] = (
            (FileTransferStartUpload, self._gui._handle_file_transfer_start, self._begin),
            (FileTransferPart, self._gui._handle_file_transfer_part, self._part),
        )
        for message, theirs, ours in handlers:
            self._link.unregister_handler(message, theirs)
            self._link.register_handler(message, ours)

    def _begin(self, client: int, message: FileTransferStartUpload) -> None:
        waiting = self._gui._current_file_upload_states
        under_way = sum(state["total_bytes"] for state in waiting.values())
        if message.size_bytes > self._largest:
            self._refuse(client, message, str(too_large(message.filename, message.size_bytes, self._largest)))
        elif under_way + message.size_bytes > AT_ONCE * self._largest:
            self._refuse(
                client, message, str(ObjectFileError(message.filename, "few uploads at once", "too many", "try again in a moment"))
            )
        else:
            self._last[client] = message.transfer_uuid
            self._gui._handle_file_transfer_start(client, message)

    def _refuse(self, client: int, message: FileTransferStartUpload, why: str) -> None:
        # The button waits for the last byte to be acknowledged.
        whole = message.size_bytes
        self._link.queue_message(FileTransferPartAck(message.source_component_uuid, message.transfer_uuid, whole, whole))
        self._refused(why)
        self._last[client] = message.transfer_uuid
        self.tell_refused(client, message.filename, why)

    def tell_refused(self, client: int | None, name: str, why: str) -> None:
        """Puts a notice of our own in the place of the page's, which says of every file that arrives whole that it was uploaded
        successfully.
        """
        page = self._server.get_clients().get(-1 if client is None else client)
        if page is None:
            return
        page.add_notification(f"{name} is refused", why, color="red", auto_close_seconds=NOTICE)
        gone = RemoveNotificationMessage(f"upload-{self._last.get(page.client_id, '')}")
        link: Any = page._websock_connection
        link.queue_message(gone)
        # The page may only be about to show it, when it has drawn next.
        loop = self._gui._event_loop
        loop.call_soon_threadsafe(loop.call_later, AGAIN, link.queue_message, gone)

    def _part(self, client: int, message: FileTransferPart) -> None:
        state = self._gui._current_file_upload_states.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] + len(message.content) > state["total_bytes"]:
            del self._gui._current_file_upload_states[message.transfer_uuid]  # more than was announced
            return
        self._gui._handle_file_transfer_part(client, message)


__all__ = ["UploadGate", "too_large"]
