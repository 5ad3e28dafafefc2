# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile commands in the runs of a campaign: all its stages fly, those of attitude too.

From a moment that is drawn on, a run's force is not its controller's. Where `attitude_control` has
limits, neither is the torque of every other forty runs, from the beginning on. What the campaign
disperses stays: estimates, attitudes, thrusters. Beside the zone it looks at the contract between
attitude and translation (docs/safety.md, lemma 6): the angle by which a force was turned wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rpo.analysis import attack
from rpo.analysis.attack import LATE, OWN, Hostile, Interceptor
from rpo.analysis.turned import theta_deg
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.quantities import Dispersion
from rpo.montecarlo.run_batch import flights_drawn
from rpo.montecarlo.sampling import draw
from rpo_core.assurance.assumed import LARGEST_NORMAL, SQRT_3, errors_of
from rpo_core.chain.flight import JUDGED, Flight
from rpo_core.control.attitude import AttitudePd
from rpo_core.control.attitude_law_kernels import TorqueLaw
from rpo_core.files.validation import InputError
from rpo_core.kernels.arrays import Floats
from rpo_core.stage import Place, Stage, section_of
from rpo_core.wire.interfaces import NAVIGATION_ATTITUDE

HOSTILE_KINDS = (OWN, *(i for i in range(len(attack.KINDS)) if i != LATE))
KINDS = ('its own', *(attack.KINDS[i] for i in HOSTILE_KINDS[1:]))

RUNS = 40
"""So many runs are drawn together."""

BIASED = 0.9
"""Share of an assumed error that is a bias; the rest is noise."""

GAIN_NM = 10.0
"""Of hostile torques, for a radian or a radian a second: their signs are drawn."""


@dataclass(frozen=True, kw_only=True)
class HostileTorques(AttitudePd):
    """A controller of attitude that answers errors with any torque; gains : (18,)."""

    kind: ClassVar[str] = 'hostile'
    gains: Any

    def law(self, inertia_kg_m2: Floats, time_scale: float) -> TorqueLaw:
        """Return the law."""
        law = super().law(inertia_kg_m2, time_scale)
        return law._replace(attitude=self.gains[:9], rate=self.gains[9:])


def _torques(campaign: Campaign, first: int) -> Campaign:
    """Return a campaign with hostile torques."""
    random = np.random.default_rng([campaign.config.seed, first, 1])
    gains, scenario = random.choice((-GAIN_NM, GAIN_NM), 18), campaign.scenario
    settings: Any = scenario.named('attitude_control')
    controller = HostileTorques(
        name='hostile', bandwidth_rad_s=1.0, damping=1.0, gains=tuple(gains.tolist()),
        feed_forward=settings.controller.feed_forward,
    )  # fmt: skip
    hostile = scenario.equipped(replace(settings, controller=controller))
    return replace(campaign, scenario=hostile)


def _flights(campaign: Campaign, first: int) -> Iterator[Flight]:
    """Yield the flights of up to 40 runs, `first` being the number of the first one."""
    random = np.random.default_rng([campaign.config.seed, first])
    since = random.integers(0, campaign.scenario.ticks, RUNS).tolist()
    words = random.integers(0, 2**32, (2, RUNS)).T.tolist()

    def interceptor(index: int) -> list[tuple[Place, Stage]]:
        """Return what comes after the controller."""
        kind, limit_n = HOSTILE_KINDS[(first + index) % len(KINDS)], campaign.scenario.max_force_n
        hostile = Hostile(kind, limit_n, words[index], since[index])
        return [(Place.SHAPING, Interceptor(hostile))]

    drawn = draw(campaign, first, min(RUNS, campaign.config.runs - first))
    limits = campaign.scenario.named('attitude_control').limits
    turned = limits is not None and first // RUNS % 2
    flown = _torques(campaign, first) if turned else campaign
    kept = *JUDGED, NAVIGATION_ATTITUDE
    return flights_drawn(flown, drawn, more=interceptor, kept=kept)


