#!/usr/bin/env bash
# Builds the Debian packages from a build tree and looks at them; with --install also
# installs, runs, upgrades, removes and purges them: packages/install.sh (as root).
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=$root/build
install=
for argument in "$@"; do
  case "$argument" in
    --install) install=yes ;;
    -h | --help) echo "Usage: tests/packages_test.sh [--install] [BUILD]"; exit 0 ;;
    *) build=$argument ;;
  esac
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "FAIL  $*" >&2; exit 1; }
ok() { echo "ok    $*"; }

build_packages() {
  # Configured and built before: this is not the place to wait for a whole build.
  nice cmake --build "$build" -j1 --target packages_ready >"$work/build.log" 2>&1 ||
    { tail -n 20 "$work/build.log" >&2; fail "the build"; }
  (cd "$build" && nice cpack -B "$work/packages" >"$work/cpack.log" 2>&1) ||
    { tail -n 20 "$work/cpack.log" >&2; fail "cpack"; }
  packages=("$work"/packages/*.deb)
  [ "${#packages[@]}" -eq 6 ] || fail "${#packages[@]} packages, expected 6"
  ok "packages: $(cd "$work/packages" && du -k -- *.deb | sed 's/^\([0-9]*\)\t\([^_]*\)_.*/\2 \1 kB/' | paste -sd ,)"
}

package() {
  local found
  found=$(printf '%s\n' "${packages[@]}" | grep "/$1_" | head -n 1)
  [ -n "$found" ] || fail "there is no package $1"
  echo "$found"
}

# holds PACKAGE PATH...
holds() {
  local list path
  list=$(dpkg-deb -c "$(package "$1")" | awk '{print $6}')
  for path in "${@:2}"; do
    grep -qx "\.$path" <<<"$list" || fail "$1 does not hold $path"
  done
  if grep -q "^\./\(home\|root\|tmp\|work\)/" <<<"$list"; then fail "$1 holds a path of this machine"; fi
  ok "$1 holds what it should"
}

# check_config PACKAGE PROGRAM
check_config() {
  [ "$(dpkg-deb -I "$(package "$1")" conffiles)" = "/etc/palpate/$2.toml" ] ||
    fail "the configuration of $2 is no conffile"
  # The page that was built: the package is not installed here.
  sed "s#/usr/share/palpate/web#$build/web#" "$root/deploy/config/$2.toml" >"$work/$2.toml"
  chmod 0644 "$work/$2.toml"
  "$build/bin/$2" --check-config --config "$work/$2.toml" >/dev/null ||
    fail "the configuration of $2 that is shipped"
}

check_contents() {
  holds palpate-daemon /usr/bin/palpated /usr/bin/palpate-import /usr/bin/palpate-lab \
    /lib/systemd/system/palpated.service /usr/lib/sysusers.d/palpate.conf \
    /usr/lib/udev/rules.d/70-palpate.rules /etc/palpate/palpated.toml /usr/share/man/man1/palpated.1.gz \
    /usr/share/doc/palpate-daemon/README.md /usr/share/doc/palpate-daemon/deploy/guides/devices.md
  holds palpate-viewer /usr/bin/palpate-view /usr/share/man/man1/palpate-view.1.gz
  holds palpate-web /usr/bin/palpate-web /usr/share/man/man1/palpate-web.1.gz \
    /lib/systemd/system/palpate-web.service /usr/lib/sysusers.d/palpate-web.conf \
    /etc/palpate/palpate-web.toml /usr/share/palpate/web/index.html /usr/share/palpate/web/app.js \
    /usr/share/palpate/web/style.css /usr/share/palpate/web/licenses.txt \
    /usr/share/palpate/nats/hub.conf /usr/share/palpate/nats/leaf.conf /usr/share/palpate/nats/service.conf
  holds palpate-client /usr/bin/palpate /usr/share/man/man1/palpate.1.gz \
    /usr/share/bash-completion/completions/palpate
  holds python3-palpate /usr/lib/python3/dist-packages/palpate/__init__.py \
    /usr/lib/python3/dist-packages/palpate/_setting_list.py \
    /usr/lib/python3/dist-packages/palpate/v1/pose_pb2_grpc.py
  holds libpalpate-client-dev /usr/include/palpate/client/sdk/client.h \
    /usr/include/palpate/client/sdk/setting_list.h \
    /usr/lib/cmake/palpate-client/palpate-client-config.cmake
  check_config palpate-daemon palpated
  check_config palpate-web palpate-web
  lintian --allow-root --fail-on error "${packages[@]}" >"$work/lintian.log" 2>&1 ||
    { cat "$work/lintian.log" >&2; fail "lintian"; }
  ok "lintian: $(grep -c '^W:' "$work/lintian.log" || true) warnings, no error"
}

# check_unit PROGRAM
check_unit() {
  local unit=$root/deploy/systemd/$1.service copy=$work/$1.service exposure
  # Programs and manual are looked for: here they are not installed.
  sed -e "s#=/usr/bin/$1#=$build/bin/$1#" -e '/^Documentation=/d' "$unit" >"$copy"
  systemd-analyze verify "$copy" >"$work/verify.log" 2>&1 || { cat "$work/verify.log" >&2; fail "verify"; }
  [ ! -s "$work/verify.log" ] || { cat "$work/verify.log" >&2; fail "systemd-analyze verify"; }
  exposure=$(systemd-analyze security --offline=true --no-pager "$unit" | awk '/Overall exposure/ {print $(NF-2)}')
  awk -v e="$exposure" 'BEGIN {exit !(e != "" && e <= 2.5)}' || fail "$1: exposure $exposure, at most 2.5"
  ok "unit of $1: verified, exposure $exposure"
}

build_packages
check_contents
check_unit palpated
check_unit palpate-web
if [ -n "$install" ]; then
  [ "$(id -u)" -eq 0 ] || fail "--install needs root"
  "$root/tests/packages/install.sh" "$work/packages"
fi
echo "packages_test: passed"
