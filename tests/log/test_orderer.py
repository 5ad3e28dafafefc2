# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks come out in order and complete, however the topics drift against each other."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_log.write import orderer
from rpo_log.write.orderer import LINE, REORDER, WINDOW, TickOrderer

QUICK = settings(max_examples=40, deadline=None, derandomize=True, database=None)
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

    def both(self, *ticks: int) -> None:
        """Say the state of each tick, and then the other topic."""
        for tick in ticks:
            self.say(0, tick)
            self.say(1, tick)

    @property
    def ticks(self) -> list[int]:
        return [tick for tick, _ in self.out]

    def count(self, index: int, *names: str) -> tuple[int, ...]:
        """Return some counts of a topic."""
        return tuple(getattr(self.orderer.counts[index], name) for name in names)


def flown(last: int = 0) -> Listener:
    """Return an orderer that has let go all ticks up to one."""
    heard = Listener()
    heard.say(EVENT, 0)
    heard.both(*range(last + 1))
    assert heard.ticks == list(range(last + 1)) and heard.orderer.next_tick == last + 1
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
    assert not any(c.missing or c.differing for c in heard.orderer.counts)


@pytest.mark.parametrize('at', [1, WINDOW, WINDOW + 3])
def test_tick_0_is_written_before_the_first_event_and_tick_1_after_or_after_a_window(at):
    # the recorder says that it is ready when it has tick 0, and the event follows from that
    heard = Listener()
    for tick in range(at + 1):
        heard.both(tick)
        assert heard.ticks == ([0] if tick <= WINDOW else list(range(tick + 1)))
    heard.say(EVENT, 0)
    assert heard.ticks == ([0, *range(at + 1)] if at <= WINDOW else [*range(at + 1), at])


def test_a_hole_is_passed_once_its_topic_is_beyond_it():
    heard = flown()
    for tick in range(1, 10):
        heard.say(0, tick)
        if tick != 4:
            heard.say(1, tick)
        expected = tick if not 4 <= tick < 4 + REORDER else 3
        assert heard.ticks[-1] == expected
    assert (4, (b'0 at 4', None, None)) in heard.out
    assert heard.count(1, 'missing', 'first_missing') == (1, 4)
    before = list(heard.out)
    heard.say(1, 4)  # given up already
    assert heard.out == before and heard.count(1, 'ignored', 'differing') == (1, 0)


def test_a_silent_topic_holds_the_others_for_one_window_only():
    heard = flown()
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
    assert heard.count(1, 'missing', 'first_missing') == (WINDOW + 2, 1)


def test_a_topic_that_is_missing_is_silent_where_the_plant_waits_for_the_log():
    """They waited for each other, for ever; also for the first run_status."""
    heard = Listener()
    heard.both(0)
    for tick in range(1, 49):
        heard.say(0, tick)
    assert heard.ticks == [0]
    heard.orderer.pass_over()
    assert heard.ticks[-1] == 47  # the newest tick may still be completed
    assert heard.count(1, 'missing') == (47,)
    heard.orderer.pass_over()
    heard.say(1, 48)
    heard.both(49)
    assert heard.ticks[-1] == 49 and heard.count(1, 'missing') == (47,)


def test_a_recorder_that_comes_late_begins_where_it_came():
    for length in (3, LINE + 5):
        heard = Listener()
        heard.both(*range(5000, 5000 + length))
        heard.orderer.close(last_tick=6000)
        assert [found for found in heard.out if None in found[1][:EVENT]] == []
        assert heard.ticks == list(range(5000, 5000 + length))
        assert heard.count(0, 'missing') == heard.count(1, 'missing') == (5000,)


def test_the_answers_to_the_last_state_are_owed_only_at_the_end_of_all():
    for last_tick, missing in ((100, 0), (4, 1)):
        heard = flown(3)
        heard.say(0, 4)
        heard.orderer.close(last_tick)
        assert heard.out[-1] == (4, (b'0 at 4', None, None))
        assert heard.count(1, 'missing') == (missing,)


# The first message of a topic and tick counts.


