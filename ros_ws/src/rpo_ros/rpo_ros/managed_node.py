# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A managed (lifecycle) node of stages: what each transition does, and what inactive means.

An inactive node answers every tick as if its stages were not in the chain (`Stage.off`): nav2's
would say nothing, and in lockstep time would stop. `docs/faults.md` has the table.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping, Sequence
from functools import partial, partialmethod
from typing import Any, TypeVar

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from rpo_core.chain.chain import Chain, Signals
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Stage, section_of
from rpo_ros import health
from rpo_ros.parameter_rows import AUTOSTART
from rpo_ros.rclpy_private import Lifecycle
from rpo_ros.stage_node import StageNode

Found = TypeVar('Found', bound=Stage)

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class ManagedNode(Lifecycle, StageNode):
    """Answers with its stages while active, without them otherwise.

    Before its first activation it sends nothing, and a plant waits. After that it answers every
    tick. Each change in flight is an event on `stage_status`; switched on again, stages begin anew.
    The subclass calls `start` when it is ready.

    off : what it does while inactive, for people
    active : whether it is
    answered_inactive : ticks answered while it was not
    """

    off = ''

    def __init__(self, name: str, overrides: Mapping[str, Any] | None) -> None:
        StageNode.__init__(self, name, overrides)
        self.active = self._began = self._starting = False
        self._cause: Exception | None = None
        self.answered_inactive = 0
        Lifecycle.__init__(self)

    def start(self) -> None:
        """Configure and activate if it shall, and listen; raises the error of a transition."""
        if self.values[AUTOSTART.name]:
            self._starting = True
            for trigger in (self.trigger_configure, self.trigger_activate):
                if trigger() != SUCCESS:
                    raise self._cause or RuntimeError('a lifecycle transition failed')
            self._starting = False
        self.begin()
        if not self.active:
            self.get_logger().info(f'unconfigured: `ros2 lifecycle set {self._full} configure`')

    def configure(self) -> None:
        """Load what it needs; raises InputError, after which the node stays unconfigured."""

    def forget(self) -> None:
        """Forget what was loaded."""

    def switched(self) -> Sequence[str]:
        """Return the names of the stages that are switched on and off."""
        return self._stages()

    def refusal(self) -> str:
        """Return why states get no answer now."""
        return '' if self._began else 'not_activated'

    def step(self, tick: int, signals: Signals) -> None:
        """Add the outputs of the stages; as if they were not there when not active."""
        if self.active:
            try:
                super().step(tick, signals)
                return
            except Exception:  # after an error in a stage the plant still needs an answer
                self.get_logger().error(f'no answer to {signals}: {traceback.format_exc()}')
                self.last_tick = tick - 1
                self.trigger_deactivate()
        self.answered_inactive += 1
        for link in self.chain.links if self.chain is not None else ():
            outputs = link.stage.off(*(signals[name] for name in link.reads))
            signals.update(zip(link.stage.outputs, outputs, strict=True))

    @property
    def _full(self) -> str:
        return str(self.get_fully_qualified_name())

    def _try(self, name: str, act: str, _state: LifecycleState) -> TransitionCallbackReturn:
        """Run a transition, a method of the node, and log its error: rclpy would hide it."""
        self._cause = None
        try:
            getattr(self, act)()
        except InputError as error:
            self._cause = error
            if not self._starting:  # at the start `run` logs it
                self.get_logger().error(f'cannot {name}: {error}')
            return FAILURE
        except Exception as error:
            self._cause = error
            self.get_logger().error(f'{name} broke: {traceback.format_exc()}')
            return ERROR
        return SUCCESS

    on_configure = partialmethod(_try, 'configure', 'configure')
    on_activate = partialmethod(_try, 'activate', '_activate')
    on_deactivate = partialmethod(_try, 'deactivate', '_deactivate')
    on_cleanup = partialmethod(_try, 'clean up', '_forget')
    on_shutdown = partialmethod(_try, 'shut down', '_end')

    def on_error(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Become unconfigured after an error in a transition."""
        self._forget()
        return SUCCESS

    def _activate(self) -> None:
        """Answer with its stages from the next tick on."""
        again, self.active, self._began = self._began, True, True
        if again:
            if self.chain is not None:
                self.chain.reset()
            self._publish_state('activated')

    def _deactivate(self) -> None:
        """Answer without its stages from the next tick on."""
        self.active = False
        self._publish_state('deactivated')
        self.get_logger().warning(f'inactive: {self.off}')

    def _publish_state(self, reason: str) -> None:
        """Publish on `stage_status` the state of the stages and its first tick."""
        state = 'active' if self.active else 'inactive'
        for stage in self.switched():
            self.publish_stage_status(stage, state, self.last_tick + 1, reason)

    def new_run(self) -> None:
        """Forget the run before; a new one may begin with an inactive node."""
        super().new_run()
        if self._began and not self.active:
            self._publish_state('switched off before the run')

    def _forget(self) -> None:
        self.active = False
        self.forget()

    def _end(self) -> None:
        """Send nothing more and end the process."""
        self._forget()
        self._began = False
        self.done = True

    def health(self) -> health.Health:
        """Return the health: also the state of the lifecycle."""
        level, doing, values = super().health()
        if not self.active:
            level, doing = health.WARN, f'{self.label}: {self.off if self._began else "silent"}'
        return level, doing, {'state': self.label, **values}


class PlaceNode(ManagedNode):
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
