# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What version 0.2 no longer has, and what to use instead: one table, and one sentence."""

from __future__ import annotations

import sys
from pathlib import Path

GONE: dict[str, dict[str, str]] = {
    'command': {
        'keygen': '`openssl genpkey -algorithm ed25519`',
        'safety peers': '`rpo simulate` with a scenario of your own',
        'watch': '`ros2 run rpo_bringup web` for a flight that runs, `rpo report` of a log',
        'tune': '`rpo train lqr`, or another kind of baseline: pd, mpc, apf_smc',
    },
    'option': {
        'report --video': '`replay.html` of the report',
        'simulate --sweep': '`rpo campaign` with the field dispersed, and `rpo report` of it',
        **dict.fromkeys(
            ('simulate --csv', 'campaign --csv', 'optimal --csv'),
            '`rpo simulate SCENARIO --output RUN`, then `rpo log export RUN flight.csv`',
        ),
        **dict.fromkeys(
            ('simulate --scenario', 'optimal --scenario', 'truth --scenario'),
            'its name or file alone',
        ),
        'explain --controller': 'its name or file alone',
        'optimal --all-starts': '`rpo optimal paper_training`, or another set of starts',
        'optimal --margin': '`rpo.analysis.optimal.constrained` with `Conditions`',
        **dict.fromkeys(
            ('evaluate --starts', 'evaluate --csv'), '`rpo report CONTROLLER`, which draws them'
        ),
        'evaluate --output': 'the tables of `rpo evaluate --robustness`',
        **dict.fromkeys(
            ('export --scenario', 'export --assurance'),
            '`rpo export SCENARIO --to c --controller NAME`',
        ),
        'safety thrusters --c': '`rpo export SCENARIO --to c --stages thrusters`',
        'truth --plot': 'the tables of `rpo truth`',
        **dict.fromkeys(
            ('plan --margins', 'plan --sample'),
            '`rpo plan` for legs and energy, `rpo optimal` for the least energy of a start',
        ),
        **{f'{name} --cluster': f'`rpo {name} --workers`' for name in ('prove', 'train')},
        'repair --in-place': '`rpo repair RUN --output FOLDER`',
        'evaluate --sensitivity': (
            '`rpo evaluate --robustness`, or `rpo report` of a campaign for what misses depend on'
        ),
    },
    'parameter': {
        'decision_rate_hz': '`rpo explain RUN --at`',
        **dict.fromkeys(
            ('keep_out_radius_m', 'corridor_half_angle_deg'), 'section `zones` of the scenario'
        ),
        'trail_points': '1000 points, which it was by default',
        'arrow_m_per_n': '20 m/N, which it was by default',
        **dict.fromkeys(
            ('loop', 'start_s', 'end_s', 'paused'), '`ros2 bag play` of the run folder'
        ),
    },
    'executable': {
        'foxglove': 'foxglove_bridge, or open `run.mcap` in the app',
        'monitor': 'the abort table of section `assurance`',
        'repair': '`rpo repair`',
        'node_pages': '`python docs/hooks/node_pages.py docs/nodes`',
        'watch': '`ros2 run rpo_bringup web`',
        'trial': 'the latency, jitter and counts in `run_status` and on `/diagnostics`',
    },
    'suffix': {'.parquet': '`.csv` or `.npz`'},
    'controller': {
        **dict.fromkeys(('everywhere', 'robust', 'trained', 'world'), '`allround`'),
        'pace': '`more_words`',
        'pd_disturbed': '`pd`',
    },
    'scenario': {'paper_test_held': '`paper_test_measured`'},
    'campaign': {'paper_test_held': '`paper_test_measured`'},
    'preset': dict.fromkeys(('everywhere', 'world'), '`allround`'),
    'family': {'pace': '`more_words`'},
    'kind': {'pace': '`more_words`'},
    'field': {
        **dict.fromkeys(
            (
                'shaping.hold_share',
                'shaping.hold_within_m',
                'shaping.hold_from_s',
                'shaping.hold_learns',
            ),
            '`shaping.slew_n_s` alone',
        ),
        'fitness.arrival': 'the mean error, which always counts',
        'fitness.disturbance': '`fitness.tests`',
        'fitness.drawn.at_limit': '0.1, which it was by default',
        **dict.fromkeys(
            ('fitness.drawn.openings', 'fitness.drawn.propellant'),
            'a limit on `valve_openings` or `propellant_kg` in `success` of the campaign',
        ),
    },
    '--to': {'python': '`rpo_core.control.controller.load_controller` in Python, or `--to c`'},
    'schema': {'rpo/monitor/1': 'the abort table of section `assurance`'},
}
"""Subject -> name -> what to use.

The name of a command is the words after `rpo`; that of an option begins with its command
(`evaluate --sensitivity`); that of a field has its section (`shaping.hold_learns`). Another subject
is the name of a field whose value is gone (`preset`).
"""

MOVED = {
    **dict.fromkeys(('rpo_guidance', 'rpo_nav', 'rpo_safety', 'rpo_sim'), 'rpo_ctrl'),
    'rpo_view': 'rpo_bringup',
}
"""Package of 0.1 -> that of its executables now; of `rpo_sim`, that of `navigation`."""

_READ = ('field', 'kind', 'schema')
"""Subjects that stand in files."""


def answer(subject: str, name: object) -> str:
    """Return 'gone in 0.2; use ...' of a name, '' if the table has it not."""
    instead = GONE.get(subject, {}).get(name) if isinstance(name, str) else None
    if instead is None:
        return ''
    last = ', and 0.1 is the last version that reads it' if subject in _READ else ''
    return f'gone in 0.2{last}; use {instead}'


def executable() -> int:
    """Answer `ros2 run PACKAGE NAME` where the executable is gone or has moved."""
    package, name = Path(sys.argv[0]).absolute().parts[-2:]
    said = answer('executable', name) or f'now `ros2 run {MOVED[package]} {name}`'
    print(f'`{package} {name}` is {said}', file=sys.stderr)
    return 2
