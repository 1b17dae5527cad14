# Sourced by demo.sh and test.sh: installs what is missing on a Debian or Ubuntu machine, and nothing
# where all is there. Packages come from the distribution, Python packages from PyPI in pinned versions, Rust
# from rustup in the version of rust-toolchain.toml.

esaac_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

say() { printf '\033[1m== %s\033[0m\n' "$*" >&2; }

fail() {
    printf 'error: %s\n' "$*" >&2
    exit 1
}

may_be_root() {
    [ "$(id -u)" -eq 0 ] || command -v sudo >/dev/null
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

# install_python FOLDER LIST...: a virtual environment in FOLDER with the packages of tools/python/LIST.txt, in
# the versions and with the hashes that stand there; nothing to do where it has them.
install_python() {
    local folder="$1" list wanted
    shift
    local lists=()
    for list in "$@"; do
        lists+=("$esaac_root/tools/python/$list.txt")
    done
    wanted=$(cat "${lists[@]}" | sha256sum)
    if [ -x "$folder/bin/python" ] && [ "$(cat "$folder/installed" 2>/dev/null)" = "$wanted" ]; then
        return
    fi
    python3 -c 'import ensurepip, venv' >/dev/null 2>&1 || apt_install python3-venv
    say "pip install: $*"
    python3 -m venv --clear "$folder"
    for list in "${lists[@]}"; do
        "$folder/bin/pip" install --quiet --disable-pip-version-check --require-hashes -r "$list"
    done
    echo "$wanted" >"$folder/installed"
}

# Subscribers for the tests that share no code with the publisher, in an environment of their own.
set_up_ros_python() {
    local folder="${CARGO_TARGET_DIR:-target}/ros-python"
    install_python "$folder" ros
    ESAAC_ROS_PYTHON="$(cd "$folder" && pwd)/bin/python"
    export ESAAC_ROS_PYTHON
}

# set_up_egl: what MuJoCo draws with where there is no screen and no GPU.
set_up_egl() {
    if ! has_library libEGL_mesa.so.0 || ! has_library libEGL.so.1 || ! has_library libOpenGL.so.0; then
        apt_install libegl1 libegl-mesa0 libopengl0 libgl1-mesa-dri
    fi
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
        command -v git >/dev/null || missing+=(git)
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

# set_up_rust [tests]: the toolchain that rust-toolchain.toml pins. A cargo without rustup, as a distribution
# packages it, will do if it is of the workspace's rust-version or newer; with `tests`, clippy and rustfmt too.
set_up_rust() {
    local pinned wanted
    pinned=$(sed -n 's/^channel = "\(.*\)"$/\1/p' "$esaac_root/rust-toolchain.toml")
    wanted=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' "$esaac_root/Cargo.toml")
    [ -n "$pinned" ] || fail "rust-toolchain.toml states no channel"
    [ -n "$wanted" ] || fail "Cargo.toml states no rust-version"
    export PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"
    if ! command -v rustup >/dev/null && ! cargo_is_new_enough "$wanted"; then
        install_rustup "$wanted"
    fi
    if command -v rustup >/dev/null && ! rustup run "$pinned" cargo --version >/dev/null 2>&1; then
        say "rustup toolchain install $pinned"
        rustup toolchain install "$pinned" --profile minimal --component clippy --component rustfmt
    fi
    cargo_is_new_enough "$wanted" ||
        fail "$(cargo --version 2>&1) is too old, expected $wanted or newer; run: rustup toolchain install $pinned"
    if [ "${1:-}" = tests ] && ! { cargo clippy --version && cargo fmt --version; } >/dev/null 2>&1; then
        command -v rustup >/dev/null || fail "cargo has no clippy or no rustfmt; install them beside it"
        rustup component add --toolchain "$pinned" clippy rustfmt
    fi
}

# rustup's own installer, for distributions that do not package it: version and hashes of the program.
RUSTUP_VERSION=1.28.2
RUSTUP_SHA256_x86_64=20a06e644b0d9bd2fbdbfd52d42540bdde820ea7df86e92e533c073da0cdd43c
RUSTUP_SHA256_aarch64=e3853c5a252fca15252d07cb23a1bdd9377a8c6f3efa01531109281ae47f841c

install_rustup() {
    local machine hash folder
    # An installable version, that is; `apt-cache show` is content with a name that others mention.
    # Without root rustup comes from its makers.
    if command -v apt-get >/dev/null && may_be_root && apt_update &&
        apt-cache policy rustup | grep 'Candidate: [0-9]' >/dev/null; then
        apt_install rustup
        return
    fi
    machine=$(uname -m)
    hash="RUSTUP_SHA256_$machine"
    hash="${!hash:-}"
    [ -n "$hash" ] || fail "Rust $1 or newer is missing; install it by hand on $machine"
    say "Rust $1 or newer is missing and this distribution packages no rustup: rustup-init $RUSTUP_VERSION"
    command -v curl >/dev/null || apt_install curl ca-certificates
    folder=$(mktemp -d)
    curl --proto '=https' --tlsv1.2 --silent --show-error --fail --output "$folder/rustup-init" \
        "https://static.rust-lang.org/rustup/archive/$RUSTUP_VERSION/$machine-unknown-linux-gnu/rustup-init"
    echo "$hash  $folder/rustup-init" | sha256sum --check --strict --quiet ||
        fail "rustup-init is not the program that was expected (SHA-256 $hash)"
    chmod +x "$folder/rustup-init"
    "$folder/rustup-init" -y --quiet --profile minimal --no-modify-path --default-toolchain none
    rm -r "$folder"
}

# set_up_python FOLDER [tests]: a virtual environment with what builds and lints the Python package; with `tests`,
# what tests it too.
set_up_python() { install_python "$1" tools "${@:2}"; }
