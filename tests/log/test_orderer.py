# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks come out in order and complete, however the topics drift against each other."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_log.write.orderer import TickOrderer
from rpo_log.write.tick_messages import REORDER, WINDOW

QUICK = settings(max_examples=150, deadline=None, derandomize=True, database=None)
EVENT = 2


class Listener:
    """An orderer of two topics of every tick and one of events, and what it let go."""

    def __init__(self) -> None:
        self.out: list[tuple[int, tuple[bytes | None, ...]]] = []
        self.orderer = TickOrderer(3, frozenset({EVENT}), EVENT, self.hear)

    def hear(self, tick: int, messages: list[tuple[int, bytes]]) -> None:
        found = dict(messages)
        self.out.append((tick, tuple(found.get(index) for index in range(3))))

    def say(self, index: int, tick: int, text: str = '') -> None:
        self.orderer.add(index, tick, (text or f'{index} at {tick}').encode())

    @property
    def ticks(self) -> list[int]:
        return [tick for tick, _ in self.out]


def begun() -> Listener:
    heard = Listener()
    for index in (EVENT, 0, 1):
        heard.say(index, 0)
    assert heard.ticks == [0]
    return heard


@QUICK
@given(st.lists(st.integers(0, 1), max_size=80), st.integers(0, 79), st.data())
def test_any_interleaving_gives_the_same_ticks(turns, event_at, data):
    # Whose message comes next; what is left follows. The event comes at any place.
    heard = Listener()
    queues = [list(range(40)), list(range(40))]
    for place, turn in enumerate(turns + [0] * 40 + [1] * 40):
        if place == event_at:
            heard.say(EVENT, 0)
        if queues[turn]:
            tick = queues[turn].pop(0)
            heard.say(turn, tick)
            if data.draw(st.integers(0, 9)) == 0:
                heard.say(turn, tick)  # a message that is sent again is the same message
    heard.orderer.close(last_tick=39)
    steady = [(t, m[:EVENT]) for t, m in heard.out if m[0] is not None]
    assert steady == [(t, (f'0 at {t}'.encode(), f'1 at {t}'.encode())) for t in range(40)]
    events = [t for t, m in heard.out if m[EVENT] is not None]
    assert events == [0]
    assert heard.ticks == sorted(heard.ticks)
    assert not any(c.missing or c.conflicts or c.late for c in heard.orderer.counts)


def test_a_complete_tick_goes_at_once():
    heard = begun()
    heard.say(0, 1)
    assert heard.ticks == [0]
    heard.say(1, 1)
    assert heard.ticks == [0, 1]


def test_tick_0_is_written_before_the_first_event_and_tick_1_after():
    # the recorder says that it is ready when it has tick 0, and the event follows from that
    heard = Listener()
    heard.say(0, 0)
    heard.say(1, 0)
    assert heard.ticks == [0]
    heard.say(0, 1)
    heard.say(1, 1)
    assert heard.ticks == [0]
    heard.say(EVENT, 0)
    assert heard.ticks == [0, 0, 1]


def test_without_any_event_the_ticks_go_after_a_window():
    heard = Listener()
    for tick in range(WINDOW + 3):
        heard.say(0, tick)
        heard.say(1, tick)
    assert heard.ticks == list(range(WINDOW + 3))


def test_a_hole_is_passed_once_its_topic_is_beyond_it():
    heard = begun()
    for tick in range(1, 10):
        heard.say(0, tick)
        if tick != 4:
            heard.say(1, tick)
        expected = tick if not 4 <= tick < 4 + REORDER else 3
        assert heard.ticks[-1] == expected
    assert (4, (b'0 at 4', None, None)) in heard.out
    assert heard.orderer.counts[1].missing == 1
    assert heard.orderer.counts[1].first_missing == 4


def test_a_silent_topic_holds_the_others_for_one_window_only():
    heard = begun()
    for tick in range(1, WINDOW + 1):
        heard.say(0, tick)
    assert heard.ticks == [0]
    heard.say(0, WINDOW + 1)
    assert heard.ticks[-1] == WINDOW  # released; the newest may still be completed
    heard.say(0, WINDOW + 2)
    assert heard.ticks[-1] == WINDOW + 1
    for tick in range(WINDOW + 3, WINDOW + 6):  # it speaks again, and is waited for again
        heard.say(0, tick)
        assert heard.ticks[-1] == tick - 1
        heard.say(1, tick)
        assert heard.ticks[-1] == tick
    assert heard.orderer.counts[1].missing == WINDOW + 2


