#!/usr/bin/env bash
# Sets the machine up, builds, and runs the demo; arguments go to `esaac demo`.
set -euo pipefail

# Relative paths among the arguments are the caller's, so the demo runs where it was called.
root=$(cd -P "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
. "$root/tools/setup.sh"

cd "$root"
set_up_packages
set_up_rust
say "cargo build --release"
cargo build --release --locked --quiet -p esaac-cli
binary="$(realpath -m "${CARGO_TARGET_DIR:-target}")/release/esaac"
cd "$OLDPWD"

status=0
"$binary" doctor >/dev/null || status=$?
if [ "$status" -ne 0 ]; then
    "$binary" doctor >&2
    exit "$status"
fi
exec "$binary" demo "$@"
