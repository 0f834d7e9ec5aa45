#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

/// Structured logging for the edges (server, command line): one line an event, `key=value`. Libraries return facts
/// instead and do not link this.
namespace mapp::log {

enum class Level { kDebug, kInfo, kWarning, kError };

struct Field {
  std::string_view key;
  std::string value;
  Field(std::string_view k, std::string_view v) : key(k), value(v) {}
  Field(std::string_view k, const char* v) : key(k), value(v) {}
  Field(std::string_view k, const std::string& v) : key(k), value(v) {}
  Field(std::string_view k, double v);
  Field(std::string_view k, bool v) : key(k), value(v ? "true" : "false") {}
  template <typename T>
  requires std::is_integral_v<T> Field(std::string_view k, T v) : key(k), value(std::to_string(v)) {}
};

/// To standard error: `2026-01-31T12:00:00.123Z INFO event key=value ...`; values with spaces are quoted.
void Write(Level level, std::string_view event, std::initializer_list<Field> fields = {});
inline void Info(std::string_view event, std::initializer_list<Field> fields = {}) {
  Write(Level::kInfo, event, fields);
}
inline void Warning(std::string_view event, std::initializer_list<Field> fields = {}) {
  Write(Level::kWarning, event, fields);
}
inline void Error(std::string_view event, std::initializer_list<Field> fields = {}) {
  Write(Level::kError, event, fields);
}
inline void Debug(std::string_view event, std::initializer_list<Field> fields = {}) {
  Write(Level::kDebug, event, fields);
}
/// "debug", "info", "warning", "error"; false for another word.
bool SetLevel(std::string_view name);

}  // namespace mapp::log
