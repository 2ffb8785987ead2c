# shellcheck shell=bash
# Sourced by run, test and lint: finds the checkout, and makes or completes its environment when that is due.

root="$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd -P)"
environment="$root/.venv"
# in Windows' bash (Git's) programs are elsewhere, and Python wants the paths of Windows; not tried
case "$OSTYPE" in
msys* | cygwin*) root="$(cygpath -m "$root")" environment="$root/.venv" python="$root/.venv/Scripts/python.exe" ;;
*) python="$environment/bin/python" ;;
esac
export MPLBACKEND=Agg

# The stamp of a layer is a copy of all that it was made from, in the order that set_up.py writes it.
layer_is_current() {
    local stamp="$environment/stamps/$1" files=("$root/pyproject.toml" "$root/requirements/main.txt")
    [ "$1" = main ] || files+=("$root/requirements/$1.txt")
    [ -x "$python" ] && [ -f "$stamp" ] && [ ! -e "$environment/incomplete" ] && { printf '%s\n' "$root" && cat -- "${files[@]}"; } | cmp -s - "$stamp"
}

kernels_are_warm() {
    local stamp="${IMPACT_ENV_CACHE:-$environment/kernel-cache}/warm" sources=("$root/impact_env/warm_up.py" "$root/impact_env/kernels" "$root/requirements/main.txt")
    [ ! -f "${sources[0]}" ] || { [ -f "$stamp" ] && [ -z "$(find "${sources[@]}" \( -name '*.py' -o -name '*.txt' \) -newer "$stamp")" ]; }
}

find_python() {
    local candidate
    for candidate in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11 python3.14 python; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' >/dev/null 2>&1; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    echo "error: no Python 3.11 to 3.14 was found; install one (https://www.python.org/downloads/) or name it: PYTHON=/path/to/python3 $0 ..." >&2
    return 1
}

# require_environment LAYER...: each layer is a file in requirements/. The layer "kernels" stands for the compiled kernels.
require_environment() {
    local layer base due=''
    for layer in "$@"; do
        if [ "$layer" = kernels ]; then
            kernels_are_warm || due=yes
        elif [ ! -f "$root/requirements/$layer.txt" ]; then
            echo "error: needs: $layer is not known (there is no requirements/$layer.txt)" >&2
            return 1
        else
            layer_is_current "$layer" || due=yes
        fi
    done
    [ -n "$due" ] || return 0
    base="$(find_python)" || return
    "$base" "$root/scripts/lib/set_up.py" "$@" >&2
}

# run_sessions OPTION...: sessions of noxfile.py with the programs of the checkout's environment, in place of this process
run_sessions() {
    cd "$root"
    exec "$python" -m nox "$@"
}
