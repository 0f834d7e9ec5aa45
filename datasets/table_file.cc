#include "datasets/table_file.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>

namespace mapp {
namespace {

constexpr std::string_view kBlanks = " \t\r";
constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;
constexpr int64_t kMaxSeconds = 9'000'000'000;

std::string_view Trim(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

std::vector<std::string> SplitAtBlanks(std::string_view text) {
  std::vector<std::string> fields;
  size_t begin = text.find_first_not_of(kBlanks);
  while (begin != std::string_view::npos) {
    const size_t end = std::min(text.find_first_of(kBlanks, begin), text.size());
    fields.emplace_back(text.substr(begin, end - begin));
    begin = text.find_first_not_of(kBlanks, end);
  }
  return fields;
}

std::vector<std::string> SplitAt(std::string_view text, char separator) {
  std::vector<std::string> fields;
  for (;;) {
    const size_t end = text.find(separator);
    fields.emplace_back(Trim(text.substr(0, end)));
    if (end == std::string_view::npos) return fields;
    text.remove_prefix(end + 1);
  }
}

template <typename T>
std::optional<T> ParseWhole(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

Status BadLine(const std::string& file, int line, const std::string& problem) {
  return absl::InvalidArgumentError(fmt::format("{}:{}: {}", file, line, problem));
}

StatusOr<std::vector<TableRow>> ReadTable(const std::string& file, char separator, size_t min_fields) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return absl::NotFoundError(fmt::format("{}: no such file", file));
  std::ifstream stream(file);
  if (!stream) return absl::DataLossError(fmt::format("{}: cannot be read", file));
  std::vector<TableRow> rows;
  std::string line;
  for (int line_number = 1; std::getline(stream, line); ++line_number) {
    const std::string_view text = Trim(line);
    if (text.empty() || text.front() == '#') continue;
    TableRow row{line_number, separator == ' ' ? SplitAtBlanks(text) : SplitAt(text, separator)};
    if (row.fields.size() < min_fields) {
      return BadLine(file, line_number, fmt::format("{} fields expected, got {}", min_fields, row.fields.size()));
    }
    rows.push_back(std::move(row));
  }
  if (stream.bad()) return absl::DataLossError(fmt::format("{}: cannot be read", file));
  return rows;
}

std::optional<double> ParseNumber(std::string_view text) {
  const std::optional<double> value = ParseWhole<double>(text);
  if (!value || !std::isfinite(*value)) return std::nullopt;
  return value;
}

std::optional<int64_t> ParseNanoseconds(std::string_view text) {
  const std::optional<int64_t> value = ParseWhole<int64_t>(text);
  if (!value || *value < 0 || *value > kMaxSeconds * kNanosecondsPerSecond) return std::nullopt;
  return value;
}

std::optional<int64_t> ParseSeconds(std::string_view text) {
  const size_t point = std::min(text.find('.'), text.size());
  const std::optional<int64_t> seconds = ParseWhole<int64_t>(text.substr(0, point));
  if (!seconds || *seconds < 0 || *seconds > kMaxSeconds) return std::nullopt;
  std::string decimals(text.substr(std::min(point + 1, text.size())));
  if (decimals.find_first_not_of("0123456789") != std::string::npos) return std::nullopt;
  decimals.resize(9, '0');
  return *seconds * kNanosecondsPerSecond + *ParseWhole<int64_t>(decimals);
}

}  // namespace mapp
