# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from rpo_ros.parameter_rows import ParameterRow as Row

VISUALIZER = (
    Row('rate_hz', 10.0, 'how often the scene is published, by wall time', 'Hz',
        least=0.1, most=100.0, wall=True, example='30.0'),
    Row('arrow_m_per_n', 20.0, 'length of the thrust arrow for a force', 'm/N', most=1e4,
        wall=True),
    Row('keep_out_radius_m', 5.0, 'sphere drawn around the target where the scenario has no '
        'zones; 0: none', 'm', most=1e4, wall=True),
    Row('corridor_half_angle_deg', 15.0, 'cone drawn along the axis of approach where the scenario '
        'has no zones; 0: none', 'deg', most=80.0, wall=True),
    Row('trail_points', 1000, 'most points of the trail; a longer trail gets coarser', least=2,
        most=1e5, wall=True),
)  # fmt: skip

WEB = (
    Row('port', 8700, 'port of the page, on 127.0.0.1 only; 0: any free port', most=65535,
        wall=True, example='8701'),
    Row('rate_hz', 15.0, 'how often the page is updated, by wall time', 'Hz',
        least=0.1, most=60.0, wall=True),
)  # fmt: skip

FOXGLOVE = (
    Row('port', 8765, 'port of the server, on 127.0.0.1 only; 0: any free port', most=65535,
        wall=True, example='8766'),
    Row('origin', '', 'a page elsewhere that may connect, beside those of this machine and '
        'app.foxglove.dev, like https://lichtblick.example.org', wall=True),
    Row('rate_hz', 30.0, 'how often the newest messages are passed on, by wall time', 'Hz',
        least=0.1, most=200.0, wall=True),
)  # fmt: skip

WATCH = (
    Row('rate_hz', 8.0, 'how often the view is drawn, by wall time', 'Hz', least=0.1, most=30.0,
        wall=True, example='4.0'),
    Row('line_every_s', 2.0, 'time between lines if the output is no terminal', 's', least=0.1,
        most=3600.0, wall=True),
    Row('until_end', False, 'end with the run, with exit code 1 if it was aborted',
        wall=True),
)  # fmt: skip
