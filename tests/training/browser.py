# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium, driven over its DevTools protocol: what it loads, says, shows and prints."""

from __future__ import annotations

import asyncio
import base64
import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

OPTIONS = (
    *('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run'),
    # WebGL, drawn by the processor
    *('--use-angle=swiftshader', '--enable-unsafe-swiftshader'),
    *('--disable-background-networking', '--disable-component-update', '--disable-sync'),
)
DEADLINE_S = 30.0


class Page:
    """One page: `requests` asked for, `messages` of its console, exceptions among them."""

    def __init__(self, socket: WebSocketClientConnection, loop: asyncio.AbstractEventLoop) -> None:
        self._socket, self._loop = socket, loop
        self._number = 0
        self._session: dict[str, str] = {}
        self.requests: list[str] = []
        self.messages: list[str] = []
        self._loaded = False
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        session = self.call('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        self._session = {'sessionId': session}
        for domain in ('Page', 'Network', 'Runtime', 'Log'):
            self.call(f'{domain}.enable')

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol, return its result."""
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': params, **self._session}
        self._loop.run_until_complete(self._send(json.dumps(message)))
        while True:
            answer = self._next()
            if answer.get('id') == self._number:
                if 'error' in answer:
                    raise RuntimeError(f'{method}: {answer["error"]}')
                return answer['result']

    def _next(self) -> dict[str, Any]:
        answer = json.loads(self._loop.run_until_complete(self._receive()))
        params = answer.get('params', {})
        if answer.get('method') == 'Network.requestWillBeSent':
            self.requests.append(params['request']['url'])
        elif answer.get('method') == 'Runtime.consoleAPICalled':
            self.messages.append(json.dumps(params['args']))
        elif answer.get('method') == 'Log.entryAdded':
            self.messages.append(params['entry']['text'])
        elif answer.get('method') == 'Runtime.exceptionThrown':
            self.messages.append(json.dumps(params['exceptionDetails']))
        elif answer.get('method') == 'Page.loadEventFired':
            self._loaded = True
        return answer

    async def _send(self, message: str) -> None:
        await self._socket.write_message(message)

    async def _receive(self) -> Any:
        return await asyncio.wait_for(self._socket.read_message(), DEADLINE_S)

    def open(self, path: Path, width: int = 1100, theme: str = 'light', media: str = '') -> None:
        """Load a file in a window of a width [px] and a theme, 'light' or 'dark'.

        media : 'print' shows it as it is printed, '' as on a screen
        """
        self._look(width, theme, media)
        self._loaded = False
        self.call('Page.navigate', url=path.resolve().as_uri())
        while not self._loaded:
            self._next()

    def _look(self, width: int, theme: str, media: str) -> None:
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        feature = {'name': 'prefers-color-scheme', 'value': theme}
        self.call('Emulation.setEmulatedMedia', media=media, features=[feature])

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression."""
        found = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        if 'exceptionDetails' in found:
            raise RuntimeError(json.dumps(found['exceptionDetails']))
        return found['result'].get('value')

    def press(self, key: str, code: int, modifiers: int = 0) -> None:
        """Press a key and let it go.

        key : as KeyboardEvent.key; code : its key code; modifiers : 8 is shift
        """
        for kind in ('keyDown', 'keyUp'):
            found = {'key': key, 'windowsVirtualKeyCode': code, 'modifiers': modifiers}
            self.call('Input.dispatchKeyEvent', type=kind, **found)

    def wait(self, expression: str) -> None:
        """Wait until a JavaScript expression is true."""
        deadline = time.monotonic() + DEADLINE_S
        while not self.evaluate(expression):
            if time.monotonic() > deadline:
                raise TimeoutError(expression)
            time.sleep(0.05)

    def screenshot(self, path: Path) -> None:
        """Write a picture of the whole page."""
        answer = self.call('Page.captureScreenshot', captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(answer['data']))

    def print(self, path: Path) -> None:
        """Print to a PDF."""
        answer = self.call('Page.printToPDF', printBackground=True, preferCSSPageSize=True)
        path.write_bytes(base64.b64decode(answer['data']))


@contextmanager
def browser(program: str, profile: Path) -> Iterator[Page]:
    """Start Chromium with a new profile; yield an empty page."""
    command = [program, *OPTIONS, f'--user-data-dir={profile}', '--remote-debugging-port=0']
    loop = asyncio.new_event_loop()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            socket = loop.run_until_complete(_connected(profile / 'DevToolsActivePort', process))
            yield Page(socket, loop)
            socket.close()
        finally:
            process.kill()
    loop.close()


async def _connected(
    port_file: Path, process: subprocess.Popen[bytes]
) -> WebSocketClientConnection:
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline and process.poll() is None:
        lines = port_file.read_text().split() if port_file.exists() else []
        if len(lines) == 2:
            address = f'ws://127.0.0.1:{lines[0]}{lines[1]}'
            return await websocket_connect(address, max_message_size=1 << 28)
        await asyncio.sleep(0.05)
    raise TimeoutError(f'chromium does not listen (exit code {process.poll()})')
