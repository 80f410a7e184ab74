#!/usr/bin/env bash
# What every commit must pass, in about a minute: style, types, the order of the rooms, unit tests of what changed.
# What changed: files that differ from the last commit; in a clean checkout, those of the last commit.
set -euo pipefail
cd "$(dirname "$0")/.."

ruff format --check --quiet .
ruff check --quiet .
mypy --no-error-summary
lint-imports --no-logo --cache-dir .cache/import_linter
snakefmt --check Snakefile rules studies/Snakefile 2>/dev/null || { echo 'rules: make format' && exit 1; }

changed=$(git diff --name-only HEAD; git ls-files --others --exclude-standard)
[[ $changed ]] || changed=$(git diff --name-only HEAD~1)

# tests that changed, and those that import a changed module by its name
tests=()
for file in $changed; do
    case $file in
        tests/integration/* | tests/studies/*) ;;
        tests/*/test_*.py) [[ -e $file ]] && tests+=("$file") ;;
        cortet/*.py)
            module=${file%.py}
            module=${module%/__init__}
            room=${module%/*}
            pattern="(from|import) ${module//\//.}( |$)|from ${room//\//.} import .*\\b${module##*/}\\b"
            mapfile -t importing < <(grep -lE "$pattern" tests/*/test_*.py | grep -vE "^tests/(integration|studies)" || true)
            tests+=("${importing[@]}")
            ;;
    esac
done
((${#tests[@]})) || { echo "check: no unit test is about what changed"; exit 0; }
mapfile -t tests < <(printf '%s\n' "${tests[@]}" | sort -u)
pytest --quiet --deselect tests/house/test_style.py "${tests[@]}"
