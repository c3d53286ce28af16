#!/usr/bin/env bash
# install.sh FOLDER: installs FOLDER's packages in a Debian root of its own, runs
# palpated there without systemd and with it, and palpate-web with it; upgrades, removes and purges
# them. As root;
# some minutes and 2 GB, of which nothing stays. Part of tests/packages_test.sh.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
packages=$1
work=$(mktemp -d)
jail=$work/root
config=$jail/etc/palpate/palpated.toml
boot='' # process id of boot.sh, while it runs
init='' # and of the systemd in it
fail() { echo "FAIL  $*" >&2; exit 1; }
ok() { echo "ok    $*"; }

shut_down() {
  [ -z "$init" ] || kill -KILL "$init" 2>/dev/null || true
  [ -z "$boot" ] || wait "$boot" || true
  boot=''
  init=''
}
clean_up() {
  shut_down
  umount "$jail/proc" 2>/dev/null || true
  # Never through a mount that is still there.
  grep -q " $jail" /proc/mounts || rm -rf "$work"
}
trap clean_up EXIT

in_jail() {
  local enter=(chroot "$jail")
  [ -z "$init" ] || enter=(nsenter --all --target "$init")
  "${enter[@]}" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
    DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 "$@"
}
apt_in_jail() {
  in_jail apt-get -q -y --no-install-recommends -o Dpkg::Options::=--force-confdef \
    -o Dpkg::Options::=--force-confold "$@" >"$work/apt.log" 2>&1 ||
    { tail -n 30 "$work/apt.log" >&2; fail "apt-get $*"; }
}
# What is done by apt and checked is the same with systemd in the root and without.
with_systemd() { [ -n "$init" ]; }

