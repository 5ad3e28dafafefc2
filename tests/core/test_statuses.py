# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of statuses: what is whole is taken, one wrong field is named."""

import pytest

from rpo_core.files.validation import InputError
from rpo_core.wire import interfaces, statuses
from rpo_core.wire.cdr import Status

RUN = Status(0, 'run', 'flying', 'none', (
    ('phase', 'running'), ('tick', '7'), ('time_s', '0.7'), ('energy_n2s', '1e-05'),
    ('distance_m', '60.0'), ('speed_m_s', '0.0'), ('saturated_ticks', '0'),
))  # fmt: skip
STAGE = Status(1, 'guidance', 'so', 'none', (
    ('stage', 'guidance'), ('state', 'go'), ('tick', '7'), ('reason', 'command `go`'),
))  # fmt: skip
GUIDANCE = Status(0, 'guidance', 'so', 'none', (
    ('phase', 'hold_60'), ('tick', '0'), ('reason', 'the flight begins'),
))  # fmt: skip
ASSURANCE = Status(1, 'assurance', 'so', 'none', (
    ('tick', '7'), ('mode', 'open'), ('constraint', ''), ('margin_m', 'inf'),
    ('margin_m_s', '-0.5'),
    *((f'{moment}_n.{axis}', 'nan') for moment in ('before', 'after') for axis in 'xyz'),
))  # fmt: skip
RECORDER = Status(0, 'recorder', 'ready', 'none', (
    ('recorder', 'ab12'), ('run', ''), ('reason', ''), ('next_tick', '16'),
))  # fmt: skip
MANIFEST = Status(0, 'plant', 'manifest', 'none', (
    ('role', 'plant'), ('run', 'ab12'), ('parameter.mode', 'lockstep'), ('file.scenario.yaml', ''),
))  # fmt: skip
HEARTBEAT = Status(0, 'navigation', 'alive', 'none', (('stages', 'sensors, estimator'),))
WHOLE = {
    statuses.RunStatus: RUN,
    statuses.StageStatus: STAGE,
    statuses.GuidanceStatus: GUIDANCE,
    statuses.AssuranceStatus: ASSURANCE,
    statuses.RecorderStatus: RECORDER,
    statuses.Manifest: MANIFEST,
    statuses.Heartbeat: HEARTBEAT,
}
REQUIRED = {
    statuses.RunStatus: ('phase', 'tick'),
    statuses.StageStatus: ('stage', 'state', 'tick', 'reason'),
    statuses.GuidanceStatus: ('phase', 'tick', 'reason'),
    statuses.AssuranceStatus: ('tick', 'mode', 'constraint', 'margin_m', 'margin_m_s', 'after_n.z'),
    statuses.RecorderStatus: ('recorder', 'run', 'reason'),
    statuses.Manifest: ('role',),
    statuses.Heartbeat: ('stages',),
}
NO_TICKS = ('soon', '', '-1', '1.5', '+5', ' 5', '5 ', '1_000', '0x10', '٣', '²', '007', '9' * 3000)
NO_FIGURES = ('soon', '', '-1.0', 'nan', 'inf', '1_0.0', ' 1.0', '1e999', '9' * 3000)


def changed(status: Status, **values: str) -> Status:
    """Return a status with some values changed, or added."""
    return status._replace(values=tuple({**dict(status.values), **values}.items()))


@pytest.mark.parametrize('reader', [r for r in WHOLE if r is not statuses.Manifest])
def test_a_text_that_would_fill_a_log_is_refused(reader):
    for field in ('message', 'name', 'hardware_id'):
        with pytest.raises(InputError, match='at most 4000 characters; got 200000'):
            reader.of(WHOLE[reader]._replace(**{field: 'a' * 200_000}))
    with pytest.raises(InputError, match="'reason' must have at most 4000 characters"):
        reader.of(changed(WHOLE[reader], reason='a' * 200_000))
    many = {f'key_{i}': 'a' * 3000 for i in range(4)}
    with pytest.raises(InputError, match='at most 10000 characters; got 12'):
        reader.of(changed(WHOLE[reader], **many))


