# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
#
# Source this in bash or zsh: then `ros2 ...` and `rpo ...` work in this shell.
#   source ros_ws/env.bash
# It lays this workspace over ROS 2 Jazzy (an installed one, or the wheels in .venv) and over
# whatever else the shell already holds. Sourcing it again changes nothing.

_rpo_prepend() {  # VARIABLE DIRECTORY
  eval "_rpo_value=\${$1:-}"
  case ":$_rpo_value:" in
    *":$2:"*) ;;
    *) export "$1=$2${_rpo_value:+:$_rpo_value}" ;;
  esac
}

_rpo_underlay_wheels() {  # VENV
  [ -z "${ZSH_VERSION:-}" ] || emulate -L sh  # globs without a match are no error
  for _rpo_dir in "$1"/lib/python3.*/site-packages/ros_*.libs "$1/lib"; do
    [ ! -d "$_rpo_dir" ] || _rpo_prepend LD_LIBRARY_PATH "$_rpo_dir"
  done
  _rpo_prepend AMENT_PREFIX_PATH "$1"
  # Paths are set: the wheels' start-up hook need not restart every interpreter to set them.
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  export ROS_VERSION=2 ROS_PYTHON_VERSION=3 ROS_DISTRO=jazzy
  case "${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}" in
    rmw_fastrtps_cpp) ;;
    *)
      echo "env.bash: RMW_IMPLEMENTATION=$RMW_IMPLEMENTATION is not among the wheels;" \
        "rmw_fastrtps_cpp is used in this shell." >&2
      export RMW_IMPLEMENTATION=rmw_fastrtps_cpp
      ;;
  esac
}

_rpo_overlay() {  # WORKSPACE
  [ -z "${ZSH_VERSION:-}" ] || emulate -L sh  # globs without a match are no error
  for _rpo_dir in "$1"/install/*/share/*/package.xml; do
    [ -f "$_rpo_dir" ] || continue
    _rpo_name="${_rpo_dir%/package.xml}"
    _rpo_name="${_rpo_name##*/}"
    for _rpo_site in "$1/install/$_rpo_name"/lib/python3.*/site-packages; do
      _rpo_prepend PYTHONPATH "$_rpo_site"
    done
    if [ -d "$1/build/$_rpo_name/$_rpo_name.egg-info" ]; then  # links to the sources
      _rpo_prepend PYTHONPATH "$1/build/$_rpo_name"
    fi
    _rpo_prepend AMENT_PREFIX_PATH "$1/install/$_rpo_name"
  done
}

_rpo_env() {  # WORKSPACE SHELL
  _rpo_root="${1%/ros_ws}"
  if [ ! -r "$_rpo_root/.venv/rpo_ros_prefix" ] || [ ! -r "$1/install/.rpo_build.json" ]; then
    echo "env.bash: this checkout is not set up yet: run \`make setup\` in $_rpo_root first." >&2
    return 1
  fi
  if [ "${ROS_DISTRO:-jazzy}" != jazzy ]; then
    echo "env.bash: ROS 2 $ROS_DISTRO is sourced in this shell, and this project needs jazzy:" \
      "use a shell without it." >&2
    return 1
  fi
  IFS= read -r _rpo_ros < "$_rpo_root/.venv/rpo_ros_prefix"
  case ":${AMENT_PREFIX_PATH:-}:" in
    *":${_rpo_ros:-$_rpo_root/.venv}:"* | *":${_rpo_ros:-none}/"*) ;;  # sourced already
    *)
      if [ -z "$_rpo_ros" ]; then
        _rpo_underlay_wheels "$_rpo_root/.venv"
      else
        . "$_rpo_ros/setup.$2"
      fi
      ;;
  esac
  _rpo_overlay "$1"
  _rpo_prepend PATH "$_rpo_root/.venv/bin"
  case ":$PATH:" in  # last: a real `ros2` anywhere on the PATH goes first
    *":$1/underlay/bin:"*) ;;
    *) export PATH="$PATH:$1/underlay/bin" ;;
  esac
  # Other people's robots stay out unless the user says otherwise.
  export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
}

if [ -n "${ZSH_VERSION:-}" ]; then
  eval '_rpo_self="${(%):-%x}"'
  _rpo_env "${_rpo_self:A:h}" zsh && _rpo_status=0 || _rpo_status=$?
else
  _rpo_env "$(CDPATH= cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd -P)" bash \
    && _rpo_status=0 || _rpo_status=$?
fi
unset -f _rpo_prepend _rpo_underlay_wheels _rpo_overlay _rpo_env
unset _rpo_value _rpo_dir _rpo_name _rpo_site _rpo_root _rpo_ros _rpo_self
if [ "$_rpo_status" -eq 0 ]; then
  unset _rpo_status
else
  unset _rpo_status
  return 1
fi
