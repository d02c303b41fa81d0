#!/bin/sh
# Boot systemd on a copy of this machine's files: boot_systemd.sh SHARED PATH...
#
# It runs in namespaces of its own for mounts, processes and control groups. Whatever it writes goes to
# memory, but for the folder SHARED, which it sees as /mnt. Each PATH is there even if it is on another
# file system than /.
set -e
shared=$1
shift
memory=$shared/memory
mkdir "$memory"
mount -t tmpfs -o size=1g tmpfs "$memory"
root=$memory/root
mkdir "$memory/upper" "$memory/work" "$root"
mount -t overlay -o "lowerdir=/,upperdir=$memory/upper,workdir=$memory/work" overlay "$root"
for path; do
    if [ "$(stat -c %d "$path")" != "$(stat -c %d /)" ]; then
        mkdir -p "$root$path"
        mount --bind -o ro "$path" "$root$path"
    fi
    # The user of the service must reach it.
    while [ "$path" != / ]; do
        chmod o+x "$root$path" 2>/dev/null || true
        path=$(dirname "$path")
    done
done

mount -t proc proc "$root/proc"
mount --bind "$root/proc/sys" "$root/proc/sys"
mount -o remount,bind,ro "$root/proc/sys"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs -o mode=755 tmpfs "$root/run"
mount -t tmpfs -o mode=755 tmpfs "$root/dev"
for node in "null 1 3" "zero 1 5" "full 1 7" "random 1 8" "urandom 1 9" "tty 5 0" "ttyACM0 166 0"; do
    # shellcheck disable=SC2086 # three words
    set -- $node
    mknod -m 666 "$root/dev/$1" c "$2" "$3"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666,mode=620 devpts "$root/dev/pts"
mount -t tmpfs tmpfs "$root/dev/shm"
ln -s pts/ptmx "$root/dev/ptmx"
ln -s /proc/self/fd "$root/dev/fd"
mount --bind "$shared" "$root/mnt"

# Nothing of this machine is started, and its /tmp is not cleared.
rm -rf "$root"/etc/systemd/system/* "$root"/usr/lib/systemd/system/*.target.wants
cat >"$root/etc/systemd/system/test.target" <<end
[Unit]
Requires=basic.target systemd-journald.service
After=basic.target systemd-journald.service
end
mkdir "$root/old"
cd "$root"
pivot_root . old
umount -l /old
exec env -i container=ps4rig PATH=/usr/local/bin:/usr/bin:/usr/sbin:/bin:/sbin \
    /lib/systemd/systemd --system --unit=test.target --log-target=journal --show-status=no
