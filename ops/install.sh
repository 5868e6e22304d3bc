#!/bin/sh
# Installs pursuit on this machine: program, user, config, units. Run as root, after `cargo build --release`.
#   ops/install.sh            install, or upgrade: a config that is there stays
#   ops/install.sh --remove   take it away again; the config stays
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
units=/etc/systemd/system

if [ "$(id -u)" -ne 0 ]; then
    echo "install.sh: this puts files into /usr/local and /etc: run it as root" >&2
    exit 1
fi

if [ "${1:-}" = --remove ]; then
    systemctl disable --now pursuit 2>/dev/null || true
    rm -f /usr/local/bin/pursuit "$units/pursuit.service" "$units/pursuit@.service"
    systemctl daemon-reload 2>/dev/null || true
    echo "removed; /etc/pursuit and the user pursuit stay"
    exit 0
fi

program="$here/target/release/pursuit"
if [ ! -x "$program" ]; then
    echo "install.sh: $program is not there: cargo build --release" >&2
    exit 1
fi
getent passwd pursuit >/dev/null || useradd --system --no-create-home --shell /usr/sbin/nologin pursuit
# A new file in its place, not over it: running services keep the build that they have.
install -m 0755 "$program" /usr/local/bin/pursuit.new
mv /usr/local/bin/pursuit.new /usr/local/bin/pursuit
install -d -m 0755 /etc/pursuit
if [ ! -e /etc/pursuit/cell.toml ]; then
    install -m 0644 "$here/config/sim.toml" /etc/pursuit/cell.toml
    echo "/etc/pursuit/cell.toml is the simulated cell: make it yours, then pursuit check /etc/pursuit/cell.toml"
fi
install -m 0644 "$here/ops/pursuit.service" "$here/ops/pursuit@.service" "$units"
systemctl daemon-reload 2>/dev/null || echo "no systemd runs here: the units are in $units"
echo "installed. systemctl enable --now pursuit; then pursuit status --run-dir /run/pursuit/cell as user pursuit"
