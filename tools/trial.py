# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`trial`: measure the running nodes, and print a table."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

from rpo_core.files.validation import InputError
from rpo_mcap.errors import LogError
from rpo_ros.entry_point import stop_signals
from tools.node_processes import NodeProcessError
from tools.trials import fuzz, links, soak

EXIT_FAILED, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 1, 2, 130

_EXAMPLE = """examples:
  ros2 run rpo_bringup trial latency --rates 10 50 100
  ros2 run rpo_bringup trial losses --rates 0 0.2 0.5
  ros2 run rpo_bringup trial soak --ticks 20000
  ros2 run rpo_bringup trial fuzz --cases 2000
"""


def _above(least: float, most: float) -> type[float]:
    def number(text: str) -> float:
        value = float(text)
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f'must be {least:g} to {most:g}; got {text}')
        return value

    return number  # type: ignore[return-value]


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='trial',
        description='Measure the running nodes, and print a table.',
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    trials = parser.add_subparsers(dest='trial', required=True)
    one = trials.add_parser('latency', help='latency and jitter of the loop in free running')
    one.add_argument(
        '--rates', nargs='+', type=_above(0.1, 1000.0), default=list(links.RATES_HZ), metavar='HZ'
    )
    one.add_argument(
        '--seconds', type=_above(1.0, 3600.0), default=30.0, help='real time of each rate [s] (30)'
    )
    one = trials.add_parser('losses', help="the paper's test in free running with faulty links")
    one.add_argument(
        '--rates', nargs='+', type=_above(0.0, 1.0), default=[0.0, 0.2, 0.4, 0.6, 0.8],
        metavar='SHARE', help='share of the messages for each fault, in both directions',
    )  # fmt: skip
    one.add_argument('--kinds', nargs='+', choices=links.KINDS, default=list(links.KINDS))
    one.add_argument('--factor', type=_above(0.1, 100.0), default=20.0, help='times real time (20)')
    one.add_argument('--seed', type=int, default=1)
    one.add_argument('--stale-after-ticks', type=int, default=10)
    one = trials.add_parser('soak', help='memory, open files and speed over a million ticks')
    one.add_argument('--ticks', type=int, default=1_000_000, help='ticks of the run (1000000)')
    one.add_argument(
        '--every', type=_above(1.0, 600.0), default=20.0, help='time between samples [s] (20)'
    )
    one = trials.add_parser('fuzz', help='hostile messages, calls and parameters in flight')
    one.add_argument('--cases', type=int, default=100_000, help='how many to send (100000)')
    one.add_argument('--first', type=int, default=0, help='number of the first case (0)')
    one.add_argument('--seed', type=int, default=1)
    one.add_argument('--nodes', nargs='+', choices=fuzz.NODES, default=list(fuzz.NODES))
    one.add_argument('--minutes', type=_above(0.1, 1e4), default=1e4, help='end after so long')
    one.add_argument('--keep', default='', metavar='FOLDER', help='keep logs and outputs there')
    return parser.parse_args(argv)


def main() -> int:
    """Entry point of `ros2 run rpo_bringup trial`."""
    options = _arguments(sys.argv[1:])
    for number in stop_signals():
        signal.signal(number, signal.default_int_handler)  # no node is left behind
    try:
        if options.trial == 'latency':
            links.run_latency(options.rates, options.seconds)
        elif options.trial == 'losses':
            stale = options.stale_after_ticks
            links.run_losses(options.rates, options.kinds, options.factor, options.seed, stale)
        elif options.trial == 'fuzz':
            return fuzz.run(fuzz.Plan(**{k: v for k, v in vars(options).items() if k != 'trial'}))
        else:
            return soak.run(options.ticks, options.every)
    except (NodeProcessError, InputError, LogError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT if isinstance(error, InputError) else EXIT_FAILED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    return 0


if __name__ == '__main__':
    sys.exit(main())
