#!/bin/sh
# Pins everything that pyproject.toml asks for, and what that needs in turn, for every supported Python at once: in
# requirements.txt what every environment has, in requirements-dev.txt what developers need, in requirements-optional.txt
# what some tests use besides. Versions already there are kept where they still fit; `make lock UPGRADE=1` takes the newest.
set -eu
cd "$(dirname "$0")/.."

uv=.cache/lock/bin/uv
[ -x $uv ] || { .venv/bin/python -m venv .cache/lock && .cache/lock/bin/pip install --quiet uv; }
pin() {
    UV_CUSTOM_COMPILE_COMMAND="make lock" $uv pip compile --quiet --universal --python-version 3.11 \
        ${UPGRADE:+--upgrade} --no-annotate "$@"
}
pin --extra published --group build pyproject.toml -o requirements.txt
pin --group dev pyproject.toml -c requirements.txt -o requirements-dev.txt
pin --extra baselines --extra slurm pyproject.toml -c requirements.txt -o requirements-optional.txt
