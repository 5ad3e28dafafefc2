# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Values with which a refused section `assurance` would do: by trial, of one kind at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

from rpo_core.assurance.settings import Assurance
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import Vector, norm

_HALVINGS = 8
_SHARES = (0.5, 0.125, 0.03)

Knob = Callable[[Assurance, float], Assurance]


def values_that_work(
    settings: Assurance,
    changed: Mapping[str, Any],
    least: Mapping[str, float],
    position_m: Vector,
    works: Callable[[Assurance], bool],
) -> str:
    """Return words on changes of a section that would do, as near to it as trials find; or ''.

    '' too where what must change anyway is enough.

    changed : fields that must change anyway; least : what is known of the errors
    position_m : (3,) at the start
    """

    def tried(knob: Knob, share: float) -> Assurance | None:
        try:
            found = knob(replace(settings, **changed), share)
        except InputError:
            return None
        return found if works(found) else None

    start_m, surer = norm(*position_m), partial(_surer, least)
    nearer = partial(_nearer, start_m)
    slower = partial(_both, _slower, nearer)
    wider = list(_corridors(settings))
    knobs: list[Knob] = [_same, *wider, nearer, _slower, slower, surer, _smaller]
    more: list[Knob] = [slower, *wider[-1:]]
    knobs += [partial(_both, first, surer) for first in more]
    for knob in knobs:
        high = 1.0
        for low in _SHARES:
            found = tried(knob, low)
            if found is None:
                high = low
                continue
            for _ in range(_HALVINGS):
                half = math.sqrt(low * high)
                milder = tried(knob, half)
                low, high = (low, half) if milder is None else (half, high)
                found = milder or found
            words = ', '.join(_changes('', settings, found))
            return f' ({words} would do)' if knob is not _same else ''
    return ''


def _same(settings: Assurance, _share: float) -> Assurance:
    return settings


def _corridors(settings: Assurance) -> Iterator[Knob]:
    """Yield what makes the corridor wider at its port, or speeds of contact larger, or both."""
    if settings.corridor is None:
        return
    width, closing, lateral = 'width_m', 'closing_m_s', 'lateral_m_s'
    for names in (
        (width,),
        (lateral,),
        (width, lateral),
        (closing, lateral),
        (width, closing, lateral),
    ):
        yield partial(_wider, names)


def _wider(names: tuple[str, ...], settings: Assurance, share: float) -> Assurance:
    way, most = settings.corridor, {'width_m': 0.49 * settings.keep_out_m}
    changed = {n: min(_rounded(getattr(way, n) / share, True), most.get(n, 10.0)) for n in names}
    return replace(settings, corridor=replace(way, **changed))


def _slower(settings: Assurance, share: float) -> Assurance:
    speed = settings.speed
    changed = {f.name: _rounded(share * getattr(speed, f.name)) for f in fields(speed)}
    return replace(settings, speed=replace(speed, **changed))


def _nearer(start_m: float, settings: Assurance, share: float) -> Assurance:
    way = settings.corridor
    min_domain_m = max(1.01 * start_m, 1.01 * settings.keep_out_m, way.outer_m if way else 0.0)
    domain_m = max(_rounded(share * settings.domain_m), _rounded(min_domain_m, True))
    return replace(settings, domain_m=min(domain_m, settings.domain_m))


def _both(first: Knob, second: Knob, settings: Assurance, share: float) -> Assurance:
    return second(first(settings, share), share)


def _surer(least: Mapping[str, float], settings: Assurance, share: float) -> Assurance:
    changed = {}
    for name, bound in least.items():
        given = getattr(settings, name)
        if given is not None:
            changed[name] = max(_rounded(bound + share * (given - bound)), min(bound, given))
    return replace(settings, **changed)


def _smaller(settings: Assurance, share: float) -> Assurance:
    return replace(settings, keep_out_m=_rounded(share * settings.keep_out_m))


def _rounded(value: float, up: bool = False) -> float:
    """Return a number >= 0 in three digits, upwards or downwards."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f'{(math.ceil if up else math.floor)(value / unit) * unit:.3g}')


def _changes(place: str, old: Any, new: Any) -> Iterator[str]:
    """Yield the fields that differ, as a file has them."""
    for field in fields(new):
        before, after = getattr(old, field.name), getattr(new, field.name)
        if before == after or (before is None and after == 0.0):  # missing, and nothing is known
            continue
        if is_dataclass(after) and is_dataclass(before):
            yield from _changes(f'{place}{field.name}.', before, after)
        else:
            yield f'`{place}{field.name}: {after!r}`'
