#!/bin/sh
# Run the notebook of examples/, store it with its outputs, and write it as a page, .cache/tour.html. Jupyter lives in an environment of its own.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
jupyter="$root/.cache/jupyter"
[ -x "$jupyter/bin/jupyter" ] || { python -m venv --system-site-packages "$jupyter" &&
    "$jupyter/bin/pip" install --quiet nbconvert==7.16.6 ipykernel==6.29.5; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$root/examples/tour.ipynb" "$work"
cd "$work"
# the packages of the environment that calls this, beside Jupyter's
PYTHONPATH="$root:$(python -c 'import site; print(site.getsitepackages()[0])')" \
    "$jupyter/bin/jupyter" nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False tour.ipynb
"$jupyter/bin/jupyter" nbconvert --to html tour.ipynb --output-dir "$root/.cache"
cp tour.ipynb "$root/examples"
echo "examples/tour.ipynb, .cache/tour.html: written"
