# shellcheck shell=bash
# Sourced by the scripts beside it: where things are, and how to speak.

# The caller may stand in any folder; relative arguments of the caller stay the caller's.
repo_dir="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
readonly repo_dir
readonly build_dir="$repo_dir/build/release"
# shellcheck disable=SC2034  # used by the scripts that source this file
readonly bin_dir="$build_dir/bin"

say() { printf '\n== %s\n' "$*" >&2; }
die() {
  printf '%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 1
}

# Configures build/release when that was not done yet. The build itself notices changed CMake files.
configure_release() {
  if [[ ! -f "$build_dir/build.ninja" ]]; then
    mkdir -p "$repo_dir/build"
    (cd "$repo_dir" && cmake --preset release >"$build_dir.configure.log" 2>&1) || {
      tail -n 30 "$build_dir.configure.log" >&2
      die "configuring failed; the whole log is $build_dir.configure.log"
    }
  fi
}
