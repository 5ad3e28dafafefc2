# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""JSON: the controller file's content, and the triangles and rules spelt out."""

from __future__ import annotations

import json

from rpo_core.control.controller import FuzzyController, to_document
from rpo_export import parts


def text(controller: FuzzyController) -> str:
    """Return the JSON text of a controller; `controller` in it is the controller file."""
    document = {
        'about': parts.facts(controller),
        'controller': to_document(controller),
        'triangles': {v.name: dict(v.terms) for v in parts.variables(controller)},
        'rules': [rule._asdict() for rule in parts.rules(controller)],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, default=str) + '\n'
