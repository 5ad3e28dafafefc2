# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A log for other tools: CSV, NumPy, CCSDS OEM; one row a tick, units in the names."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rpo_core.files import gone
from rpo_core.wire import interfaces
from rpo_log.bag import open_run
from rpo_log.errors import LogError, cannot_write, exists
from rpo_log.read.run_log import RunLog, read_run, scenario_of
from rpo_log.topics import Topic

_COLUMNS = {
    interfaces.STATE_TYPE: ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'),
    interfaces.FORCE_TYPE: ('fx_n', 'fy_n', 'fz_n'),
}
_COVARIANCES = tuple(
    f'{letter}{row}_{letter}{column}_{unit}'
    for letter, unit in (('', 'm2'), ('v', 'm2_s2'))
    for row in 'xyz'
    for column in 'xyz'
)
_TURNING = ('qx', 'qy', 'qz', 'qw', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s')
_PUSHES = ('dx_n', 'dy_n', 'dz_n')
_PRIMARY = (interfaces.RELATIVE_STATE, interfaces.CONTROL_FORCE, interfaces.DISTURBANCE_FORCE)

Table = dict[str, NDArray[np.generic]]
"""Column name to values: tick, time_s, stamp_ns, then those of each topic."""


def table(log: RunLog) -> Table:
    """Return the log as a table; NaN where a message is missing."""
    columns_by_name: Table = {
        'tick': log.ticks,
        'time_s': log.times_s,
        'stamp_ns': log.base.epoch_ns + log.ticks * log.base.dt_ns,
    }
    for topic in _with_riders(log):
        if topic.row.columns:
            columns_by_name.update(zip(columns(topic), log.values[topic.signal].T, strict=True))
    return columns_by_name


def _with_riders(log: RunLog) -> Iterator[Topic]:
    """Yield the topics, and what rides in them: covariances, attitudes, torques.

    As far as the scenario has them, or a message says one that is not at rest.
    """
    rows = (row for row in map(interfaces.row_of, log.values) if row.rides)
    values = {row: log.values[row.name] for row in rows}
    told = {row.name for row, v in values.items() if (np.isfinite(v) & (v != row.rest)).any()}
    with suppress(LogError):  # a bag may lack it
        scenario = scenario_of(log)
        if scenario.thrusters is not None and scenario.thrusters.table is not None:
            told.add(interfaces.EXERTED_TORQUE)
        if scenario.attitude is not None:
            told |= {interfaces.CHASER_ATTITUDE, interfaces.BODY_TORQUE, interfaces.APPLIED_TORQUE}
    for topic in log.topics:
        yield topic
        if topic.row.rider in told:
            yield Topic(topic.name, interfaces.row_of(topic.row.rider))


def columns(topic: Topic) -> list[str]:
    """Return the names of a topic's columns: quantity and unit, after the first word of its name.

    The state, the command and the disturbance have no such word before them.
    """
    if topic.row.attitude:
        return [f'{topic.signal}_{name}' for name in _TURNING]
    if topic.signal == interfaces.NAVIGATION_COVARIANCE:
        return [f'navigation_{name}' for name in _COVARIANCES]
    if topic.signal == interfaces.ATTITUDE_COVARIANCE:
        return [f'attitude_{row}_{column}_rad2' for row in 'xyz' for column in 'xyz']
    if topic.row.rides:
        return [f'{topic.signal.partition("_")[0]}_t{axis}_nm' for axis in 'xyz']
    if topic.row.covariance:
        return [f'{topic.signal}_{name}' for name in (*_COLUMNS[topic.type], *_COVARIANCES)]
    pushes = topic.row.carries == interfaces.DISTURBANCE
    prefix = '' if topic.signal in _PRIMARY else topic.signal.partition('_')[0] + '_'
    return [prefix + name for name in (_PUSHES if pushes else _COLUMNS[topic.type])]


def _csv(log: RunLog, stream: IO[bytes]) -> int:
    text = io.TextIOWrapper(stream, encoding='utf-8', newline='', write_through=True)
    writer, rows = csv.writer(text), table(log)
    writer.writerow(rows)
    writer.writerows(zip(*(column.tolist() for column in rows.values()), strict=True))
    text.detach()
    return len(log.ticks)


def _npz(log: RunLog, stream: IO[bytes]) -> int:
    np.savez_compressed(stream, **table(log))  # type: ignore[arg-type]
    return len(log.ticks)


OEM_FRAME = 'RSW_ROTATING'
"""Name of `target_lvlh` in the registry of CCSDS; its other names are in docs/theory.md."""


def _oem(log: RunLog, stream: IO[bytes]) -> int:
    import ccsds_ndm as ndm  # type: ignore[import-untyped,import-not-found,unused-ignore]

    there = np.isfinite(log.states).all(axis=1)
    epochs = [_utc(log.base.stamp_ns(tick)) for tick in log.ticks[there].tolist()]
    rows = zip(epochs, (log.states[there] / 1000.0).tolist(), strict=True)
    states = [ndm.StateVectorAcc(epoch, *row) for epoch, row in rows]
    if not states:
        raise LogError(log.path, 'holds no state')
    metadata = ndm.OemMetadata(
        object_name='CHASER', object_id='CHASER', center_name='TARGET', ref_frame=OEM_FRAME,
        time_system='UTC', start_time=states[0].epoch, stop_time=states[-1].epoch,
        comment=['relative to the target; velocity as seen in the turning frame'],
    )  # fmt: skip
    header = ndm.OdmHeader(creation_date=_utc(time.time_ns()), originator='RPO')
    message = ndm.Oem(header, [ndm.OemSegment(metadata, ndm.OemData(state_vectors=states))])
    message.validate()
    stream.write(message.to_str('kvn').encode('ascii'))
    return len(states)


def _utc(stamp_ns: int) -> str:
    """Return a stamp as CCSDS writes it, to the nanosecond."""
    second, ns = divmod(stamp_ns, 1_000_000_000)
    return f'{time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(second))}.{ns:09d}'


FORMATS: dict[str, Callable[[RunLog, IO[bytes]], int]] = {
    '.csv': _csv,
    '.npz': _npz,
    '.oem': _oem,
}
"""By the suffix of the output. CSV writes floats so that they come back bit for bit."""


def export(path: str | Path, output: str | Path) -> int:
    """Write a log as .csv, .npz or .oem; return the number of rows. Raises LogError.

    OEM needs ccsds-ndm-py, ModuleNotFoundError without it. An existing file is not overwritten.
    """
    target = Path(output)
    if target.suffix not in FORMATS:
        suffix = gone.answer('suffix', target.suffix) or target.suffix or 'no suffix'
        raise LogError(target, f'must end in one of {", ".join(FORMATS)}; got {suffix}')
    log = read_run(open_run(path))
    try:
        with open(target, 'xb') as stream:
            return FORMATS[target.suffix](log, stream)
    except FileExistsError:
        raise exists(target, 'name another output') from None
    except BaseException as error:
        with suppress(OSError):
            target.unlink()  # what is there is not whole
        if isinstance(error, OSError):
            raise cannot_write(target, error) from None
        raise
