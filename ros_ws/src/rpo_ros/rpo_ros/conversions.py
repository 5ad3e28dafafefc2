# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Statuses as messages and as bytes; signals have no message object (`rpo_ros.signals`)."""

from __future__ import annotations

from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from rpo_core.wire.cdr import encode_status


def to_status(
    level: bytes, name: str, message: str, values: Iterable[tuple[str, object]]
) -> DiagnosticStatus:
    """Return a DiagnosticStatus; values become texts, as `texts_of` makes them."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id='none',
        values=[KeyValue(key=key, value=text) for key, text in texts_of(values)],
    )


def packed_status(name: str, message: str, values: Iterable[tuple[str, object]]) -> bytes:
    """Return a DiagnosticStatus of level OK as bytes, always the same for the same content."""
    return encode_status(0, name, message, 'none', texts_of(values))


def texts_of(values: Iterable[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
    """Return keys and values as texts, floats by repr so that no digit is lost."""
    return tuple([(k, v if isinstance(v, str) else repr(v)) for k, v in values])
