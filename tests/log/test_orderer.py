# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks come out in order and complete, however the topics drift against each other."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_mcap.write import orderer
from rpo_mcap.write.orderer import HOLD, LINE, MOST_MESSAGES, NOTHING, REORDER, WINDOW, TickOrderer

QUICK = settings(max_examples=40, deadline=None, derandomize=True, database=None)
EVENT = 2


def read(index: int, data: bytes) -> tuple[str, bool]:
    """The numbers of a message are its text up to a `+`, behind which it holds something else."""
    numbers, more, _ = data.decode().partition('+')
    return numbers, not more


class Listener:
    """An orderer of two topics of every tick and one of events, and what it let go."""

    def __init__(self) -> None:
        self.out: list[tuple[int, tuple[bytes | None, ...]]] = []
        self.orderer = TickOrderer(3, frozenset({EVENT}), EVENT, self.hear, read)

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

    def report(self, tick: int, *texts: str) -> None:
        """Say what the plant published and took at a tick, of topics 0 and 1."""
        found = texts or (f'0 at {tick}', f'1 at {tick}')
        self.orderer.report(tick, dict(enumerate(found)))

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


def test_tick_0_is_written_before_the_first_event_and_tick_1_after():
    # the recorder says that it is ready when it has tick 0, and the event follows from that
    heard = Listener()
    heard.both(0)
    assert heard.ticks == [0]
    heard.both(1)
    assert heard.ticks == [0]
    heard.say(EVENT, 0)
    assert heard.ticks == [0, 0, 1]


def test_without_any_event_the_ticks_go_after_a_window():
    heard = Listener()
    for tick in range(WINDOW + 3):
        heard.both(tick)
        assert heard.ticks == ([0] if tick <= WINDOW else list(range(tick + 1)))


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


def test_late_and_different_messages_change_nothing():
    heard = begun()
    for tick in range(1, 9):
        heard.say(0, tick)
        if tick != 2:
            heard.say(1, tick)
    before = list(heard.out)
    heard.say(1, 2)  # given up already
    heard.say(0, 8, 'other')  # waits no more: 8 is complete and gone
    heard.say(0, 3)  # again, the same
    heard.orderer.close(last_tick=100)
    assert heard.out == before
    counts = heard.orderer.counts
    assert counts[1].late == 1
    assert counts[0].conflicts == 1
    assert counts[0].duplicates == 1


def test_a_recorder_that_comes_late_begins_where_it_came():
    heard = Listener()
    heard.both(*range(5000, 5003))
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
        heard.both(tick * 1_000_000_000)
        heard.both(tick)
    for tick in range(10**9, 10**9 + LINE):
        heard.say(0, tick)
    heard.orderer.close(last_tick=10**9)
    assert heard.ticks == [*range(100), *range(10**9, 10**9 + LINE)]


def test_what_is_stamped_ahead_moves_nothing():
    heard = begun()
    for tick in (1, 2, 3, 4, WINDOW - 1, 900):
        heard.say(1, tick, 'not yet')
    for tick in (WINDOW - 1, 500, 900):
        heard.say(0, tick, 'not the plant')
    for tick in range(1, 30):
        heard.both(tick)
        heard.report(tick)
    heard.orderer.end(29)
    heard.orderer.close(last_tick=29)
    assert heard.out[1:] == [(t, (b'0 at %d' % t, b'1 at %d' % t, None)) for t in range(1, 30)]
    counts = heard.orderer.counts
    assert not any(c.missing or c.late or c.conflicts for c in counts)
    assert (counts[0].ignored, counts[1].ignored) == (3, 6)


def test_an_orderer_waits_for_another_message_where_one_came_before_its_state():
    heard = begun()
    heard.say(1, 1, 'early')
    heard.say(0, 1)
    heard.both(*range(2, HOLD + 1))
    assert heard.ticks == [0] and heard.orderer.asks_from is None
    heard.say(0, HOLD + 1)
    assert heard.ticks == list(range(HOLD + 1))
    ended = begun()
    ended.say(1, 1, 'early')
    ended.say(0, 1)
    assert ended.ticks == [0]
    ended.orderer.end(1)  # nothing follows
    assert ended.ticks == [0, 1]


