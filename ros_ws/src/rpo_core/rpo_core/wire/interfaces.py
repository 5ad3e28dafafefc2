# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The table of interfaces: what flies between stages, and how a topic carries it.

A signal is a tuple of floats with a name. A signal whose row names a type of message is a topic of
that name too. Nodes, recorder, log reader, verify, replay and the pages of the documentation read
this table; a new topic needs one row (`add`) and nothing else. See `rpo_core.plugins`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from rpo_core import plugins
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr
from rpo_core.wire.cdr import Layout

LVLH_FRAME = 'target_lvlh'
"""Target-centred: x R-bar outward, y V-bar along the velocity, z H-bar along angular momentum."""

CHASER_FRAME = 'chaser'
"""Chaser body; its axes are parallel to LVLH, but where the scenario has section `attitude`."""

TARGET_FRAME = 'target_body'
"""The target's body, where it has an attitude (section `target`)."""

CLOCK_TYPE = cdr.CLOCK
STATE_TYPE = cdr.ODOMETRY
FORCE_TYPE = cdr.WRENCH
STATUS_TYPE = 'diagnostic_msgs/msg/DiagnosticStatus'
ARRAY_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'

STATE, COMMAND, THRUST, DISTURBANCE = 'state', 'command', 'thrust', 'disturbance'
ATTITUDE = 'attitude'
"""What a signal carries: a relative state; a force commanded, on its way to the thrusters; the
force that thrusters exert; a force from outside; the attitude of the chaser. A stage that reads one
of these gets the last signal made before it."""

PREVIOUS_COMMAND = 'command of the tick before'
"""What a stage before the controller may read: the last command, made one tick ago; zero at tick 0.
Of commands that a link may lose or delay, it is the one that was sent."""

_PREVIOUS = ' of the tick before'

TRUTH, EACH_TICK, EVENT = 'truth', 'each tick', 'event'
"""When a message is due: at each tick, by the plant itself; at each tick, in answer to a state (in
free running it may be late or missing); now and then."""

_COLUMNS = {
    STATE_TYPE: tuple(
        f'{part}.{axis}'
        for part in ('pose.pose.position', 'twist.twist.linear')
        for axis in 'xyz'
    ),
    FORCE_TYPE: tuple(f'wrench.force.{axis}' for axis in 'xyz'),
}  # fmt: skip

_TURNING = (
    *(f'pose.pose.orientation.{axis}' for axis in 'xyzw'),
    *(f'twist.twist.angular.{axis}' for axis in 'xyz'),
)
"""An attitude: quaternion x, y, z, w and rate x, y, z."""

ALIGNED = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""The attitude in a message of which nobody knows another."""

_COVARIANCES = tuple(
    f'{part}.covariance[{6 * row + column}]'
    for part in ('pose', 'twist')
    for row in range(3)
    for column in range(3)
)
"""Covariances of position and of velocity, 3 x 3 each, row by row."""

_TURNED = tuple(f'pose.covariance[{6 * row + column}]' for row in (3, 4, 5) for column in (3, 4, 5))
"""Covariance of an attitude, 3 x 3, row by row."""

_TORQUE = tuple(f'wrench.torque.{axis}' for axis in 'xyz')


@dataclass(frozen=True)
class Qos:
    """Quality of service that the publisher of a topic offers."""

    reliability: str = 'reliable'
    durability: str = 'volatile'
    depth: int = 64


LOCKSTEP = Qos()
"""States and forces. One tick is under way at a time; the depth lets DDS repair a loss for a
recorder some ticks behind. Not deeper: a hole is repaired at a heartbeat, up to 3 s later, and all
that follows would be held back until then. Not transient local: a late joiner must not get another
run's forces."""

PROGRESS_TICKS, MOST_AHEAD_TICKS = 16, 48
"""A recorder says every so many ticks how far it is; in lockstep the plant waits for one that is so
many ticks behind. With what is under way that is less than the depth: nothing is lost."""

LATCHED = Qos(durability='transient_local', depth=1)
"""Statuses and manifests: who comes late still learns the last one."""


