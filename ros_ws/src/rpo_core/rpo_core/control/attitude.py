# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers of the chaser's attitude, their files, and section `attitude_control` of a scenario.

fuzzy_attitude  the paper's fuzzy system, one for each body axis alike: attitude error, rate error
attitude_pd     proportional-derivative law of the quaternion, by bandwidth and damping
attitude_lqr    linear quadratic regulator of a double integrator for each axis, in closed form

A file is made for a chaser and a pace. The torque of all kinds is in proportion to the inertia of
the chaser that flies, and the section has a `time_scale`, so that one file serves all chasers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import degrees, radians, sqrt
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from rpo_core import files
from rpo_core.attitude.attitude_kernels import Body, momentum_of, synchronised
from rpo_core.attitude.chaser import turn_back, unloaded, wheels_after
from rpo_core.control.attitude_law_kernels import (
    Steering,
    TorqueLaw,
    attitude_ahead,
    attitude_torque,
)
from rpo_core.control.attitude_limits import (
    FAR,
    NONE,
    AttitudeLimits,
    Bounds,
    TorqueLimits,
    bounds_of,
    numbers_of,
)
from rpo_core.control.controller import (
    SYSTEM_FIELDS,
    FuzzyController,
    parse_system,
    system_document,
    text_of,
)
from rpo_core.control.controller_file import SCHEMA
from rpo_core.control.fuzzy import FuzzySystem
from rpo_core.control.inference import FisTables
from rpo_core.files import codec
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    Description,
    InputError,
    Name,
    Provenance,
    choice,
    flag,
    mapping,
    matrix,
    optional,
    real,
    schema,
    shown,
)
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table, step_kernel
from rpo_core.stage import ZERO, KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces

UNLIMITED_NM = 1e9
"""Limit of a torque that has none: without wheels the thrusters give what they can."""

_positive = partial(real, above=0.0, most=1e6)


@dataclass(frozen=True, kw_only=True)
class AttitudeController(Checked):
    """A controller of the attitude.

    feed_forward : whether the torque that the reference and the turning body need is added
    provenance : how its parameters came to be; free text and numbers, not read by the control
    """

    kind: ClassVar[str]

    name: Name
    description: Description = field(default='', compare=False)
    feed_forward: Annotated[bool, flag] = True
    provenance: Provenance = field(default_factory=dict, compare=False)

    @abstractmethod
    def law(self, inertia_kg_m2: Floats, time_scale: float) -> TorqueLaw:
        """Return the law for a chaser and a pace."""

    def to_document(self) -> dict[str, Any]:
        """Return the document that `parse` reads."""
        fields = codec.to_mapping({name: getattr(self, name) for name in self.__dataclass_fields__})
        made = fields.pop('provenance')
        return {'schema': SCHEMA, 'name': fields.pop('name'), 'kind': self.kind, **fields,
                'provenance': made}  # fmt: skip


_ZERO: Any = (0.0,) * 9
_NO_FIS = FisTables(
    _ZERO[:5], _ZERO[:5], as_table([0] * 25, np.int64), *(as_table([0.0]) for _ in range(4))
)


def _linear(attitude: Floats, rate: Floats) -> TorqueLaw:
    gains: Any = [tuple(matrix.ravel().tolist()) for matrix in (attitude, rate)]
    return TorqueLaw(0, gains[0], gains[1], 1.0, 1.0, ZERO, _NO_FIS)


@dataclass(frozen=True, kw_only=True)
class AttitudePd(AttitudeController):
    """Torque -J (b^2 e + 2 d b w) of the attitude error e, bandwidth b, damping d, rate error w."""

    kind: ClassVar[str] = 'attitude_pd'

    bandwidth_rad_s: Annotated[float, partial(_positive, unit='rad/s')]
    damping: Annotated[float, _positive]

    def law(self, inertia_kg_m2: Floats, time_scale: float) -> TorqueLaw:
        """Return the law."""
        b = self.bandwidth_rad_s / time_scale
        return _linear(b * b * inertia_kg_m2, 2.0 * self.damping * b * inertia_kg_m2)


