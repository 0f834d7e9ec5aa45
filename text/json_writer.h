#pragma once

#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mapp {

/// Writes one JSON document (RFC 8259), indented by two spaces. Calls must nest properly and an object's values must
/// follow a Key: that is checked, as a programmer's error.
class JsonWriter {
 public:
  JsonWriter& BeginObject();
  JsonWriter& EndObject();
  JsonWriter& BeginArray();
  JsonWriter& EndArray();
  JsonWriter& Key(std::string_view key);

  /// Bytes that are not UTF-8 are written as U+FFFD.
  JsonWriter& Value(std::string_view text);
  JsonWriter& Value(const std::string& text) { return Value(std::string_view(text)); }
  JsonWriter& Value(const char* text) { return Value(std::string_view(text)); }
  /// The shortest digits that read back as the same number; null when it is not finite, which JSON cannot say.
  JsonWriter& Value(double number);
  JsonWriter& Value(float number);
  JsonWriter& Value(std::same_as<bool> auto truth) { return Literal(truth ? "true" : "false"); }
  template <std::integral T>
  requires(!std::same_as<T, bool>) JsonWriter& Value(T number) { return Literal(std::to_string(number)); }
  template <typename T>
  JsonWriter& Value(const std::optional<T>& value) {
    return value.has_value() ? Value(*value) : Null();
  }
  JsonWriter& Null() { return Literal("null"); }

  template <typename T>
  JsonWriter& Field(std::string_view key, const T& value) {
    return Key(key).Value(value);
  }

  /// The finished document, ending in a newline.
  std::string Finish() &&;

 private:
  struct Level {
    bool is_object = false;
    bool is_empty = true;
  };

  JsonWriter& Literal(std::string_view text);
  JsonWriter& Begin(bool is_object);
  JsonWriter& End(bool is_object);
  /// Puts the comma and the line break before a value or a key.
  void BeforeItem();
  void NewLine();

  std::string text_;
  std::vector<Level> levels_;
  bool after_key_ = false;
};

}  // namespace mapp
