#!/usr/bin/env bash
# make.sh VENV: build tf2_msgs and control_msgs into a virtual environment that has the wheels of ROS 2.
# Needs cmake and a C++ compiler.
set -euo pipefail
venv=$(realpath "$1")
cd "$(dirname "$0")"
export PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv
for name in tf2_msgs control_msgs; do
  build=$venv/build/$name
  cmake -S "$name" -B "$build" -Wno-dev -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$venv" \
    -DCMAKE_INSTALL_PREFIX="$venv" -DPython3_EXECUTABLE="$venv/bin/python"
  cmake --build "$build" -j2
  cmake --install "$build"
done
