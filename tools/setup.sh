#!/usr/bin/env bash
# Makes .venv with everything cortet needs. Run again it does what is missing, at once when nothing is.
#
#   tools/setup.sh              the default line, and the setting `cgal` by the wheel of that name: nothing is compiled
#   tools/setup.sh published    the paper's own tool as well: pygalmesh, which has no wheel, is compiled, once
#   tools/setup.sh dev          the default line, and what checks the code and makes the documentation
#   tools/setup.sh test         all of these, the programs that tests call, the other meshers and Snakemake's plugin for SLURM
#
#   PYTHON=python3.12      interpreter to use (default: the first that fits)
#   CORTET_WHEELS=FOLDER   where the compiled pygalmesh is kept (default: ~/.cache/cortet/untimed-wheels)
set -euo pipefail
cd "$(dirname "$0")/.."

what=${1:-default}
venv=.venv
wheels=${CORTET_WHEELS:-${XDG_CACHE_HOME:-$HOME/.cache}/cortet/untimed-wheels}
pygalmesh=$(sed -n 's/^\(pygalmesh==[^ ;]*\).*/\1/p' requirements.txt)
pygalmesh_sources=8
kernel_count=130

# Shared libraries that wheels load from the system: Gmsh, PyMeshLab, VTK; GMP and MPFR for pygalmesh.
run_packages=(libglu1-mesa libgl1 libopengl0 libegl1 libxrender1 libxcursor1 libxft2 libxinerama1 libgmp10 libmpfr6)
# What compiling pygalmesh takes, besides the headers of Python.
build_packages=(g++ libcgal-dev libeigen3-dev)
# Programs that tests call: a solver for exported files, the browser for pages, Connectome Workbench, and a SLURM with its
# database for a cluster of one machine, and what builds a container without a registry. A test without its own is skipped.
test_packages=(calculix-ccx chromium connectome-workbench buildah mmdebstrap
    slurm-wlm slurmdbd munge mariadb-server-core mariadb-client-core)

say() { printf 'set-up: %s\n' "$*" >&2; }
fail() { say "$@"; exit 1; }

# --- the stamp: written last, names what the environment was made from -----------------------------------------------

wanted_stamp() { cat requirements*.txt tools/setup.sh | sha256sum | cut -d' ' -f1; }
has_stamp() { [[ -x $venv/bin/python && $(cat "$venv/.stamp$1" 2>/dev/null) == "$(wanted_stamp)" ]] && $venv/bin/python -c ''; }
is_ready() {
    has_stamp '' || return
    [[ ! $what =~ dev|test ]] || has_stamp .dev || return
    [[ ! $what =~ published|test ]] || has_stamp .published || return
    [[ $what != test ]] || has_stamp .test
}

# --- the interpreter -------------------------------------------------------------------------------------------------

fits() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
makes_venvs() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# 3.12 and 3.11 come first: for later ones PyPI has no `cgal` wheel, so S1 would have one backend at most.
choose_python() {
    local candidate fallback=
    for candidate in ${PYTHON:-python3.12 python3.11 python3 /usr/bin/python3 python3.13 python3.14}; do
        fits "$candidate" || continue
        if makes_venvs "$candidate"; then echo "$candidate"; return; fi
        fallback=${fallback:-$candidate}
    done
    [[ $fallback ]] || fail "no Python >= 3.11 found${PYTHON:+ (PYTHON=$PYTHON)}; install one, or name it: PYTHON=/path/to/python3"
    echo "$fallback"
}

# Debian keeps these parts of its Python in packages of their own.
python_packages() {
    "$python" -c 'import os, sys, sysconfig
if sys.base_prefix != "/usr": sys.exit()
package = "python%d.%d-" % sys.version_info[:2]
try:
    import ensurepip, venv
except ImportError:
    print(package + "venv")
if not os.path.exists(sysconfig.get_path("include") + "/Python.h"):
    print(package + "dev")'
}

# --- system packages -------------------------------------------------------------------------------------------------

is_installed() { [[ $(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null) == installed ]]; }

