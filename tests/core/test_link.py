# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a faulty link does to messages: deterministic, and nothing but what was asked for."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.files.validation import InputError
from rpo_core.world.link import CORRUPTIONS, KINDS, FaultRates, Schedule, SeededLink

RATES = st.builds(FaultRates, **{kind: st.floats(0.0, 1.0) for kind in KINDS})
SEEDS = st.integers(0, 2**32)


def sent(rates, seed, count=60, **options):
    channel = SeededLink(rates, seed, **options)
    out = [pair for message in range(count) for pair in channel.take(message)]
    return out, channel


@given(RATES, SEEDS)
def test_the_same_seed_gives_the_same_faults(rates, seed):
    assert sent(rates, seed)[0] == sent(rates, seed)[0]


@given(SEEDS)
def test_without_rates_all_passes_unchanged(seed):
    assert sent(FaultRates(), seed)[0] == [(message, '') for message in range(60)]


@given(RATES, SEEDS)
def test_outside_the_schedule_all_passes_unchanged(rates, seed):
    channel = SeededLink(rates, seed)
    assert [channel.take(message, faulty=False) for message in range(9)] == [
        [(message, '')] for message in range(9)
    ]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), SEEDS, st.integers(1, 9))
def test_a_delay_loses_and_adds_nothing(delay, reorder, repeat, seed, by):
    rates = FaultRates(delay=delay, reorder=reorder, repeat=repeat)
    out, channel = sent(rates, seed, delay_messages=by)
    for message in range(60, 60 + by):
        out += channel.take(message, faulty=False)
    assert channel.held == 0
    times = Counter(message for message, _ in out)
    assert set(times) == set(range(60 + by))
    assert sum(times.values()) == 60 + by + channel.counts['repeat']
    assert max(times.values()) <= 2


@given(st.integers(1, 9))
def test_a_delayed_message_comes_so_many_messages_later(by):
    channel = SeededLink(FaultRates(delay=1.0), 0, delay_messages=by)
    assert channel.take('first') == []
    for number in range(1, by):
        assert channel.take(number, faulty=False) == [(number, '')]
    assert channel.take(by, faulty=False) == [(by, ''), ('first', '')]


def test_a_reordered_message_comes_after_its_successor():
    channel = SeededLink(FaultRates(reorder=1.0), 0)
    assert channel.take('first') == []
    assert channel.take('second', faulty=False) == [('second', ''), ('first', '')]


def test_a_frozen_channel_says_the_first_message_for_ever():
    assert {message for message, _ in sent(FaultRates(freeze=1.0), 0)[0]} == {0}


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), SEEDS)
def test_a_higher_rate_only_adds_losses(one, other, seed):
    low, high = (
        {message for message, _ in sent(FaultRates(drop=rate), seed)[0]}
        for rate in sorted((one, other), reverse=True)
    )
    assert low <= high


@pytest.mark.parametrize('kind', CORRUPTIONS)
def test_only_the_corruption_asked_for_happens(kind):
    out, channel = sent(FaultRates(corrupt=0.5), 3, corruptions=(kind,))
    assert {corruption for _, corruption in out} == {'', kind}
    assert channel.counts[kind] == sum(corruption == kind for _, corruption in out)


@pytest.mark.parametrize('kind', KINDS)
def test_rates_are_those_asked_for(kind):
    _, channel = sent(FaultRates(**{kind: 0.2}), 7, count=10_000)
    hits = sum(channel.counts[name] for name in (*KINDS, *CORRUPTIONS))
    assert abs(hits - 2000) < 5 * 40  # five standard deviations of a binomial


@pytest.mark.parametrize('rate', [-0.1, 1.1, float('nan'), 'much'])
def test_a_rate_that_is_none_is_refused(rate):
    with pytest.raises(InputError, match='`drop` must be'):
        FaultRates(drop=rate)


def test_a_schedule_covers_both_its_ends_and_no_stamp_of_no_tick():
    schedule = Schedule(3, 5)
    assert [tick for tick in range(9) if schedule.covers(tick)] == [3, 4, 5]
    assert not schedule.covers(None)
    assert Schedule().covers(None)
    with pytest.raises(InputError, match='`to_tick` must be >= from_tick'):
        Schedule(5, 3)


def test_a_delay_by_time_holds_a_message_for_that_time():
    channel = SeededLink(FaultRates(delay=1.0), 0, delay_s=0.5)
    assert channel.take('first', now_s=10.0) == []
    assert channel.take('second', faulty=False, now_s=10.1) == [('second', '')]
    assert channel.due(10.49) == []
    assert channel.due(10.5) == [('first', '')]
    assert channel.held == 0


@given(RATES, SEEDS)
def test_by_time_as_by_messages_nothing_is_lost_but_the_lost(rates, seed):
    channel = SeededLink(rates, seed, delay_s=3.5)
    out = [pair for now in range(60) for pair in channel.take(now, now_s=1.0 + now)]
    out += channel.take(60, faulty=False, now_s=61.0) + channel.due(99.0)
    assert channel.held == 0
    assert (
        channel.counts['sent'] == len(out) == 61 - channel.counts['drop'] + channel.counts['repeat']
    )
