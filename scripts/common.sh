# Where this project keeps what it installs. Sourced by the other scripts.
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
deps=$(realpath -ms "${CALE_DEPS_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/cale}")
export CALE_DEPS_DIR=$deps
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$root} CCACHE_NOHASHDIR=1

say() { printf '\033[1m%s\033[0m\n' "$*"; }
# With --help: prints the comment at the top of the script that calls, and ends it.
help_from_comment() {
    case ${1:-} in
        -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit ;;
    esac
}
# forget_other_deps BUILD: where the folder BUILD was configured with another CALE_DEPS_DIR, has CMake begin anew, as it
# keeps the paths that it found.
forget_other_deps() {
    local known=
    if [ -f "$1/CMakeCache.txt" ]; then known=$(sed -n 's/^CALE_DEPS_DIR:[A-Z]*=//p' "$1/CMakeCache.txt"); fi
    if [ -n "$known" ] && [ "$known" != "$deps" ]; then rm -rf "$1/CMakeCache.txt" "$1/CMakeFiles"; fi
}
fail() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; exit 1; }
