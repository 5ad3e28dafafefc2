# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.develop import develop
from setuptools.command.install_scripts import install_scripts

scripts = [
    'final_approach = rpo_bringup.commands:final_approach',
    'flight_software = rpo_bringup.commands:flight_software',
    'ping_pong = rpo_bringup.commands:ping_pong',
    'visualizer = rpo_bringup.commands:visualizer',
    'web = rpo_bringup.commands:web',
]
scripts += [
    f'{name} = rpo_core.files.gone:executable' for name in ('monitor', 'node_pages', 'trial')
]

# The packages of 0.1 whose executables are elsewhere now: `ros2 run` says where.
MOVED = {
    'rpo_guidance': ('guidance', 'operator'),
    'rpo_nav': ('navigation',),
    'rpo_safety': ('assurance',),
    'rpo_view': ('foxglove', 'visualizer', 'watch', 'web'),
}
ANSWER = f"""#!{sys.executable}
from rpo_core.files.gone import executable

raise SystemExit(executable())
"""


def install_moved(own: Path) -> None:
    """Let `ros2 run` find the packages of `MOVED` beside `own`, the folder of our executables."""
    for package, names in MOVED.items():
        marker = own.parents[1] / 'share/ament_index/resource_index/packages' / package
        folder = own.parent / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        marker.touch()
        for name in names:
            (folder / name).write_text(ANSWER)
            (folder / name).chmod(0o755)


class Install(install_scripts):
    """`colcon build`."""

    def run(self) -> None:
        """Install our executables, and the answers."""
        super().run()
        install_moved(Path(self.install_dir))


class Develop(develop):
    """`colcon build --symlink-install`."""

    def run(self) -> None:
        """Install our executables, and the answers."""
        super().run()
        install_moved(Path(self.script_dir))


setup(  # setup.cfg says the rest
    entry_points={'console_scripts': scripts},
    cmdclass={'install_scripts': Install, 'develop': Develop},
)
