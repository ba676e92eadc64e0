#!/usr/bin/env bash
# `make fresh`: the README's two commands in a clone of the last commit, on a Debian that has nothing installed.
# debootstrap makes the system, once, below FOLDER (~/.cache/fit-material/fresh); it takes root, and some 10 GB of disk.
# Only pip's settings and certificates of this machine are lent to it.
#
#   fresh.sh [COMMAND…]      `make demo` and `make test` where no command is given
set -euo pipefail

release=${DEBIAN:-bookworm}
folder=${FOLDER:-$HOME/.cache/fit-material/fresh}
base=$folder/$release-base system=$folder/$release project=$(git rev-parse --show-toplevel)

fail() {
    echo "make fresh: $1" >&2
    exit 2
}

[ "$(id -u)" = 0 ] || fail "needs root, to make a system of its own"
command -v debootstrap >/dev/null || fail "needs debootstrap; type: sudo apt-get install debootstrap"
[ "${FRESH_NAMESPACE:-}" = "$$" ] || FRESH_NAMESPACE=$$ exec unshare --mount bash "$0" "$@" # mounts end with this process

if [ ! -e "$base/whole" ]; then
    rm -rf --one-file-system "$base"
    mkdir -p "$base"
    packages=python3,python3-venv,make,git,ca-certificates
    debootstrap --variant=minbase --include="$packages" "$release" "$base" >"$folder/debootstrap.log" 2>&1 ||
        fail "debootstrap failed: $(tail -n 1 "$folder/debootstrap.log")"
    cp -r /etc/apt/apt.conf.d "$base/etc/apt/"
    if grep -q "VERSION_CODENAME=$release" /etc/os-release; then # the same release: its sources, with its updates
        cp -rL /etc/apt/sources.list* "$base/etc/apt/"
    fi
    touch "$base/whole"
fi
rm -rf --one-file-system "$system"
cp -a "$base" "$system"
git clone --quiet "$project" "$system/root/project"

mount --bind /proc "$system/proc"
mount --bind /dev "$system/dev"
mount -t tmpfs shared-memory "$system/dev/shm"
cp -L /etc/resolv.conf /etc/hosts "$system/etc/"
lend() {
    [ -e "$1" ] || return 0
    mkdir -p "$system$(dirname "$1")"
    if [ -d "$1" ]; then mkdir -p "$system$1" && mount --bind "$1" "$system$1"; else cp -L "$1" "$system$1"; fi
}
for path in /etc/pip.conf /etc/xdg/pip "$HOME/.config/pip/pip.conf" /etc/ssl/certs/ca-certificates.crt; do lend "$path"; done
# folders of this disk in which pip is set to look
for path in $(python3 -m pip config list 2>/dev/null | grep -oE "(file://)?/[^ '\"\\]+" | sed 's#^file://##; s#/simple/*$##'); do
    [ ! -d "$path" ] || lend "$path"
done

inside() {
    mapfile -t settings < <(env | grep -iE '^(https?_proxy|no_proxy|PIP_[A-Z_]*|SSL_CERT_(FILE|DIR))=')
    env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive "${settings[@]}" \
        chroot "$system" sh -c 'cd /root/project && exec "$@"' sh "$@"
}
if [ $# -gt 0 ]; then
    inside "$@"
else
    inside make demo
    inside make test
fi
