# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A campaign of a short flight with every dispersion, for the tests."""

import yaml

from rpo.montecarlo import config
from rpo_core.scenario.scenario import dumps

SHORT = """
schema: rpo/scenario/1
name: short
orbit_radius_m: 6678000.0
mass_kg: 10.0
max_force_n: 0.5
dt_s: 0.1
duration_s: 20.0
initial_position_m: [10.0, 60.0, -40.0]
initial_velocity_m_s: [0.0, 0.0, 0.0]
epoch: 2026-01-01T00:00:00Z
disturbance: paper_phase
"""
EVERYTHING = {
    'initial_position_m': {'uniform': [5.0, 4.0, 3.0]},
    'initial_velocity_m_s': {'normal': 0.02},
    'mass_share': {'normal': 0.03},
    'thrust_share': {'normal': 0.02},
    'misalignment_deg': {'normal': 1.0},
    'navigation_position_bias_m': {'normal': 0.02},
    'navigation_velocity_bias_m_s': {'normal': 0.0005},
    'navigation_position_noise_m': {'white': 0.01},
    'navigation_velocity_noise_m_s': {'white': 0.001},
    'delay_ticks': {'whole': 3},
    'disturbance_amplitude_share': {'uniform': 0.5},
    'disturbance_phase_rad': {'uniform': 3.0},
    'disturbance_frequency_share': {'uniform': 0.5},
    'orbit_altitude_m': {'uniform': 100e3},
}


def write_campaign(folder, flown=None, required=None, **changes):
    """Write a campaign, and the scenario it names, into a folder; return its path.

    flown : the scenario, in place of the short one
    required : requirements of the short one
    changes : of the campaign's fields; None: without that field
    """
    scenario = folder / 'short.yaml'
    text = SHORT + (f'requirements: {required}\n' if required else '')
    scenario.write_text(dumps(flown) if flown else text)
    document = {
        'schema': config.SCHEMA,
        'name': 'test',
        'scenario': str(scenario),
        'controller': 'handmade',
        'runs': 90,
        'seed': 3,
        'dispersions': EVERYTHING,
        'success': {'hold_error_per_axis_m': 60.0},
        **changes,
    }
    path = folder / 'c.yaml'
    given = {name: value for name, value in document.items() if value is not None}
    path.write_text(yaml.safe_dump(given))
    return path