def test_late_and_contradicting_messages_change_nothing():
    heard = begun()
    for tick in range(1, 9):
        heard.say(0, tick)
        if tick != 2:
            heard.say(1, tick)
    before = list(heard.out)
    heard.say(1, 2)  # given up already
    heard.say(0, 8, 'other')  # waits no more: 8 is complete and gone
    heard.say(0, 3)  # again, the same
    assert heard.out == before
    counts = heard.orderer.counts
    assert counts[1].late == 1
    assert (counts[0].conflicts, counts[0].first_conflict) == (1, 8)
    assert counts[0].duplicates == 1


def test_a_recorder_that_comes_late_begins_where_it_came():
    heard = Listener()
    for tick in range(5000, 5003):
        heard.say(0, tick)
        heard.say(1, tick)
    heard.orderer.close(last_tick=6000)
    assert heard.ticks == [5000, 5001, 5002]
    assert heard.orderer.counts[0].missing == 5000


def test_the_answers_to_the_last_state_are_owed_only_at_the_end_of_all():
    aborted, finished = begun(), begun()
    for heard in (aborted, finished):
        for tick in range(1, 5):
            heard.say(0, tick)
            if tick < 4:
                heard.say(1, tick)
    aborted.orderer.close(last_tick=100)
    finished.orderer.close(last_tick=4)
    assert aborted.orderer.counts[1].missing == 0
    assert finished.orderer.counts[1].missing == 1
    assert aborted.out[-1] == finished.out[-1] == (4, (b'0 at 4', None, None))


def test_what_is_stamped_ahead_moves_nothing():
    heard = begun()
    for tick in (1, 2, 3, 4, 900, WINDOW - 1):
        heard.say(1, tick, 'not yet')
    for tick in (WINDOW - 1, 500, 900):
        heard.say(0, tick, 'not the plant')
    for tick in range(1, 30):
        heard.say(0, tick)
        heard.say(1, tick)
    heard.orderer.end(29)
    heard.orderer.close(last_tick=29)
    assert heard.out[1:] == [(t, (b'0 at %d' % t, b'1 at %d' % t, None)) for t in range(1, 30)]
    counts = heard.orderer.counts
    assert not any(c.missing or c.late for c in counts)
    assert (counts[0].ignored, counts[1].ignored) == (3, 2)


def test_a_hole_in_the_states_is_passed_once_they_follow_each_other():
    heard = begun()
    for tick in range(1, 40):
        for index in (0, 1):
            if (index, tick) != (0, 4):
                heard.say(index, tick)
    assert heard.ticks == list(range(40))
    assert heard.out[4] == (4, (None, b'1 at 4', None))
    assert all(None not in messages[:EVENT] for tick, messages in heard.out if tick != 4)
    assert heard.orderer.counts[0].missing == 1


def test_a_hostile_state_far_ahead_costs_no_time_and_no_memory():
    heard = begun()
    for tick in range(1, 100):
        heard.say(0, tick * 1_000_000_000)
        heard.say(1, tick * 1_000_000_000)
        heard.say(0, tick)
        heard.say(1, tick)
    heard.orderer.close(last_tick=99)
    assert heard.ticks == list(range(100))


def test_a_message_far_ahead_gives_way_to_one_that_comes_near_its_state():
    """A forged one said tick 5000 at tick 0; the real one too came a moment before its state."""
    heard = begun()
    heard.say(1, 2 * WINDOW, 'forged')
    heard.say(1, 2 * WINDOW, 'forged too')
    for tick in range(1, 2 * WINDOW + 20):
        heard.say(1, tick)
        heard.say(0, tick)
    heard.orderer.end(2 * WINDOW + 19)
    heard.orderer.close(last_tick=2 * WINDOW + 19)
    assert heard.ticks == list(range(2 * WINDOW + 20))
    assert all(found[:2] == (b'0 at %d' % t, b'1 at %d' % t) for t, found in heard.out)
    assert heard.orderer.counts[1].ignored == 2
    assert heard.orderer.counts[1].conflicts == 0


def test_a_message_that_came_a_little_early_does_not_give_way_to_a_late_one():
    """A forged one had the numbers of five ticks after; the real one was heard before its state."""
    heard = begun()
    heard.orderer.wary = True
    for tick in range(1, 30):
        heard.say(1, tick)
        heard.say(0, tick)
        if tick > 6:
            heard.say(1, tick - 5, 'forged')
    heard.orderer.end(29)
    heard.orderer.close(last_tick=29)
    assert all(found[1] == b'1 at %d' % t for t, found in heard.out)
