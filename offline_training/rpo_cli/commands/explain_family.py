# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo explain` of a family: its rules, the reasons of a force, and what is proven of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rpo_core.files.validation import InputError, printable
from rpo_ctrl.family import Family

if TYPE_CHECKING:
    from rich.console import Console

    from rpo_core.control.controller_file import Reason
    from rpo_core.kernels import Vector


def print_controller(console: Console, controller: Family, certify: bool) -> bool:
    """Print the rules of a controller, with `certify` what is proven; return whether it holds."""
    from rpo_cli.display import print_table

    console.print(controller.name, style='bold', end='')
    console.print(f': {printable(controller.description)}')
    for title, headings, rows in controller.tables():
        print_table(headings, rows, title)
    if not certify:
        return True
    claims = controller.claims()
    console.print('\nCertificate', style='bold')
    for claim in claims:
        word, color = ('proven', 'green') if claim.holds else ('not proven', 'yellow')
        console.print(f'{word:10s}', style=color, end='')
        console.print(f' {claim.name}: {claim.statement}', soft_wrap=True)
    return all(claim.holds for claim in claims if claim.needed)


def print_at(
    console: Console, controller: Family, state: Sequence[float], tick: int
) -> tuple[Sequence[Reason], Vector]:
    """Print the reasons of a state at a tick; return them and the force [N]."""
    from rpo_core.control.explain import in_words

    x, y, z, vx, vy, vz = state
    reasons = controller.reasons((x, y, z, vx, vy, vz), tick)
    for axis, (sentence, pairs) in zip('xyz', reasons, strict=True):
        console.print(f'\n{axis}', style='bold', end='')
        said = in_words(controller, sentence, dict(pairs)).sentence
        console.print(f': {said}', soft_wrap=True)
        console.print(', '.join(f'{name} {value:.4g}' for name, value in pairs), soft_wrap=True)
    return reasons, controller.force_n((x, y, z), (vx, vy, vz), tick)


def print_reasons(
    console: Console, controller: Family, state: Sequence[float], at_s: float
) -> None:
    """Print the reasons of a state at a time since the start of the run; raises InputError."""
    if controller.clock_s is None:
        if at_s:
            raise InputError(f'`--at` needs a run: controller {controller.name} has no clock')
        print_at(console, controller, state, 0)
        return
    if not 0.0 <= at_s <= 1e6:
        raise InputError(f'`--at` must be from 0 s to 1e6 s; got {at_s:g}')
    tick = round(at_s / controller.clock_s)
    console.print(f'tick {tick}, {tick * controller.clock_s:g} s since the start')
    print_at(console, controller, state, tick)
