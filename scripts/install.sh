# How this project installs what it needs, from Debian's packages and from PyPI. Sourced by scripts/setup and scripts/web,
# behind common.sh.
requirements=$root/scripts/requirements
ale_version=0.12.1

# One set-up at a time works in $deps.
wait_for_other_setups() {
    mkdir -p "$deps"
    exec 9>"$deps/.lock"
    flock -n 9 || { say "Another set-up is at work in $deps: waiting for it."; flock 9; }
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif command -v sudo >/dev/null; then sudo "$@"
    else fail "needs root or sudo to run: $*"; fi
}

# Installs what a file of scripts/requirements lists.
debian_packages() {
    local wanted missing=()
    mapfile -t wanted < <(sed -e 's/#.*//' -e '/^\s*$/d' "$requirements/$1")
    for package in "${wanted[@]}"; do
        dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
    done
    [ ${#missing[@]} = 0 ] && return
    command -v apt-get >/dev/null || fail "this script knows Debian and its relatives only; install these yourself: ${missing[*]}"
    say "Installing ${#missing[@]} of Debian's packages (a minute or two)."
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >"$deps/apt.log" ||
        { tail -n 20 "$deps/apt.log" >&2; fail "apt-get failed; its whole output is in $deps/apt.log"; }
}

# $1: folder to make whole, $2: function that fills the folder it is given.
# A folder appears under its name only when it is complete.
install_folder() {
    [ -d "$deps/$1" ] && return 0
    rm -rf "$deps/$1.partial"
    mkdir -p "$deps/$1.partial"
    "$2" "$deps/$1.partial"
    mv "$deps/$1.partial" "$deps/$1"
}

pip() { "$deps/downloader/bin/python" -m pip --quiet --disable-pip-version-check "$@"; }

make_downloader() {
    /usr/bin/python3 -m venv "$1"
    "$1/bin/python" -m pip --quiet --disable-pip-version-check install --require-hashes -r "$requirements/downloader.txt"
}

# $1: the folder for ALE's sources, with its ROMs.
unpack_ale() {
    pip download --no-deps --no-binary :all: --no-build-isolation --require-hashes -r "$requirements/ale.txt" -d "$1"
    tar -xzf "$1/ale_py-$ale_version.tar.gz" -C "$1" --strip-components=1
    rm "$1/ale_py-$ale_version.tar.gz"
}
