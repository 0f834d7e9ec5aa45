#!/usr/bin/env bash
# Formats all C++ sources in place; with --check only tells which are not formatted.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

mode=(-i)
if [[ "${1:-}" == --check ]]; then mode=(--dry-run --Werror); fi
formatter="$(command -v clang-format-14 || command -v clang-format)" || {
  echo "format.sh: clang-format is not installed" >&2
  exit 1
}
git ls-files -z --cached --others --exclude-standard '*.h' '*.cc' | xargs -0 "$formatter" "${mode[@]}"
