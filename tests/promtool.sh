#!/bin/sh
# Lets promtool check the alert rules; unless it is there, it is taken out of Debian's package prometheus, into build/.
set -eu
folder=build/promtool
if ! command -v promtool > /dev/null && ! [ -x "$folder/usr/bin/promtool" ]; then
    mkdir -p "$folder"
    (cd "$folder" && { apt-get download -qq prometheus 2> /dev/null || { apt-get update -qq && apt-get download -qq prometheus; }; })
    dpkg-deb -x "$folder"/prometheus_*.deb "$folder"
fi
PATH="$PWD/$folder/usr/bin:$PATH" exec .venv/bin/pytest tests/sinks/test_prometheus.py -k "promtool or alerts" "$@"
