#!/usr/bin/env bash
# make.sh VENV: build tf2_msgs and control_msgs into a virtual environment that has the wheels of ROS 2.
# Needs cmake and a C++ compiler. Only what is spoken: the C type supports of Fast DDS, and Python.
set -euo pipefail
venv=$(realpath "$1")
cd "$(dirname "$0")"
export PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv
export STATIC_ROSIDL_TYPESUPPORT_C=rosidl_typesupport_fastrtps_c
export STATIC_ROSIDL_TYPESUPPORT_CPP=rosidl_typesupport_fastrtps_cpp
for name in tf2_msgs control_msgs; do
  build=$venv/build/$name
  cmake -S "$name" -B "$build" -Wno-dev -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH="$venv" \
    -DCMAKE_INSTALL_PREFIX="$venv" -DPython3_EXECUTABLE="$venv/bin/python"
  cmake --build "$build" -j2
  cmake --install "$build"
done
