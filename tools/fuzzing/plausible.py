# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Plausible statuses with one wrong field, as a careless program sends them.

Hostile values in random places seldom make a status that a node looks at twice. Here all fields
but one are those of a whole status: the last genuine one of the topic, or one made here.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from rpo_core import files
from rpo_core.wire import cdr, interfaces, statuses

_NODES = ('fuzzy_controller', 'guidance', 'assurance', 'navigation', 'disturbance_injector')
_STAGES = ('controller', 'guidance', 'assurance', 'estimator', 'sensors', 'disturbance')
_STATES = (
    'active', 'inactive', 'refused', 'without_command', 'go', 'hold', 'retreat', 'abort', 'armed',
    'holding', 'resumed',
)  # fmt: skip
_PHASES = ('hold_60', 'to_20', 'docked', 'aborting', 'drifting')
_WRONG = (
    'soon', '', ' ', '-1', '-0', '1.5', '1e3', '+5', ' 5', '5 ', '0x10', '1_000', '٣', '²', 'nan',
    'inf', '-inf', 'None', 'true', '9' * 5000, 'x' * 200_000, 'flying', 'control_force_raw',
    'two words', '\x1b[2J', 'a\x00b', '[', '\n',
)  # fmt: skip
Pairs = tuple[tuple[str, str], ...]


def _figures(rng: Random, tick: int) -> Pairs:
    return (
        ('tick', str(tick)),
        ('time_s', repr(tick / 10.0)),
        ('energy_n2s', repr(rng.random())),
        ('distance_m', repr(60.0 * rng.random())),
        ('speed_m_s', repr(rng.random())),
        ('saturated_ticks', '0'),
    )


def _run_status(rng: Random, tick: int) -> cdr.Status:
    phase = rng.choice(list(statuses.LEVELS))
    values = (('phase', phase), *_figures(rng, tick))
    if rng.random() < 0.5:
        values += (('dropped', rng.choice(interfaces.rows()).name),)
    if rng.random() < 0.2:
        values += (('resumed', 'true'),)
    return cdr.Status(rng.choice(statuses.LEVELS[phase]), 'run', 'flying', 'none', values)


def _stage_status(rng: Random, tick: int) -> cdr.Status:
    pairs = ('stage', rng.choice(_STAGES)), ('state', rng.choice(_STATES)), ('tick', str(tick))
    return cdr.Status(1, rng.choice(_NODES), 'so', 'none', (*pairs, ('reason', 'so')))


def _guidance_status(rng: Random, tick: int) -> cdr.Status:
    pairs = ('phase', rng.choice(_PHASES)), ('tick', str(tick)), ('reason', 'the leg is over')
    return cdr.Status(0, 'guidance', 'so', 'none', pairs)


def _assurance_status(rng: Random, tick: int) -> cdr.Status:
    names = ('margin_m', 'margin_m_s', *(f'{m}_n.{a}' for m in ('before', 'after') for a in 'xyz'))
    pairs = ('tick', str(tick)), ('mode', 'open'), ('constraint', rng.choice(('', 'keep_out')))
    return cdr.Status(
        1, 'assurance', 'so', 'none', (*pairs, *((n, repr(rng.random())) for n in names))
    )


def _recorder_status(rng: Random, tick: int) -> cdr.Status:
    says = rng.choice(('waiting', 'ready', 'closed', 'failed'))
    pairs = ('recorder', '0' * 32), ('run', ''), ('reason', ''), ('next_tick', str(tick))
    pairs += (('asks_from', str(tick)),) if rng.random() < 0.5 else ()
    return cdr.Status(0, 'recorder', says, 'none', pairs)


def _plant_tick(rng: Random, tick: int) -> cdr.Status:
    rows = interfaces.row_of(interfaces.RELATIVE_STATE), interfaces.row_of(interfaces.CONTROL_FORCE)
    numbers = ((row.name, ' '.join(repr(rng.random()) for _ in row.columns)) for row in rows)
    pairs = ('run', '0' * 32), ('tick', str(tick)), *numbers
    return cdr.Status(0, 'plant', 'tick', 'none', pairs)


def _manifest(rng: Random, tick: int) -> cdr.Status:
    role = rng.choice(('plant', 'controller', 'disturbance'))
    text = files.read_text(files.find('scenario', rng.choice(('quick', 'docking'))))
    if role == 'plant':  # a whole one is an act: another plant flies
        text = text[: len(text) // 2]
    pairs = ('role', role), ('run', '0' * 32), ('parameter.mode', 'lockstep')
    return cdr.Status(0, role, 'manifest', 'none', (*pairs, ('file.scenario.yaml', text)))


_MADE: dict[str, Callable[[Random, int], cdr.Status]] = {
    interfaces.RUN_STATUS: _run_status,
    interfaces.STAGE_STATUS: _stage_status,
    interfaces.GUIDANCE_STATUS: _guidance_status,
    statuses.AssuranceStatus.topic: _assurance_status,
    interfaces.RECORDER_STATUS: _recorder_status,
    interfaces.PLANT_TICK: _plant_tick,
    interfaces.NODE_MANIFEST: _manifest,
}


KINDS = ('value', 'value', 'value', 'key', 'missing', 'twice', 'more', 'head')


def made(topic: str, rng: Random, tick: int) -> cdr.Status:
    """Return a whole status of a topic of `statuses.READERS`."""
    return _MADE[topic](rng, tick)


def one_wrong(topic: str, genuine: bytes, rng: Random, tick: int) -> bytes:
    """Return a status of a topic of `statuses.READERS` with one wrong field, as CDR.

    genuine : the last one heard, b'' if there is none
    """
    whole = made(topic, rng, tick)
    if genuine and rng.random() < 0.5:
        whole = cdr.decode_status(genuine)
    return cdr.encode_status(*spoilt(whole, rng.choice(KINDS), rng))


def spoilt(whole: cdr.Status, how: str, rng: Random) -> cdr.Status:
    """Return a status with one field changed, in one of `KINDS`; by chance it may be whole too."""
    values = list(whole.values)
    if how == 'head' or not values:
        field = rng.choice(('level', 'name', 'message', 'hardware_id'))
        wrong = rng.choice((3, 255)) if field == 'level' else rng.choice(_WRONG)
        return whole._replace(**{field: wrong})
    at = rng.randrange(len(values))
    key, value = values[at]
    if how == 'value':
        values[at] = key, rng.choice(_WRONG)
    elif how == 'key':
        values[at] = rng.choice((f'{key}s', key.upper(), key[:-1])), value
    elif how == 'missing':
        del values[at]
    elif how == 'twice':
        values.insert(rng.randrange(len(values) + 1), (key, rng.choice((value, *_WRONG))))
    else:
        values.append((rng.choice(('note', 'parameter', *_WRONG)), rng.choice(_WRONG)))
    return whole._replace(values=tuple(values))