# What the plant reports of tick 1, and which of two messages of topic 1 is let go: 'a', which came
# first, or 'b'; and what is counted of the other.
REPORTS = {
    'the first': ('a', 'a', (1, 0)),
    'the second': ('b', 'b', (1, 0)),
    'another one': ('c', 'a', (0, 1)),
    'nothing was taken': (NOTHING, 'a', (1, 0)),
}


@pytest.mark.parametrize('case', REPORTS)
def test_of_two_messages_the_one_that_the_plant_took_is_let_go(case):
    numbers, kept, counted = REPORTS[case]
    heard = begun()
    heard.say(0, 1)
    assert heard.orderer.asks_from is None
    heard.both(2)
    heard.say(1, 1, 'a')
    assert heard.ticks == [0, 1, 2] and heard.orderer.asks_from is None
    heard.say(1, 3, 'a')
    heard.say(1, 3, 'b')
    heard.say(0, 3)
    heard.say(1, 3, 'a')  # again
    heard.both(4)
    assert heard.ticks == [0, 1, 2] and heard.orderer.asks_from == 3
    assert heard.orderer.latest == 3  # a state leads once the plant has passed the one before
    heard.report(3, '0 at 3', numbers)
    assert heard.ticks[3:] == ([] if counted[1] else [3])  # another one may still come
    for tick in range(4, 8):
        heard.both(tick)
        heard.report(tick)
        assert heard.ticks[-1] == (tick if not counted[1] or tick >= 3 + REORDER else 2)
    assert heard.out[3] == (3, (b'0 at 3', kept.encode(), None))
    count = heard.orderer.counts[1]
    assert (count.ignored, count.conflicts) == counted


def test_one_message_that_the_plant_did_not_take_waits_for_the_other():
    heard = begun()
    heard.orderer.ask(1)
    heard.say(0, 1)
    heard.say(1, 1, 'forged')
    heard.report(1)
    assert heard.ticks == [0]
    heard.say(1, 1)
    assert heard.out[1:] == [(1, (b'0 at 1', b'1 at 1', None))]
    heard.say(0, 2)
    heard.say(1, 2, 'forged')
    heard.report(2)
    heard.orderer.close(last_tick=2)
    assert heard.out[-1] == (2, (b'0 at 2', b'forged', None))
    assert (heard.orderer.counts[1].ignored, heard.orderer.counts[1].conflicts) == (1, 1)


def contested() -> Listener:
    """Two messages of topic 1 at tick 1 differ."""
    heard = begun()
    for text in ('a', 'b'):
        heard.say(1, 1, text)
    heard.say(0, 1)
    return heard


@pytest.mark.parametrize('texts', ['ab', 'abc'])
def test_a_report_may_come_before_the_messages_and_twice(texts):
    heard = begun()
    for _ in range(2):
        heard.report(1, '0 at 1', texts[-1])
    for text in texts:
        heard.say(1, 1, text)
    heard.say(0, 1)
    assert heard.out[1] == (1, (b'0 at 1', texts[-1].encode(), None))
    counts = heard.orderer.counts[1]
    assert (counts.ignored, counts.conflicts) == (len(texts) - 1, 0)


def test_two_reports_that_differ_say_nothing():
    heard = contested()
    heard.report(2, '0 at 2', 'a')  # of another tick
    heard.report(2, '0 at 2', 'b')
    assert heard.ticks == [0]
    for text in ('a', 'b'):
        heard.say(1, 2, text)
    heard.say(0, 2)
    heard.report(1, '0 at 1', 'b')
    assert heard.out[1:] == [(1, (b'0 at 1', b'b', None)), (2, (b'0 at 2', b'a', None))]
    assert [c.conflicts for c in heard.orderer.counts] == [0, 1, 0]


def test_a_window_of_states_without_reports_lets_a_tick_go_with_a_conflict():
    heard = contested()
    for tick in range(2, 2 * WINDOW + 2):
        heard.both(tick)
        # at tick + 1 - WINDOW the newest state leads, which is a window behind the newest of all
        assert heard.orderer.latest == max(1, tick + 1 - WINDOW)
        assert heard.ticks == list(range(max(1, heard.orderer.latest + 1 - WINDOW)))
    heard.orderer.close(last_tick=2 * WINDOW + 1)
    assert heard.ticks == list(range(2 * WINDOW + 2))
    assert heard.orderer.counts[1].conflicts == 1
    assert heard.out[1] == (1, (b'0 at 1', b'a', None))


