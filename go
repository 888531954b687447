#!/bin/sh
# ./go          set up, then explore the vase
# ./go test     set up, then run the tests
# ./go VERB     set up, then palpate VERB
set -eu
cd "$(dirname "$0")"
unset PYTHONPATH PYTHONHOME  # a sourced ROS 2 puts packages called launch on the path

say() { echo "palpate: $*" >&2; }

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
    rm -rf .venv
    if ! "$1" -m venv .venv >/dev/null 2>&1; then
        rm -rf .venv
        say "Python's venv is missing; on Debian or Ubuntu: sudo apt install python3-venv"
        return 2
    fi
}

install() {
    if command -v uv >/dev/null 2>&1 && ! private_index "$1"; then
        rm -rf .venv
        uv venv --quiet --python "$1" .venv
        uv pip install --quiet --python .venv/bin/python -c constraints.txt -e '.[dev]'
    else
        make_venv "$1" || return 2
        .venv/bin/python -m pip install --quiet --disable-pip-version-check \
            -c constraints.txt -e '.[dev]'
    fi
}

stamp=$(cat pyproject.toml constraints.txt | cksum)
if [ "$(cat .venv/.stamp 2>/dev/null)" != "$stamp" ] || ! runs .venv/bin/python; then
    python=$(find_python) || exit 2
    say "setting up .venv with $python; this takes a minute, once"
    install "$python" || { code=$?; say "setting up failed"; exit "$code"; }
    echo "$stamp" >.venv/.stamp
fi

case "${1:-}" in
    "") exec .venv/bin/palpate run vase ;;
    test) shift; exec .venv/bin/python -m pytest "$@" ;;
    *) exec .venv/bin/palpate "$@" ;;
esac