@pytest.mark.parametrize('after', range(REORDER + 2))
@pytest.mark.parametrize('tick', [0, 3])
def test_of_two_messages_the_first_counts_and_one_that_differs_is_counted(tick, after):
    """As long as a second controller may be behind; a later one is ignored, as the plant does."""
    heard = flown(tick)
    heard.both(*range(tick + 1, tick + after + 1))
    before = list(heard.out)
    for _ in range(2):
        heard.say(1, tick, 'other')
    heard.say(1, tick)  # again, the same
    assert heard.out == before
    counted = (2, tick, 0) if after <= REORDER else (0, None, 2)
    assert heard.count(1, 'differing', 'first_differing', 'ignored') == counted
    assert heard.count(1, 'duplicates') == (1,)
    heard.both(*range(tick + after + 1, 2 * WINDOW))
    heard.say(1, tick)  # not known any more
    assert heard.count(1, 'duplicates', 'ignored') == (1, counted[2] + 1)


def test_the_first_tick_with_a_difference_is_the_lowest():
    heard = flown(3)
    for tick in (3, 2, 3):
        heard.say(1, tick, 'other')
    assert heard.count(1, 'differing', 'first_differing') == (3, 2)


def test_what_is_stamped_ahead_moves_nothing():
    heard = flown()
    for tick in (1, 2, 3, 4, WINDOW - 1, 900):
        heard.say(1, tick, 'not yet')
    for tick in (WINDOW - 1, 500, 900):
        heard.say(0, tick, 'not the plant')
    heard.both(*range(1, 30))
    heard.orderer.end(29)
    heard.orderer.close(last_tick=29)
    assert heard.out[1:] == [(t, (b'0 at %d' % t, b'1 at %d' % t, None)) for t in range(1, 30)]
    assert not any(c.missing or c.differing for c in heard.orderer.counts)
    assert (heard.count(0, 'ignored'), heard.count(1, 'ignored')) == ((3,), (6,))


def test_what_came_before_its_state_is_used_where_no_other_message_comes():
    """The states were lost for a while, and came again, in order."""
    heard = flown()
    for tick in range(1, 3 * WINDOW):
        heard.say(1, tick)
    assert heard.ticks == [0]
    for tick in range(1, 3 * WINDOW):
        heard.say(0, tick)
        assert heard.ticks[-1] == max(0, tick - REORDER)
    heard.orderer.end(3 * WINDOW - 1)  # nothing follows
    assert heard.ticks[-1] == 3 * WINDOW - 1
    for tick, found in heard.out[1:]:
        assert found == (b'0 at %d' % tick, b'1 at %d' % tick, None)
    assert not any(c.missing or c.ignored or c.differing for c in heard.orderer.counts)


def test_of_messages_before_their_state_the_last_counts_and_then_the_first():
    heard = flown()
    for text in ('forged', 'forged', 'another', ''):
        heard.say(1, 1, text)
    heard.both(2)
    heard.say(0, 1)
    assert heard.ticks == [0] and heard.count(1, 'ignored', 'differing') == (2, 0)
    heard.say(1, 1, 'first')
    assert heard.out[-1] == (1, (b'0 at 1', b'first', None))
    heard.say(1, 1)
    assert heard.count(1, 'ignored', 'differing') == (3, 1)


def test_a_hole_in_the_states_is_passed_once_they_follow_each_other():
    heard = flown()
    for tick in range(1, 40):
        for index in (0, 1):
            if (index, tick) != (0, 4):
                heard.say(index, tick)
        heard.say(0, 1000 + 2 * tick, 'not the plant')
    heard.orderer.end(39)
    assert heard.ticks == list(range(40))
    assert heard.out[4] == (4, (None, b'1 at 4', None))
    assert all(None not in messages[:EVENT] for tick, messages in heard.out if tick not in (0, 4))
    assert heard.count(0, 'missing', 'first_missing') == (1, 4)


def test_a_hostile_state_far_ahead_costs_no_time_and_no_memory():
    heard = flown()
    for tick in range(1, 100):
        heard.both(tick * 1_000_000_000)
        heard.both(tick)
    for tick in range(10**9, 10**9 + LINE):
        heard.say(0, tick)
    heard.orderer.close(last_tick=10**9)
    assert heard.ticks == [*range(100), *range(10**9, 10**9 + LINE)]