@dataclass(frozen=True)
class Interface:
    """One row of the table.

    name : of the signal and of the topic, relative, so that two runs live in two namespaces
    type : ROS type of the message; '' for a signal that is no topic
    meaning : in a few words, with unit and frame
    carries : STATE, COMMAND, THRUST, DISTURBANCE, ATTITUDE; '' for a signal read by its name only
    due : TRUTH, EACH_TICK or EVENT
    logged : whether `run.mcap` holds it
    qos : offered by its publisher
    numbers : of a signal that is no topic
    covariance : whether the numbers of a state are followed by the covariances of position and of
        velocity, 9 each
    attitude : whether the numbers are an attitude, quaternion and rate
    frame : of the numbers, and of the body that they are about; '' for those of the type
    also : another frame that its header may have, where a scenario says so; '' for none
    rider : name of a signal whose numbers are the covariances, the attitude or the torque in the
        same message; '' for none
    rides : name of the signal in whose message it travels; '' for none
    beside : name of the signal without which a run has no such events; '' for none
    """

    name: str
    type: str
    meaning: str
    carries: str = ''
    due: str = EACH_TICK
    logged: bool = True
    qos: Qos = field(default=LOCKSTEP)
    numbers: int = 3
    covariance: bool = False
    attitude: bool = False
    frame: str = ''
    also: str = ''
    rider: str = ''
    rides: str = ''
    beside: str = ''

    @property
    def topic(self) -> str:
        """Name of the topic for a node: relative, but for the clock and diagnostics."""
        return f'/{self.name}' if self.name in (CLOCK, DIAGNOSTICS) else self.name

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the message's fields that the numbers of the signal fill, in their order."""
        if self.attitude:
            return _TURNING
        if self.rides:
            carrier = _TABLE[self.rides]
            covariances = _TURNED if carrier.attitude else _COVARIANCES
            return _TORQUE if carrier.type == FORCE_TYPE else covariances
        return _COLUMNS.get(self.type, ()) + (_COVARIANCES if self.covariance else ())

    @property
    def frames(self) -> tuple[str, ...]:
        """Frame ids in the message: that of the header, and the child frame of a state."""
        body = self.frame or CHASER_FRAME
        force = (self.frame or LVLH_FRAME,)
        return {STATE_TYPE: (LVLH_FRAME, body), FORCE_TYPE: force}.get(self.type, ())

    @property
    def rest(self) -> tuple[float, ...]:
        """Numbers in a message of which nobody knows others."""
        return ALIGNED if self.attitude else (0.0,) * len(self.columns)

    def whole(self, signals: Mapping[str, tuple[float, ...]]) -> tuple[float, ...]:
        """Return the numbers of a message: those of the signal, and of what rides in it."""
        values = signals[self.name]
        return (*values, *signals.get(self.rider, ())) if self.rider else values

    def spoken(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Return the numbers of a message, those of a rider only where it says something."""
        width = len(self.columns)
        silent = bool(self.rider) and values[width:] == row_of(self.rider).rest
        return values[:width] if silent else values

    @property
    def layout(self) -> Layout:
        """Where the numbers of the signal lie in the bytes of its message."""
        riding = row_of(self.rider).columns if self.rider else ()
        width = len(self.columns)
        return Layout.of(self.type, self.frames, self.columns + riding, width, self.also)

    def layout_in(self, scenario: Any) -> Layout:
        """Return the layout of a scenario's messages: of a section's `own_axes`, with `also`."""
        theirs = (getattr(settings, 'own_axes', ()) for settings in scenario.sections)
        return self.layout.also or self.layout if self.name in chain(*theirs) else self.layout


_TABLE: dict[str, Interface] = {}


def add(row: Interface, before: str = '') -> Interface:
    """Add a row to the table, in the order in which the messages of a tick are logged.

    before : name of the row that follows; '' for the end

    Raises InputError if there is a row of that name already, or none of the name `before`; or if it
    is logged each tick and its type is none that has a layout.
    """
    if row.name in _TABLE:
        raise InputError(f'interface `{row.name}` must be added once; it is in the table already')
    types = (STATUS_TYPE,) if row.due == EVENT else (CLOCK_TYPE, STATE_TYPE, FORCE_TYPE)
    if row.logged and row.type not in types:
        allowed = ' or '.join(types)
        raise InputError(f'interface `{row.name}` must be {allowed} to be logged; got {row.type}')
    rows = list(_TABLE.values())
    if before and before not in _TABLE:
        raise InputError(f'`before` must be one of {", ".join(_TABLE)}; got {before!r}')
    rows.insert(list(_TABLE).index(before) if before else len(rows), row)
    _TABLE.clear()
    _TABLE.update((r.name, r) for r in rows)
    return row


def table() -> dict[str, Interface]:
    """Return name -> row of all signals; loads the plug-ins first."""
    plugins.load()
    return _TABLE


def rows_so_far() -> tuple[Interface, ...]:
    """Return the rows of the modules imported so far: of whatever is in use, others too."""
    return tuple(_TABLE.values())


def previous(name: str) -> str:
    """Return the name of a signal as it was one tick ago."""
    return name + _PREVIOUS


def current(name: str) -> str:
    """Return the name of a signal without its delay of a tick."""
    return name.removesuffix(_PREVIOUS)


def row_of(name: str) -> Interface:
    """Return the row of a signal, of this tick or the one before; raises InputError if none."""
    row = _TABLE.get(name) or table().get(current(name))
    if row is None:
        raise InputError(f'interface must be one of {", ".join(_TABLE)}; got {name!r}')
    return row


def applied(name: str) -> str:
    """Return what says, in free running, what the plant took of a signal; '' where nothing does."""
    turned = {BODY_FORCE: APPLIED_BODY_FORCE, BODY_TORQUE: APPLIED_TORQUE}
    taken = {COMMAND: APPLIED_FORCE, DISTURBANCE: APPLIED_DISTURBANCE}
    return turned.get(name) or taken.get(row_of(name).carries, '')


def find(name: str) -> Interface | None:
    """Return the row of a signal or topic, absolute or in a namespace; None if it has none."""
    return table().get(name.rsplit('/', 1)[-1])


def rows(*, logged: bool | None = None) -> tuple[Interface, ...]:
    """Return the rows of topics in their order; those logged, those that are not, or all."""
    return tuple(r for r in table().values() if r.type and logged in (None, r.logged))


def _row(name: str, kind: str, meaning: str, *more: Any, **others: Any) -> str:
    """Add a row; return its name."""
    return add(Interface(name, kind, meaning, *more, **others)).name


# fmt: off
CLOCK = _row('clock', CLOCK_TYPE, 'simulated time, for others; no control depends on it', due=TRUTH)
RELATIVE_STATE = _row('relative_state', STATE_TYPE,
    'true state of the chaser, target LVLH, stamp of its tick',
    STATE, TRUTH, rider='chaser_attitude')
CHASER_ATTITUDE = _row('chaser_attitude', '',
    'true attitude in relative_state, where the chaser has one: its axes to target LVLH; rate in '
    'its axes, against inertial space',
    ATTITUDE, TRUTH, logged=False, attitude=True, rides='relative_state')
ATTITUDE_MEASUREMENT = _row('attitude_measurement', STATE_TYPE,
    'attitude as a star tracker finds it, 0, 0, 0, 0 where it does not; rate of a gyro',
    attitude=True)
NAVIGATION_ATTITUDE = _row('navigation_attitude', STATE_TYPE,
    'attitude and rate of the chaser as navigation finds them',
    ATTITUDE, attitude=True, rider='attitude_covariance')
ATTITUDE_COVARIANCE = _row('attitude_covariance', '',
    'covariance of the angles in navigation_attitude, axes of the chaser [rad^2]',
    logged=False, rides='navigation_attitude')
NAVIGATION_STATE = _row('navigation_state', STATE_TYPE,
    'state as navigation finds it, where the scenario has errors of it',
    STATE, rider='navigation_covariance')
NAVIGATION_COVARIANCE = _row('navigation_covariance', '',
    'covariances of position and velocity in navigation_state, where it is estimated',
    logged=False, rides='navigation_state')
ESTIMATED_DISTURBANCE = _row('estimated_disturbance', FORCE_TYPE,
    'disturbance as the estimator finds it, target LVLH, where it does')
REFERENCE_STATE = _row('reference_state', STATE_TYPE,
    'state that the controller shall follow, where the scenario has guidance')
REFERENCE_FORCE = _row('reference_force', FORCE_TYPE,
    'force that a chaser on the reference needs, target LVLH')
REFERENCE_ATTITUDE = _row('reference_attitude', STATE_TYPE,
    'attitude and rate that the chaser shall have', attitude=True)
CONTROL_FORCE = _row('control_force', FORCE_TYPE,
    'commanded force, target LVLH, stamp of the state it answers', COMMAND)
SHAPED_FORCE = _row('shaped_force', FORCE_TYPE,
    'command after shaping, target LVLH, stamp of the state it answers', COMMAND)
ASSURED_FORCE = _row('assured_force', FORCE_TYPE,
    'command after runtime assurance, target LVLH, stamp of the state it answers', COMMAND)
DISTURBANCE_FORCE = _row('disturbance_force', FORCE_TYPE,
    'disturbance, target LVLH, stamp of the state it answers', DISTURBANCE)
BODY_FORCE = _row('body_force', FORCE_TYPE,
    'commanded force in the axes of the chaser, where it has an attitude',
    COMMAND, frame=CHASER_FRAME, rider='body_torque')
BODY_TORQUE = _row('body_torque', '',
    'commanded torque in body_force [N m]', logged=False, rides='body_force')
APPLIED_FORCE = _row('applied_force', FORCE_TYPE,
    'command that acts, saturated (free running)', COMMAND, TRUTH)
APPLIED_DISTURBANCE = _row('applied_disturbance', FORCE_TYPE,
    'disturbance that acts (free running)', DISTURBANCE, TRUTH)
APPLIED_BODY_FORCE = _row('applied_body_force', FORCE_TYPE,
    'the same of body_force, axes of the chaser (free running)',
    COMMAND, TRUTH, frame=CHASER_FRAME, rider='applied_torque')
APPLIED_TORQUE = _row('applied_torque', '',
    'torque in applied_body_force [N m]', logged=False, rides='applied_body_force')
DUE_FORCE = _row('due_force', '',
    'command that is due at the thrusters, late where they are', logged=False)
SATURATED_FORCE = _row('saturated_force', '', 'the same, saturated', logged=False)
THRUST_FORCE = _row('thrust_force', '', 'force that the thrusters exert', THRUST, logged=False)
EXERTED_FORCE = _row('exerted_force', FORCE_TYPE,
    'force that thrusters exert, where they fire or turn, mean of a tick, target LVLH',
    THRUST, TRUTH, rider='exerted_torque')
EXERTED_TORQUE = _row('exerted_torque', '',
    'torque in exerted_force that a table of thrusters gives, mean of a tick [N m]',
    logged=False, rides='exerted_force')
WHEEL_MOMENTUM = _row('wheel_momentum', '',
    'momentum of the wheels, axes of the chaser [N m s]', logged=False)
UNLOADING_TORQUE = _row('unloading_torque', '',
    'torque of the thrusters that empties the wheels [N m]', logged=False)
THRUST_SHIFT = _row('thrust_shift', '',
    'state x mass that a force gives by turning [N s^2], [N s]', logged=False, numbers=6)
CHASER_MASS = _row('chaser_mass', '',
    'mass of the chaser in the middle of a tick [kg], where it falls', logged=False, numbers=1)
TARGET_ATTITUDE = _row('target_attitude', STATE_TYPE,
    'attitude of the target, its axes to target LVLH; rate in its axes, against inertial space',
    due=TRUTH, attitude=True, frame=TARGET_FRAME)
STAGE_STATUS = _row('stage_status', STATUS_TYPE,
    'a stage that was switched off or on in flight, and from which tick', due=EVENT, qos=LATCHED)
GUIDANCE_STATUS = _row('guidance_status', STATUS_TYPE,
    'phase of the plan that begins, its first tick and why', due=EVENT, logged=False, qos=LATCHED)
ASSURANCE_STATUS = _row('assurance_status', STATUS_TYPE,
    'each intervention of runtime assurance: constraint, margins, force before and after',
    due=EVENT, qos=Qos(durability='transient_local'), beside='assured_force')
RUN_STATUS = _row('run_status', STATUS_TYPE,
    'waiting, running, paused, finished or aborted; reason and metrics', due=EVENT, qos=LATCHED)
NODE_MANIFEST = _row('node_manifest', STATUS_TYPE,
    'files and parameters that shape the flight, for the log', due=EVENT, logged=False, qos=LATCHED)
RECORDER_STATUS = _row('recorder_status', STATUS_TYPE,
    'waiting, ready, closed or failed', due=EVENT, logged=False, qos=LATCHED)
HEARTBEAT = _row('heartbeat', STATUS_TYPE,
    'sign of life of a node of the loop, 5 a second of wall time',
    due=EVENT, logged=False, qos=Qos(depth=16))
DIAGNOSTICS = _row('diagnostics', ARRAY_TYPE,
    'health, once a second of wall time', due=EVENT, logged=False, qos=Qos(depth=10))
# fmt: on

NEXT = (RELATIVE_STATE, CHASER_ATTITUDE)
"""The truth: signals that a tick makes for the next one."""
