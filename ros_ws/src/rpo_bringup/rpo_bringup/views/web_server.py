# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Server of the page of a running flight, and of its events, for this machine only; no ROS.

A server on 127.0.0.1 is still open to every page that a browser of this machine shows, and a page
elsewhere may give its own name to this machine (DNS rebinding). `Host` and `Origin`, which a
browser writes and a page cannot change, show both.
"""

from __future__ import annotations

import errno
import json
import re
import sys
import threading
from collections.abc import Callable, Iterator
from email.message import Message
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

from rpo_bringup.views.live import LiveFlight
from rpo_bringup.views.samples import Samples
from rpo_core.files.validation import InputError
from rpo_log.show import replay, style

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
_EVENTS = re.compile(r'/events\?flight=([0-9.]{0,40})&from=([0-9]{1,9})')
_FEWEST = 2
"""Moments that a picture needs."""

_KEEP_ALIVE_S = 5.0
_TIMEOUT_S = 30.0
"""A reader that sends no request, or takes no event, for so long is disconnected."""


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


class Feed:
    """What the page shows now, for any number of readers; a slow reader skips some.

    topic : of the states
    """

    def __init__(self, live: LiveFlight, topic: str) -> None:
        self.live, self.topic = live, topic
        self.closed = False
        self._samples: Samples | None = None
        self._news = threading.Condition()

    def update(self, look: Callable[[], bool]) -> None:
        """Look at the flight; a sound state that came is one more moment of it."""
        with self._news:
            if look():
                scenario, samples = self.live.scenario, self._samples
                if samples is None or samples.number != self.live.flights:
                    samples = Samples(self.live, scenario) if scenario is not None else None
                if samples is not None:
                    samples.add(self.live)
                self._samples = samples
            self._news.notify_all()

    def close(self) -> None:
        """Disconnect all readers."""
        with self._news:
            self.closed = True
            self._news.notify_all()

    @property
    def _drawn(self) -> Samples | None:
        """What a page can draw; None while there is none."""
        samples = self._samples
        return samples if samples is not None and len(samples.rows) >= _FEWEST else None

    def page(self) -> bytes:
        """Return the page, complete in itself: of the flight so far, or a card."""
        with self._news:
            if self._drawn is None:
                colours = style.variables()
                return replay.filled(
                    'rpo_bringup.views', 'page/card.html', colours=colours
                ).encode()
            document = self._drawn.document(self.live, self.live.sentence(self.topic))
            return replay.page_of(document['flights'][0]['name'], document).encode()

    def events(self, flight: str, first: int) -> Iterator[bytes]:
        """Yield what is new since the moment `first` of a flight, as JSON; b'' if nothing is."""
        before, news = b'', True
        while not self.closed:
            with self._news:
                said, first = self._since(flight, first)
                if said == before:
                    news = self._news.wait(_KEEP_ALIVE_S)
            if said != before or not news:
                yield said if said != before else b''
                before, news = said, True

    def _since(self, flight: str, first: int) -> tuple[bytes, int]:
        """Return what a page is told that shows a flight up to a moment, and the next moment."""
        sentence, samples, more, last = self.live.sentence(self.topic), self._drawn, None, first
        name = samples.name if samples is not None else ''
        if samples is not None and flight == name and len(samples.rows) > first:
            more, last = samples.flight(self.live, sentence, first), len(samples.rows)
        card = self.live.card(self.topic)
        said = {'flight': name, 'from': first, 'sentence': sentence, 'card': card, 'more': more}
        return json.dumps(said).encode(), last


class _Handler(BaseHTTPRequestHandler):
    """Serves `/`, the page, and `/events`, what is new since a moment of its flight."""

    server: LivePage
    protocol_version = 'HTTP/1.1'
    server_version = 'rpo_bringup'
    sys_version = ''
    timeout = _TIMEOUT_S

    def do_GET(self) -> None:
        if why := refusal(self.headers, self.server.server_port):
            self.send_error(HTTPStatus.FORBIDDEN, why)
        elif self.path == '/':
            self._page()
        elif found := _EVENTS.fullmatch(self.path):
            self._events(found[1], int(found[2]))
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _head(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header('Content-Type', kind)
        for name, value in _HEADERS.items():
            self.send_header(name, value)

    def _page(self) -> None:
        self._head('text/html; charset=utf-8')
        page = self.server.feed.page()
        self.send_header('Content-Length', str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def _events(self, flight: str, first: int) -> None:
        self._head('text/event-stream')
        self.send_header('Connection', 'close')
        self.end_headers()
        self.close_connection = True
        try:
            for said in self.server.feed.events(flight, first):
                self.wfile.write(b'data: ' + said + b'\n\n' if said else b': alive\n\n')
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

    def __init__(self, port: int, feed: Feed) -> None:
        self.feed = feed
        replay.library()  # without it there is no page
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
