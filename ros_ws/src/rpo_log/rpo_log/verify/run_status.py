# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What run_status says of the flight, recomputed: phases, their order, figures to the last digit.

Its texts, and the events of `stage_status`, are what the nodes said; nothing computes them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import NEXT
from rpo_core.wire.statuses import ABORTED, FINISHED, LEVELS, RUNNING
from rpo_log import topics
from rpo_log.read.decode import Event, TickBlock
from rpo_log.topics import Topic
from rpo_log.verify.verification import REST, Difference

_FIGURES = ('time_s', 'energy_n2s', 'distance_m', 'speed_m_s', 'saturated_ticks')


class Statuses:
    """Compares the events of a log with its flight.

    free : free running: the end carries figures of the wall clock
    awaited : signals that the plant reads and does not make; it may go on without them
    foreign : the plant is somebody else's: its figures are not judged
    """

    def __init__(
        self,
        scenario: Scenario,
        topic: Topic | None,
        free: bool,
        awaited: Collection[str],
        foreign: bool = False,
    ) -> None:
        self._scenario, self._topic, self._free = scenario, topic, free
        self._awaited = {interfaces.row_of(name).rides or name for name in awaited} - {*NEXT}
        self._foreign = foreign
        self._phases: list[str] = []
        self._said = hashlib.sha256()
        # squares per axis [N^2], energy [N²s], saturated ticks; NaN from an unknown on
        self._spent = np.zeros(5)
        self._next = 0  # tick from which they are known
        # of the last two blocks: ticks, states, and what was spent before each tick
        self._blocks: list[tuple[NDArray[np.int64], Floats, Floats]] = []

    @property
    def said(self) -> str:
        """SHA-256 of the events, as they were logged."""
        return self._said.hexdigest()

    @property
    def gaps(self) -> list[str]:
        """What run_status should say of a whole flight and does not."""
        if self._topic is None or (
            self._phases[:1] == [RUNNING] and self._phases[-1:] == [FINISHED]
        ):
            return []
        phases = ', '.join(dict.fromkeys(self._phases))
        said = f'its phases are {phases}' if phases else 'it says nothing'
        return [f'{self._topic.name} does not say that the flight began and finished: {said}']

    def account(self, block: TickBlock, taken: Floats, due: Floats) -> None:
        """Add up what the thrusters took, (n, 3) N, of the (n, 3) N that were due."""
        saturated = (taken != due).any(axis=1) * 1.0
        saturated[np.isnan(taken).any(axis=1)] = np.nan
        squares = taken * taken
        energy = (squares[:, 0] + squares[:, 1] + squares[:, 2]) * self._scenario.dt_s
        each = np.column_stack([squares, energy, saturated])
        sums = np.cumsum(np.concatenate([self._spent[None], each]), axis=0)
        skipped = np.flatnonzero(block.ticks != np.append(self._next, block.ticks[:-1] + 1))
        sums[skipped[0] if len(skipped) else len(sums) :] = np.nan
        self._next = int(block.ticks[-1]) + 1 if len(block.ticks) else self._next
        self._spent = sums[-1]
        states = block.values[interfaces.RELATIVE_STATE]
        self._blocks = [*self._blocks[-1:], (block.ticks, states, sums[:-1])]

    def difference(self, event: Event) -> Difference | None:
        """Return what an event says that does not follow from the flight."""
        status = event.status
        self._said.update(b'%d %d ' % (event.tick, len(event.signal)) + event.signal.encode())
        self._said.update(cdr.encode_status(*status))
        repeated = len(event.values) < len(status.values)
        if event.signal == interfaces.STAGE_STATUS and repeated:  # readers take one or the other
            names = ' '.join(name for name, _ in status.values)
            return Difference(event.tick, event.signal, 'values', names, 'each name once', REST)
        if event.signal != interfaces.RUN_STATUS or self._topic is None:
            return None
        for field, logged, computed in self._compared(event):
            if logged != computed and not (self._foreign and field in _FIGURES):
                name = self._topic.name
                return Difference(event.tick, name, field, logged, computed, REST)
        self._phases.append(event.values.get('phase', ''))
        return None

    def _compared(self, event: Event) -> Iterator[tuple[str, str, str]]:
        """Yield (field, logged, computed) of a run_status."""
        status, values = event.status, event.values
        phase = values.get('phase', '')
        goes_on = self._phases[-1:] in ([], [RUNNING])  # the first may be missing: a gap
        wanted = (RUNNING, FINISHED, ABORTED) if goes_on else ()
        yield 'phase', phase, phase if phase in wanted else ' or '.join(wanted) or 'none'
        level = LEVELS[phase]
        yield 'level', str(status.level), str(status.level if status.level in level else level[0])
        yield 'name', status.name, 'run'
        yield 'hardware_id', status.hardware_id, 'none'
        tick, last = topics.tick_of(status), self._scenario.ticks
        sound = tick is not None and tick <= event.tick and (phase != FINISHED or tick == last)
        tick = tick if tick is not None and sound else last if phase == FINISHED else event.tick
        yield 'tick', values.get('tick', ''), str(tick)
        yield 'time_s', values.get('time_s', ''), repr(self._scenario.time_s(tick))
        dropped = values.get('dropped', '').split()
        awaited = [name for name in dropped if name in self._awaited]
        yield 'dropped', ' '.join(dropped), ' '.join(awaited)
        yield from self._figures(tick, values)
        names = [name for name, _ in status.values]
        allowed = ['phase', 'tick', 'dropped', *_FIGURES]
        ended_free = self._free and phase in (FINISHED, ABORTED)
        for name in names:
            is_there = names.count(name) == 1 and (name in allowed or ended_free)
            yield 'values', name, name if is_there else 'no such value'

    def _figures(self, tick: int, values: dict[str, str]) -> Iterator[tuple[str, str, str]]:
        for name, computed in self._figures_at(tick).items():
            # In free running what was applied is saturated already.
            if not (self._free and name == 'saturated_ticks'):
                logged, texts = values.get(name, 'nothing'), [repr(value) for value in computed]
                yield name, logged, logged if logged in texts else texts[0]

    def _figures_at(self, tick: int) -> dict[str, tuple[float, ...]]:
        """Return the figures that are known at a tick of the last blocks.

        Of the energy there are two: older versions of the plant added it up in another order.
        """
        figures: dict[str, tuple[float, ...]] = {}
        for ticks, states, spent in self._blocks:
            for row in np.flatnonzero(ticks == tick).tolist():
                x, y, z, in_turn, saturated = spent[row].tolist()
                if not math.isnan(saturated):
                    figures['energy_n2s'] = ((x + y + z) * self._scenario.dt_s, in_turn)
                    figures['saturated_ticks'] = (int(saturated),)
                state = states[row].tolist()
                if not math.isnan(state[0]):
                    figures['distance_m'] = (norm(*state[:3]),)
                    figures['speed_m_s'] = (norm(*state[3:]),)
        return figures