# The mirror, keys and proxies are this machine's: none of them is in this tree.
make_jail() {
  local mirror
  # No exit at the first: with pipefail, the end of cat would be the end of this script.
  mirror=$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*.{list,sources} 2>/dev/null | awk '
    /^URIs:/ {if (!found++) print $2}
    /^deb / {for (n = 2; n <= NF; ++n) if ($n ~ /:\/\// && !found++) print $n}') || true
  [ -n "$mirror" ] || fail "apt names no mirror"
  debootstrap --variant=minbase bookworm "$jail" "$mirror" >"$work/debootstrap.log" 2>&1 ||
    { tail -n 20 "$work/debootstrap.log" >&2; fail "debootstrap"; }
  cp -L /etc/resolv.conf /etc/hosts "$jail/etc/"
  rm -f "$jail/etc/apt/sources.list"
  cp -a /etc/apt/. "$jail/etc/apt/"
  mount -t proc proc "$jail/proc"
  apt_in_jail update
  ok "a Debian root of $(du -sm --one-file-system "$jail" | cut -f1) MB"
}

install_all() {
  local files
  mkdir "$jail/opt/test"
  cp -r "$packages"/*.deb "$here"/*.py "$here"/clients.sh "$here/../../client/sdk/example" "$jail/opt/test/"
  files=$(cd "$jail" && printf '/%s\n' opt/test/*.deb)
  # shellcheck disable=SC2086
  apt_in_jail install $files
  ok "installed, $(du -sm --one-file-system "$jail" | cut -f1) MB in all"
  # Mesa draws where there is no graphics card; a compiler for the library; the rest for
  # certificates and addresses.
  apt_in_jail install libgl1-mesa-dri cmake g++ make openssl iproute2
}

# Whether it boots: some machines (containers) do not let it.
boot_systemd() {
  umount "$jail/proc"
  "$here/boot.sh" "$jail" >"$work/boot.log" 2>&1 &
  boot=$!
  for _ in $(seq 120); do
    sleep 0.5
    kill -0 "$boot" 2>/dev/null || break
    init=$(pgrep -P "$(pgrep -P "$boot" -f unshare)" 2>/dev/null) || continue
    case "$(in_jail systemctl is-system-running 2>/dev/null)" in
      running | degraded) return 0 ;;
    esac
  done
  tail -n 5 "$work/boot.log" >&2
  shut_down
  mount -t proc proc "$jail/proc"
  return 1
}

# next_version PACKAGE PROGRAM: whose configuration differs from this one's
next_version() {
  local folder=$work/next-$2
  dpkg-deb -R "$packages"/"$1"_*.deb "$folder"
  sed -i 's/^Version: .*/&+next1/' "$folder/DEBIAN/control"
  echo '# Of the next version.' >>"$folder/etc/palpate/$2.toml"
  (cd "$folder" && find etc lib usr -type f -exec md5sum {} + >DEBIAN/md5sums)
  dpkg-deb --root-owner-group -b "$folder" "$jail/opt/test/next-$2.deb" >/dev/null
}

main_pid() { in_jail systemctl show --value --property MainPID "$1"; }

# check_upgrade PACKAGE PROGRAM
check_upgrade() {
  local config=$jail/etc/palpate/$2.toml before='' after
  next_version "$1" "$2"
  echo '# Edited here.' >>"$config"
  cp "$config" "$work/edited.toml"
  if with_systemd; then before=$(main_pid "$2"); fi
  apt_in_jail install "/opt/test/next-$2.deb"
  cmp "$config" "$work/edited.toml" || fail "an upgrade changes the configuration"
  [ -e "$config.dpkg-dist" ] || fail "the new configuration is not beside it"
  in_jail "$2" --check-config --config "/etc/palpate/$2.toml" >/dev/null || fail "the upgraded $2"
  if with_systemd; then
    after=$(main_pid "$2")
    if [ "$after" = 0 ] || [ "$after" = "$before" ]; then fail "an upgrade does not restart $2"; fi
  fi
  ok "$2 upgraded, with the configuration as it was edited"
}

check_removal() {
  local left program
  apt_in_jail remove palpate-daemon palpate-web
  [ -e "$config" ] || fail "remove takes the configuration"
  [ ! -e "$jail/usr/bin/palpated" ] || fail "remove leaves palpated"
  # Without systemd nothing runs; those of this machine are seen too.
  for program in palpated palpate-web; do
    if with_systemd && in_jail pgrep -x "$program"; then fail "remove leaves $program running"; fi
  done
  touch "$jail/var/lib/palpate/volumes/trial.mcap"
  apt_in_jail purge palpate-daemon
  [ -e "$jail/var/lib/palpate/volumes/trial.mcap" ] || fail "purge takes recordings"
  [ "$(ls "$jail/var/lib/palpate")" = volumes ] || fail "purge leaves state"
  [ -e "$jail/etc/palpate/palpate-web.toml" ] || fail "purge takes the configuration of palpate-web"
  rm "$jail/var/lib/palpate/volumes/trial.mcap"
  # With nothing of value left, and nothing edited.
  apt_in_jail install "/opt/test/$(basename "$packages"/palpate-daemon_*.deb)"
  if with_systemd; then in_jail systemctl --quiet is-active palpated || fail "it is not started at once"; fi
  apt_in_jail purge palpate-daemon palpate-web palpate-client palpate-viewer python3-palpate libpalpate-client-dev
  # Not in /run: what the harness made there is no package's.
  left=$(find "$jail" -xdev -name '*palpate*' ! -path "$jail/opt/*" ! -path "$jail/run/*" | head)
  [ -z "$left" ] || fail "purge leaves $left"
  if grep -q palpate "$jail/etc/passwd" "$jail/etc/group"; then fail "purge leaves the user"; fi
  ok "removed and purged; recordings only by hand"
}

make_jail
install_all
in_jail python3 -u /opt/test/notify_harness.py /opt/test/clients.sh /opt/test/example ||
  fail "palpated as a service, without systemd"
if boot_systemd; then
  ok "systemd $(in_jail systemctl --version | awk 'NR == 1 {print $2}') runs in it"
  in_jail python3 -u /opt/test/systemd_harness.py ||
    { in_jail journalctl -q --unit palpated -n 20 --no-pager >&2; fail "palpated as a service of systemd"; }
else
  echo "skip  systemd does not boot on this machine: upgrade and removal without it"
fi
check_upgrade palpate-daemon palpated
if with_systemd; then
  in_jail palpate info | grep -q '0\.7 N/mm' || fail "the upgraded palpated does not serve as before"
fi
check_upgrade palpate-web palpate-web
check_removal