@dataclass(frozen=True, kw_only=True)
class AttitudeLqr(AttitudeController):
    """The torque of each axis that minimises the integral of q e^2 + r w^2 + (torque / J)^2.

    The regulator of a double integrator in closed form: -J (sqrt(q) e + sqrt(r + 2 sqrt(q)) w).

    attitude_weight : q [1/s^4]; rate_weight : r [1/s^2]
    """

    kind: ClassVar[str] = 'attitude_lqr'

    attitude_weight: Annotated[float, partial(_positive, unit='1/s^4')]
    rate_weight: Annotated[float, partial(real, unit='1/s^2', least=0.0, most=1e6)]

    def law(self, inertia_kg_m2: Floats, time_scale: float) -> TorqueLaw:
        """Return the law."""
        moments, s = np.diag(np.diag(inertia_kg_m2)), time_scale
        k = sqrt(self.attitude_weight)
        d = sqrt(self.rate_weight + 2.0 * k)
        return _linear(k / (s * s) * moments, d / s * moments)


@dataclass(frozen=True, kw_only=True)
class FuzzyAttitude(AttitudeController):
    """One fuzzy system for each body axis alike, with its scales.

    angle_rad, rate_rad_s : the error that saturates an input
    torque_nm : at full output, of an axis whose moment of inertia is `moment_kg_m2`; other axes
        and other chasers get torque in proportion
    """

    kind: ClassVar[str] = 'fuzzy_attitude'

    system: FuzzySystem
    angle_rad: Annotated[float, partial(_positive, unit='rad')]
    rate_rad_s: Annotated[float, partial(_positive, unit='rad/s')]
    torque_nm: Annotated[float, partial(_positive, unit='N m')]
    moment_kg_m2: Annotated[float, partial(_positive, unit='kg m^2')]

    @property
    def axis(self) -> FuzzyController:
        """The law of an axis as a controller: position is the attitude [rad], force the torque."""
        scales = self.angle_rad, self.rate_rad_s, self.torque_nm
        return FuzzyController(self.name, self.system, *scales, description=self.description)

    def law(self, inertia_kg_m2: Floats, time_scale: float) -> TorqueLaw:
        """Return the law."""
        s, moments = time_scale, np.diag(inertia_kg_m2)
        x, y, z = (self.torque_nm * (moments / self.moment_kg_m2) / (s * s)).tolist()
        scales = self.angle_rad, self.rate_rad_s / s
        return TorqueLaw(1, _ZERO, _ZERO, *scales, (x, y, z), self.system.tables)

    def to_document(self) -> dict[str, Any]:
        """Return the document that `parse` reads."""
        fields = super().to_document()
        made = fields.pop('provenance')
        del fields['system']
        fields['scales'] = {name: fields.pop(name) for name in _SCALES}
        return {**fields, **system_document(self.system, _VARIABLES), 'provenance': made}


_VARIABLES = ('angle', 'rate', 'torque')
_SCALES = ('angle_rad', 'rate_rad_s', 'torque_nm', 'moment_kg_m2')

KINDS: Mapping[str, type[AttitudeController]] = {
    kind.kind: kind for kind in (FuzzyAttitude, AttitudePd, AttitudeLqr)
}
"""Kind in a file -> class."""


def parse(document: Any) -> AttitudeController:
    """Return the attitude controller of a parsed YAML document; raises InputError."""
    schema(document, SCHEMA)
    if not isinstance(document, Mapping) or 'kind' not in document:
        raise InputError(f'an attitude controller must have a `kind`; got {shown(document)}')
    kind = KINDS[choice('kind', document['kind'], KINDS)]
    body = {key: value for key, value in document.items() if key not in ('schema', 'kind')}
    if kind is FuzzyAttitude:
        needed = ['name', 'scales', *SYSTEM_FIELDS]
        data = mapping('', body, needed, ['description', 'feed_forward', 'provenance'])
        scales = mapping('scales', data['scales'], _SCALES)
        rest = {key: value for key, value in data.items() if key not in needed[1:]}
        return FuzzyAttitude(system=parse_system(data, _VARIABLES), **scales, **rest)
    return codec.from_mapping(kind, '', body)


def dumps(controller: AttitudeController) -> str:
    """Return the YAML text of a controller; floats round-trip bit for bit."""
    return text_of(controller.to_document())


def load(name: str | Path) -> AttitudeController:
    """Return the attitude controller of a shipped name or a path; raises InputError."""
    return files.load(files.find('attitude_controller', str(name)), parse)


def is_one(name: str) -> bool:
    """Whether a name, or a file, is that of an attitude controller; raises InputError."""
    if name in files.shipped('attitude_controller'):
        return True
    if not name.endswith(('.yaml', '.yml')) or not Path(name).is_file():
        return False
    document = files.load(Path(name), lambda found: found)
    return isinstance(document, Mapping) and document.get('kind') in KINDS


