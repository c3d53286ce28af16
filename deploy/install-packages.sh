#!/usr/bin/env bash
# install-packages.sh [SECTION...]: installs the missing Debian packages of these sections of
# packages.txt. Without a SECTION: of all sections. If all packages are installed, it does
# nothing and needs no network.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

mapfile -t packages < <(sed 's/#.*//' "$here/packages.txt" | awk -v wanted=" $* " '
  /^\[/ { section = substr($1, 2, length($1) - 2); next }
  NF && (wanted == "  " || index(wanted, " " section " ")) { print $1 }')
if [ ${#packages[@]} -eq 0 ]; then
  echo "install-packages: packages.txt has no section $*" >&2
  exit 2
fi
# A package counts as installed if another one provides it: a nodejs from elsewhere brings its own
# npm, and apt would replace it.
declare -A installed
while read -r status names; do
  [ "$status" = installed ] || continue
  for name in $names; do installed[$name]=yes; done
done < <(dpkg-query -W -f '${db:Status-Status} ${Package} ${Provides}\n' | sed -e 's/([^)]*)//g' -e 's/,/ /g')
missing=()
for package in "${packages[@]}"; do
  [ -n "${installed[$package]-}" ] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "install-packages: ${#missing[@]} packages are missing: run as root, or install sudo (${missing[*]})" >&2
    exit 1
  fi
  as_root=(sudo)
fi
log=$(mktemp)
# Servers among them, such as nginx, would start at once, on ports that others can reach.
policy=/usr/sbin/policy-rc.d
if [ ! -e $policy ]; then
  printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" install -m 0755 /dev/stdin $policy
else
  policy=
fi
trap 'rm -f "$log"; [ -z "$policy" ] || "${as_root[@]}" rm -f "$policy"' EXIT
echo "installing ${#missing[@]} Debian packages, some minutes: ${missing[*]}"
if ! { "${as_root[@]}" apt-get update -q &&
       "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -q --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
  grep -E '^(E|W|Err):' "$log" >&2 || tail -n 5 "$log" >&2
  echo "install-packages: apt-get failed: check the network, and that this is Debian 12" >&2
  exit 1
fi
