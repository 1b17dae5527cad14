#!/usr/bin/env bash
# Every test that this machine can run: formatting, lints, every kernel permutation through spirv-val,
# all tests with Vulkan's validation layer on, documentation.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/setup.sh

# Every kernel that the last build compiled, wherever a build script of this workspace put it.
validate_kernels() {
    local target_env build folder kernel count=0
    target_env=$(sed -n 's/^pub const TARGET_ENV: &str = "\(.*\)";$/\1/p' engine/kernels/src/compile.rs)
    build="${CARGO_TARGET_DIR:-target}/debug/build"
    for package in esaac-engine esaac-scene; do
        folder=$(find "$build" -path "*/$package-*/out" -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d ' ' -f 2-)
        for kernel in "$folder"/*.spv; do
            spirv-val --target-env "$target_env" "$kernel" || fail "$kernel is not valid"
            count=$((count + 1))
        done
    done
    say "$count kernels are valid"
}

set_up_packages tests
set_up_rust tests
ESAAC_PYTHON=$(numpy_python) || fail "no Python with NumPy, though python3-numpy is installed"
export ESAAC_PYTHON
set_up_ros_python

say "shell scripts"
for script in tools/*.sh .ci/run; do
    bash -n "$script"
done

say "cargo fmt"
cargo fmt --all --check

say "cargo clippy"
cargo clippy --workspace --all-targets --locked -- -D warnings

say "cargo test"
ESAAC_VALIDATION=1 cargo test --workspace --locked --no-fail-fast

say "cargo test, feature tracy"
cargo clippy -p esaac-benches --features tracy --all-targets --locked -- -D warnings
ESAAC_VALIDATION=1 cargo test -p esaac-benches --features tracy --test tracy --locked

say "spirv-val"
validate_kernels

say "cargo doc"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

say "all passed"
