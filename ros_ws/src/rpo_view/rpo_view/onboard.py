# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What navigation, guidance, assurance and thrusters of a run say; no ROS.

A run without one of these says nothing of it, and the views show nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rpo_attitude.turns import apart
from rpo_core.files.validation import MOST_NAME, printable
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import AssuranceStatus, GuidanceStatus, tick_of

Vector = tuple[float, ...]

_MOST_DIGITS = 15
_LARGEST = 1e100
"""A larger number of a foreign message is not shown: its square is beyond all floats."""
_NO_LIMIT = 1e12
"""A larger margin is none: after contact nothing limits."""
_KEPT_STATES = 64


def number(text: str) -> float | None:
    """Return a finite number, or None where the text is something else."""
    try:
        found = float(text)
    except ValueError:
        return None
    return found if math.isfinite(found) else None


def _margin(found: float | None) -> float | None:
    return found if found is not None and -math.inf < found <= _NO_LIMIT else None


def _sound(values: Sequence[float]) -> bool:
    """Whether numbers and what is computed of them are finite."""
    return all(abs(value) < _LARGEST for value in values)


def _keep(states: dict[int, Vector], stamp_ns: int, state: Vector) -> None:
    """Add a state; the oldest ones go."""
    states[stamp_ns] = state
    while len(states) > _KEPT_STATES:
        del states[next(iter(states))]


@dataclass(frozen=True)
class Acting:
    """What assurance does from a tick on.

    constraint : for which it changes the command; '' where the command passes
    mode : open, approach or contact
    margin_m, margin_m_s : that the command as it came would leave
    """

    tick: int
    constraint: str
    mode: str
    margin_m: float | None
    margin_m_s: float | None

    @classmethod
    def of(cls, tick: int, values: Mapping[str, str]) -> Acting:
        """Return what a status tells."""
        constraint, mode = (
            printable(values.get(key, ''), MOST_NAME) for key in ('constraint', 'mode')
        )
        margins = (_margin(number(values.get(key, ''))) for key in ('margin_m', 'margin_m_s'))
        return cls(tick, constraint, mode, *margins)


