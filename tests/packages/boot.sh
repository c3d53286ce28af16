#!/usr/bin/env bash
# boot.sh ROOT: runs the systemd that is installed in ROOT, as the first process of
# namespaces of its own for processes, mounts, network and cgroups, until that ends.
# It is this process's grandchild; `nsenter --all --target PID` runs commands beside it.
# Wants root and cgroup2.
set -euo pipefail

if [ "$1" != --inside ]; then
  groups=$(mktemp -d)
  mount -t cgroup2 cgroup2 "$groups"
  # The root of the cgroups that it sees.
  group=$groups/palpate-test.$$
  mkdir "$group"
  (echo "$BASHPID" >"$group/cgroup.procs" &&
    exec unshare --cgroup --mount --pid --fork --kill-child --uts --ipc --net \
      "${BASH_SOURCE[0]}" --inside "$1") || true
  find "$group" -depth -type d -exec rmdir {} +
  umount "$groups"
  rmdir "$groups"
  exit
fi

mount --make-rprivate /
mount --bind "$2" "$2"
cd "$2"
mount -t proc proc proc
mount -t sysfs sysfs sys
mount -t cgroup2 cgroup2 sys/fs/cgroup
mount -t tmpfs -o mode=755 tmpfs run
mount -t tmpfs -o mode=755 tmpfs dev
mkdir dev/pts dev/shm
mount -t devpts -o newinstance,ptmxmode=0666 devpts dev/pts
ln -s pts/ptmx dev/ptmx
ln -s /proc/self/fd dev/fd
for device in null zero full random urandom tty; do
  touch "dev/$device"
  mount --bind "/dev/$device" "dev/$device"
done
pivot_root . mnt
umount -l /mnt
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd </dev/null
