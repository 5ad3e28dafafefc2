# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The node that runs a part of the chain: subscribe, match by stamp, step once a tick, publish.

It is a managed (lifecycle) node. An inactive one answers every tick as if its stages were not in
the chain (`Stage.off`): nav2's would say nothing, and in lockstep time would stop. `docs/faults.md`
has the table of transitions.
"""

from __future__ import annotations

import time
import traceback
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import partial, partialmethod
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from rpo_core.chain.chain import Chain, Signals
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import WITHOUT_COMMAND, ZERO, Signal, Stage
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import current
from rpo_core.wire.statuses import ENDED, GONE, REFUSED, RUNNING, WAITING, RunStatus
from rpo_ros import health, qos
from rpo_ros.heartbeat import Pulse
from rpo_ros.parameter_rows import AUTOSTART
from rpo_ros.plant_scenario import PlantScenario
from rpo_ros.rclpy_private import Lifecycle
from rpo_ros.running import EXIT_BAD_INPUT, FlightNode
from rpo_ros.signals import Outlet, hear, listen, to_status

MOST_REPEATS = 3
"""Without a command, of this tick or before, a state that was repeated so often is answered; in
free running, one that is so many ticks newer than the last answer."""

LEAST_WAIT_S = 0.6
"""But not so soon after it first came, by the node's own clock: anybody can send copies of a state,
and the plant needs 0.75 s for so many."""

FAR_TICKS = 100
"""An input so many ticks ahead of the last answer is somebody else's, unless a row begins there."""

ROW = 3
"""So many inputs, each of them one to `ROW` ticks after the one before, are a row."""

LONELY_S = 3.0
"""A plant that stands repeats its state more often than this."""

LOST_TICKS = 5
"""A peer whose commands are missing at so many ticks in a row is lost."""


class InputTimeout:
    """Counts how often a state comes again while something is missing.

    may_miss : signal -> the stage that goes on without it
    """

    def __init__(self) -> None:
        self.may_miss: dict[str, Stage] = {}
        self.forget()

    def forget(self) -> None:
        """Begin a run."""
        self._stamp_ns, self._repeats, self._came_s = -1, 0, 0.0
        self._newest_ns, self._dt_ns, self._near_s = -1, 0, 0.0
        self._row: list[int] = []
        self._gone_on, self._in_a_row = -1, 0  # newest tick without something, and how many

    def answered(self, stamp_ns: int, dt_ns: int) -> None:
        """Note the stamp of an answer."""
        self._newest_ns, self._dt_ns = max(stamp_ns, self._newest_ns), dt_ns

    def is_stray(self, stamp_ns: int) -> bool:
        """Return whether an input is to be ignored: it is far ahead of the newest answer.

        A stage with memory that took it could answer no tick before it any more. It is not ignored
        where a row of inputs begins, or where it comes again and for LONELY_S nothing else came.
        """
        if self._newest_ns < 0 or stamp_ns <= self._newest_ns + FAR_TICKS * self._dt_ns:
            self._near_s, self._row = time.monotonic(), []
            return False
        follows = self._row and 0 <= stamp_ns - self._row[-1] <= ROW * self._dt_ns
        self._row = [*self._row[1 - ROW :], stamp_ns] if follows else [stamp_ns]
        lonely = time.monotonic() - self._near_s > LONELY_S
        return len(self._row) < ROW or (len(set(self._row)) < ROW and not lonely)

    @property
    def calm(self) -> bool:
        """Whether nothing came again, and no tick of the run missed anything."""
        return not (self._repeats or self._in_a_row)

    def hear(self, chain: Chain) -> None:
        """Take the stages whose inputs are waited for."""
        self.may_miss = {
            read: link.stage
            for link in chain.links
            for name, read in zip(link.stage.inputs, link.reads, strict=True)
            if name in link.stage.may_miss and read in chain.inputs
        }

    def came(self, stamp_ns: int, again: bool) -> None:
        """Note when an input of a tick first came, and count how often it came again."""
        if self._stamp_ns != stamp_ns:
            self._stamp_ns, self._repeats, self._came_s = stamp_ns, 0, time.monotonic()
        self._repeats += again

    def is_over(
        self, missing: Sequence[str], tick: int, last_tick: int, stamp_ns: int, late: bool
    ) -> bool:
        """Return whether to go on with zero for what is missing.

        Where nobody would read it, the node waits at LOST_TICKS ticks and not at those that follow:
        a peer that lives stays in step, and one that is lost costs no time.

        last_tick : that was answered; -1: none yet, and commands of this tick may still begin
        late : in free running, whether the state is too new to wait
        """
        now = [name for name in missing if current(name) == name]
        if not self.may_miss.keys() >= set(now) or (now and last_tick < 0):
            return False
        unread = all(self.may_miss[name].goes_without(tick) for name in now)
        waited = self._stamp_ns == stamp_ns and time.monotonic() - self._came_s >= LEAST_WAIT_S
        over = last_tick < 0 or (waited and self._repeats >= MOST_REPEATS) or late
        follows = self._gone_on == tick - 1
        if over or (now and unread and follows and self._in_a_row >= LOST_TICKS):
            self._in_a_row = self._in_a_row + 1 if follows else 1
            self._gone_on = tick
            return True
        return False


SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)

FOREIGN, LATE = 'foreign_stamp', 'late'
_NOTHING: tuple[int, Signal] = (-1, ())

_LAST_WORDS = Duration(seconds=0, nanoseconds=200_000_000)
"""Longest wait, at the end, until the listeners acknowledge."""

_REFUSAL_S = 1.0
"""How long a node that refuses a run stays, so that the plant finds it and hears why."""

SILENT_S = 3.0
"""A running plant that sends no state for so long is gone; the warning follows within a second."""

PATIENCE_S = 3.0
"""A plant that sends states for so long without a manifest has no scenario to publish."""


class StageNode(Lifecycle, FlightNode):
    """Answers the inputs of each tick with the outputs of its stages, with the stamp of the inputs.

    A repeated input gets the same answer again. Where stages have memory, an input out of order
    changes nothing. `ignored` counts the inputs without an answer, by reason.

    A stage that reads the command of the tick before waits for it. It takes zero at tick 0; from
    where the plant coasts; and, said on `stage_status`, where it began in flight or the state was
    repeated for a while (`InputTimeout`). In free running it reads what the plant applied, but
    of a chaser that turns, whose plant says that in other axes, what was sent. A stage that may
    miss a command of this tick waits as long, once a run has begun.

    Before its first activation it sends nothing, and a plant waits. After that it answers every
    tick, without its stages while it is inactive. Each change in flight is an event on
    `stage_status`; switched on again, stages begin anew. The subclass calls `start` when it is
    ready.

    bare : whether its stages depend on no section of the scenario
    off : what it does while inactive, for people
    chain : the stages, None until the scenario is known
    active : whether it answers with its stages
    answered_inactive : ticks answered while it was not
    """

    bare: ClassVar[bool] = False
    off = ''

    def __init__(self, name: str, overrides: Mapping[str, Any] | None) -> None:
        FlightNode.__init__(self, name, overrides)
        self.active = self._began = self._starting = False
        self._cause: Exception | None = None
        self.answered_inactive = 0
        self.chain: Chain | None = None
        self.answered = 0
        self.ignored: Counter[str] = Counter()
        self.last_tick, self._anew = -1, False
        self.plant_phase = ''
        self._answered_s: float | None = None
        self._heard_s: float | None = None
        self._rate = health.Rate()
        self._outlets: dict[str, Outlet] = {}
        self._inlets: dict[str, Any] = {}
        self._waiting: dict[str, tuple[int, Signal]] = {}
        self._reads: tuple[str, ...] = (interfaces.RELATIVE_STATE,)
        self._routes: dict[str, list[tuple[str, slice]]] = {}
        self._input_timeout = InputTimeout()
        self._asked: tuple[Any, ...] = ()
        self._signals: Signals = {}
        self._dropped: dict[str, int] = {}
        self._sent: list[tuple[Outlet, bytes]] = []
        self.manifest: health.Manifest | None = None
        self._stage_status = self.create_publisher(
            DiagnosticStatus, interfaces.STAGE_STATUS, qos.LATCHED
        )
        self._run = PlantScenario(
            self, self.values['scenario'], self._fly_in, self.refuse, self.bare
        )
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

    def begin(self) -> None:
        """Start to listen; the subclass is ready."""
        self._open(self.outlets())
        if not self._inlets:
            self._listen(interfaces.RELATIVE_STATE)
        hear(self, RunStatus, self._on_run_status, qos.LATCHED)
        health.publish_health(self, self.health)
        self._pulse = Pulse(self, self._stages)
        self._run.begin()

    def _stages(self) -> list[str]:
        return [link.stage.name for link in self.chain.links] if self.chain else []

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the run, None until it is known."""
        return self._run.scenario

    @abstractmethod
    def part(self, scenario: Scenario) -> Chain | None:
        """Return the stages that this node runs; None: the scenario has no stage for it."""

    def outlets(self) -> Sequence[str]:
        """Return the signals that it publishes for every scenario."""
        return ()

    def without_scenario(self) -> Chain | None:
        """Return the stages for a plant without a manifest; None: there are none."""
        return None

    def configure(self) -> None:
        """Load what it needs; raises InputError, after which the node stays unconfigured."""

    def forget(self) -> None:
        """Forget what was loaded."""

    def switched(self) -> Sequence[str]:
        """Return the names of the stages that are switched on and off."""
        return self._stages()

    def step(self, tick: int, signals: Signals) -> None:
        """Add the outputs of a tick to `signals`, which hold its inputs.

        As if the stages were not there when not active.
        """
        if self.active:
            try:
                if self.chain is not None:
                    self.chain.step(tick, signals)
                return
            except Exception:  # after an error in a stage the plant still needs an answer
                self.get_logger().error(f'no answer to {signals}: {traceback.format_exc()}')
                self.last_tick = tick - 1
                self.trigger_deactivate()
        self.answered_inactive += 1
        for link in self.chain.links if self.chain is not None else ():
            outputs = link.stage.off(*(signals[name] for name in link.reads))
            signals.update(zip(link.stage.outputs, outputs, strict=True))

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Do the work that can wait until the answer is sent."""

    def rebuild(self) -> None:
        """Make the stages again, in the same run; raises InputError."""
        if self.scenario is not None and self._connect(self.scenario):
            self._take_up()

    def publish_stage_status(self, stage: str, state: str, tick: int, reason: str) -> None:
        """Publish the state of a stage from a tick on."""
        level = health.OK if state == 'active' else health.WARN
        values = [('stage', stage), ('state', state), ('tick', tick), ('reason', reason)]
        self._stage_status.publish(to_status(level, self.get_name(), reason, values))

    def refuse(self, reason: str) -> None:
        """Take no part in the run: publish the reason, also for the plant, and end."""
        self.get_logger().error(reason)
        self.publish_stage_status(self.get_name(), REFUSED, max(0, self.last_tick + 1), reason)
        self.exit_code = EXIT_BAD_INPUT
        self.chain = None
        self.every(_REFUSAL_S, self._leave)

    def _leave(self) -> None:
        self.done = True

    def refusal(self) -> str:
        """Return why inputs get no answer now; '' if they get one."""
        return '' if self._began else 'not_activated'

    def _fly_in(self, scenario: Scenario) -> None:
        """Take part in a run of a scenario; raises InputError."""
        if self._connect(scenario):
            self.new_run()
            self._take_up()

    def _connect(self, scenario: Scenario) -> bool:
        """Make the stages of a scenario, if it has any here, and connect to their signals."""
        chain = self.part(scenario)
        if chain is None:
            return False
        made = [name for name in chain.outputs if interfaces.row_of(name).type]
        self._open(made)
        for name in made:
            self._outlets[name].fly_in(scenario)
        self._hear(chain)
        chain.warm_up(tuple(map(float, scenario.start)))
        self.chain = chain
        if self.manifest is not None:
            self.manifest.repeat()  # it names the topics that are heard from now on
        return True

    def _open(self, outputs: Iterable[str]) -> None:
        """Make the publishers of some signals."""
        for name in outputs:
            if name not in self._outlets:
                self._outlets[name] = Outlet(self, name)

    def _hear(self, chain: Chain) -> None:
        """Listen to the inputs of the stages, and to nothing else."""
        self._reads = chain.inputs or (interfaces.RELATIVE_STATE,)
        self._input_timeout.hear(chain)
        sources: dict[str, list[tuple[str, slice]]] = {}
        for read in self._reads:
            name = self._source(read)
            width, rides = len(interfaces.row_of(name).columns), interfaces.row_of(read).rides
            part = slice(width, None) if rides else slice(width)
            sources.setdefault(name, []).append((read, part))
        self._routes = sources
        unused = set(self._inlets) - set(sources)
        narrow = {name for name in self._inlets if interfaces.row_of(name).rider in self._reads}
        for name in unused | narrow:  # those may have been made without what rides in them
            self.destroy_subscription(self._inlets.pop(name))
        for name in sources:
            if name not in self._inlets:
                self._listen(name)

    def _source(self, read: str) -> str:
        """Return the topic that carries what is read."""
        name = interfaces.current(read)
        turns = self.scenario is not None and self.scenario.named('attitude_control') is not None
        if name != read and self._run.free_running and not turns:
            return interfaces.APPLIED_FORCE
        return interfaces.row_of(name).rides or name

    def _listen(self, name: str) -> None:
        take = partial(self._on_signal, name)
        wide = interfaces.row_of(name).rider in self._reads
        self._inlets[name] = listen(self, name, take, self._ignore, with_rider=wide)

    def _ignore(self, reason: str) -> None:
        self.ignored[reason] += 1

    def _on_signal(self, name: str, stamp_ns: int, values: Signal) -> None:
        chain = self.chain
        if self.exit_code:  # it refused, and leaves
            return
        if self._input_timeout.is_stray(stamp_ns):
            self.ignored['stray'] += 1
            return
        if chain is None:
            reason = self.refusal()
            if reason:
                self.ignored[reason] += 1
            else:
                self._wait_for_scenario(name, stamp_ns, values)
            return
        if self._reads == (name,):
            self._ask(stamp_ns, {name: values})
            return
        for read, part in self._routes.get(name, ()):
            if values[part]:  # what came before the scenario may lack the rider: it is sent again
                self._take(read, stamp_ns, values[part])

    def _take(self, read: str, stamp_ns: int, values: Signal) -> None:
        """Take one of several inputs; answer if all of its tick are there."""
        delayed = interfaces.current(read) != read
        again = not delayed and self._waiting.get(read) == (stamp_ns, values)
        if delayed and self.scenario is not None:
            stamp_ns += self.scenario.dt_ns
            answered = self._asked and stamp_ns <= self._asked[0]
            if answered or self.scenario.tick_of(stamp_ns) is None:
                return  # it must not replace the one that waits: nobody sends that again
        elif not interfaces.row_of(read).rides:
            self._input_timeout.came(stamp_ns, again)
        self._waiting[read] = stamp_ns, values
        if self._goes_smoothly(stamp_ns):
            waiting = [self._waiting.get(name, _NOTHING) for name in self._reads]
            if all(at == stamp_ns for at, _ in waiting):
                inputs = (signal for _, signal in waiting)
                self._ask(stamp_ns, dict(zip(self._reads, inputs, strict=True)))
            return
        inputs = {name: self._input(name, stamp_ns) for name in self._reads}
        missing = [name for name, signal in inputs.items() if signal is None]
        over = bool(self._asked) and stamp_ns <= self._asked[0]
        if over and read in self._input_timeout.may_miss and self._signals.get(read) != values:
            return  # that tick was answered without it
        if missing and (len(missing) < len(inputs)) and self._goes_without(missing, stamp_ns):
            inputs.update((name, (0.0,) * len(interfaces.row_of(name).columns)) for name in missing)
            missing = []
        if not missing:
            self._ask(stamp_ns, {name: signal for name, signal in inputs.items() if signal})
        elif again and any(interfaces.current(name) != name for name in missing):
            self._send_again()  # and so the command that was lost is sent again

    def _goes_smoothly(self, stamp_ns: int) -> bool:
        """Return whether a tick follows an answered one, and nothing was lost: it needs all."""
        after = bool(self._asked) and stamp_ns > self._asked[0]
        return after and self._input_timeout.calm and not (self._dropped or self._run.free_running)

    def _input(self, read: str, stamp_ns: int) -> Signal | None:
        """Return an input of a tick: that of the answer given before, or one that waits."""
        answered = bool(self._asked) and self._asked[0] == stamp_ns
        if answered and read in self._input_timeout.may_miss:
            return self._signals.get(read)
        if interfaces.current(read) != read:
            tick = self.scenario.tick_of(stamp_ns) if self.scenario is not None else None
            coasts = self._dropped.get(self._source(read))
            if tick == 0 or (coasts is not None and tick is not None and tick > coasts):
                return ZERO
            if answered:
                return self._signals.get(read)
        at, values = self._waiting.get(read, (None, ()))
        return values if at == stamp_ns else self._signals.get(read) if answered else None

    def _goes_without(self, missing: Sequence[str], stamp_ns: int) -> bool:
        """Return whether to go on with zero for what is missing; say so on `stage_status`."""
        tick = self.scenario.tick_of(stamp_ns) if self.scenario is not None else None
        late = self._run.free_running and tick is not None and tick > self.last_tick + MOST_REPEATS
        last = self.last_tick
        if tick is None or not self._input_timeout.is_over(missing, tick, last, stamp_ns, late):
            return False
        for link in self.chain.links if self.chain is not None else ():
            if set(missing) & set(link.reads) and not link.stage.goes_without(tick):
                before = interfaces.current(missing[0]) != missing[0]
                reason = f'no {self._source(missing[0])} of tick {tick - before}'
                link.stage.take_event(tick, WITHOUT_COMMAND)
                self.publish_stage_status(link.stage.name, WITHOUT_COMMAND, tick, reason)
        return True

    def _wait_for_scenario(self, name: str, stamp_ns: int, values: Signal) -> None:
        """Keep the newest input; after PATIENCE_S go on without a scenario."""
        self._waiting[name] = (stamp_ns, values)
        if self._heard_s is None:
            self._heard_s = time.monotonic()
            self._waits = self.every(PATIENCE_S, self._lose_patience)

    def _lose_patience(self) -> None:
        self.destroy_timer(self._waits)
        if self.chain is None and self.scenario is None:
            self.chain = self.without_scenario()
            if self.chain is not None:
                self.get_logger().warning(
                    'the plant publishes no scenario: this node reads relative_state'
                )
                self._take_up()

    def _take_up(self) -> None:
        """Answer the inputs that came before the stages were known."""
        waiting, self._waiting = self._waiting, {}
        for name, (stamp_ns, values) in waiting.items():
            self._on_signal(name, stamp_ns, values)

    def _ask(self, stamp_ns: int, signals: Signals) -> None:
        """Answer the inputs of a tick."""
        asked = (stamp_ns, *signals.values())
        if self._anew:
            self._begin_anew(stamp_ns)
        if asked == self._asked:
            self._send_again()
            self.answered += 1
            self.after_answer(stamp_ns, self._signals)
            return
        reason, tick = self._placed(stamp_ns)
        if reason:
            self.ignored[reason] += 1
            return
        if self.last_tick < 0 < tick and self.chain is not None:
            if not self._run.confirmed(PATIENCE_S):
                return  # it joins in flight: the plant may fly another scenario
            self._say_begun(self.chain, tick)
        self.step(tick, signals)
        self._sent = [(out, out.publish_of(stamp_ns, signals)) for out in self._outlets.values()]
        self._asked, self._signals = asked, signals
        self.last_tick = max(tick, self.last_tick)
        if self.scenario is not None:
            self._input_timeout.answered(stamp_ns, self.scenario.dt_ns)
        self.answered += 1
        self._answered_s = time.monotonic()
        self.after_answer(stamp_ns, signals)

    def _send_again(self) -> None:
        for outlet, data in self._sent:
            outlet.publisher.publish(data)

    def _begin_anew(self, stamp_ns: int) -> None:
        """Begin a new run with its first state: the word of anybody alone does not end one."""
        tick = self.scenario.tick_of(stamp_ns) if self.scenario is not None else 0
        if tick == 0 or self.last_tick < 0:
            self.new_run()
        self._anew = False

    def _say_begun(self, chain: Chain, tick: int) -> None:
        """Say that stages with memory begin without it, in the middle of a run."""
        for link in chain.links:
            if link.stage.memory_ticks != 0:
                self.publish_stage_status(link.stage.name, 'active', tick, 'began in flight')

    def _placed(self, stamp_ns: int) -> tuple[str, int]:
        """Return why a stamp gets no answer ('' if it gets one), and its tick."""
        reason = self.refusal()
        if reason or self.chain is None:
            return reason or 'no_stages', -1
        tick = self.scenario.tick_of(stamp_ns) if self.scenario is not None else None
        if tick is None:
            return ('', 0) if not self.chain.counts_ticks else (FOREIGN, -1)
        if self.chain.memory_ticks != 0 and tick <= self.last_tick:
            return LATE, tick
        return '', tick

    def new_run(self) -> None:
        """Forget the run before."""
        self.last_tick, self._asked = -1, ()
        self._dropped = {}
        self._input_timeout.forget()
        for read in self._reads:
            if interfaces.current(read) != read:
                self._waiting.pop(read, None)
        if self.chain is not None:
            self.chain.reset()
        if self._began and not self.active:  # a new run may begin with an inactive node
            self._publish_state('switched off before the run')

    def _on_run_status(self, status: RunStatus) -> None:
        for name in status.dropped:
            self._dropped.setdefault(name, status.tick)
        if status.phase == WAITING and self.plant_phase not in ('', WAITING):
            self._anew = True
        alone = len(FlightNode.alive) == 1  # else the process ends with the flight
        if alone and status.phase in ENDED and self.plant_phase not in ENDED:
            self.get_logger().info(
                'the flight is over: waiting for the next; Ctrl-C ends this node'
            )
        self.plant_phase = status.phase

    @property
    def plant_gone(self) -> bool:
        """Whether no state comes although the last status of the plant was `running`."""
        flying = self.plant_phase == RUNNING and self._answered_s is not None
        return flying and health.age_s(self._answered_s) > SILENT_S

    def close(self) -> None:
        """Wait until the last answer has arrived: otherwise the log would miss it."""
        self._pulse.beat(GONE)
        for outlet in self._outlets.values():
            outlet.publisher.wait_for_all_acked(_LAST_WORDS)
        self._stage_status.wait_for_all_acked(_LAST_WORDS)

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

    def _forget(self) -> None:
        self.active = False
        self.forget()

    def _end(self) -> None:
        """Send nothing more and end the process."""
        self._forget()
        self._began = False
        self.done = True

    def health(self) -> health.Health:
        """Return the health of this node for /diagnostics; also the state of the lifecycle."""
        ignored = {f'ignored_{kind}': count for kind, count in sorted(self.ignored.items())}
        values = {
            'state': self.label,
            'answered': self.answered,
            'rate_hz': self._rate.per_s(self.answered),
            'command_age_s': health.age_s(self._answered_s),
            **ignored,
        }
        if not self.active:
            doing = self.off if self._began else 'silent'
            return health.WARN, f'{self.label}: {doing}', values
        if self.plant_gone:
            return health.WARN, 'no states: the plant is gone', values
        troubles = [link.stage.trouble() for link in self.chain.links] if self.chain else []
        if any(troubles):
            return health.WARN, '; '.join(filter(None, troubles)), values
        doing = 'answering states' if self.chain is not None else 'waiting for the scenario'
        return health.WARN if ignored else health.OK, doing, values
