# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Who may connect to the servers of the views: programs and pages of this machine; no ROS.

A server on 127.0.0.1 is still open to every page that a browser of this machine shows, and a page
elsewhere may give its own name to this machine (DNS rebinding). `Host` and `Origin`, which a
browser writes and a page cannot change, show both.

`Gate` stands before a WebSocket server that does not check who connects.
The server listens at an address of the loopback network that no page can guess (`hidden_address`).
The gate has the port that people know. It reads the head of each request, and passes on the
connections that `refusal` accepts.
"""

from __future__ import annotations

import asyncio
import errno
import secrets
import socket
import threading
from email.message import Message
from http.client import HTTPException, parse_headers
from io import BytesIO
from urllib.parse import urlsplit

from rpo_core.files.validation import InputError

HOST = '127.0.0.1'
_NAMES = (HOST, 'localhost')

_HEAD_S = 10.0
"""Longest time until the head of a request is there."""

_MOST_BYTES = 1 << 16
_END = b'\r\n\r\n'
_LOST = (OSError, EOFError, HTTPException, asyncio.TimeoutError, asyncio.LimitOverrunError)


def refusal(headers: Message, port: int, origins: tuple[str, ...] = ()) -> str:
    """Return why a request to the server at `port` is refused; '' if it is of this machine.

    origins : of pages elsewhere that may connect too
    """
    host, origin = headers.get_all('Host', []), headers.get_all('Origin', [])
    if len(host) != 1 or host[0] not in [f'{name}:{port}' for name in _NAMES]:
        return 'only as 127.0.0.1 or localhost'
    if len(origin) > 1 or (origin and not _is_local(origin[0]) and origin[0] not in origins):
        return 'only for programs and pages of this machine'
    return ''


def _is_local(origin: str) -> bool:
    try:
        return urlsplit(origin).hostname in _NAMES
    except ValueError:  # it is no address
        return False


def port_taken(port: int, error: OSError) -> InputError:
    """Return the error of a port that cannot be opened."""
    why = 'it is in use' if error.errno == errno.EADDRINUSE else error.strerror
    return InputError(f'`port` must be free; got {port}: {why}')


def hidden_address() -> str:
    """Return a random address of the loopback network 127.0.0.0/8."""
    return '.'.join(map(str, (127, *(1 + secrets.randbelow(254) for _ in range(3)))))


class Gate:
    """Passes connections from 127.0.0.1 on to `inner`, from a thread of its own.

    port : of the gate; 0, any free one
    inner : (address, port) of the server
    origins : of pages elsewhere that may connect

    Raises
    ------
    InputError
        If the port is not free.
    """

    def __init__(self, port: int, inner: tuple[str, int], origins: tuple[str, ...] = ()) -> None:
        self._inner, self._origins = inner, origins
        self._tasks: set[asyncio.Task[None] | None] = set()
        try:
            listener = socket.create_server((HOST, port))
        except OSError as error:
            raise port_taken(port, error) from None
        self.port: int = listener.getsockname()[1]
        self._loop = asyncio.new_event_loop()
        server = asyncio.start_server(self._connected, sock=listener, limit=_MOST_BYTES)
        self._server = self._loop.run_until_complete(server)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        self._tasks.add(task)  # asyncio holds it weakly, once the caller has said all
        try:
            head = await asyncio.wait_for(reader.readuntil(_END), _HEAD_S)
            headers = parse_headers(BytesIO(head.partition(b'\r\n')[2]))
            if why := refusal(headers, self.port, self._origins):
                answer = f'HTTP/1.1 403 Forbidden\r\nContent-Length: {len(why)}\r\n\r\n{why}'
                writer.write(answer.encode())
            else:
                await self._pass_on(head, reader, writer)
        except _LOST:
            pass  # whoever it was is gone
        finally:
            writer.close()
            self._tasks.discard(task)

    async def _pass_on(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Pass bytes on in both directions until the server has said all."""
        answers, requests = await asyncio.open_connection(*self._inner, limit=_MOST_BYTES)
        requests.write(head)
        asking = asyncio.ensure_future(_copy(reader, requests))
        try:
            await _copy(answers, writer)
        finally:
            asking.cancel()
            await asyncio.gather(asking, return_exceptions=True)
            requests.close()

    def close(self) -> None:
        """Close the port and all connections."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        own = asyncio.current_task()
        # Again and again: a caller that was let in just before begins a task meanwhile.
        while others := [task for task in asyncio.all_tasks() if task is not own]:
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            await asyncio.sleep(0.0)


async def _copy(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Copy bytes until the source ends or is lost; then the sink ends too."""
    try:
        while data := await source.read(_MOST_BYTES):
            sink.write(data)
            await sink.drain()
    finally:
        sink.write_eof()
