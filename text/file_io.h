#pragma once

#include "mapp/base/status.h"

#include <ostream>
#include <string>
#include <string_view>

namespace mapp {

/// Writes the whole file, or the stream `out` when `file` is "-". The error names the file and the reason; a file that
/// could not be written whole is removed.
Status WriteOutput(const std::string& file, std::string_view content, std::ostream& out);
/// NOT_FOUND naming the file when it cannot be opened.
StatusOr<std::string> ReadInput(const std::string& file);

}  // namespace mapp
