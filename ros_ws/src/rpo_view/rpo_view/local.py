# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Who may connect to the servers of the views: programs and pages of this machine; no ROS.

A server on 127.0.0.1 is still open to every page that a browser of this machine shows, and a page
elsewhere may give its own name to this machine (DNS rebinding). `Host` and `Origin`, which a
browser writes and a page cannot change, show both.
"""

from __future__ import annotations

import errno
from email.message import Message
from urllib.parse import urlsplit

from rpo_core.files.validation import InputError

HOST = '127.0.0.1'
_NAMES = (HOST, 'localhost')


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
