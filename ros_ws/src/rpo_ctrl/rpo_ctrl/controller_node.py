# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The managed (lifecycle) node that every controller is.

configure loads and checks the file, activate allows to command, deactivate commands zero, cleanup
makes room for another file, shutdown ends the process.
"""

from __future__ import annotations

import hashlib
import traceback
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from rpo_core import files
from rpo_core.controller import DEFAULT_CONTROLLER
from rpo_core.validation import InputError
from rpo_ctrl.decision import DecisionPublisher, Reason
from rpo_ros import health, names
from rpo_ros.answering import AnsweringNode, Force
from rpo_ros.parameters import Row, declare

PARAMETERS = (
    Row('controller', DEFAULT_CONTROLLER, 'shipped controller, or path of a controller file; may '
        'change while the controller is not active', changeable=True,
        example='path/to/mine.yaml'),
    Row('autostart', True, 'configure and activate at the start; false: wait for `ros2 lifecycle '
        'set`', wall=True),
    Row('decision_rate_hz', 1.0, 'decisions published per simulated second; 0: none', 'Hz',
        most=1e4),
)  # fmt: skip

ZERO: Force = (0.0, 0.0, 0.0)
SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class ControllerNode(LifecycleNodeMixin, AnsweringNode):
    """Answers states with the force of a law; the subclass says which laws it reads.

    Before its first activation it is silent, and a plant waits. From then on every state is
    answered: by the law while active, with zero force otherwise. A state that comes again gets the
    answer that it got, whatever changed in between.
    """

    def __init__(
        self,
        name: str,
        overrides: Mapping[str, Any] | None = None,
        rows: Sequence[Row] = PARAMETERS,
    ) -> None:
        AnsweringNode.__init__(self, name, overrides)
        self.values = declare(self, rows)
        self._rows = rows
        self.law: Any = None
        self.active = False
        self._began = False
        self._sha256 = ''
        self._flown = 'none'
        self._cause: Exception | None = None
        self._asked: tuple[Any, ...] = ()
        self._given: Force = ZERO
        self.answered_zero = 0
        LifecycleNodeMixin.__init__(self)
        self._starting = self.values['autostart']
        if self._starting:
            self._autostart()
        self._decision = DecisionPublisher(self, self.values['decision_rate_hz'])
        self.answer_on(names.CONTROL_FORCE)
        if not self.active:
            self.get_logger().info(f'unconfigured: `ros2 lifecycle set {self._full} configure`')

    @abstractmethod
    def parse(self, document: Any) -> Any:
        """Return the law of a parsed controller file; raises InputError. It has a `name`."""

    @abstractmethod
    def command_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force:
        """Return the force [N] that `self.law` commands in a finite state, target LVLH."""

    def reasons(self, state: tuple[float, ...], force: Force) -> Sequence[Reason]:
        """Return for each axis why the law commands this force."""
        return [(f'commands {f:.3g} N', [('force_n', f)]) for f in force]

    @property
    def _full(self) -> str:
        return str(self.get_fully_qualified_name())

    @property
    def label(self) -> str:
        """State of the lifecycle: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def force_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force | str:
        """Return the law's force, zero when not active, or why the state is not answered."""
        if not self._began:
            return 'not_activated'
        asked = (stamp_ns, *state)
        if asked != self._asked:
            self._given = self._decided(stamp_ns, state)
            self._asked = asked
        return self._given

    def _decided(self, stamp_ns: int, state: tuple[float, ...]) -> Force:
        if self.active:
            try:
                return self.command_n(stamp_ns, state)
            except Exception:  # a law that breaks must not take the answer with it
                self.get_logger().error(f'no command in {state}: {traceback.format_exc()}')
                self.trigger_deactivate()
        self.answered_zero += 1
        return ZERO

    def after_answer(self, stamp: Time, state: tuple[float, ...], force: Force) -> None:
        """Publish why, when it is time: the force is on its way already."""
        self._decision.offer(stamp, self._flown, lambda: self._explain(state, force))

    def _explain(self, state: tuple[float, ...], force: Force) -> tuple[bytes, Sequence[Reason]]:
        if self.active:
            return health.OK, self.reasons(state, force)
        return health.WARN, [('inactive: commands zero', [('force_n', 0.0)])] * 3

    def _autostart(self) -> None:
        """Configure and activate; raises what kept it from that."""
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != SUCCESS:
                raise self._cause or RuntimeError('a lifecycle transition failed')
        self._starting = False

    def _loaded(self, name: str) -> tuple[Any, str]:
        """Return the law of a controller file and the file's text; raises InputError."""
        path = files.find('controller', name)
        content = files.read_text(path)
        return files.loads(content, self.parse, str(path)), content

    def _take(self, law: Any, content: str) -> None:
        """Make a law the one that flies, and say so."""
        self.law = law
        self._sha256 = hashlib.sha256(content.encode()).hexdigest()
        self._flown = f'{law.name} {self._sha256[:12]}'
        shaping = {row.name: self.values[row.name] for row in self._rows if not row.wall}
        shaping['controller'] = law.name
        if not hasattr(self, '_manifest'):
            self._manifest = health.Manifest(self, 'controller')
        self._manifest.say(shaping, {'controller.yaml': content})

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Load and check the file; a bad one leaves the node unconfigured."""
        return self._try('configure', lambda: self._take(*self._loaded(self.values['controller'])))

    def on_activate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Command from the next state on."""
        return self._try('activate', self._activate)

    def on_deactivate(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Command zero from the next state on."""
        return self._try('deactivate', self._deactivate)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the file."""
        return self._try('clean up', self._forget)

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Fall silent and end the process."""
        return self._try('shut down', self._end)

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """After a transition that broke: unconfigured, commanding zero."""
        self._forget()
        return SUCCESS

    def _activate(self) -> None:
        self.active = self._began = True
        self.get_logger().info(f'controlling with {self.law.name}')

    def _deactivate(self) -> None:
        self.active = False
        self.get_logger().warning('inactive: commanding zero')

    def _forget(self) -> None:
        self.active = False
        self.law, self._sha256, self._flown = None, '', 'none'

    def _end(self) -> None:
        self._forget()
        self._began = False
        self.done = True

    def _try(self, name: str, act: Callable[[], None]) -> TransitionCallbackReturn:
        """Run a transition; rclpy would swallow what it raises."""
        self._cause = None
        try:
            act()
        except InputError as error:
            self._cause = error
            if not self._starting:  # then it is said by whoever started the node
                self.get_logger().error(f'cannot {name}: {error}')
            return FAILURE
        except Exception as error:
            self._cause = error
            self.get_logger().error(f'{name} broke: {traceback.format_exc()}')
            return ERROR
        return SUCCESS

    def refuse_change(self, asked: Mapping[str, Any]) -> None:
        """Refuse another controller in flight, or one that does not load."""
        if 'controller' in asked:
            if self.active:
                raise InputError(
                    '`controller` may not change while the controller is active: '
                    f'`ros2 lifecycle set {self._full} deactivate` first'
                )
            self._checked = self._loaded(asked['controller'])

    def changed(self, applied: Mapping[str, Any]) -> None:
        """Fly the new controller file from the next activation on."""
        if 'controller' in applied and self.law is not None:
            self._take(*self._checked)

    def health(self) -> health.Health:
        """Return what /diagnostics says: the lifecycle's state, the file and its hash."""
        level, _, values = super().health()
        doing = 'commanding' if self.active else 'commanding zero' if self._began else 'silent'
        doing = 'no states: the plant is gone' if self.plant_gone else doing
        values = {
            'state': self.label,
            'controller': self.law.name if self.law is not None else '',
            'controller_file': self.values['controller'],
            'controller_sha256': self._sha256,
            'answered_zero': self.answered_zero,
            **values,
        }
        return level if self.active else health.WARN, f'{self.label}: {doing}', values