def test_a_plant_that_reports_nothing_and_waits_for_the_log_is_asked_in_vain():
    """They waited for each other, for ever."""
    heard = contested()
    heard.both(*range(2, 49))
    assert (heard.ticks, heard.orderer.furthest) == ([0], 48)
    heard.orderer.pass_over()
    assert heard.ticks == list(range(49)) and heard.orderer.latest == 48
    assert heard.orderer.counts[1].conflicts == 1
    heard.both(49)
    assert heard.ticks[-1] == 49
    heard.report(49)  # it does report
    heard.both(50)
    assert heard.ticks[-1] == 49


def test_a_topic_that_is_missing_is_silent_where_the_plant_waits_for_the_log():
    heard = flown(3)
    for tick in range(4, 49):
        heard.say(0, tick)
    assert heard.ticks[-1] == 3
    heard.orderer.pass_over()
    assert heard.ticks[-1] == 47  # the newest tick may still be completed
    assert heard.orderer.counts[1].missing == 44
    heard.orderer.pass_over()
    heard.say(1, 48)
    heard.both(49)
    assert heard.ticks[-1] == 49 and heard.orderer.counts[1].missing == 44


def test_ticks_before_the_question_wait_for_no_report():
    heard = begun()
    for text in ('a', 'b'):
        heard.say(1, 5, text)
    assert heard.orderer.asks_from == 5
    for tick in range(1, 7):
        heard.say(0, tick)
        if tick != 5:
            heard.say(1, tick)
    assert heard.ticks == [0, 1, 2, 3, 4] and heard.orderer.latest == 5
    heard.report(5, '0 at 5', 'a')
    assert heard.ticks[-1] == 5 and heard.orderer.latest == 6


def test_a_forged_line_of_states_moves_nothing_while_the_plant_is_asked():
    heard = contested()
    for tick in range(2, WINDOW):
        heard.say(0, tick, 'forged')
    assert heard.orderer.latest == 1
    for tick in range(1, 30):
        if tick > 1:
            heard.say(1, tick)
            heard.say(0, tick)
        heard.report(tick, f'0 at {tick}', 'a' if tick == 1 else f'1 at {tick}')
    assert heard.ticks == list(range(30))
    assert all(found[0] == b'0 at %d' % t for t, found in heard.out)
    assert heard.orderer.counts[0].ignored == 28


# A message of a tick that is written, what the plant reports, and what is counted.
WRITTEN = {
    'the other was taken': ('b', '1 at 3', (1, 0)),
    'this one was taken': ('b', 'b', (0, 1)),
    'none was taken': ('b', NOTHING, (1, 0)),
    'no report': ('b', None, (0, 1)),
    'the same numbers': ('1 at 3+more', '1 at 3', (1, 0)),
    'the same numbers, no report': ('1 at 3+more', None, (1, 0)),
}


@pytest.mark.parametrize('case', WRITTEN)
@pytest.mark.parametrize('first', ['message', 'report'])
def test_a_different_message_of_a_tick_that_is_written(case, first):
    text, numbers, counted = WRITTEN[case]
    heard = begun()
    heard.both(*range(1, 6))
    before = list(heard.out)
    steps = [lambda: heard.say(1, 3, text)]
    if numbers is not None:
        steps.append(lambda: heard.report(3, '0 at 3', numbers))
    for step in steps if first == 'message' else reversed(steps):
        step()
    assert heard.orderer.asks_from == 3
    heard.orderer.close(last_tick=5)
    count = heard.orderer.counts[1]
    assert heard.out == before
    assert (count.ignored, count.conflicts) == counted


