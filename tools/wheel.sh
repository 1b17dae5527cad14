#!/usr/bin/env bash
# Makes the Python package's wheel for release, for every Linux with glibc 2.35 (Ubuntu 22.04) or newer:
#
#     tools/wheel.sh [FOLDER]            # kit_bridge/dist by default
#     tools/wheel.sh --dev [FOLDER]      # quicker to build, slower to run: to try this script
#
# If the library needs symbols of a newer glibc, which this machine has, Zig links it again: Zig knows the symbols of
# older ones.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/setup.sh

readonly GLIBC=2.35
readonly TARGET=x86_64-unknown-linux-gnu

profile=(--release)
if [ "${1:-}" = --dev ]; then
    profile=(--profile dev)
    shift
fi
folder=${1:-kit_bridge/dist}
mkdir -p "$folder"
folder=$(realpath "$folder")

[ "$(uname -sm)" = "Linux x86_64" ] || fail "this is $(uname -sm); release wheels are made on Linux x86_64"
set_up_packages
set_up_rust
command -v objdump >/dev/null || apt_install binutils
environment="$(realpath -m "${CARGO_TARGET_DIR:-target}")/wheel-tools"
install_python "$environment" wheel
export PATH="$environment/bin:$PATH"

say "third-party notices"
mkdir -p kit_bridge/licenses
cp LICENSE kit_bridge/licenses/LICENSE
python3 tools/notices.py esaac-python --target "$TARGET" >kit_bridge/licenses/THIRD-PARTY-NOTICES.txt

say "maturin build ${profile[*]}"
fresh=$(mktemp -d)
trap 'rm -rf "$fresh"' EXIT
build() {
    (cd kit_bridge && maturin build "${profile[@]}" --locked --compatibility "manylinux_${GLIBC/./_}" --out "$fresh" "$@")
}
if ! build; then
    present=$(getconf GNU_LIBC_VERSION | awk '{ print $2 }')
    version_at_least "$GLIBC" "$present" && fail "no wheel was built, see above"
    say "this machine has glibc $present: linking with Zig for $GLIBC"
    build --zig --target "$TARGET"
fi
python3 tools/check_wheel.py "$fresh"/esaac-*.whl --newest-glibc "$GLIBC"
# A wheel of another version beside it would be installed with it.
rm -f "$folder"/esaac-*.whl
mv "$fresh"/esaac-*.whl "$folder"
