#!/bin/sh
# Run every script of examples/ in a folder of its own, and keep its picture for the page of the gallery.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$root/docs/gallery"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
for script in "$root"/examples/*.py; do
    echo "$(basename "$script")"
    python "$script"
done
python - "$root/docs/gallery" <<'END'
import sys
from pathlib import Path

import PIL.Image

for path in Path().glob("*.png"):
    picture = PIL.Image.open(path).convert("RGB")
    picture.thumbnail((1000, 1000))
    picture.save(Path(sys.argv[1], path.name), optimize=True)
END
