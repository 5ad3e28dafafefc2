# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What an engineer would fly instead of the fuzzy controller; parameters come from its file.

pd       saturated proportional-derivative law, axis by axis
lqr      infinite-horizon linear quadratic regulator of the discrete relative dynamics
mpc      shrinking-horizon minimum-energy transfer to rest, planned anew at every tick
apf_smc  artificial potential field with sliding mode
drift    no force: what the orbit does alone

Their laws are kernels, the same bits interpreted and compiled. Every law is odd bit for bit: the
force of the mirrored state is the mirrored force.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from math import sqrt
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.controller_file import (
    ControllerFile,
    ControllerStage,
    Scaling,
    Units,
    register,
)
from rpo_core.files import codec
from rpo_core.files.validation import Checked, matrix, real, store
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import as_table, inlined, kernel, step_kernel
from rpo_core.kernels.records import prepared
from rpo_core.stage import KernelStage, Stage
from rpo_core.world import cw

GAINS = 18
"""Numbers in a row of a gain table: K (3, 6) row by row, forces from (x, y, z, vx, vy, vz)."""


class BaselineLaw(NamedTuple):
    """A law as the kernels read it; tables by `rpo_core.kernels.jit.as_table`, empty if not used.

    gains : (rows, 18) f = -K x [N/m, N s/m]; row k is that of tick k, the last one stays
    field : the 6 numbers of `sliding_force`
    limit : largest |f| of an axis [N]
    distances, speeds, forces : of `table_force`
    """

    gains: list[list[float]]
    field: list[float]
    limit: float
    distances: list[float]
    speeds: list[float]
    forces: list[float]


def law_of(
    limit: float,
    *,
    gains: Any = (),
    field: Any = (),
    table: tuple[Any, Any, Any] = ((), (), ()),
) -> BaselineLaw:
    """Return a law of one kind: gains, or a field, or the table of `table_force`."""
    rows = np.asarray(gains, dtype=np.float64).reshape(-1, GAINS)
    distances, speeds, forces = (as_table(np.ravel(part)) for part in table)
    return BaselineLaw(as_table(rows), as_table(field), limit, distances, speeds, forces)


@kernel
def gain_force(state: State, g: Any) -> Vector:
    """Force [N] of linear state feedback, f = -K x, g = K (3, 6) row by row."""
    x, y, z, vx, vy, vz = state
    return (
        -(g[0] * x + g[1] * y + g[2] * z + g[3] * vx + g[4] * vy + g[5] * vz),
        -(g[6] * x + g[7] * y + g[8] * z + g[9] * vx + g[10] * vy + g[11] * vz),
        -(g[12] * x + g[13] * y + g[14] * z + g[15] * vx + g[16] * vy + g[17] * vz),
    )


@kernel
def sliding_surface(state: State, speed: float, radius: float) -> Vector:
    """Sliding variable s = v + grad phi [m/s], phi = speed * sqrt(|r|^2 + radius^2).

    The potential is a cone of slope `speed` [m/s] with its tip rounded within `radius` [m]. On the
    surface s = 0 the chaser flies down its gradient.
    """
    x, y, z, vx, vy, vz = state
    slope = speed / sqrt(x * x + y * y + z * z + radius * radius)
    return vx + slope * x, vy + slope * y, vz + slope * z


