#include "text/file_io.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <system_error>

namespace mapp {
namespace {

std::string ErrnoText() { return std::generic_category().message(errno); }

}  // namespace

Status WriteOutput(const std::string& file, std::string_view content, std::ostream& out) {
  if (file == "-") {
    out << content << std::flush;
    return out.good() ? absl::OkStatus() : absl::DataLossError("standard output: write failed");
  }
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  if (!stream) return absl::FailedPreconditionError(fmt::format("{}: cannot be created: {}", file, ErrnoText()));
  stream << content;
  stream.close();
  if (!stream) {
    const std::string reason = ErrnoText();
    std::remove(file.c_str());
    return absl::DataLossError(fmt::format("{}: write failed: {}", file, reason));
  }
  return absl::OkStatus();
}

StatusOr<std::string> ReadInput(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return absl::NotFoundError(fmt::format("{}: cannot be opened: {}", file, ErrnoText()));
  std::ostringstream content;
  content << stream.rdbuf();
  if (stream.bad() || content.bad()) return absl::DataLossError(fmt::format("{}: read failed", file));
  return std::move(content).str();
}

}  // namespace mapp
