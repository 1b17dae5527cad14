#!/usr/bin/env bash
# Every test that this machine can run: formatting, lints, every kernel permutation through spirv-val,
# all tests with Vulkan's validation layer on, those of the kernels without it as well, documentation.
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

# The wheel, as a user has it, in an environment that has nothing else of this repository.
test_python() {
    local target environment wheels
    target=$(realpath "${CARGO_TARGET_DIR:-target}")
    environment="$target/python" wheels="$target/wheels"
    set_up_python "$environment"
    rm -rf "$wheels"
    (cd kit_bridge && "$environment/bin/maturin" build --profile dev --locked --quiet --out "$wheels")
    "$environment/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps \
        "$wheels"/esaac-*.whl
    "$environment/bin/python" -m pip install --quiet --disable-pip-version-check "$(ls "$wheels"/esaac-*.whl)[test]"
    "$environment/bin/ruff" check kit_bridge
    "$environment/bin/ruff" format --check kit_bridge
    # The types of the package, against a program that uses all of it.
    "$environment/bin/mypy" --strict kit_bridge/tests/typed_use.py
    "$environment/bin/hadolint" docker/Dockerfile
    "$environment/bin/check-jsonschema" --builtin-schema vendor.compose-spec docker/compose.yaml
    (cd kit_bridge && "$environment/bin/python" -m pytest --quiet)
}

# A node of the sourced ROS 2, where one is sourced. Elsewhere its types alone, which proves that it compiles
# and no more: ROS's own messages are stand-ins, and nothing is linked or run.
test_rclrs() {
    local folder
    if [ -z "${ROS_DISTRO:-}" ] || [ -z "${AMENT_PREFIX_PATH:-}" ]; then
        say "cargo clippy, feature rclrs: types only, no ROS 2 is sourced"
        ROS_DISTRO=jazzy cargo clippy -p esaac-ros --no-default-features --features rclrs-types-only \
            --all-targets --locked -- -D warnings
        return
    fi
    say "cargo test, feature rclrs, ROS 2 $ROS_DISTRO"
    if ! compgen -G "${AMENT_PREFIX_PATH%%:*}/share/esaac_msgs/package.xml" >/dev/null; then
        folder=$(realpath "${CARGO_TARGET_DIR:-target}")/ros2
        colcon --log-base "$folder/log" build --base-paths ros/esaac_msgs --build-base "$folder/build" \
            --install-base "$folder/install"
        set +u
        . "$folder/install/setup.bash"
        set -u
    fi
    cargo clippy -p esaac-ros --features rclrs --all-targets --locked -- -D warnings
    # Loopback and nothing else, as Jazzy, Humble and Cyclone DDS are told it.
    ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_LOCALHOST_ONLY=1 \
        CYCLONEDDS_URI='<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>' \
        cargo test -p esaac-ros --features rclrs --test rclrs --locked
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

# Kernels that the layer does not watch are others on the software driver.
say "cargo test, without the layer"
cargo test -p esaac-tests --locked --test gpu_against_oracle --test stages --test packets --test invariants

say "cargo test, feature tracy"
cargo clippy -p esaac-benches --features tracy --all-targets --locked -- -D warnings
ESAAC_VALIDATION=1 cargo test -p esaac-benches --features tracy --test tracy --locked

# Off by default: Zenoh alone takes longer to build than all that is tested here.
if [ -n "${ESAAC_TEST_ZENOH:-}" ]; then
    say "cargo test, feature zenoh"
    "$ESAAC_ROS_PYTHON" -m pip install --quiet --disable-pip-version-check 'eclipse-zenoh>=1.10,<2' xxhash
    cargo clippy -p esaac-ros -p esaac-cli --features esaac-cli/zenoh --all-targets --locked -- -D warnings
    cargo test -p esaac-ros --features zenoh --locked zenoh
fi

test_rclrs

say "pytest"
test_python

say "spirv-val"
validate_kernels

say "cargo doc"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

say "all passed"
