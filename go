#!/bin/sh
# ./go          set up, then explore the vase
# ./go test     set up, then run the quick tests; ./go test --all runs every test
# ./go VERB     set up, then palpate VERB
set -eu
root=$(cd "$(dirname "$0")" && pwd)
unset PYTHONPATH PYTHONHOME  # a sourced ROS 2 puts packages called launch on the path

say() { echo "palpate: $*" >&2; }

if [ ! -f "$root/pyproject.toml" ]; then
    say "$root has no pyproject.toml; call go by its path in the repository, not through a link"
    exit 2
fi

# A name on the path is not enough: a version manager may answer to it and refuse to run.
runs() { "$1" -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' >/dev/null 2>&1; }

find_python() {
    for name in ${PYTHON:+"$PYTHON"} python3 python3.11 python3.12 python3.13 python; do
        if command -v "$name" >/dev/null 2>&1 && runs "$name"; then
            echo "$name"
            return 0
        fi
    done
    say "needs Python 3.11 or newer; install one, or set PYTHON=/path/to/python3"
    return 2
}

# uv knows nothing of pip's settings, so where pip has an index of its own, pip it is.
private_index() {
    env | grep -qE '^PIP_(INDEX_URL|EXTRA_INDEX_URL|FIND_LINKS|NO_INDEX)=' ||
        "$1" -m pip config list 2>/dev/null | grep -qE 'index-url|find-links|no-index'
}

make_venv() {
    rm -rf "$root/.venv"
    if ! "$1" -m venv "$root/.venv" >/dev/null 2>&1; then
        rm -rf "$root/.venv"
        say "Python's venv is missing; on Debian or Ubuntu: sudo apt install python3-venv"
        return 2
    fi
}

install() {
    if command -v uv >/dev/null 2>&1 && ! private_index "$1"; then
        rm -rf "$root/.venv"
        uv venv --quiet --python "$1" "$root/.venv"
        uv pip install --quiet --python "$root/.venv/bin/python" -c "$root/constraints.txt" -e "$root[dev]"
    else
        make_venv "$1" || return 2
        "$root/.venv/bin/python" -m pip install --quiet --disable-pip-version-check \
            -c "$root/constraints.txt" -e "$root[dev]"
    fi
}

stamp=$(cat "$root/pyproject.toml" "$root/constraints.txt" | cksum)
if [ "$(cat "$root/.venv/.stamp" 2>/dev/null)" != "$stamp" ] || ! runs "$root/.venv/bin/python"; then
    python=$(find_python) || exit 2
    say "setting up .venv with $python; this takes a minute, once"
    install "$python" || { code=$?; say "setting up failed"; exit "$code"; }
    echo "$stamp" >"$root/.venv/.stamp"
fi

case "${1:-}" in
    "") exec "$root/.venv/bin/palpate" run vase ;;
    test) shift; cd "$root"; exec .venv/bin/python -m pytest -n auto --dist worksteal "$@" ;;
    *) exec "$root/.venv/bin/palpate" "$@" ;;
esac