@dataclass
class Onboard:
    """The stages of a run as far as messages came; None where none came.

    estimate : (6,) [m, m/s] and covariance : (9,) [m^2] of the position, target LVLH; the latter
        is None where navigation has errors and no estimator
    reference : (6,) [m, m/s] of guidance
    miss : (6,) true state less reference, error : (6,) estimate less truth, both of one stamp
    attitude : (7,) true quaternion and rate of a chaser that has one
    off : from the reference and from the estimate of the attitude, by the name of the signal: angle
        [rad] and size of the rate error [rad/s], both of one stamp
    openings : of valves so far, by the plant's health
    interventions : of assurance so far, by its health
    table : of the abort table, armed or inhibited, and its phase, by the health of assurance
    """

    estimate: Vector | None = None
    covariance: Vector | None = None
    reference: Vector | None = None
    miss: Vector | None = None
    error: Vector | None = None
    attitude: Vector | None = None
    off: Mapping[str, Vector] = field(default_factory=dict)
    openings: int | None = None
    interventions: int | None = None
    table: str = ''
    _phase: GuidanceStatus | None = None
    _acting: Acting | None = None
    _states: dict[int, Vector] = field(default_factory=dict)
    _turns: dict[int, Vector] = field(default_factory=dict)

    def anew(self) -> Onboard:
        """Return that of another run, with the statuses: they may be of it, and have their tick."""
        return Onboard(_phase=self._phase, _acting=self._acting)

    def on_state(self, stamp_ns: int, state: Vector) -> None:
        """Take a true state (6,)."""
        _keep(self._states, stamp_ns, state)

    def on_attitude(self, stamp_ns: int, attitude: Vector) -> None:
        """Take the true attitude (7,)."""
        if _sound(attitude):
            self.attitude = attitude
            _keep(self._turns, stamp_ns, attitude)

    def on_turn(self, name: str, stamp_ns: int, attitude: Vector) -> None:
        """Take an attitude (7,), the reference or an estimate, by the name of its signal."""
        truth = self._turns.get(stamp_ns)
        if truth is not None and _sound(attitude):
            self.off = {**self.off, name: tuple(apart(truth, attitude).tolist())}

    def on_estimate(self, stamp_ns: int, state: Vector, covariance: Sequence[float]) -> None:
        """Take a state (6,) of navigation, and the covariance (9,) of its position."""
        if not _sound(state):
            return
        self.estimate, self.covariance = state, None
        sure = tuple(map(float, covariance))
        if any(sure) and _sound(sure) and min(sure[0], sure[4], sure[8]) >= 0.0:
            self.covariance = sure
        truth = self._states.get(stamp_ns)
        if truth is not None:
            self.error = tuple(e - t for e, t in zip(state, truth, strict=True))

    def on_reference(self, stamp_ns: int, state: Vector) -> None:
        """Take a reference (6,)."""
        if not _sound(state):
            return
        self.reference = state
        truth = self._states.get(stamp_ns)
        if truth is not None:
            self.miss = tuple(t - r for t, r in zip(truth, state, strict=True))

    def on_guidance(self, status: GuidanceStatus) -> None:
        """Take a guidance_status."""
        self._phase = status

    def on_assurance(self, status: AssuranceStatus) -> None:
        """Take an assurance_status."""
        margins = _margin(status.margin_m), _margin(status.margin_m_s)
        self._on_acting(Acting(status.tick, status.constraint, status.mode, *margins))

    def _on_acting(self, said: Acting) -> None:
        before = self._acting
        if before is not None and said.constraint == before.constraint and said.tick > before.tick:
            said = Acting(before.tick, said.constraint, said.mode, said.margin_m, said.margin_m_s)
        self._acting = said

    def on_health(self, values: Mapping[str, str]) -> None:
        """Take the health of a node of this run: that of the plant, or that of assurance."""
        for name in ('openings', 'interventions'):
            count = number(values.get(name, ''))
            if count is not None and 0.0 <= count < 10.0**_MOST_DIGITS:
                setattr(self, name, int(count))
        if 'table' in values:
            table, phase = (printable(values.get(k, ''), MOST_NAME) for k in ('table', 'phase'))
            self.table = f'{table}, {phase}' if phase else table
        tick = tick_of(values)
        if 'margin_m' in values and tick is not None:
            self._on_acting(Acting.of(tick, values))

    def phase(self, tick: int) -> GuidanceStatus | None:
        """Return the phase of the plan at a tick; None if what was heard is of another run."""
        return self._phase if self._phase is not None and self._phase.tick <= tick else None

    def acting(self, tick: int) -> Acting | None:
        """Return what assurance does at a tick; None if what was heard is of another run."""
        return self._acting if self._acting is not None and self._acting.tick <= tick else None

    def turns(self) -> str:
        """Return how the chaser turns, in words; '' where it has no attitude."""
        if self.attitude is None:
            return ''
        said = f'turns at {math.degrees(math.hypot(*self.attitude[4:])):.3f} °/s'
        if (off := self.off.get(interfaces.REFERENCE_ATTITUDE)) is not None:
            angle, rate = map(math.degrees, off)
            said = f'{angle:.3f}° and {rate:.3f} °/s from the reference; {said}'
        if (off := self.off.get(interfaces.NAVIGATION_ATTITUDE)) is not None:
            said += f'; estimate {math.degrees(off[0]):.3f}° off the truth'
        return said

    @property
    def sigmas_m(self) -> Vector | None:
        """Sigma (3,) of the estimated position; None if it is not known."""
        c = self.covariance
        return None if c is None else tuple(math.sqrt(c[i]) for i in (0, 4, 8))

    def snapshot(self, tick: int, dt_s: float | None) -> dict[str, Any]:
        """Return all of it, ready for JSON; None for unknown data."""
        phase, acting = self.phase(tick), self.acting(tick)
        seconds = dt_s or 0.0
        return {
            'estimate_m': self.estimate and self.estimate[:3],
            'covariance_m2': self.covariance,
            'sigmas_m': self.sigmas_m,
            'estimate_error_m': self.error and math.hypot(*self.error[:3]),
            'reference_m': self.reference and self.reference[:3],
            'miss_m': self.miss and math.hypot(*self.miss[:3]),
            'miss_m_s': self.miss and math.hypot(*self.miss[3:]),
            'turns': self.turns() or None,
            'openings': self.openings,
            'guidance': phase
            and {'phase': phase.phase, 'reason': phase.reason, 'since_s': phase.tick * seconds},
            'assurance': acting
            and {
                'constraint': acting.constraint,
                'mode': acting.mode,
                'since_s': acting.tick * seconds,
                'margin_m': acting.margin_m,
                'margin_m_s': acting.margin_m_s,
                'interventions': self.interventions,
                'table': self.table,
            },
        }
