#!/bin/sh
# Install the system libraries Qt needs, where we may; name those that are missing where we may not.
set -u
missing=""
for library in "$@"; do
    dpkg -s "$library" >/dev/null 2>&1 || missing="$missing $library"
done
[ -z "$missing" ] && exit 0
if ! command -v dpkg >/dev/null 2>&1; then
    echo "not a Debian system: the window needs the equivalents of$missing" >&2
elif [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $missing
else
    echo "the window needs system libraries that are missing:$missing (apt-get install$missing)" >&2
fi