install_packages() {
    local package missing=()
    if ! command -v apt-get dpkg-query >/dev/null; then
        say "no apt here; if 'cortet doctor' finds something missing, install the equivalents of: $*"
        return
    fi
    for package; do is_installed "$package" || missing+=("$package"); done
    ((${#missing[@]})) || return 0

    local get="apt-get install -y --no-install-recommends ${missing[*]}" root=()
    if ((EUID)); then
        # a password is asked for only where somebody can type one
        if ! command -v sudo >/dev/null || ! { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
            fail "system packages are missing and I am not root; run this line, then try again:
    sudo apt-get update && sudo $get"
        fi
        root=(sudo)
    fi
    say "installing system packages: ${missing[*]}"
    "${root[@]}" apt-get update -q -o DPkg::Lock::Timeout=300 </dev/null >&2 || say "apt-get update failed; trying with the old lists"
    # shellcheck disable=SC2086
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive $get -q -o DPkg::Lock::Timeout=300 </dev/null >&2 ||
        fail "apt-get could not install: ${missing[*]}"
}

# --- pygalmesh -------------------------------------------------------------------------------------------------------

# Fails unless the cache has a wheel that fits this Python and loads on this machine.
install_pygalmesh() {
    $venv/bin/python -m pip install --quiet --no-index --no-deps --force-reinstall --find-links "$wheels" "$pygalmesh" 2>/dev/null &&
        $venv/bin/python -c 'import pygalmesh' 2>/dev/null
}

cgal_version() { echo '#include <CGAL/version.h>' | g++ -E -dM -x c++ - 2>/dev/null | awk '$2 == "CGAL_VERSION" {print $3}'; }

# Says every half minute that the rest of its arguments is going on, after a command that prints how far; until it is ended.
report_progress() {
    local how_far=$1 began=$SECONDS
    shift
    while sleep 30 && kill -0 $$ 2>/dev/null; do say "$*: $(eval "$how_far"), $((SECONDS - began)) s"; done
}

# Compiles the wheel into the cache. Two set-ups at once compile it once: the second waits.
compile_pygalmesh() {
    local cgal headers= log=$wheels/compile.log build progress status=0
    exec 8<"$wheels"
    flock -n 8 || { say "another set-up is compiling pygalmesh; waiting for it"; flock 8; }
    if install_pygalmesh; then exec 8<&-; return; fi

    install_packages "${build_packages[@]}" # nothing to do, unless a wheel in the cache did not load
    cgal=$(cgal_version)
    case $cgal in
        '') say "there are no CGAL headers"; exec 8<&-; return 1 ;;
        5.*) ;;
        6.*) headers=$PWD/tools/cgal6 ;; # two headers that went away after version 5
        *) say "pygalmesh is not known to compile with CGAL $cgal; trying" ;;
    esac

    say "compiling $pygalmesh with CGAL $cgal, since it has no wheel: some ten minutes on one core, once (log: $log)"
    rm -rf "$wheels"/.build.* # of a set-up that was killed
    build=$(mktemp -d "$wheels/.build.XXXXXX")
    : >"$log"
    report_progress "grep -c -- ' -c src/' '$log'" "compiling pygalmesh, $pygalmesh_sources files" 8<&- 9<&- & progress=$!
    # CGAL gives perturbation the wall-clock time that refinement took: a mesh would depend on what else the machine does.
    $venv/bin/python -m pip download --quiet --no-deps --no-build-isolation --no-binary pygalmesh --dest "$build" "$pygalmesh" &&
        mkdir "$build/source" && tar -xf "$build"/pygalmesh-*.tar.gz -C "$build/source" --strip-components 1 &&
        sed -i 's/CGAL::parameters::perturb()/CGAL::parameters::perturb(CGAL::parameters::time_limit = 0)/' \
            "$build"/source/src/generate*.cpp &&
        # one compiler per core; each takes about 2 GB
        sed -i '1i from pybind11.setup_helpers import ParallelCompile; ParallelCompile("CORTET_COMPILERS").install()' \
            "$build/source/setup.py" || status=$?
    # CXXFLAGS takes the place of the flags Python was compiled with, of which -O2 and -DNDEBUG matter
    ((status)) || CORTET_COMPILERS=$(nproc) CXXFLAGS="-O2 -DNDEBUG" CPLUS_INCLUDE_PATH=$headers${CPLUS_INCLUDE_PATH:+:$CPLUS_INCLUDE_PATH} \
        $venv/bin/python -m pip wheel --verbose --no-deps --no-build-isolation --no-cache-dir \
        --wheel-dir "$build" "$build/source" </dev/null &>"$log" || status=$?
    kill $progress 2>/dev/null || true
    ((status)) || mv "$build"/*.whl "$wheels"
    rm -rf "$build"
    exec 8<&-
    ((status == 0)) || { say "pygalmesh could not be compiled; the end of $log:"; tail -n 15 "$log" >&2; return 1; }
    install_pygalmesh
}

# --- the environment -------------------------------------------------------------------------------------------------

[[ $what =~ ^(default|dev|published|test)$ ]] || fail "unknown: $what (say dev, published, test, or nothing)"
# https://github.com/snakemake/snakemake/issues/2645: no job would run, and none would have a log
odd=$'[][ \t\n\'"()$&;|<>*?{}!#\\\\`]'
[[ ! $PWD =~ $odd ]] ||
    fail "the path of this folder has '${BASH_REMATCH[0]}', by which Snakemake cannot run jobs: move it to one without blanks, quotes and parentheses"
is_ready && exit
exec 9<.
flock -n 9 || { say "another set-up is running here; waiting for it"; flock 9; }
is_ready && exit

if ! has_stamp ''; then
    python=$(choose_python)
    install_packages "${run_packages[@]}" $(python_packages)
    makes_venvs "$python" || fail "$python cannot make virtual environments (no module venv or ensurepip)"

    say "making $venv with $("$python" --version) and $(grep -c == requirements.txt) packages: a minute or two, by how fast they download"
    [[ ! -L $venv ]] || fail "$venv is a link: what it leads to would be emptied; delete the link"
    "$python" -m venv --clear $venv
    pip=($venv/bin/python -m pip --disable-pip-version-check --quiet)
    "${pip[@]}" install "$(grep '^pip==' requirements.txt)"
    "${pip[@]}" install --no-deps -r <(grep -v '^pygalmesh==' requirements.txt)
    # setuptools warns of every editable installation
    PYTHONWARNINGS=ignore "${pip[@]}" install --no-deps --no-build-isolation --editable .

    say "compiling the numerical code, once per machine and version: a minute or two"
    kernels=$($venv/bin/python -c 'from cortet.geometry.kernel_cache import cache_folder; print(cache_folder())')
    report_progress "find '$kernels' -name '*.nbc' -newer $venv/pyvenv.cfg | wc -l" "compiled functions, of about $kernel_count" 9<&- & progress=$!
    $venv/bin/python -c 'from cortet.pipeline import warm_up; warm_up()' || { kill $progress; exit 1; }
    kill $progress
    wanted_stamp >$venv/.stamp
fi

if [[ $what =~ dev|test ]] && ! has_stamp .dev; then
    say "installing what developers need: requirements-dev.txt"
    $venv/bin/python -m pip --disable-pip-version-check --quiet install --no-deps -r requirements-dev.txt
    wanted_stamp >$venv/.stamp.dev
fi

if [[ $what =~ published|test ]] && ! has_stamp .published; then
    pip=($venv/bin/python -m pip --disable-pip-version-check --quiet)
    tag=$($venv/bin/python -c 'import sys; print("cp%d%d" % sys.version_info[:2])')
    compgen -G "$wheels/pygalmesh-*-$tag-*.whl" >/dev/null || install_packages "${build_packages[@]}"
    mkdir -p "$wheels"
    if ! { install_pygalmesh || compile_pygalmesh; }; then
        "${pip[@]}" uninstall --yes pygalmesh 2>/dev/null
        say "going on without pygalmesh: CGAL runs by the \`cgal\` wheel (to try again: rm $venv/.stamp.published)"
        $venv/bin/python -c 'import CGAL' 2>/dev/null ||
            fail "but that has none for $($venv/bin/python --version): install Python 3.11 or 3.12, too"
    fi
    wanted_stamp >$venv/.stamp.published
fi

if [[ $what == test ]] && ! has_stamp .test; then
    (install_packages "${test_packages[@]}") || say "going on without ${test_packages[*]}: tests that need them are skipped"
    $venv/bin/python -m pip --disable-pip-version-check --quiet install --no-deps -r requirements-optional.txt ||
        say "going on without some of requirements-optional.txt: tests that need them are skipped"
    wanted_stamp >$venv/.stamp.test
fi
say "done in $SECONDS s"
