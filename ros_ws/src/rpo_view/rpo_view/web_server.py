# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Server of the live page and its stream of events, for this machine only; no ROS.

A server on 127.0.0.1 is still open to every page that a browser of this machine shows, and a page
elsewhere may give its own name to this machine (DNS rebinding). `Host` and `Origin`, which a
browser writes and a page cannot change, show both.
"""

from __future__ import annotations

import errno
import json
import sys
import threading
from email.message import Message
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from rpo_core.files.validation import InputError
from rpo_log.show import style

HOST = '127.0.0.1'
_NAMES = (HOST, 'localhost')

_HEADERS = {
    'Cache-Control': 'no-store',
    'X-Content-Type-Options': 'nosniff',
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    ),
}
_KEEP_ALIVE_S = 5.0
_TIMEOUT_S = 30.0
"""A reader that sends no request, or takes no event, for so long is disconnected."""

_PALETTE_GOES = '/* The palette of rpo_log.show.style comes here. */'


def refusal(headers: Message, port: int) -> str:
    """Return why a request to the server at `port` is refused; '' if it is of this machine."""
    host, origin = headers.get_all('Host', []), headers.get_all('Origin', [])
    if len(host) != 1 or host[0] not in [f'{name}:{port}' for name in _NAMES]:
        return 'only as 127.0.0.1 or localhost'
    if len(origin) > 1 or (origin and not _is_local(origin[0])):
        return 'only for programs and pages of this machine'
    return ''


def _is_local(origin: str) -> bool:
    try:
        return urlsplit(origin).hostname in _NAMES
    except ValueError:  # it is no address
        return False


def page() -> bytes:
    """Return the page, complete in itself."""
    text = resources.files('rpo_view').joinpath('page/live.html').read_text(encoding='utf-8')
    return text.replace(_PALETTE_GOES, style.variables()).encode()


class Feed:
    """The newest snapshot, for any number of readers; a slow reader skips some."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._version = 0
        self._now = b'{}'
        self._trail: list[Any] = []
        self.closed = False

    def publish(self, snapshot: dict[str, Any], trail: list[Any]) -> None:
        """Set the next snapshot; a new reader also gets the trail."""
        with self._news:
            self._now = json.dumps(snapshot, allow_nan=False).encode()
            self._trail = trail
            self._version += 1
            self._news.notify_all()

    def close(self) -> None:
        """Disconnect all readers."""
        with self._news:
            self.closed = True
            self._news.notify_all()

    def trail(self) -> bytes:
        """Return the trail as JSON."""
        with self._news:
            return json.dumps(self._trail, allow_nan=False).encode()

    def after(self, version: int) -> tuple[int, bytes]:
        """Return the newest snapshot when it is newer than `version`; b'' if none comes."""
        with self._news:
            self._news.wait_for(lambda: self.closed or self._version > version, _KEEP_ALIVE_S)
            return self._version, self._now if self._version > version else b''


class _Handler(BaseHTTPRequestHandler):
    """Serves `/`, the page, and `/events`, the stream of events."""

    server: LivePage
    protocol_version = 'HTTP/1.1'
    server_version = 'rpo_view'
    sys_version = ''
    timeout = _TIMEOUT_S

    def do_GET(self) -> None:
        if why := refusal(self.headers, self.server.server_port):
            self.send_error(HTTPStatus.FORBIDDEN, why)
        elif self.path == '/':
            self._page()
        elif self.path == '/events':
            self._events()
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _head(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header('Content-Type', kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)

    def _page(self) -> None:
        self._head('text/html; charset=utf-8')
        self.send_header('Content-Length', str(len(self.server.page)))
        self.end_headers()
        self.wfile.write(self.server.page)

    def _events(self) -> None:
        self._head('text/event-stream')
        self.send_header('Connection', 'close')
        self.end_headers()
        self.close_connection = True
        feed = self.server.feed
        try:
            self.wfile.write(b'event: trail\ndata: ' + feed.trail() + b'\n\n')
            version = 0
            while not feed.closed:
                version, snapshot = feed.after(version)
                self.wfile.write(b'data: ' + snapshot + b'\n\n' if snapshot else b': alive\n\n')
                self.wfile.flush()
        except OSError:
            pass  # the reader is gone

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: requests of the page are not interesting."""


class LivePage(ThreadingHTTPServer):
    """Serves the page on 127.0.0.1 from a thread of its own.

    Raises
    ------
    InputError
        If the port is not free.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, port: int) -> None:
        self.feed = Feed()
        self.page = page()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            why = 'it is in use' if error.errno == errno.EADDRINUSE else error.strerror
            raise InputError(f'`port` must be free; got {port}: {why}') from None
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f'http://{HOST}:{self.server_port}/'

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a connection that was lost; print what else went wrong."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    def close(self) -> None:
        """Stop serving."""
        self.feed.close()
        self.shutdown()
        self.server_close()
