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


@contextmanager
def cluster(workers, folder):
    """Start a scheduler and workers as processes; yield its address and all of them."""
    local = ['--host', '127.0.0.1']
    scheduler = _start('dask_scheduler', *local, '--port', '0', '--no-dashboard')
    processes = [scheduler]
    try:
        address = next(
            found.group()
            for line in scheduler.stderr
            if (found := re.search(r'tcp://127.0.0.1:\d+', line))
        )
        _drain(scheduler)
        for _ in range(workers):
            worker = _start(
                *('dask_worker', address, *local, '--nthreads', '1', '--no-nanny'),
                *('--no-dashboard', '--local-directory', str(folder)),
            )
            processes.append(worker)
            _drain(worker)
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()
