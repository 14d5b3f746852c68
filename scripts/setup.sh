#!/bin/sh
# Finds or builds the Python that runs this project. The Makefile calls it; see `make help`.
#
#   setup.sh mode           print "wheel" or "apt": which DOLFINx this machine is to use
#   setup.sh python         print a Python >= 3.12 that can carry DOLFINx's wheel, or fail
#   setup.sh wheel          build or refresh .venv, and leave .venv/.stamp only on success
#   setup.sh check-apt [M]  fail, naming the `apt install` line, if Debian's packages
#                           (and those of the further modules M) are not all there
#   setup.sh apt-packages   print the Debian packages
#
# Environment: PYTHON        the Python to build .venv with, instead of searching for one
#              SYSTEM_PYTHON the Python with Debian's packages (default /usr/bin/python3)
set -eu
cd "$(dirname "$0")/.."
root=$(pwd -P)
venv=.venv
wheel_needs="x86-64 Linux, with venv and Python.h"
stamp=$venv/.stamp
system_python=${SYSTEM_PYTHON:-/usr/bin/python3}

# Each of these modules is in the Debian package that `package` names.
apt_modules="dolfinx meshio numba matplotlib pytest xdist scipy pandas rich hypothesis"

say() { printf '%s\n' "$*" >&2; }
die() { say "$@"; exit 1; }

# A pyenv shim may be on PATH and not answer, so a candidate counts only once it has run this.
# It prints the base interpreter, not that of an active venv, which may be the .venv being built.
# The wheel is for x86-64 Linux with glibc >= 2.34; DOLFINx compiles against Python.h at run time.
probe='
import os, platform, sys, sysconfig
import ensurepip, venv
header = os.path.join(sysconfig.get_path("include"), "Python.h")
glibc = tuple(int(n) for n in platform.libc_ver()[1].split(".")[:2] if n.isdigit())
ok = (
    sys.version_info >= (3, 12)
    and sys.implementation.name == "cpython"
    and not sysconfig.get_config_var("Py_GIL_DISABLED")
    and sys.platform == "linux"
    and platform.machine() == "x86_64"
    and glibc >= (2, 34)
    and os.path.exists(header)
)
print(sys._base_executable if ok else "")
'

answer() { # path of the base interpreter behind candidate $1, or nothing
    "$1" -I -c "$probe" 2>/dev/null </dev/null || true
}

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        "$PYTHON" -c \
            'import sys; print(sys._base_executable); sys.exit(sys.version_info < (3, 12))' ||
            die "PYTHON=$PYTHON does not run, or is older than 3.12."
        return
    fi
    pyenv_root=${PYENV_ROOT:-}
    # 3.13 and 3.12 first: later ones may still lack wheels of numba.
    for name in python3.13 python3.12 python3.14 python3 python; do
        version=${name#python}
        set -- "$name"
        case $version in
            3.*) for base in "$pyenv_root" "${HOME:-}/.pyenv"; do
                     [ -z "$base" ] || set -- "$@" "$base"/versions/"$version"*/bin/python3
                 done ;;
        esac
        for candidate in "$@"; do
            command -v "$candidate" >/dev/null 2>&1 || continue
            found=$(answer "$candidate")
            [ -z "$found" ] || { printf '%s\n' "$found"; return; }
        done
    done
    return 1
}

stamp_is_good() { # made for this folder (a venv cannot be moved) and by a Python still there
    [ "$(cat $stamp 2>/dev/null)" = "$root" ] && $venv/bin/python -c '' 2>/dev/null
}

mode() {
    stamp_is_good && { echo wheel; return; }
    rm -f $stamp
    if [ -n "${PYTHON:-}" ] || find_python >/dev/null; then echo wheel; else echo apt; fi
}

compiler='
import os, shutil, sysconfig
names = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
raise SystemExit(shutil.which(names.split()[0]) is None)
'

# mpi4py first: it loads the MPI library that the wheel's DOLFINx needs and does not find itself.
greet='
import platform
from mpi4py import MPI
import dolfinx
print("DOLFINx", dolfinx.__version__, "on Python", platform.python_version())
'

build_venv() {
    unset PYTHONPATH PYTHONHOME # another DOLFINx on PYTHONPATH would pass for an installed one
    rm -f $stamp
    if [ -z "${PYTHON:-}" ] && [ -e $venv/.root ] && [ "$(cat $venv/.root)" = "$root" ] &&
        $venv/bin/python -m pip --version >/dev/null 2>&1; then
        say "Refreshing .venv: pyproject.toml has changed or the last set-up did not end ..."
    else
        python=$(find_python) || {
            [ -z "${PYTHON:-}" ] || exit 1
            die "No Python >= 3.12 that can carry DOLFINx's wheel was found ($wheel_needs)." \
                "Name one with 'make setup PYTHON=/path/to/python3', or use Debian's DOLFINx:" \
                "'make test-apt'."
        }
        say "Setting up .venv with $("$python" --version) ($python), about a minute ..."
        rm -rf $venv
        "$python" -m venv $venv
        printf '%s\n' "$root" >$venv/.root
    fi
    $venv/bin/python -c "$compiler" || die \
        "No C compiler was found, and DOLFINx compiles its forms at run time:  sudo apt install gcc"
    if ! $venv/bin/python -m pip install --quiet --disable-pip-version-check --progress-bar off \
        -e ".[wheel,test]" </dev/null ||
        ! versions=$($venv/bin/python -c "$greet"); then
        die "The set-up of .venv failed, as said above; the next make tries again." \
            "'make test-apt' uses Debian's DOLFINx and needs no .venv."
    fi
    printf '%s\n' "$root" >$stamp
    say ".venv is ready: $versions"
}

check_apt() {
    missing=$("$system_python" - $apt_modules "$@" <<'PY'
import importlib.util, sys
if sys.version_info < (3, 11):
    found = (sys.executable,) + sys.version_info[:2]
    sys.exit("%s is Python %d.%d, and 3.11 or later is needed." % found)
print(*(m for m in sys.argv[1:] if importlib.util.find_spec(m) is None))
PY
    ) || die "$system_python cannot be used; on Debian or Ubuntu:" \
        "    sudo apt install python3 $(apt_packages "$@")"
    [ -n "$missing" ] || return 0
    packages=
    for module in $missing; do packages="$packages $(package "$module")"; done
    say "$system_python cannot import: $missing"
    say "Install with:"
    say "    sudo apt install$packages"
    if python=$(find_python); then
        say "Or use DOLFINx's wheel, with $python: 'make test' and 'make demo' without DOLFINX=apt."
    else
        say "Or install a Python >= 3.12 ($wheel_needs), and make will build .venv with it."
    fi
    exit 1
}

package() {
    case $1 in
        xdist) printf 'python3-pytest-xdist' ;;
        *) printf 'python3-%s' "$(printf '%s' "$1" | tr _ -)" ;;
    esac
}

apt_packages() {
    packages=
    for module in $apt_modules "$@"; do packages="$packages $(package "$module")"; done
    printf '%s\n' "${packages# }"
}

command=${1:-}
[ $# -eq 0 ] || shift
case $command in
    mode) mode ;;
    python) find_python ;;
    wheel) build_venv ;;
    check-apt) check_apt "$@" ;;
    apt-packages) apt_packages ;;
    *) die "usage: $0 mode | python | wheel | check-apt [module ...] | apt-packages" ;;
esac