def test_of_messages_with_the_same_numbers_the_one_with_nothing_else_is_let_go():
    for texts in (('a+x', 'a', 'a+y'), ('a', 'a+x', 'a+y')):
        for numbers in (['a'], []):  # the plant says nothing of what it does not take
            heard = begun()
            for text in texts:
                heard.say(1, 1, text)
            heard.say(0, 1)
            heard.report(1, '0 at 1', *numbers)
            assert heard.out[1] == (1, (b'0 at 1', b'a', None))
            assert heard.orderer.counts[1].ignored == 2


def test_how_many_different_messages_are_kept():
    for number, conflicts in ((MOST_MESSAGES, 0), (MOST_MESSAGES + 1, MOST_MESSAGES - 1)):
        heard = begun()
        for turn in range(number):
            heard.say(1, 1, f'of {turn}')
        heard.say(0, 1)
        heard.report(1, '0 at 1', f'of {number - 1}')
        heard.orderer.close(last_tick=1)
        assert heard.orderer.counts[1].conflicts == conflicts
        assert heard.orderer.counts[1].ignored == (1 if conflicts else MOST_MESSAGES - 1)


def flown(last: int) -> Listener:
    heard = begun()
    heard.both(*range(1, last + 1))
    assert heard.orderer.next_tick == last + 1
    return heard


def test_messages_are_compared_with_those_of_one_window():
    heard = flown(3 * WINDOW)
    oldest = heard.orderer.next_tick - WINDOW
    heard.say(1, oldest - 1, 'other')
    assert heard.orderer.counts[1].ignored == 1 and heard.orderer.asks_from is None
    heard.say(1, oldest, 'other')
    assert heard.orderer.asks_from == oldest
    heard.report(oldest)
    assert heard.orderer.counts[1].ignored == 2
    heard.say(1, oldest + 1, 'other')
    heard.report(3 * WINDOW)
    heard.both(3 * WINDOW + 1)
    heard.report(3 * WINDOW + 1)
    assert heard.orderer.counts[1].conflicts == 0
    heard.both(3 * WINDOW + 2)
    heard.report(3 * WINDOW + 2)  # now it is too old to be compared any more
    assert heard.orderer.counts[1].conflicts == 1
    heard.report(oldest + 1)
    assert heard.orderer.counts[1].conflicts == 1


def test_a_late_message_of_a_hole_is_late_however_old():
    heard = begun()
    for tick in range(1, 3 * WINDOW):
        heard.say(0, tick)
        if tick != 4:
            heard.say(1, tick)
    heard.say(1, 4)
    heard.say(1, 5)
    assert (heard.orderer.counts[1].late, heard.orderer.counts[1].ignored) == (1, 1)


def test_reports_of_ticks_far_away_are_forgotten():
    heard = flown(2 * WINDOW)
    kept = heard.orderer._reports
    first, last = heard.orderer.next_tick - WINDOW, heard.orderer.latest + WINDOW
    for tick in (first - 1, first, last, last + 1):
        heard.report(tick)
    assert sorted(kept) == [first, last]
    heard.both(2 * WINDOW + 1)
    heard.report(2 * WINDOW)
    assert sorted(kept) == [2 * WINDOW, last]


def test_a_line_of_states_ahead_is_followed_and_not_a_shorter_one():
    for length in (LINE - 1, LINE):
        heard = begun()
        heard.say(1, 500 - 1)
        heard.say(1, 500)
        heard.both(*range(500, 500 + length))
        assert heard.orderer.latest == (504 if length == LINE else 0)
        heard.say(0, heard.orderer.latest + 1)
        heard.orderer.close(last_tick=1000)
        assert heard.ticks == ([0, *range(500, 506)] if length == LINE else [0, 1])
        assert heard.orderer.counts[1].ignored == (1 if length == LINE else 5)
        assert heard.orderer.counts[0].ignored == (0 if length == LINE else LINE - 1)


@pytest.mark.parametrize('further', [0, 1])
def test_a_message_one_window_ahead_is_compared_and_one_further_ahead_gives_way(further):
    heard = begun()
    heard.say(1, WINDOW + further, 'forged')
    heard.both(*range(1, WINDOW + 9))
    assert heard.orderer.asks_from == (None if further else WINDOW)
    assert heard.orderer.counts[1].ignored == further


