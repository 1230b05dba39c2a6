# Where this project keeps what it installs. Sourced by the other scripts.
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
deps=$(realpath -m "${CALE_DEPS_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/cale}")
export CALE_DEPS_DIR=$deps
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$root} CCACHE_NOHASHDIR=1

say() { printf '\033[1m%s\033[0m\n' "$*"; }
# With --help: prints the comment at the top of the script that calls, and ends it.
help_from_comment() {
    case ${1:-} in
        -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit ;;
    esac
}
# cmake ARGUMENTS, for the build folder BUILD: from the beginning where that was configured with other dependencies, whose
# places CMake would keep.
configure() {
    local build=$1 known=
    shift
    if [ -f "$build/CMakeCache.txt" ]; then known=$(sed -n 's/^CALE_DEPS_DIR:[A-Z]*=//p' "$build/CMakeCache.txt"); fi
    if [ -n "$known" ] && [ "$known" != "$deps" ]; then set -- --fresh "$@"; fi
    cmake "$@"
}
fail() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; exit 1; }
