#!/usr/bin/env bash
# Runs clang-tidy over the project's sources, or over those given. Needs a configured build folder:
#   tools/tidy.sh [FILE.cc...]      MAPP_BUILD_DIR=DIR chooses the build folder; default build/release
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

build_dir="${MAPP_BUILD_DIR:-build/release}"
if [[ ! -f "$build_dir/compile_commands.json" ]]; then
  echo "tidy.sh: $build_dir is not configured; run scripts/build first" >&2
  exit 1
fi
tidy="$(command -v clang-tidy-14 || command -v clang-tidy)" || {
  echo "tidy.sh: clang-tidy is not installed" >&2
  exit 1
}
if [[ $# -gt 0 ]]; then
  printf '%s\0' "$@"
else
  git ls-files -z '*.cc'
fi | xargs -0 -n 1 -P "$(nproc)" "$tidy" -p "$build_dir" --quiet
