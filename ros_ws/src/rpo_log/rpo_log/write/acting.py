# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which of several messages of one topic and tick acted: the next state follows from it.

The plant takes one answer to each state and ignores the others; the recorder hears all of them, in
an order of its own. In lockstep the dynamics show which acted; in free running the plant publishes
the force that it applied.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import islice, product

from rpo_core import kernels
from rpo_core.chain.chain import Chain, Signals
from rpo_core.chain.stage import Place, Signal
from rpo_core.files.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import RELATIVE_STATE, Interface
from rpo_core.world.thrusters import ZERO
from rpo_log.topics import Topic, free_running
from rpo_log.write.tick_messages import HOLD, Candidates

_MOST_TRIED = 256
_PLANT = (Place.LINK, Place.THRUSTERS, Place.DYNAMICS)
_APPLIED = {
    interfaces.COMMAND: interfaces.APPLIED_FORCE,
    interfaces.DISTURBANCE: interfaces.APPLIED_DISTURBANCE,
}


def _excess(row: Interface, data: bytes) -> int:
    """Return what a message holds: 0: its numbers; 1: a covariance that rides too; 2: more."""
    stamp_ns, values, _ = row.layout.decode(data)
    if data == row.layout.encode(stamp_ns, values[: len(row.columns)]):
        return 0
    return 1 if data == row.layout.encode(stamp_ns, values) else 2


