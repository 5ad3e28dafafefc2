# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The recorders as the plant sees them: present, ready, closed, failed or gone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from rpo_core.wire import interfaces
from rpo_core.wire.statuses import CLOSED, FAILED, READY, RecorderStatus
from rpo_core.wire.statuses import RECORDER_WAITS as WAITING
from rpo_ros.heartbeat import Timeout
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear

LEASE_S = 5.0
"""Longest silence of a live recorder: it publishes its status once a second."""

_BUSY = 'busy'

PATIENCE_S = 5.0
"""Longest wait for a recorder that is behind; DDS repairs a loss within 3 s."""

_MOST = 32


@dataclass
class _Recorder:
    """One recorder: the last thing it said, and how long ago; how far it is, if it said so."""

    says: str = ''
    next_tick: int | None = None
    timeout: Timeout = field(default_factory=Timeout)


class RecorderWatch:
    """Listens to `recorder_status`; each recorder gives its id, and that of the plant it records.

    insist : a run needs one
    run : id of the plant
    on_progress : called when one says how far it is
    """

    def __init__(
        self, node: FlightNode, insist: bool, run: str, on_progress: Callable[[], None]
    ) -> None:
        self._node, self._insist, self._run = node, insist, run
        self._on_progress = on_progress
        self._in_sight, self._seen_s = 0, 0.0
        self._known: dict[str, _Recorder] = {}
        self.forget()
        hear(node, RecorderStatus, self._on_status)

    def forget(self) -> None:
        """Expect another recorder: a new run begins."""
        self._known.clear()
        self._why = ''
        self._waited_from_s, self._impatient = 0.0, False

    def _on_status(self, status: RecorderStatus) -> None:
        if status.recorder not in self._known and len(self._known) >= _MOST:
            return
        one = self._known.setdefault(status.recorder, _Recorder())
        one.says = _BUSY if status.run not in ('', self._run) else status.says
        one.timeout.broken()
        if one.says == FAILED:
            self._why = status.reason
        if status.next_tick is not None:
            one.next_tick = status.next_tick
            self._on_progress()

    def _that_say(self, *words: str) -> list[_Recorder]:
        """Return the recorders that live and said one of these words last."""
        alive = [one for one in self._known.values() if one.timeout.look() <= LEASE_S]
        return [one for one in alive if one.says in words]

    def behind(self, tick: int) -> bool:
        """Return whether a recorder is so far behind a tick that it might lose messages.

        After PATIENCE_S in which none came nearer, the run goes on without regard to them.
        """
        far = tick - interfaces.MOST_AHEAD_TICKS
        late = any(k.next_tick is not None and k.next_tick < far for k in self._that_say(READY))
        if not late or self._impatient:
            self._waited_from_s = 0.0
            return False
        now_s = time.monotonic()
        self._waited_from_s = self._waited_from_s or now_s
        if now_s - self._waited_from_s > PATIENCE_S:
            self._impatient = True
            self._node.get_logger().warning('a recorder does not keep up: the run goes on')
        return not self._impatient

    @property
    def failure(self) -> str:
        """Why the run cannot be recorded although it must be; '' if it can."""
        return self._why if self._insist and not self._that_say(READY, WAITING) else ''

    def awaited(self) -> bool:
        """Return whether a run must wait until each in sight is ready; call it often.

        Also for one that still records another plant: that may be the plant before this one.
        """
        if self._that_say(WAITING, _BUSY) or self._unheard():
            return True
        return self._insist and not self._that_say(READY)

    def _unheard(self) -> bool:
        """Return whether a recorder is in sight that has said nothing yet.

        One that was killed stays in sight for a while, but says nothing.
        """
        said = self._node.resolve_topic_name(interfaces.RECORDER_STATUS)
        in_sight, now_s = self._node.count_publishers(said), time.monotonic()
        if in_sight > self._in_sight:
            self._seen_s = now_s
        self._in_sight = in_sight
        heard = len(self._that_say(WAITING, READY, CLOSED, FAILED, _BUSY))
        return in_sight > heard and now_s - self._seen_s < LEASE_S

    @property
    def done(self) -> bool:
        """Whether none needs anything more from the plant."""
        return not self._that_say(WAITING, READY)

    @property
    def lost(self) -> bool:
        """Whether those that were ready publish no more; look at it often."""
        was_ready = any(one.says == READY for one in self._known.values())
        return was_ready and not self._that_say(READY)
