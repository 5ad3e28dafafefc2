# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Work on a `dask.distributed` cluster, with the bits of one machine.

`pool`: tasks on any cluster. `simulator`: a population's members as such tasks. Campaigns use
`pool` themselves.
"""
