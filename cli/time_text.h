#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <string>

namespace mapp {

/// A moment as people type it, in UTC, as Unix time in nanoseconds: `2026-11-23T15:00:00Z`, `2026-11-23 15:00:00` as
/// the tables print it (UTC as well), `2026-11-23` for that day's first moment, or Unix seconds. INVALID_ARGUMENT: none
/// of these, not in the calendar, or not after 1970-01-01T00:00:00Z, whose 0 stands for "not said" on the wire.
StatusOr<int64_t> ParseUnixTime(const std::string& text);

}  // namespace mapp
