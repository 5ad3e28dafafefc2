# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of a controller file.

It loads any controller file, fuzzy or not. Where the scenario has navigation, it answers
`navigation_state` instead of `relative_state`.

It is a managed (lifecycle) node that activates itself. To make it command zero:
`ros2 lifecycle set /fuzzy_controller deactivate`. To load another file then:
`ros2 param set /fuzzy_controller controller handmade`, and `activate`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from rpo_core import files
from rpo_core.chain.chain import Chain, Link, Signals
from rpo_core.control import controller
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import ZERO, Place
from rpo_core.wire import interfaces
from rpo_ros import health
from rpo_ros.stage_node import StageNode

_ANY_TICK_S = 1.0


class ControllerNode(StageNode):
    """Answers states with the force of a controller; with zero force while inactive.

    node_name : of the node
    """

    node_name = 'fuzzy_controller'
    package = 'rpo_ctrl'
    off = 'commanding zero'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(self.node_name, overrides)
        self.controller: AnyController | None = None
        self._sha256 = ''
        self.start()

    def outlets(self) -> Sequence[str]:
        """Return the commanded force: a plant must find a controller at once."""
        return (interfaces.CONTROL_FORCE,)

    def parse(self, document: Any) -> AnyController:
        """Return the controller of a parsed file; raises InputError."""
        return controller.parse(document)

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the controller as a stage; raises InputError if its tick has another length."""
        if self.controller is None:
            return None
        return Chain.of(scenario, self.controller).part(Place.CONTROLLER)

    def without_scenario(self) -> Chain | None:
        """Return the controller as a stage that reads the relative state."""
        if self.controller is None or getattr(self.controller, 'clock_s', None) is not None:
            return None
        stage = self.controller.stage(_ANY_TICK_S)
        return Chain([Link(Place.CONTROLLER, stage, (interfaces.RELATIVE_STATE,))])

    def switched(self) -> Sequence[str]:
        """Return the name of its stage, also while nothing is loaded."""
        return ('controller',)

    def step(self, tick: int, signals: Signals) -> None:
        """Add the force of the controller; zero when not active, also while nothing is loaded."""
        super().step(tick, signals)
        signals.setdefault(interfaces.CONTROL_FORCE, ZERO)

    def _loaded(self, name: str) -> tuple[AnyController, str]:
        """Return the controller of a file and the file's text; raises InputError."""
        path = files.find('controller', name)
        content = files.read_text(path)
        return files.loads(content, self.parse, str(path)), content

    def _use(self, loaded: AnyController, content: str) -> None:
        """Make a controller the one of the run, and publish it; raises InputError."""
        self.controller = loaded
        self._sha256 = hashlib.sha256(content.encode()).hexdigest()
        shaping = {row.name: self.values[row.name] for row in self.rows if not row.wall}
        shaping['controller'] = loaded.name
        self.manifest = self.manifest or health.Manifest(self, 'controller')
        self.manifest.publish(shaping, {'controller.yaml': content})
        self.rebuild()

    def configure(self) -> None:
        """Load and check the file; raises InputError."""
        self._use(*self._loaded(self.values['controller']))

    def forget(self) -> None:
        """Forget the file."""
        self.controller, self._sha256 = None, ''

    def _activate(self) -> None:
        super()._activate()
        if self.controller is not None:
            self.get_logger().info(f'controlling with {self.controller.name}')

    def refuse_change(self, wanted: Mapping[str, Any]) -> None:
        """Refuse another controller while active, or one that does not load."""
        if 'controller' in wanted:
            if self.active:
                raise InputError(
                    '`controller` may not change while the controller is active: '
                    f'`ros2 lifecycle set {self._full} deactivate` first'
                )
            self._checked = self._loaded(wanted['controller'])

    def changed(self, applied: Mapping[str, Any]) -> None:
        """Use the new controller file from the next activation on."""
        if 'controller' in applied and self.controller is not None:
            self._use(*self._checked)

    def health(self) -> health.Health:
        """Return the health: the state of the lifecycle, the file and its hash."""
        level, _, values = super().health()
        doing = 'commanding' if self.active else 'commanding zero' if self._began else 'silent'
        doing = 'no states: the plant is gone' if self.plant_gone else doing
        values = {
            'controller': self.controller.name if self.controller is not None else '',
            'controller_file': self.values['controller'],
            'controller_sha256': self._sha256,
            'answered_zero': self.answered_inactive,
            **values,
        }
        return level if self.active else health.WARN, f'{self.label}: {doing}', values


main = ControllerNode.main
