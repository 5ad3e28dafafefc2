# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A dask cluster of real processes, for the tests."""

import re
import subprocess
import sys
import threading
from contextlib import contextmanager


def _start(*arguments):
    return subprocess.Popen(
        [sys.executable, '-m', 'distributed.cli.' + arguments[0], *arguments[1:]],
        stderr=subprocess.PIPE,
        text=True,
    )


def _drain(process):
    threading.Thread(target=process.stderr.read, daemon=True).start()


LOCAL = ('--host', '127.0.0.1', '--no-dashboard', '--dashboard-address', '127.0.0.1:0')
"""Options of docs/campaigns.md; without the last an HTTP port is open to all."""


@contextmanager
def cluster(workers, folder, *tls):
    """Start a scheduler and workers as processes; yield its address and all of them.

    tls : options of dask, for a cluster that encrypts
    """
    protocol = 'tls' if tls else 'tcp'
    scheduler = _start('dask_scheduler', *LOCAL, '--port', '0', '--protocol', protocol, *tls)
    processes = [scheduler]
    try:
        address = next(
            found.group()
            for line in scheduler.stderr
            if (found := re.search(rf'{protocol}://127.0.0.1:\d+', line))
        )
        _drain(scheduler)
        for _ in range(workers):
            worker = _start(
                *('dask_worker', address, *LOCAL, *tls, '--nthreads', '1', '--no-nanny'),
                *('--local-directory', str(folder)),
            )
            processes.append(worker)
            _drain(worker)
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()
