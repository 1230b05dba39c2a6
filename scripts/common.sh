# Where this project keeps what it installs. Sourced by the other scripts.
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
deps=${CALE_DEPS_DIR:-${XDG_CACHE_HOME:-$HOME/.cache}/cale}
export CALE_DEPS_DIR=$deps
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$root} CCACHE_NOHASHDIR=1

say() { printf '\033[1m%s\033[0m\n' "$*"; }
fail() { printf '%s: %s\n' "$(basename "$0")" "$*" >&2; exit 1; }
