# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A node of places whose stage takes commands: a service for each, and word of what they change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from std_srvs.srv import Trigger

from rpo_core.chain.stage import Stage
from rpo_ros.managed_node import PlaceNode

Found = TypeVar('Found', bound=Stage)


class CommandedNode(PlaceNode):
    """Offers a service `~/command` for each command, which acts from the next state on.

    commands : that it takes
    deaf : why a command is refused while nothing takes it
    """

    commands: tuple[str, ...] = ()
    deaf = ''

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        self._said = 0
        super().__init__(overrides)
        for name in self.commands:
            self.create_service(Trigger, f'~/{name}', partial(self._on_command, name))

    @property
    def listener(self) -> Any:
        """What takes the commands (`command`, `next_tick`, `changes`); None: nothing does."""
        raise NotImplementedError

    def stage_of(self, kind: type[Found]) -> Found | None:
        """Return its stage of a kind; None without one."""
        links = self.chain.links if self.chain is not None else ()
        return next((link.stage for link in links if isinstance(link.stage, kind)), None)

    def new_run(self) -> None:
        """Forget the run before."""
        self._said = 0
        super().new_run()

    def begun(self) -> Sequence[Any]:
        """Return what the listener has changed since it was asked."""
        changes = self.listener.changes if self.listener is not None else []
        first = self._said if self._said <= len(changes) else 0  # it began anew
        self._said = len(changes)
        return changes[first:]

    def _on_command(
        self, name: str, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Take a command, or refuse it with the reason."""
        listener = self.listener
        if listener is None:
            response.success, response.message = False, self.deaf
            return response
        tick = listener.next_tick
        refused = listener.command(name) if self.active else f'{self.node_name} is inactive'
        response.success, response.message = not refused, refused or f'{name} from tick {tick} on'
        if not refused:
            self.publish_stage_status(self.node_name, name, tick, f'command `{name}`')
        return response
