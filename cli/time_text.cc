#include "cli/time_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <limits>
#include <optional>
#include <string_view>
#include <system_error>

namespace mapp {
namespace {

/// The number that a text of digits alone says.
std::optional<int64_t> ParseDigits(std::string_view text) {
  if (text.empty() || !std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; })) return std::nullopt;
  int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc()) return std::nullopt;
  return number;
}

/// Of texts as long as `pattern`, with digits where it has `d` and else what it has: the numbers between.
std::optional<std::array<int, 6>> ParseFields(std::string_view text, std::string_view pattern) {
  if (text.size() != pattern.size()) return std::nullopt;
  std::array<int, 6> fields = {};
  size_t field = 0;
  for (size_t i = 0; i < text.size(); ++i) {
    if (pattern[i] == 'd') {
      if (text[i] < '0' || text[i] > '9') return std::nullopt;
      fields[field] = 10 * fields[field] + (text[i] - '0');
      continue;
    }
    if (text[i] != pattern[i]) return std::nullopt;
    ++field;
  }
  return fields;
}

/// Unix seconds of a moment of the calendar.
std::optional<int64_t> ParseCalendarSeconds(std::string_view text) {
  for (const std::string_view pattern : {"dddd-dd-ddTdd:dd:ddZ", "dddd-dd-dd dd:dd:dd", "dddd-dd-dd"}) {
    const std::optional<std::array<int, 6>> fields = ParseFields(text, pattern);
    if (!fields) continue;
    const auto [year, month, day, hour, minute, second] = *fields;
    const std::chrono::year_month_day date(std::chrono::year(year), std::chrono::month(static_cast<unsigned>(month)),
                                           std::chrono::day(static_cast<unsigned>(day)));
    if (!date.ok() || hour > 23 || minute > 59 || second > 59) return std::nullopt;
    const int64_t days = std::chrono::sys_days(date).time_since_epoch().count();
    return ((days * 24 + hour) * 60 + minute) * 60 + second;
  }
  return std::nullopt;
}

}  // namespace

StatusOr<int64_t> ParseUnixTime(const std::string& text) {
  constexpr int64_t kNsPerSecond = 1'000'000'000;
  std::optional<int64_t> seconds = ParseDigits(text);
  if (!seconds) seconds = ParseCalendarSeconds(text);
  if (!seconds) {
    return absl::InvalidArgumentError(fmt::format(
        "{} is no time: give 2026-11-23T15:00:00Z, 2026-11-23 (its first moment), both UTC, or Unix seconds", text));
  }
  if (*seconds <= 0 || *seconds > std::numeric_limits<int64_t>::max() / kNsPerSecond) {
    return absl::InvalidArgumentError(
        fmt::format("{} is out of range: give a time after 1970-01-01T00:00:00Z and before 2262", text));
  }
  return *seconds * kNsPerSecond;
}

}  // namespace mapp
