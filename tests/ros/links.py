# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two hosts in one machine: network namespaces joined by a link that can be cut, or be a bad one.

`python links.py NAME NAME LOSS DELAY_S SEED` is the bad link, as few kernels have netem: it passes
Ethernet frames between two TAP interfaces, and loses and delays them.
"""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

ADDRESSES = {'plant': '10.77.0.1', 'controller': '10.77.0.2'}
NO_NAMESPACES = 'network namespaces are not allowed here'
NO_TAP = 'there is no /dev/net/tun'

_TUNSETIFF, _TAP_WITHOUT_HEADER = 0x400454CA, 0x1002


class LinkError(Exception):
    """What cannot be had on this machine."""


def _ip(*words: str) -> None:
    try:
        subprocess.run(['ip', *words], check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise LinkError(NO_NAMESPACES) from error


class Hosts:
    """Hosts `plant` and `controller`, each a namespace with one interface."""

    def __init__(self) -> None:
        self.names = {host: f'rpo_{os.getpid()}_{host[0]}' for host in ADDRESSES}
        self.interfaces = {host: f'rpo{os.getpid() % 100000}{host[0]}' for host in ADDRESSES}

    def on(self, host: str) -> list[str]:
        """Return what to put before a command so that it runs on a host."""
        return ['ip', 'netns', 'exec', self.names[host]]

    def join(self) -> None:
        """Make both hosts and a cable between them."""
        self._make_namespaces()
        a, b = self.interfaces.values()
        _ip('link', 'add', a, 'type', 'veth', 'peer', 'name', b)
        self._plug()

    @contextlib.contextmanager
    def relay(self, loss: float, delay_s: float) -> Iterator[None]:
        """Join both hosts by a process that passes frames on, but for some, in both directions."""
        self._make_namespaces()
        if not os.path.exists('/dev/net/tun'):
            raise LinkError(NO_TAP)
        words = [*self.interfaces.values(), str(loss), str(delay_s), '1']
        command = [sys.executable, __file__, *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            try:
                if process.stdout is None or process.stdout.readline() != b'ready\n':
                    raise LinkError(NO_TAP)
                self._plug()
                yield
            finally:
                process.kill()

    def _make_namespaces(self) -> None:
        for name in self.names.values():
            _ip('netns', 'add', name)

    def _plug(self) -> None:
        for host, name in self.names.items():
            interface = self.interfaces[host]
            _ip('link', 'set', interface, 'netns', name)
            _ip('-n', name, 'addr', 'add', f'{ADDRESSES[host]}/24', 'dev', interface)
            _ip('-n', name, 'link', 'set', 'lo', 'up')
        self.heal()

    def cut(self) -> None:
        """Pull the cable."""
        for host, name in self.names.items():
            _ip('-n', name, 'link', 'set', self.interfaces[host], 'down')

    def heal(self) -> None:
        """Plug it in again."""
        for host, name in self.names.items():
            _ip('-n', name, 'link', 'set', self.interfaces[host], 'up')
            # A host without a default route has none for multicast either.
            _ip('-n', name, 'route', 'replace', '239.0.0.0/8', 'dev', self.interfaces[host])

    def remove(self) -> None:
        """Leave nothing behind; a namespace takes its interface with it."""
        for name in self.names.values():
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)


@contextlib.contextmanager
def hosts() -> Iterator[Hosts]:
    """Yield two hosts that are not joined yet; remove them at the end."""
    found = Hosts()
    try:
        yield found
    finally:
        found.remove()


def _tap(name: str) -> int:
    file = os.open('/dev/net/tun', os.O_RDWR)
    fcntl.ioctl(file, _TUNSETIFF, struct.pack('16sH22x', name.encode(), _TAP_WITHOUT_HEADER))
    return file


def relay(names: tuple[str, str], loss: float, delay_s: float, seed: int) -> None:
    """Pass frames on for ever."""
    taps = [_tap(name) for name in names]
    print('ready', flush=True)
    chance, count = random.Random(seed), 0
    waiting: list[tuple[float, int, int, bytes]] = []
    while True:
        left = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        for file in select.select(taps, [], [], left)[0]:
            frame, count = os.read(file, 65536), count + 1
            if chance.random() >= loss:
                other = taps[1 - taps.index(file)]
                heapq.heappush(waiting, (time.monotonic() + delay_s, count, other, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            _, _, other, frame = heapq.heappop(waiting)
            with contextlib.suppress(OSError):  # the other end is down
                os.write(other, frame)


if __name__ == '__main__':
    relay((sys.argv[1], sys.argv[2]), float(sys.argv[3]), float(sys.argv[4]), int(sys.argv[5]))