class Acting:
    """The plant of a scenario, run again where the messages of a tick differ.

    topics : of the log, in the order of their indices
    reach : ticks after one that show which of its messages acted
    tells_states : whether it knows which state follows: not where thrusters remember all ticks
    """

    def __init__(self, scenario: Scenario, topics: Sequence[Topic]) -> None:
        self._scenario, self._topics = scenario, topics
        self._index = {topic.signal: index for index, topic in enumerate(topics)}
        whole = Chain.of(scenario)
        self._plant, self._before = whole.part(*_PLANT), whole.part(Place.SENSOR, Place.ESTIMATOR)
        self._delay = self._plant.memory_ticks or 0
        self.tells_states = self._plant.memory_ticks is not None
        self._free = free_running(topics)
        self._inputs = [name for name in self._plant.inputs if name != RELATIVE_STATE]
        self.reach = HOLD + self._delay

    def acted(self, index: int, tick: int, candidates: Candidates) -> bytes | None:
        """Return the message of a topic that acted at a tick; None if that is not known."""
        signal = self._topics[index].signal
        if signal == RELATIVE_STATE and tick == 0:
            start = tuple(map(float, self._scenario.start))
            return self._like(signal, candidates(index, 0), [start])
        if signal in self._before.outputs:
            made = self._navigated(index, tick, candidates)
            return made or self._only_plain(index, candidates(index, tick))
        if signal in self._inputs and self._free:
            return self._applied(index, tick, candidates)
        if signal == RELATIVE_STATE:
            return self._consistent(index, tick - 1, candidates)
        if signal in map(self._source, self._inputs) and self.tells_states:
            return self._consistent(index, tick + self._late(signal), candidates)
        return self._only_plain(index, candidates(index, tick))

    def _only_plain(self, index: int, found: Sequence[bytes]) -> bytes | None:
        """Return the one message that holds its numbers and nothing else, as nodes publish it."""
        row = self._topics[index].row
        plain = [data for data in found if _excess(row, data) < 2]
        return plain[0] if len(plain) == 1 else None

    def _source(self, name: str) -> str:
        """Return the topic that carries an input of the plant as it acted."""
        return _APPLIED[interfaces.row_of(name).carries] if self._free else name

    def _late(self, signal: str) -> int:
        """Return after how many ticks a signal acts."""
        return self._delay if interfaces.row_of(signal).carries == interfaces.COMMAND else 0

    def _values(self, signal: str, data: bytes) -> Signal:
        row = self._topics[self._index[signal]].row
        return row.layout.decode(data)[1][: len(row.columns)]

    def _like(self, signal: str, found: Sequence[bytes], wanted: Sequence[Signal]) -> bytes | None:
        """Return the first message with one of some values; one with nothing else in it first."""
        row = self._topics[self._index[signal]].row
        for data in sorted(found, key=partial(_excess, row)):
            if self._values(signal, data) in wanted:
                return data
        return None

    def _heard(self, signal: str, tick: int, candidates: Candidates) -> Sequence[bytes]:
        return candidates(self._index[signal], tick) if signal in self._index else ()

    def _navigated(self, index: int, tick: int, candidates: Candidates) -> bytes | None:
        """Return the message that the stages before guidance make of the state."""
        signal = self._topics[index].signal
        wanted = []
        if self._before.memory_ticks == 0:
            for state in self._heard(RELATIVE_STATE, tick, candidates):
                signals: Signals = {RELATIVE_STATE: self._values(RELATIVE_STATE, state)}
                self._before.step(tick, signals)
                wanted.append(signals[signal])
        return self._like(signal, candidates(index, tick), wanted)

    def _applied(self, index: int, tick: int, candidates: Candidates) -> bytes | None:
        """Return the answer that the plant applied in its tick or soon after."""
        signal = self._topics[index].signal
        source, limit = self._source(signal), float(self._scenario.max_force_n)
        bound = limit if interfaces.row_of(signal).carries == interfaces.COMMAND else float('inf')
        for later in range(tick, tick + HOLD):
            applied = [self._values(source, d) for d in self._heard(source, later, candidates)]
            for data in candidates(index, tick):
                values = self._values(signal, data)
                if tuple(kernels.saturate(value, bound) for value in values) in applied:
                    return data
        return None

    def _consistent(self, index: int, tick: int, candidates: Candidates) -> bytes | None:
        """Return the message from which, with others of its time, the state after a tick follows.

        index : of the topic of which a message is wanted
        """
        if tick < 0:
            return None
        reads = [(RELATIVE_STATE, tick), (RELATIVE_STATE, tick + 1)]
        reads += [(self._source(name), tick - self._late(name)) for name in self._inputs]
        if not all(self._heard(name, at, candidates) for name, at in reads[:2]):
            return None
        of_topic = [self._index.get(name) for name, _ in reads]
        place = of_topic.index(index, 1)  # not the state before: it is settled already
        heard = [self._plain_first(name, at, candidates) for name, at in reads]
        tried = product(*heard[:2], *([*found, b''] for found in heard[2:]))  # b'': none acted
        for combination in islice(tried, _MOST_TRIED):
            state, after, *answers = combination
            made = self._next_state(tick, state, answers, candidates)
            if made == self._values(RELATIVE_STATE, after):
                return combination[place] or None
        return None

    def _plain_first(self, signal: str, tick: int, candidates: Candidates) -> Sequence[bytes]:
        """Return messages, those first that hold their numbers and nothing else."""
        found = self._heard(signal, tick, candidates)
        if len(found) < 2:
            return found
        row = self._topics[self._index[signal]].row
        return sorted(found, key=partial(_excess, row))

    def _next_state(
        self, tick: int, state: bytes, answers: Sequence[bytes], candidates: Candidates
    ) -> Signal:
        """Return the state that follows a tick; thrusters that are late get the commands before."""
        self._plant.reset()
        signals: Signals = {}
        for at in range(max(0, tick - self._delay), tick + 1):
            signals[RELATIVE_STATE] = self._values(RELATIVE_STATE, state)
            for name, answer in zip(self._inputs, answers, strict=True):
                late = self._late(name)
                if at == tick - late:
                    data: bytes = answer
                else:
                    data = next(iter(self._heard(self._source(name), at, candidates)), b'')
                signals[name] = self._values(self._source(name), data) if data else ZERO
            self._plant.step(at, signals)
        return signals[RELATIVE_STATE]
