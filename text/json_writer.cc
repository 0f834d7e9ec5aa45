#include "text/json_writer.h"

#include "mapp/base/check.h"

#include <fmt/format.h>

#include <cmath>

namespace mapp {
namespace {

/// Length of the well-formed UTF-8 sequence at the start of `text` (Unicode 15, table 3-7); 0 when there is none.
size_t Utf8SequenceLength(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<uint8_t>(text[i]); };
  const uint8_t lead = byte(0);
  if (lead < 0x80) return 1;
  const size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : 2;
  if (lead < 0xC2 || lead > 0xF4 || text.size() < length) return 0;
  for (size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
  }
  const bool overlong = (lead == 0xE0 && byte(1) < 0xA0) || (lead == 0xF0 && byte(1) < 0x90);
  const bool surrogate = lead == 0xED && byte(1) > 0x9F;
  const bool beyond_unicode = lead == 0xF4 && byte(1) > 0x8F;
  return overlong || surrogate || beyond_unicode ? 0 : length;
}

std::string Escaped(std::string_view text) {
  std::string escaped = "\"";
  while (!text.empty()) {
    const size_t length = Utf8SequenceLength(text);
    const char c = text.front();
    if (length == 0) {
      escaped += "\\ufffd";
    } else if (c == '"' || c == '\\') {
      escaped += {'\\', c};
    } else if (c == '\n') {
      escaped += "\\n";
    } else if (length == 1 && c < 0x20) {
      escaped += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      escaped += text.substr(0, length);
    }
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return escaped + '"';
}

}  // namespace

JsonWriter& JsonWriter::BeginObject() { return Begin(true); }
JsonWriter& JsonWriter::EndObject() { return End(true); }
JsonWriter& JsonWriter::BeginArray() { return Begin(false); }
JsonWriter& JsonWriter::EndArray() { return End(false); }

JsonWriter& JsonWriter::Key(std::string_view key) {
  MAPP_CHECK(!levels_.empty() && levels_.back().is_object && !after_key_);
  BeforeItem();
  text_ += Escaped(key) + ": ";
  after_key_ = true;
  return *this;
}

JsonWriter& JsonWriter::Value(std::string_view text) { return Literal(Escaped(text)); }

JsonWriter& JsonWriter::Value(double number) {
  return std::isfinite(number) ? Literal(fmt::format("{}", number)) : Null();
}

JsonWriter& JsonWriter::Value(float number) {
  return std::isfinite(number) ? Literal(fmt::format("{}", number)) : Null();
}

std::string JsonWriter::Finish() && {
  MAPP_CHECK(levels_.empty() && !text_.empty());
  return std::move(text_) + "\n";
}

JsonWriter& JsonWriter::Literal(std::string_view text) {
  MAPP_CHECK(after_key_ || levels_.empty() || !levels_.back().is_object);
  BeforeItem();
  text_ += text;
  after_key_ = false;
  return *this;
}

JsonWriter& JsonWriter::Begin(bool is_object) {
  Literal(is_object ? "{" : "[");
  levels_.push_back({is_object, true});
  return *this;
}

JsonWriter& JsonWriter::End(bool is_object) {
  MAPP_CHECK(!levels_.empty() && levels_.back().is_object == is_object && !after_key_);
  const bool was_empty = levels_.back().is_empty;
  levels_.pop_back();
  if (!was_empty) NewLine();
  text_ += is_object ? '}' : ']';
  return *this;
}

void JsonWriter::BeforeItem() {
  if (after_key_) return;
  if (levels_.empty()) {
    MAPP_CHECK(text_.empty());
    return;
  }
  if (!levels_.back().is_empty) text_ += ',';
  levels_.back().is_empty = false;
  NewLine();
}

void JsonWriter::NewLine() {
  text_ += '\n';
  text_.append(2 * levels_.size(), ' ');
}

}  // namespace mapp