def test_a_line_of_states_ahead_is_followed_and_not_a_shorter_one():
    for length in (LINE - 1, LINE):
        heard = flown()
        heard.both(*range(500, 500 + length))
        assert heard.orderer.latest == (504 if length == LINE else 0)
        heard.say(0, heard.orderer.latest + 1)
        heard.orderer.close(last_tick=1000)
        assert heard.ticks == ([0, *range(500, 506)] if length == LINE else [0, 1])
        ignored = 0 if length == LINE else LINE - 1
        assert heard.count(0, 'ignored') == heard.count(1, 'ignored') == (ignored,)


def test_memory_for_what_is_ahead_is_bounded(monkeypatch):
    monkeypatch.setattr(orderer, 'MOST_AHEAD', 3)
    heard = flown()
    for tick in range(2, 7):
        heard.say(0, tick * WINDOW)
    assert len(heard.orderer._states_ahead) <= 3
    heard.say(0, 1)
    assert heard.count(0, 'ignored') == (5,)
    for tick in range(2 * WINDOW, 2 * WINDOW + 4):
        heard.say(1, tick)
    assert heard.count(1, 'ignored') == (1,)
    heard.say(1, WINDOW)  # not far ahead
    assert heard.count(1, 'ignored') == (1,)


def test_events_are_taken_ahead_as_far_as_there_is_room(monkeypatch):
    monkeypatch.setattr(orderer, 'MOST_AHEAD', 2)
    heard = flown()
    heard.say(EVENT, WINDOW)
    heard.say(EVENT, WINDOW + 1)
    heard.say(EVENT, WINDOW + 2)
    assert heard.count(EVENT, 'ignored') == (1,)
    heard.say(EVENT, WINDOW)
    assert heard.count(EVENT, 'ignored', 'duplicates') == (1, 1)
    heard.say(EVENT, 0)  # it is the newest of two, and the first one is forgotten
    heard.say(EVENT, WINDOW)
    assert heard.count(EVENT, 'duplicates') == (1,)


def test_an_event_of_the_tick_written_last_is_passed_on_and_one_of_the_next_waits():
    heard = flown(3)
    heard.say(EVENT, 4)
    assert heard.out[-1] == (3, (b'0 at 3', b'1 at 3', None))
    heard.say(EVENT, 3)
    assert heard.out[-1] == (3, (None, None, b'2 at 3'))


def test_what_is_stamped_after_the_end_is_no_part_of_the_flight():
    heard = flown(5)
    heard.say(1, 6)
    heard.say(EVENT, 6)
    heard.say(EVENT, 7)
    heard.say(1, 8)
    heard.say(0, 50)
    heard.orderer.close(last_tick=100)
    assert heard.out[6:] == [(6, (None, None, b'2 at 6'))]
    assert (heard.count(0, 'ignored'), heard.count(1, 'ignored')) == ((1,), (2,))
    assert heard.count(EVENT, 'ignored', 'written') == (1, 2)
    assert not heard.orderer.counts[0].missing


def test_states_ahead_count_up_to_the_end_that_the_run_has():
    heard = flown(5)
    for tick in (7, 8, 9):
        heard.say(0, tick)
    heard.orderer.end(8)
    heard.orderer.close(last_tick=100)
    assert heard.ticks == [0, 1, 2, 3, 4, 5, 7, 8]
    assert heard.count(0, 'missing') == (1,)  # 6
    assert heard.count(1, 'missing') == (2,)  # 6, 7: the answers to the last state are not due


def test_a_topic_that_is_dropped_is_missed_no_more_from_its_tick_on():
    heard = flown(3)
    heard.orderer.drop(1, 5)
    for tick in (4, 5, 6):
        heard.say(0, tick)
    assert heard.ticks[-1] == 3
    heard.say(1, 4)
    assert heard.ticks[-1] == 6
    assert heard.count(1, 'missing') == (0,)
