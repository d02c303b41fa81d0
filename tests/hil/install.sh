#!/usr/bin/env bash
# What tests/hil boots: QEMU, a static busybox, Debian's kernel, and the module v4l2loopback for it.
# Kernel and module are unpacked and built in a folder of their own; nothing of them is installed.
# Does nothing where all of it is there. For Debian on amd64; packages are installed as root.
set -euo pipefail

kernel=${PS4RIG_HIL_KERNEL:-${XDG_CACHE_HOME:-${HOME:-$(echo ~)}/.cache}/ps4rig/hil-kernel}
packages=()
command -v qemu-system-x86_64 >/dev/null || packages+=(qemu-system-x86)
dpkg-query --show --showformat='${db:Status-Status}' busybox-static 2>/dev/null | grep -qx installed ||
    packages+=(busybox-static)
have_kernel=$(find "$kernel" -name v4l2loopback.ko 2>/dev/null || true)
if [ -z "$have_kernel" ]; then
    command -v make >/dev/null || packages+=(make)
    command -v gcc >/dev/null || packages+=(gcc)
    # Of the tool that checks the module's object code.
    ldconfig -p | grep -q 'libelf\.so\.1' || packages+=(libelf1)
elif [ ${#packages[@]} -eq 0 ]; then
    exit 0
fi

as_root=()
[ "$(id -u)" = 0 ] || as_root=(sudo)
"${as_root[@]}" apt-get update -qq
if [ ${#packages[@]} -gt 0 ]; then
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "${packages[@]}" >/dev/null
fi
[ -z "$have_kernel" ] || exit 0

depends_of() { apt-cache depends "$1" | sed -n 's/^ *Depends: *\(linux-[^ ]*\)$/\1/p'; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
# The meta package names the kernel of the day.
image=$(depends_of linux-image-amd64 | head -n 1)
version=${image#linux-image-}
headers=linux-headers-$version
mapfile -t build < <(depends_of "$headers" | grep -e '-common$' -e '^linux-kbuild-')
# apt fetches as a user of its own, who may not write here, and warns of it.
apt-get download -qq -o APT::Sandbox::User=root "$image" "$headers" "${build[@]}" v4l2loopback-dkms
for package in linux-image-*.deb; do dpkg-deb -x "$package" tree; done
for package in linux-headers-*.deb linux-kbuild-*.deb v4l2loopback-*.deb; do
    dpkg-deb -x "$package" build
done
# It names its other half by the place where it would be installed.
sed -i "s|/usr/src|$work/build/usr/src|" "build/usr/src/$headers/Makefile"
source=$(echo build/usr/src/v4l2loopback-*)
make -s -C "build/usr/src/$headers" M="$work/$source" CC=gcc modules >make.log 2>&1 ||
    { cat make.log >&2; exit 1; }
modules=$(find tree -type d -path "*/lib/modules/$version")
cp "$source/v4l2loopback.ko" "$modules/kernel/"
mkdir -p "$(dirname "$kernel")"
rm -rf "$kernel"
# Moved when it is whole, so that a broken-off run leaves no half kernel.
mv tree "$kernel"
