#!/usr/bin/env bash
# What tests/hil boots: QEMU, a static busybox, and Debian's kernel, which is unpacked, not installed.
# Does nothing where all of it is there. Needs root on a Debian for amd64.
set -euo pipefail

kernel=${PS4RIG_HIL_KERNEL:-${XDG_CACHE_HOME:-${HOME:-$(echo ~)}/.cache}/ps4rig/hil-kernel}
packages=()
command -v qemu-system-x86_64 >/dev/null || packages+=(qemu-system-x86)
dpkg-query --show --showformat='${db:Status-Status}' busybox-static 2>/dev/null | grep -qx installed ||
    packages+=(busybox-static)
have_kernel=$(find "$kernel" -name 'vmlinuz-*' 2>/dev/null || true)
if [ ${#packages[@]} -eq 0 ] && [ -n "$have_kernel" ]; then
    exit 0
fi

apt-get update -qq
if [ ${#packages[@]} -gt 0 ]; then
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
        "${packages[@]}" >/dev/null
fi
if [ -z "$have_kernel" ]; then
    # The meta package names the kernel of the day.
    image=$(apt-cache depends linux-image-amd64 | sed -n 's/^ *Depends: *//p' | head -n 1)
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    # apt fetches as a user of its own, who may not write here, and warns of it.
    (cd "$work" && apt-get download -qq -o APT::Sandbox::User=root "$image")
    dpkg-deb -x "$work"/*.deb "$work/tree"
    mkdir -p "$(dirname "$kernel")"
    rm -rf "$kernel"
    # Moved when it is whole, so that a broken-off run leaves no half kernel.
    mv "$work/tree" "$kernel"
fi
