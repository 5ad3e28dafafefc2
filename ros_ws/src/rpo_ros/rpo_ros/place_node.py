# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the stages at some places of the chain, and those that an operator commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from rpo_core.chain.chain import Chain
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Stage, section_of
from rpo_core.wire import interfaces
from rpo_ros import health, qos
from rpo_ros.stage_node import StageNode

Found = TypeVar('Found', bound=Stage)

PLACES = {
    'rpo_ctrl navigation': (
        Place.ATTITUDE_SENSOR,
        Place.SENSOR,
        Place.ATTITUDE_ESTIMATOR,
        Place.ESTIMATOR,
    ),
    'rpo_ctrl guidance': (Place.GUIDANCE, Place.POINTING),
    'rpo_ctrl fuzzy_controller': (Place.CONTROLLER,),
    'rpo_ctrl assurance': (Place.SHAPING, Place.ASSURANCE),
    'rpo_ctrl attitude_controller': (Place.STEERING,),
    'rpo_sim disturbance_injector': (Place.DISTURBANCE,),
}
"""Package and executable of a node -> the places of the chain whose stages it runs."""


class PlaceNode(StageNode):
    """Runs the stages that a scenario has at some places of the chain.

    node_name : of the node
    places : of the chain
    what : the work of the stages in a word, and their product
    role : in the manifest; '' for its name, and no parameters
    """

    node_name = ''
    places: tuple[Place, ...] = ()
    what = ('', '')
    role = ''

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(self.node_name, overrides)
        self.start()

    def chain_of(self, scenario: Scenario) -> Chain:
        """Return the stages of its places."""
        return Chain.of(scenario).part(*self.places)

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the stages of its places; without any, the node ends."""
        chain = self.chain_of(scenario)
        does, makes = self.what
        if not chain.links:
            # No error: one launch file serves every scenario.
            self.get_logger().info(f'{scenario.name} has no {makes}: nothing to do')
            self.done = True
            return None
        for settings in scenario.sections:
            section = section_of(settings)
            if section.rehearse is not None and section.place in self.places:
                section.rehearse(settings, scenario)
        self.manifest = self.manifest or health.Manifest(self, self.role or self.node_name)
        self.manifest.publish({'scenario': scenario.name} if self.role else {}, {})
        self.get_logger().info(f'{does} as in {scenario.name}')
        return chain


class CommandedNode(PlaceNode):
    """Offers a service `~/command` for each command, which acts from the next state on.

    commands : that it takes
    deaf : why a command is refused while nothing takes it
    status : topic of what it says of its stages
    """

    commands: tuple[str, ...] = ()
    status = ''
    deaf = ''

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        self._said = 0
        super().__init__(overrides)
        for name in self.commands:
            self.create_service(Trigger, f'~/{name}', partial(self._on_command, name))

    def begin(self) -> None:
        """Make the publisher of what it says, and start to listen."""
        profile = qos.of(interfaces.row_of(self.status).qos)
        self._status = self.create_publisher(DiagnosticStatus, self.status, profile)
        super().begin()

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
