#!/usr/bin/env bash
# Tests with real V4L2 devices: prepares the virtual machine, renders what is shown to it, and runs pytest inside.
# Arguments go to pytest.
set -euo pipefail
cd "$(dirname "$0")/../.."
tests/guest/setup.sh
export SYNCWATCH_GUEST=1
.venv/bin/python -m compileall -q pipeline sources sinks syncwatch tests .venv/lib > /dev/null || true
.venv/bin/python -m tests.guest.render build/guest/results/rig.npz
[ $# -gt 0 ] || set -- tests/guest
tests/guest/boot.sh .venv/bin/python -m pytest -p no:cacheprovider -p no:xdist --timeout 180 --durations 5 "$@"