def test_what_is_whole_is_taken():
    found = {reader: reader.of(status) for reader, status in WHOLE.items()}
    assert found[statuses.RunStatus] == statuses.RunStatus('running', 7, 'flying')
    assert found[statuses.StageStatus].state == 'go' and found[statuses.StageStatus].tick == 7
    assert found[statuses.RecorderStatus].next_tick == 16
    assert found[statuses.AssuranceStatus].margin_m == float('inf')
    coasting = statuses.RunStatus.of(changed(RUN, dropped='control_force disturbance_force'))
    assert coasting.dropped == ('control_force', 'disturbance_force')
    ended = changed(RUN, phase='finished', latency_p50_ms='1.5')
    assert statuses.RunStatus.of(ended).ended, 'free running adds figures of its own'


@pytest.mark.parametrize('reader', WHOLE, ids=lambda reader: reader.topic)
def test_each_status_topic_has_its_reader_and_needs_its_values(reader):
    assert statuses.READERS[reader.topic] is reader
    for name in REQUIRED[reader]:
        values = tuple(pair for pair in WHOLE[reader].values if pair[0] != name)
        with pytest.raises(InputError, match=f'`{name}` is missing'):
            reader.of(WHOLE[reader]._replace(values=values))
    twice = WHOLE[reader]._replace(values=WHOLE[reader].values + WHOLE[reader].values[:1])
    with pytest.raises(InputError, match='must come once'):
        reader.of(twice)


def test_every_status_topic_of_the_table_has_a_reader():
    rows = [row for row in interfaces.rows() if row.type == interfaces.STATUS_TYPE]
    assert {row.name for row in rows} == set(statuses.READERS)


@pytest.mark.parametrize('wrong', NO_TICKS, ids=lambda text: text[:8])
@pytest.mark.parametrize(
    'reader', [reader for reader in WHOLE if 'tick' in REQUIRED[reader]], ids=lambda r: r.topic
)
def test_a_tick_is_a_whole_number(reader, wrong):
    with pytest.raises(InputError, match='`tick` must be a whole number') as raised:
        reader.of(changed(WHOLE[reader], tick=wrong))
    assert len(str(raised.value)) < 200


@pytest.mark.parametrize('wrong', NO_FIGURES, ids=lambda text: text[:8])
def test_a_figure_of_a_run_is_a_number(wrong):
    for name in ('time_s', 'energy_n2s', 'distance_m', 'speed_m_s', 'saturated_ticks'):
        with pytest.raises(InputError, match=f'`{name}` must be a'):
            statuses.RunStatus.of(changed(RUN, **{name: wrong}))


@pytest.mark.parametrize(
    ('status', 'said'),
    [
        (changed(RUN, phase='flying'), '`phase` must be one of waiting'),
        (changed(RUN, phase='aborted'), 'the level of `aborted` must be 1 or 2; got 0'),
        (changed(RUN, dropped='control_force soon'), '`dropped` must be one of'),
        (changed(RUN, resumed='yes'), '`resumed` must be one of true'),
        (changed(RUN, note='5'), "'note' is not a known value"),
        (changed(RUN, phase='finished', note='so'), '`note` must be a number'),
        (RUN._replace(name='walk'), '`name` must be one of run'),
        (RUN._replace(hardware_id=''), '`hardware_id` must be one of none'),
        (changed(STAGE, state=''), '`state` must be a text'),
        (changed(STAGE, stage='a\x1b[2J'), '`stage` must be printable'),
        (STAGE._replace(name=''), '`name` must be a text'),
        (changed(ASSURANCE, mode='shut'), '`mode` must be one of open'),
        (changed(ASSURANCE, margin_m='wide'), '`margin_m` must be a number'),
        (changed(RECORDER, next_tick='9' * 3000), '`next_tick` must be a whole number'),
        (changed(RECORDER, recorder=''), '`recorder` must be a text'),
        (RECORDER._replace(message='shut'), '`message` must be one of waiting'),
        (HEARTBEAT._replace(message='well'), '`message` must be one of alive, gone'),
        (changed(MANIFEST, role=' '), '`role` must be a text'),
        (
            changed(MANIFEST, mode='lockstep'),
            "'mode' is none of parameter., file., publishes",
        ),
    ],
    ids=lambda part: part if isinstance(part, str) else '',
)
def test_one_wrong_field_is_named(status, said):
    reader = next(
        reader for reader, whole in WHOLE.items()
        if {k for k, _ in whole.values} <= {k for k, _ in status.values}
    )  # fmt: skip
    with pytest.raises(InputError) as raised:
        reader.of(status)
    assert said in str(raised.value)
