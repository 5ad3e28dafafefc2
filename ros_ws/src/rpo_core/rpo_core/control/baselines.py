# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What an engineer would fly instead of the fuzzy controller; parameters come from its file.

pd       saturated proportional-derivative law, axis by axis
lqr      infinite-horizon linear quadratic regulator of the discrete relative dynamics
mpc      shrinking-horizon minimum-energy transfer to rest, planned anew at every tick
apf_smc  artificial potential field with sliding mode
drift    no force: what the orbit does alone
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.baseline_kernels import (
    GAINS,
    BaselineLaw,
    baseline_force,
    law_of,
    least_energy_gains,
)
from rpo_core.control.controller_file import (
    ControllerFile,
    ControllerStage,
    Scaling,
    Units,
    register,
)
from rpo_core.files import codec
from rpo_core.files.validation import Checked, matrix, real, store
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.stage import Signal, Stage
from rpo_core.world import cw

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


class BaselineStage(ControllerStage):
    """A baseline in the chain; its force follows from the state and the tick."""

    def __init__(self, law: BaselineLaw, counts_ticks: bool) -> None:
        self._law, self.counts_ticks = law, counts_ticks

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the commanded force (3,) [N] of a state (6,)."""
        return (baseline_force(inputs[0], tick, self._law),)


@dataclass(frozen=True, kw_only=True, repr=False)
class Baseline(ControllerFile):
    """A controller without memory: its force is `baseline_force` of the state and the tick.

    One whose axes are `alike` has a law that is odd in position and velocity.
    """

    @property
    @abstractmethod
    def law(self) -> BaselineLaw:
        """What the kernels read."""

    def kernel(self) -> tuple[Callable[[State, int, Any], Vector], Any]:
        """Return the kernel that answers a state at a tick, and the law that it reads: for C."""
        return baseline_force, self.law

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage; raises InputError, see `refuse_other_ticks`."""
        self.refuse_other_ticks(dt_s)
        return BaselineStage(self.law, self.clock_s is not None)

    def scaled(self: Scaled, scaling: Scaling, **also: Any) -> Scaled:
        """Return the controller of the similar loop; its model becomes that of the vehicle."""
        if hasattr(self, 'model'):
            own = scaling.vehicle
            also = {'model': Model(own.orbit_radius_m, own.mass_kg, own.dt_s, own.body), **also}
        return super().scaled(scaling, **also)

    def force_n(
        self, position_m: Sequence[float], velocity_m_s: Sequence[float], tick: int = 0
    ) -> tuple[float, float, float]:
        """Return the commanded force (3 floats, N) of a relative state, target LVLH, at a tick.

        The state must be finite; callers at the edge check it.
        """
        state: Any = tuple(map(float, (*position_m, *velocity_m_s)))
        x, y, z = map(float, baseline_force(state, tick, self.law))
        return x, y, z


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
    """Artificial potential field tracked by sliding mode, see `baseline_kernels.sliding_force`.

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
