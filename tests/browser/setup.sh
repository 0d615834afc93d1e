#!/bin/sh
# Installs Debian's chromium, which tests/browser drives, unless it is there. Needs root.
set -eu
command -v chromium > /dev/null && exit 0
apt-get update -qq
DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core
