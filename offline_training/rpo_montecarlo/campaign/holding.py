# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the limit of the hold force allows by itself: runs in which a chaser at rest would keep it.

At rest the thrusters balance the disturbance, whatever the controller: the command of an axis is
the disturbance over (1 + thrust share). The limit is a share of the largest disturbance of the run;
so it is missed where that comes in the hold, on an axis whose thrusters are weak.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpo_core.judge.metrics import hold_tick
from rpo_kernels.arrays import Floats
from rpo_montecarlo.campaign import judging
from rpo_montecarlo.campaign.config import LEVEL, SHARE, Campaign
from rpo_montecarlo.campaign.statistics import Rate, rate
from rpo_montecarlo.campaign.store import Store

DRAWS = (
    'disturbance_amplitude_share',
    'disturbance_phase_rad',
    'disturbance_frequency_share',
    *(f'thrust_share_{axis}' for axis in 'xyz'),
)
_STEP_S = 1.0


def at_rest_n(campaign: Campaign, draws: Mapping[str, Floats]) -> Floats:
    """Return the largest command [N] of an axis (n,) of a chaser that rests at the target.

    draws : `DRAWS` of the runs, (n,) each

    While the hold is judged, once a second; without misaligned thrusters, the mass does not matter.
    """
    scenario = campaign.scenario
    first = (hold_tick(scenario) or 0) * scenario.dt_s
    times = np.append(np.arange(first, scenario.duration_s, _STEP_S), scenario.duration_s)
    share, phase, rate_share = (draws[name][:, None] for name in DRAWS[:3])
    most = np.zeros(len(share))
    for axis, constant in zip('xyz', scenario.disturbance.constant_n, strict=True):
        force = np.full((len(share), len(times)), constant)
        for h in (h for h in scenario.disturbance.harmonics if h.axis == axis):
            angle = h.angular_rate_rad_s * (1.0 + rate_share) * times + h.phase_rad + phase
            force += h.amplitude_n * (np.sin(angle) if h.function == 'sin' else np.cos(angle))
        force *= (1.0 + share) / (1.0 + draws[f'thrust_share_{axis}'][:, None])
        most = np.maximum(most, np.abs(force).max(axis=1))
    return most


def rate_at_rest(store: Store) -> Rate | None:
    """Return how many runs keep the scenario's limit of the hold force at rest, named by it.

    None where the hold force is not judged, and where a chaser at rest needs other forces: away
    from the target, in another world.
    """
    campaign, scenario = store.campaign, store.campaign.scenario
    elsewhere = ('guidance', 'dynamics', 'thrusters')
    moves = scenario.goal is not None or any(scenario.named(name) for name in elsewhere)
    if SHARE not in campaign.config.success or moves:
        return None
    command = at_rest_n(campaign, {name: store.column(name) for name in DRAWS})
    share = campaign.required.get(SHARE, campaign.config.success[SHARE])
    kept = int((command <= share * store.column(LEVEL)).sum())
    return rate(judging.label(SHARE, share), kept, campaign.config.runs)
