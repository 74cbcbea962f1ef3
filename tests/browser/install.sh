#!/usr/bin/env bash
# Installs what the test of the report page needs on Debian: chromium and its WebDriver. Needs root;
# does nothing when both are there.
set -euo pipefail
if command -v chromium > /dev/null && command -v chromedriver > /dev/null; then
    exit 0
fi
if [ "$(id -u)" -ne 0 ]; then
    echo "chromium or chromedriver is missing, and only root can install them" >&2
    exit 1
fi
# Another installation may be under way: wait for its lock.
apt-get -o DPkg::Lock::Timeout=600 update
DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600 install --yes --no-install-recommends \
    chromium chromium-driver fonts-dejavu-core