def approach_of(flight: Flight) -> tuple[int, float, float, float]:
    """Return the ticks before contact, and what was seen at the states after tick 0 until then.

    How deep the zone was entered outside of the corridor [m], 0.0: never; speed at contact [m/s],
    that across it of an axis, infinite without contact.
    """
    settings = attack.settings_of(flight.scenario)
    (x, y, z), v, way = flight.seen[1:, :3].T, flight.seen[1:, 3:], settings.corridor
    inside, ticks = settings.keep_out_m - np.sqrt(x * x + y * y + z * z), len(v)
    closing = lateral = math.inf
    if way is not None:
        axis, side = 'xyz'.index(way.along[1]), 1.0 if way.along[0] == '+' else -1.0
        across = [(axis + 1) % 3, (axis + 2) % 3]
        r, d = np.abs((x, y, z)), side * (x, y, z)[axis] - way.port_m
        within = way.width_m + way.slope * np.maximum(d, 0.0) - np.max(r[across], axis=0)
        touches = (within >= 0.0) & (d <= 0.0) & (np.append(0.0, d[:-1]) > 0.0)
        inside = np.where(d > 0.0, np.minimum(inside, -within), inside)
        if touches.any():
            ticks = int(np.argmax(touches))
            closing, lateral = -side * v[ticks, axis], np.abs(v[ticks, across]).max()
    return ticks, float(inside[:ticks].max(initial=0.0)), float(closing), float(lateral)


@dataclass(frozen=True)
class Flown:
    """Runs of one kind of commands.

    depth_m : (n,) deepest in the zone, outside the corridor, before contact; 0.0: never
    closing_m_s, lateral_m_s : (n,) at contact, the latter per axis; infinite without one
    turned_deg : (n,) largest angle by which a force was turned wrongly, before contact
    """

    kind: str
    depth_m: Floats
    closing_m_s: Floats
    lateral_m_s: Floats
    turned_deg: Floats


def bounded(campaign: Campaign) -> Campaign:
    """Return a campaign whose position is known as badly as assurance assumes, by no sensors."""
    scenario, config = campaign.scenario, campaign.config
    settings = attack.settings_of(scenario)
    errors = errors_of(settings, scenario)
    seeing = (Place.SENSOR, Place.ESTIMATOR)
    sections = tuple(s for s in scenario.sections if section_of(s).place not in seeing)
    kept = {n: d for n, d in config.dispersions.items() if not n.startswith('sensor_')}
    for name, unit, bound in (
        ('position', 'm', errors.position_m),
        ('velocity', 'm_s', errors.velocity_m_s),
    ):
        bias, noise = (BIASED * bound / SQRT_3,) * 3, ((1.0 - BIASED) * bound / LARGEST_NORMAL,)
        kept[f'navigation_{name}_bias_{unit}'] = Dispersion('uniform', bias)
        kept[f'navigation_{name}_noise_{unit}'] = Dispersion('white', noise)
    without_sensors = replace(scenario, sections=sections)
    return replace(campaign, config=replace(config, dispersions=kept), scenario=without_sensors)


def attack_campaign(
    campaign: Campaign, advance: Callable[[int], None] = lambda _: None
) -> list[Flown]:
    """Fly the runs of a campaign with each kind of command in turn; raises InputError.

    advance : gets how many runs are done
    """
    scenario, runs = campaign.scenario, campaign.config.runs
    attack.settings_of(scenario)
    if scenario.named('attitude_control') is None:
        raise InputError(
            f'a campaign under attack needs `attitude_control`; scenario {scenario.name} has none'
        )
    figures = np.empty((4, runs))
    for first in range(0, runs, RUNS):
        for run, flight in enumerate(_flights(campaign, first), first):
            ticks, *seen = approach_of(flight)
            # a contact is seen at the end of its tick
            turned = theta_deg(flight)[: min(ticks + 1, scenario.ticks)]
            figures[:, run] = *seen, turned.max(initial=0.0)
            advance(run + 1)
    kinds = np.arange(runs) % len(KINDS)
    return [Flown(name, *figures[:, kinds == i]) for i, name in enumerate(KINDS)]
