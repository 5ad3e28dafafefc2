# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A log for other tools: CSV, NumPy, Parquet; one row a tick, units in the column names."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_log import topics
from rpo_log.errors import Kind, LogError
from rpo_log.run import cannot_write
from rpo_log.stream import RunReader

STATE_COLUMNS = ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s')
FORCE_COLUMNS = ('fx_n', 'fy_n', 'fz_n')
DISTURBANCE_COLUMNS = ('dx_n', 'dy_n', 'dz_n')
APPLIED_COLUMNS = tuple(f'applied_{column}' for column in FORCE_COLUMNS)
APPLIED_DISTURBANCE_COLUMNS = tuple(f'applied_{column}' for column in DISTURBANCE_COLUMNS)
NAVIGATION_COLUMNS = tuple(f'navigation_{column}' for column in STATE_COLUMNS)

Table = dict[str, NDArray[np.generic]]
"""Column name to values: tick, time_s, stamp_ns, then states, forces and disturbances."""


def tables(reader: RunReader) -> Iterator[Table]:
    """Yield the log as tables of some thousand ticks; NaN where a message lacks."""
    roles = [topic.role for topic in reader.topics]
    optional = {
        topics.DISTURBANCE: (DISTURBANCE_COLUMNS, 'disturbances_n'),
        topics.NAVIGATION: (NAVIGATION_COLUMNS, 'navigation'),
        topics.APPLIED: (APPLIED_COLUMNS, 'applied_n'),
        topics.APPLIED_DISTURBANCE: (APPLIED_DISTURBANCE_COLUMNS, 'applied_disturbances_n'),
    }
    base = reader.base
    for block in reader.blocks():
        if not len(block.ticks):
            continue
        table: Table = {
            'tick': block.ticks,
            'time_s': block.ticks * base.dt_ns / 1_000_000_000,
            'stamp_ns': base.epoch_ns + block.ticks * base.dt_ns,
        }
        table.update(zip(STATE_COLUMNS, block.states.T, strict=True))
        table.update(zip(FORCE_COLUMNS, block.forces_n.T, strict=True))
        for role, (columns, values) in optional.items():
            if role in roles:
                table.update(zip(columns, getattr(block, values).T, strict=True))
        yield table


def _csv(reader: RunReader, output: Path) -> int:
    rows = 0
    with open(output, 'x', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream)
        for table in tables(reader):
            if not rows:
                writer.writerow(table)
            writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
            rows += len(table['tick'])
    return rows


def _npz(reader: RunReader, output: Path) -> int:
    parts = list(tables(reader))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    with open(output, 'xb') as stream:
        np.savez_compressed(stream, **columns)  # type: ignore[arg-type]
    return len(columns['tick'])


def _parquet(reader: RunReader, output: Path) -> int:
    import pyarrow as pa  # type: ignore[import-untyped,import-not-found,unused-ignore]
    import pyarrow.parquet as pq  # type: ignore[import-untyped,import-not-found,unused-ignore]

    rows, writer = 0, None
    with open(output, 'xb') as stream:
        for part in tables(reader):
            table = pa.table(part)
            writer = writer or pq.ParquetWriter(stream, table.schema)
            writer.write_table(table)
            rows += len(table)
        if writer is not None:
            writer.close()
    return rows


FORMATS: dict[str, Callable[[RunReader, Path], int]] = {
    '.csv': _csv,
    '.npz': _npz,
    '.parquet': _parquet,
}
"""By the suffix of the output. CSV writes floats so that they come back bit for bit."""


def export(path: str | Path, output: str | Path) -> int:
    """Write a log as .csv, .npz or .parquet; return the number of rows. Raises LogError.

    Parquet needs pyarrow. An existing file is not overwritten.
    """
    target = Path(output)
    write = FORMATS.get(target.suffix)
    if write is None:
        raise LogError(
            Kind.CANNOT_WRITE,
            target,
            f'must end in one of {", ".join(FORMATS)}; got {target.suffix or "no suffix"}',
        )
    if target.suffix == '.parquet' and importlib.util.find_spec('pyarrow') is None:
        raise LogError(
            Kind.CANNOT_WRITE,
            target,
            'Parquet needs pyarrow, which is not installed; install it, or export to .csv or .npz',
        )
    reader = RunReader(path)
    try:
        return write(reader, target)
    except FileExistsError:
        raise LogError(Kind.EXISTS, target, 'exists already; name another output') from None
    except OSError as error:
        raise cannot_write(target, error) from None