@kernel
def sliding_force(state: State, field: Any) -> Vector:
    """Force [N] that brings the state to the sliding surface and keeps it there.

    f = m (-d/dt grad phi - a_cw) - gain * sat(s / layer): the equivalent control of the nominal
    relative dynamics a_cw, and a switching term with a boundary layer.

    field : approach speed [m/s], rounding radius [m], switching gain [N], boundary layer [m/s],
        mass [kg], mean motion [rad/s]
    """
    speed, radius, gain, layer, mass, n = field[0], field[1], field[2], field[3], field[4], field[5]
    x, y, z, vx, vy, vz = state
    sx, sy, sz = sliding_surface(state, speed, radius)
    square = x * x + y * y + z * z + radius * radius
    slope = speed / sqrt(square)
    closing = (x * vx + y * vy + z * vz) / square
    ax, ay, az = 3.0 * n * n * x + 2.0 * n * vy, -(2.0 * n * vx), -(n * n * z)
    return (
        -(mass * (slope * (vx - closing * x) + ax)) - gain * saturate(sx / layer, 1.0),
        -(mass * (slope * (vy - closing * y) + ay)) - gain * saturate(sy / layer, 1.0),
        -(mass * (slope * (vz - closing * z) + az)) - gain * saturate(sz / layer, 1.0),
    )


@kernel
def interval(x: float, knots: Any) -> tuple[int, float]:
    """Return the interval of ascending knots that x lies in, and its share of it, in [0, 1].

    Beyond the first or the last knot, x counts as the knot.
    """
    last = len(knots) - 1
    if x <= knots[0]:
        return 0, 0.0
    if x >= knots[last]:
        return last - 1, 1.0
    i = 0
    while x >= knots[i + 1]:
        i += 1
    return i, (x - knots[i]) / (knots[i + 1] - knots[i])


@inlined
def table_inputs(r: float, v: float) -> tuple[float, float]:
    """Distance [m] and closing speed [m/s] of an axis at position r [m] and velocity v [m/s]."""
    return abs(r), -v if r >= 0.0 else v


@kernel
def table_force(r: float, v: float, distances: Any, speeds: Any, forces: Any) -> float:
    """Force [N] of an axis by a zero-order Takagi-Sugeno system of its distance and closing speed.

    Triangles with peaks at `distances` [m] and `speeds` [m/s] partition both inputs; AND is the
    product, the consequents are forces towards the target. So the force is bilinear between the
    peaks. The table begins with a distance of 0.

    forces : (distances * speeds,) [N], row by row; the first row is odd in the speed, which makes
        the force of the mirrored state the mirrored force, also where r = 0
    """
    distance, speed = table_inputs(r, v)
    i, far = interval(distance, distances)
    j, fast = interval(speed, speeds)
    n = len(speeds)
    near = (1.0 - fast) * forces[n * i + j] + fast * forces[n * i + j + 1]
    beyond = (1.0 - fast) * forces[n * (i + 1) + j] + fast * forces[n * (i + 1) + j + 1]
    pull = (1.0 - far) * near + far * beyond
    return -pull if r >= 0.0 else pull


@kernel
def baseline_force(state: State, tick: int, law: BaselineLaw) -> Vector:
    """Force [N] of a law at a tick, saturated."""
    if len(law.field) > 0:
        fx, fy, fz = sliding_force(state, law.field)
    elif len(law.forces) > 0:
        d, u, f = law.distances, law.speeds, law.forces
        fx = table_force(state[0], state[3], d, u, f)
        fy = table_force(state[1], state[4], d, u, f)
        fz = table_force(state[2], state[5], d, u, f)
    else:
        last = len(law.gains) - 1
        fx, fy, fz = gain_force(state, law.gains[tick if tick < last else last])
    return saturate(fx, law.limit), saturate(fy, law.limit), saturate(fz, law.limit)


