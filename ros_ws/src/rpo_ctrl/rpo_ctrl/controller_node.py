# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The node of every controller: a managed (lifecycle) node that loads any controller file.

configure loads and checks the file, activate starts to command, deactivate commands zero, cleanup
unloads the file, shutdown ends the process. `fuzzy_controller` and `rival_controller` are two names
of it with different default files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from rpo_core import files
from rpo_core.chain.chain import Chain, Link, Signals
from rpo_core.chain.stage import ZERO, Place
from rpo_core.control import controller
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import followed
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import Decimation
from rpo_ctrl import explain
from rpo_ros import conversions, health, qos
from rpo_ros.managed_node import ManagedNode

_ANY_TICK_S = 1.0


class DecisionPublisher:
    """Publishes decisions when they are due, each with the stamp of its state.

    rate_hz : decisions per simulated second, by the stamps alone; 0: none
    """

    def __init__(self, node: Node, rate_hz: float) -> None:
        self._decimation = Decimation(rate_hz)
        self._before_ns: int | None = None
        self._explained_ns: int | None = None
        self._out = node.create_publisher(DiagnosticArray, interfaces.DECISION, qos.LOCKSTEP)

    def offer(
        self,
        stamp_ns: int,
        scenario: Scenario | None,
        label: str,
        reasons_of: Callable[[], tuple[bytes, Sequence[explain.Reason]]],
    ) -> None:
        """Publish the decision on a state if it is due; a repeated state gets it again.

        scenario : of the run; without it, the state before decides what is due
        label : controller and hash of its file
        reasons_of : returns the level, and the reasons of x, y, z
        """
        if not self._is_due(stamp_ns, scenario):
            return
        level, reasons = reasons_of()
        statuses = [
            cdr.Status(level[0], f'decision: {axis}', sentence, label, conversions.texts_of(pairs))
            for axis, (sentence, pairs) in zip('xyz', reasons, strict=True)
        ]
        self._out.publish(cdr.encode_array(stamp_ns, interfaces.LVLH_FRAME, statuses))

    def _is_due(self, stamp_ns: int, scenario: Scenario | None) -> bool:
        tick = scenario.tick_of(stamp_ns) if scenario is not None else None
        if scenario is not None and tick is not None:  # a foreign state before changes nothing
            before_ns = scenario.stamp_ns(tick - 1) if tick else None
            return self._decimation.due(stamp_ns, before_ns)
        if self._decimation.due(stamp_ns, self._before_ns):
            self._explained_ns = stamp_ns
        self._before_ns = stamp_ns
        return stamp_ns == self._explained_ns


class ControllerNode(ManagedNode):
    """Answers states with the force of a controller; with zero force while inactive.

    node_name : of the node
    """

    node_name = 'fuzzy_controller'
    package = 'rpo_ctrl'
    off = 'commanding zero'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(self.node_name, overrides)
        self.controller: AnyController | None = None
        self._sha256, self._label = '', 'none'
        self._decision = DecisionPublisher(self, self.values['decision_rate_hz'])
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

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish the decision when it is due; the force is sent already."""
        self._decision.offer(
            stamp_ns, self.scenario, self._label, lambda: self._explain(stamp_ns, signals)
        )

    def _explain(self, stamp_ns: int, signals: Signals) -> tuple[bytes, Sequence[explain.Reason]]:
        if not self.active or self.controller is None:
            return health.WARN, explain.INACTIVE
        tick = None if self.scenario is None else self.scenario.tick_of(stamp_ns)
        state, force_n = signals[self._reads[0]], signals[interfaces.CONTROL_FORCE]
        if interfaces.REFERENCE_STATE in self._reads:
            seen, law = followed(state, force_n, signals)
            state, force_n = tuple(seen.tolist()), tuple(law.tolist())
        elif self.scenario is not None:
            state = self.scenario.from_goal(state)
        return health.OK, explain.reasons(self.controller, state, force_n, tick or 0)

    def _loaded(self, name: str) -> tuple[AnyController, str]:
        """Return the controller of a file and the file's text; raises InputError."""
        path = files.find('controller', name)
        content = files.read_text(path)
        return files.loads(content, self.parse, str(path)), content

    def _use(self, loaded: AnyController, content: str) -> None:
        """Make a controller the one of the run, and publish it; raises InputError."""
        self.controller = loaded
        self._sha256 = hashlib.sha256(content.encode()).hexdigest()
        self._label = explain.label(loaded, self._sha256)
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
        self.controller, self._sha256, self._label = None, '', 'none'

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
