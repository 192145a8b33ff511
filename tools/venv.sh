#!/bin/sh
# Makes a virtual environment with the first Python >= 3.11 on the path.
set -eu
venv=$1
for python in python3 python3.14 python3.13 python3.12 python3.11 python; do
    if command -v "$python" >/dev/null 2>&1 &&
        "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        [ -x "$venv/bin/python" ] && exit 0
        "$python" -m venv "$venv" 2>/dev/null && exit 0
        # Some systems ship Python without ensurepip: their own pip can fill the environment.
        rm -rf "$venv"
        "$python" -m venv --without-pip "$venv"
        if "$python" -m pip --version >/dev/null 2>&1 &&
            "$python" -m pip --python "$venv/bin/python" install -q pip; then
            exit 0
        fi
        echo "kfgen: $python has neither ensurepip nor pip; install python3-venv and run make again" >&2
        exit 2
    fi
done
echo "kfgen: no Python 3.11 or newer on the path" >&2
exit 2