def test_what_came_far_ahead_is_used_where_no_other_message_comes():
    """The states were lost for a while, and came again, in order."""
    heard = begun()
    for tick in range(1, 3 * WINDOW):
        heard.say(1, tick)
    for tick in range(1, 3 * WINDOW):
        heard.say(0, tick)
    heard.both(*range(3 * WINDOW, 3 * WINDOW + 4))
    heard.orderer.close(last_tick=3 * WINDOW + 3)
    assert heard.out == [(0, heard.out[0][1])] + [
        (t, (b'0 at %d' % t, b'1 at %d' % t, None)) for t in range(1, 3 * WINDOW + 4)
    ]
    assert not any(c.missing or c.ignored or c.conflicts for c in heard.orderer.counts)
    assert heard.orderer.asks_from is None


def test_memory_for_what_is_ahead_is_bounded(monkeypatch):
    monkeypatch.setattr(orderer, 'MOST_AHEAD', 3)
    heard = begun()
    for tick in range(2, 7):
        heard.say(0, tick * WINDOW)
    assert heard.orderer.counts[0].ignored == 2
    heard.say(0, 1)
    assert heard.orderer.counts[0].ignored == 5
    for tick in range(2 * WINDOW, 2 * WINDOW + 4):
        heard.say(1, tick)
    assert heard.orderer.counts[1].ignored == 1


def test_events_are_taken_ahead_as_far_as_there_is_room(monkeypatch):
    monkeypatch.setattr(orderer, 'MOST_AHEAD', 2)
    heard = begun()
    heard.say(1, 1)
    heard.say(1, 2)
    heard.say(EVENT, WINDOW + 1)
    assert heard.orderer.counts[EVENT].ignored == 1
    heard.say(EVENT, WINDOW)  # not far ahead
    assert heard.orderer.counts[EVENT].ignored == 1
    heard.say(EVENT, WINDOW)
    assert heard.orderer.counts[EVENT].duplicates == 1
    heard.say(EVENT, 0)
    assert heard.orderer.counts[EVENT].duplicates == 2
    heard.say(EVENT, 0, 'another')  # it is now the newest of two, and the first one is forgotten
    heard.say(EVENT, 0, 'a third')
    heard.say(EVENT, WINDOW)
    assert heard.orderer.counts[EVENT].duplicates == 2


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
    heard.orderer.close(last_tick=100)
    assert heard.out[6:] == [(6, (None, None, b'2 at 6'))]
    counts = heard.orderer.counts
    assert (counts[1].ignored, counts[EVENT].ignored, counts[EVENT].written) == (2, 1, 2)
    assert not counts[0].missing


def test_a_state_ahead_of_the_first_one_is_no_part_of_the_flight():
    heard = begun()
    heard.say(0, 50)
    heard.orderer.close(last_tick=100)
    assert heard.ticks == [0] and heard.orderer.counts[0].ignored == 1


def test_states_ahead_count_up_to_the_end_that_the_run_has():
    heard = flown(5)
    for tick in (7, 8, 9):
        heard.say(0, tick)
    heard.orderer.end(8)
    heard.orderer.close(last_tick=100)
    assert heard.ticks == [0, 1, 2, 3, 4, 5, 7, 8]
    assert heard.orderer.counts[0].missing == 1  # 6
    assert (
        heard.orderer.counts[1].missing == 2
    )  # 6 and 7: the answers to the last state are not due


def test_a_topic_that_is_dropped_is_missed_no_more_from_its_tick_on():
    heard = flown(3)
    heard.orderer.drop(1, 5)
    for tick in (4, 5, 6):
        heard.say(0, tick)
    assert heard.ticks[-1] == 3
    heard.say(1, 4)
    assert heard.ticks[-1] == 6
    assert heard.orderer.counts[1].missing == 0


def test_holes_that_are_remembered_are_bounded(monkeypatch):
    monkeypatch.setattr(orderer, 'MOST_HOLES', 3)
    heard = begun()
    heard.both(*range(500, 500 + LINE))
    assert heard.orderer.counts[1].missing == 499
    for tick in (1, 3, 4):
        heard.say(1, tick)
    assert (heard.orderer.counts[1].late, heard.orderer.counts[1].ignored) == (2, 1)
