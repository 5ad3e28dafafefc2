# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Offline training, campaigns and reports of the final-approach controller: the command `rpo`.

Rooms, from what they stand on to what they show: `engine` flies many flights side by side; `search`
and `baselines` look for controllers, `cluster` with the help of others; `evaluation`, `campaign`,
`analysis` and `truth` judge them; `report`, `export` and `bench` show them; `commands` are what a
user types. `gym` is the environment for learning controllers. None of it is in a flight.
"""

__version__ = '0.1.0'