@step_kernel
def command(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """F = `baseline_force`: from a state u (6,) at a tick to a force y (3,) [N]."""
    y[0], y[1], y[2] = baseline_force((u[0], u[1], u[2], u[3], u[4], u[5]), tick, p)


@kernel
def solve_in_place(m: NDArray[np.float64]) -> None:
    """Solve m[:, :6] X = m[:, 6:] for a positive definite matrix; X is left in m[:, 6:].

    Gauss-Jordan without pivoting, in a fixed order: no BLAS, so the same bits on every machine.
    """
    columns = m.shape[1]
    for i in range(6):
        inverse = 1.0 / m[i, i]
        for column in range(i, columns):
            m[i, column] *= inverse
        for row in range(6):
            if row != i:
                factor = m[row, i]
                if factor != 0.0:
                    for column in range(i, columns):
                        m[row, column] -= factor * m[i, column]


@kernel
def multiply(a: NDArray[np.float64], b: NDArray[np.float64], product: NDArray[np.float64]) -> None:
    """Fill product = a b, each entry summed in one order."""
    for i in range(a.shape[0]):
        for k in range(b.shape[1]):
            total = 0.0
            for j in range(a.shape[1]):
                total += a[i, j] * b[j, k]
            product[i, k] = total


@kernel
def least_energy_gains(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    scale: NDArray[np.float64],
    least: int,
    gains: NDArray[np.float64],
) -> None:
    """Fill gains (rows, 3, 6) of the least-energy transfer to rest in `rows - 1 + least` ticks.

    With T ticks to go, P = A^(T-1) and the Gramian W = sum over j < T of A^j B B' A'^j, the first
    force of the least-energy plan from x to rest is -B' P' W^-1 P A x. Row k is for T = rows - 1 -
    k + least; the states are scaled by `scale` (6,) for the solution.

    a, b : (6, 6), (6, 3), of x+ = A x + B f
    """
    rows = len(gains)
    power, reach, product = np.zeros((6, 6)), np.empty((6, 3)), np.empty((6, 6))
    gramian, m = np.zeros((6, 6)), np.empty((6, 12))
    for i in range(6):
        power[i, i] = 1.0
    for to_go in range(1, rows - 1 + least + 1):
        multiply(power, b, reach)
        multiply(power, a, product)
        for i in range(6):
            for j in range(3):
                reach[i, j] /= scale[i]
        for i in range(6):
            for k in range(6):
                for j in range(3):
                    gramian[i, k] += reach[i, j] * reach[k, j]
                m[i, k], m[i, 6 + k] = gramian[i, k], product[i, k] / scale[i]
                power[i, k] = product[i, k]
        if to_go >= least:
            solve_in_place(m)
            multiply(reach.T, m[:, 6:], gains[rows - 1 - (to_go - least)])


Scaled = TypeVar('Scaled', bound='Baseline')

MAX_GAIN = 1e6
MAX_HORIZON_TICKS = 100_000

_LEAST_TICKS = 10  # a transfer to rest needs two forces per axis; ten keep its Gramian well away
_SCALE = np.array([100.0, 100.0, 100.0, 1.0, 1.0, 1.0])  # of states [m, m/s], for the Gramian


@dataclass(frozen=True)
class Model(Checked):
    """The relative dynamics that a design takes for true.

    body : what the target orbits; a file names one of `cw.BODIES`, or has a mapping
    """

    orbit_radius_m: float
    mass_kg: cw.Mass
    dt_s: cw.TickLength
    body: Annotated[Any, cw.body_of] = codec.unless_default(cw.EARTH)

    def __post_init__(self) -> None:
        super().__post_init__()
        store(self, orbit_radius_m=cw.orbit_radius(self.orbit_radius_m, self.body))

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion of the target."""
        return cw.mean_motion(self.orbit_radius_m, self.body)

    def matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return A_d (6, 6) and B_d (6, 3) of a tick."""
        return cw.matrices(cw.discretise(self.mean_motion_rad_s, self.mass_kg, self.dt_s))


PAPER_MODEL = Model(orbit_radius_m=6_678_000.0, mass_kg=10.0, dt_s=0.1)


class BaselineStage(KernelStage, ControllerStage):
    """A baseline in the chain; its force follows from the state and the tick."""

    kernel = command

    def __init__(self, law: Any, counts_ticks: bool) -> None:
        super().__init__(law)
        self.counts_ticks = counts_ticks


@dataclass(frozen=True, kw_only=True, repr=False)
class Baseline(ControllerFile):
    """A controller without memory: its force is `baseline_force` of the state and the tick.

    One whose axes are `alike` has a law that is odd in position and velocity.
    """

    @property
    @abstractmethod
    def law(self) -> BaselineLaw:
        """What the kernels read."""

    @cached_property
    def _settings(self) -> Any:
        """Its law, as kernels of this process read it."""
        return prepared(self.law)

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage; raises InputError, see `refuse_other_ticks`."""
        self.refuse_other_ticks(dt_s)
        return BaselineStage(self._settings, self.clock_s is not None)

    def scaled(self: Scaled, scaling: Scaling, **also: Any) -> Scaled:
        """Return the controller of the similar loop; its model becomes that of the vehicle."""
        if hasattr(self, 'model'):
            own = scaling.vehicle
            also = {'model': Model(own.orbit_radius_m, own.mass_kg, own.dt_s, own.body), **also}
        return super().scaled(scaling, **also)


_matrix = partial(matrix, rows=3, columns=6, bound=MAX_GAIN)
_gain = partial(real, least=0.0, most=MAX_GAIN)
_positive = partial(real, least=1e-6, most=MAX_GAIN)


@dataclass(frozen=True, kw_only=True, repr=False)
class Drift(Baseline):
    """No force at all: the free motion of the relative orbit, the null of every comparison."""

    kind: ClassVar[str] = 'drift'

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        return law_of(self.max_force_n, gains=np.zeros(GAINS))


@dataclass(frozen=True, kw_only=True, repr=False)
class Pd(Baseline):
    """Saturated PD: f = -kp r - kd v of each axis, without a model of the motion."""

    kind: ClassVar[str] = 'pd'
    units: ClassVar[Units] = {'position_gain_n_m': (-1, 0, 1), 'velocity_gain_n_s_m': (-1, 1, 1)}

    position_gain_n_m: Annotated[float, partial(_gain, unit='N/m')]
    velocity_gain_n_s_m: Annotated[float, partial(_gain, unit='N s/m')]

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        k = np.hstack([self.position_gain_n_m * np.eye(3), self.velocity_gain_n_s_m * np.eye(3)])
        return law_of(self.max_force_n, gains=k)


@dataclass(frozen=True, kw_only=True, repr=False)
class Lqr(Baseline):
    """Linear quadratic regulator: f = -K x minimises sum of x' Q x + f' f over all ticks.

    Q = diag(position_weight (3), velocity_weight (3)) with the weights per tick. The file holds the
    solution too, so that it flies without a Riccati solver; `rpo train lqr` writes both.

    position_weight, velocity_weight : of Q [N^2/m^2], [N^2 s^2/m^2]
    gains : (3, 6) K [N/m, N s/m]
    """

    kind: ClassVar[str] = 'lqr'
    units: ClassVar[Units] = {'position_weight': (-2, 0, 2), 'velocity_weight': (-2, 2, 2)}

    position_weight: Annotated[float, partial(_gain, unit='N^2/m^2')]
    velocity_weight: Annotated[float, partial(_gain, unit='N^2 s^2/m^2')]
    gains: Annotated[tuple[tuple[float, ...], ...], _matrix]
    model: Model = PAPER_MODEL

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        return law_of(self.max_force_n, gains=self.gains)

    def scaled(self, scaling: Scaling, **also: Any) -> Lqr:
        """Return the controller of the similar loop; its gains scale, they are not solved anew."""
        gains = tuple(
            scaling.of(row[:3], (-1, 0, 1)) + scaling.of(row[3:], (-1, 1, 1)) for row in self.gains
        )
        return super().scaled(scaling, gains=gains, **also)


@dataclass(frozen=True, kw_only=True, repr=False)
class Mpc(Baseline):
    """Shrinking-horizon model predictive control: the least energy to rest at the origin in time.

    At tick k it plans the forces of the ticks left to the horizon, minimum sum of f' f subject to
    x+ = A x + B f and rest at the origin at its end, and gives the first of them. As long as no
    limit of the plan is active the quadratic program has a closed form, by the Gramian of the ticks
    left: a gain for each tick. The time to go is never less than `least_time_to_go_s`, so that the
    gains stay bounded and hold the chaser after arrival, without a step at the change.

    horizon_s : when it comes to rest, since the start of the run
    least_time_to_go_s : of the plans made near the horizon and after it
    """

    kind: ClassVar[str] = 'mpc'
    units: ClassVar[Units] = {'horizon_s': (0, 1, 0), 'least_time_to_go_s': (0, 1, 0)}

    horizon_s: float
    least_time_to_go_s: float
    model: Model = PAPER_MODEL

    def __post_init__(self) -> None:
        super().__post_init__()
        shortest, longest = _LEAST_TICKS * self.model.dt_s, MAX_HORIZON_TICKS * self.model.dt_s
        least = real(
            'least_time_to_go_s', self.least_time_to_go_s, 's', least=shortest, most=longest
        )
        horizon = real('horizon_s', self.horizon_s, 's', least=least, most=longest)
        store(self, least_time_to_go_s=least, horizon_s=horizon)

    @property
    def clock_s(self) -> float | None:
        """Length of the ticks that it counts."""
        return self.model.dt_s

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read; a row of gains for each tick until the holding begins."""
        a, b = self.model.matrices()
        least = round(self.least_time_to_go_s / self.model.dt_s)
        rows = round(self.horizon_s / self.model.dt_s) - least + 1
        gains = np.empty((rows, 3, 6))
        least_energy_gains(a, b, _SCALE, least, gains)
        return law_of(self.max_force_n, gains=gains)


@dataclass(frozen=True, kw_only=True, repr=False)
class PotentialField(Baseline):
    """Artificial potential field tracked by sliding mode, see `baselines.sliding_force`.

    The potential as guidance: Lopez and McInnes, "Autonomous Rendezvous Using Artificial Potential
    Function Guidance", JGCD 18(2), 1995. Its gradient as a sliding surface: Guldner and Utkin,
    "Sliding Mode Control for Gradient Tracking and Robot Navigation Using Artificial Potential
    Fields", IEEE Trans. Robotics and Automation 11(2), 1995; for rendezvous, Cao, Qiao and Xu, Acta
    Astronautica 143, 2018 (cited by AAS 23-199), and Mancini et al., arXiv:1906.10945. Without an
    obstacle the attractive potential is all there is.

    approach_speed_m_s : far from the target
    rounding_radius_m : within which the speed falls in proportion to the distance
    switching_gain_n, boundary_layer_m_s : of the sliding mode
    """

    kind: ClassVar[str] = 'apf_smc'
    units: ClassVar[Units] = {
        'approach_speed_m_s': (1, -1, 0),
        'rounding_radius_m': (1, 0, 0),
        'switching_gain_n': (0, 0, 1),
        'boundary_layer_m_s': (1, -1, 0),
    }

    approach_speed_m_s: Annotated[float, partial(_positive, unit='m/s')]
    rounding_radius_m: Annotated[float, partial(_positive, unit='m')]
    switching_gain_n: Annotated[float, partial(_positive, unit='N')]
    boundary_layer_m_s: Annotated[float, partial(_positive, unit='m/s')]
    model: Model = PAPER_MODEL

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        numbers = [
            self.approach_speed_m_s,
            self.rounding_radius_m,
            self.switching_gain_n,
            self.boundary_layer_m_s,
            self.model.mass_kg,
            self.model.mean_motion_rad_s,
        ]
        return law_of(self.max_force_n, field=numbers)


KINDS: Mapping[str, type[Baseline]] = {
    kind.kind: register(kind) for kind in (Pd, Lqr, Mpc, PotentialField, Drift)
}
"""Kind in a controller file -> class."""