def axis_of(controller: str | AttitudeController) -> FuzzyController:
    """Return the law of an axis of a fuzzy attitude controller, or of its name; see `axis`."""
    loaded = load(controller) if isinstance(controller, str) else controller
    if not isinstance(loaded, FuzzyAttitude):
        raise InputError(f'`controller` must be fuzzy here; {loaded.name} is of kind {loaded.kind}')
    return loaded.axis


def _controller(name: str, value: Any) -> AttitudeController:
    if isinstance(value, AttitudeController):
        return value
    if isinstance(value, Mapping):
        return parse(value)
    if not isinstance(value, str):
        raise InputError(f'`{name}` must be a name or a mapping; got {shown(value)}')
    return load(value)


@dataclass(frozen=True, kw_only=True)
class AttitudeControl(Checked):
    """How the chaser turns: section `attitude_control`.

    controller : name of a shipped file, a path, or its content
    time_scale : its loop is slower by this factor: rates by it, torque by its square
    limit_nm : largest torque of an axis; None: that of the wheels, without wheels none
    inertia_kg_m2 : (3, 3) that it assumes; None: that of section `attitude`
    limits : what any torque must keep; None: nothing
    """

    controller: Annotated[Any, _controller]
    time_scale: Annotated[float, partial(real, above=0.0, most=1e4)] = unless_default(1.0)
    limit_nm: Annotated[float | None, partial(optional, check=_positive, unit='N m')] = (
        unless_default(None)
    )
    inertia_kg_m2: Annotated[Any, partial(optional, check=matrix, rows=3, columns=3, bound=1e9)] = (
        unless_default(None)
    )
    limits: AttitudeLimits | None = unless_default(None)

    def law_of(self, scenario: Any) -> tuple[Steering, TorqueLaw]:
        """Return the law of a scenario as the kernels read it.

        Raises InputError where the torque cannot keep its limits.
        """
        chaser, thrusters, dt_s = scenario.attitude, scenario.thrusters, scenario.dt_s
        j = np.array(self.inertia_kg_m2 or chaser.inertia_kg_m2, np.float64)
        momentum = chaser.wheels.momentum_nms if chaser.wheels else 0.0
        assumed: Any = (0.0,) * 6
        if self.controller.feed_forward:
            assumed = tuple(float(j[at]) for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        ahead_s = ((thrusters.delay_ticks if thrusters else 0) + 0.5) * dt_s
        numbers = momentum, scenario.mean_motion_rad_s, dt_s, ahead_s, *_unloading(scenario)
        limit = float(self.limit_of(scenario))
        steering = Steering((limit, limit, limit), *numbers, assumed, self.kept(scenario))
        return steering, self.controller.law(j, self.time_scale)

    def kept(self, scenario: Any) -> TorqueLimits:
        """Return what the torque must keep in a scenario; raises InputError where it cannot."""
        if self.limits is None:
            return NONE
        wheels, limit = scenario.attitude.wheels, self.limit_of(scenario)
        full = FAR if wheels is None else min(
            self.limits.momentum_nms or wheels.momentum_nms, wheels.momentum_nms
        )  # fmt: skip
        body, bounds = self._body(scenario), self.bounds(scenario)
        return numbers_of(self.limits, bounds, body, limit, full, scenario.dt_s)

    def bounds(self, scenario: Any) -> Bounds:
        """Return what `limits` make certain in a scenario; raises InputError where nothing is."""
        chaser, n, limits = scenario.attitude, scenario.mean_motion_rad_s, self.limits
        limit, wheels, body = self.limit_of(scenario), chaser.wheels, self._body(scenario)
        if limits is None or limit == UNLIMITED_NM:
            raise InputError('`attitude_control.limits` needs `limit_nm`, or wheels')
        if wheels is None and getattr(scenario.thrusters, 'table', None) is None:
            raise InputError(
                '`attitude_control.limits` needs `attitude.wheels` or `thrusters.table`: nothing '
                'else exerts a torque'
            )
        rates = chaser.start(n)[4:]
        if max(map(abs, rates)) > radians(limits.rate_deg_s):
            raise InputError(
                '`attitude.rates_deg_s` must begin within `attitude_control.limits.rate_deg_s`, '
                f'{limits.rate_deg_s!r}; got {[round(degrees(rate), 6) for rate in rates]}'
            )
        turning, spun = momentum_of(rates, body), wheels.start_nms if wheels else ZERO
        start = norm(*(a + b for a, b in zip(turning, spun, strict=True)))
        start += limits.inertia_share * norm(*turning)
        pull = 3.0 * n * n * norm(*body.inertia[:3]) if chaser.gravity_gradient else 0.0
        outside = limits.disturbance_nm + max(map(abs, chaser.disturbance_torque_nm)) + pull
        limits = replace(limits, disturbance_nm=outside)
        dt_s, duration_s, empties = scenario.dt_s, scenario.duration_s, _unloading(scenario)
        return bounds_of(
            limits, body, limit, start, dt_s, duration_s, wheels is not None, empties
        )  # fmt: skip

    def _body(self, scenario: Any) -> Body:
        """Return the body that it assumes; raises InputError for an inertia that none has."""
        inertia = self.inertia_kg_m2 or scenario.attitude.inertia_kg_m2
        assumed: Any = replace(scenario.attitude, inertia_kg_m2=inertia)
        return assumed.craft(scenario.mean_motion_rad_s).body

    def limit_of(self, scenario: Any) -> float:
        """Return the largest torque [N m] of an axis: of wheels what unloading leaves them."""
        wheels, left = scenario.attitude.wheels, _unloading(scenario)[1]
        has: float = wheels.torque_nm - left if wheels else UNLIMITED_NM
        return min(self.limit_nm or has, has)


def _unloading(scenario: Any) -> tuple[float, float]:
    """Return from which momentum [N m s] and with what torque [N m] thrusters empty wheels."""
    settings = scenario.named('unloading')
    return (settings.above_nms, settings.torque_nm) if settings else (0.0, 0.0)


@dataclass(slots=True)
class Control:
    """Settings of the kernel `command`; pointed : 1 where a reference attitude is read."""

    steering: Steering
    law: TorqueLaw
    pointed: int


@dataclass(slots=True)
class Commanded:
    """Memory of the kernel `command`.

    wheels_nms : their momentum by its own commands
    tick, rate_rad_s : of the tick before, and the rate of the reference there
    """

    wheels_nms: Annotated[list[float], 3]
    tick: int
    rate_rad_s: Annotated[list[float], 3]


@step_kernel
def command(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Turn the commanded force into the axes that the chaser has when it acts; make the torque.

    u : force (3,) [N], target LVLH, attitude (7,), and the reference attitude (7,), if any
    y : force (3,) [N] and torque (3,) [N m] in the chaser's axes
    """
    seen, wanted = (u[3], u[4], u[5], u[6], u[7], u[8], u[9]), synchronised(p.steering.orbit)
    if p.pointed:
        wanted = (u[10], u[11], u[12], u[13], u[14], u[15], u[16])
    before, rate, w = (wanted[4], wanted[5], wanted[6]), m.rate_rad_s, m.wheels_nms
    if m.tick == tick - 1:
        before = (rate[0], rate[1], rate[2])
    s = p.steering
    _, wheels = unloaded((w[0], w[1], w[2]), s.above, s.unload, s.dt)
    torque = attitude_torque(seen, wanted, before, wheels, s, p.law)
    y[0], y[1], y[2] = turn_back((u[0], u[1], u[2]), attitude_ahead(seen, s.orbit, s.ahead))
    y[3], y[4], y[5] = torque
    m.tick, rate[0], rate[1], rate[2] = tick, wanted[4], wanted[5], wanted[6]
    w[0], w[1], w[2] = wheels_after(wheels, torque, s.dt, s.wheels)


class AttitudeControlStage(KernelStage):
    """Turns the commanded force into the chaser's axes, and makes the torque."""

    name = 'attitude_control'
    outputs = (interfaces.BODY_FORCE, interfaces.BODY_TORQUE)
    memory_ticks = None
    counts_ticks = False
    kernel = command

    def __init__(self, settings: AttitudeControl, scenario: Any) -> None:
        chaser, pointed = scenario.named('attitude'), scenario.named('pointing') is not None
        reference = (interfaces.REFERENCE_ATTITUDE,) if pointed else ()
        self.inputs = (interfaces.COMMAND, interfaces.ATTITUDE, *reference)
        wheels = list(map(float, chaser.wheels.start_nms)) if chaser.wheels else [0.0] * 3
        super().__init__(
            Control(*settings.law_of(scenario), int(pointed)), Commanded(wheels, -2, [0.0] * 3)
        )

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that a chaser that nobody steers gets neither force nor torque."""
        return (), ()


def _check(settings: AttitudeControl, scenario: Any) -> None:
    if scenario.named('attitude') is None:
        raise InputError('`attitude_control` needs section `attitude`; the scenario has none')
    settings.kept(scenario)


register(
    Section(
        'attitude_control',
        AttitudeControl,
        Place.STEERING,
        AttitudeControlStage,
        _check,
        names_files=True,
    )
)
