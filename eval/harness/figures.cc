#include "eval/harness/figures.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace mapp {
namespace {

using Json = nlohmann::json;

std::string NameOf(const Json& element, size_t index) {
  for (const char* key : {"name", "method", "step"}) {
    if (element.is_object() && element.contains(key) && element[key].is_string()) return element[key];
  }
  return std::to_string(index);
}

void Flatten(const Json& value, const std::string& path, Figures& figures) {
  const auto below = [&](const std::string& name) { return path.empty() ? name : path + "." + name; };
  if (value.is_number()) {
    figures.Set(path, value.get<double>());
  } else if (value.is_boolean()) {
    figures.Set(path, value.get<bool>() ? 1 : 0);
  } else if (value.is_object()) {
    for (const auto& [key, child] : value.items()) Flatten(child, below(key), figures);
  } else if (value.is_array()) {
    for (size_t i = 0; i < value.size(); ++i) Flatten(value[i], below(NameOf(value[i], i)), figures);
  }
}

}  // namespace

StatusOr<Figures> Figures::Parse(const std::string& json, const std::string& what) {
  const Json document = Json::parse(json, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (document.is_discarded()) return absl::DataLossError(fmt::format("{}: no JSON", what));
  Figures figures;
  Flatten(document, "", figures);
  return figures;
}

std::optional<double> Figures::Get(const std::string& path) const {
  const auto found = values_.find(path);
  if (found == values_.end()) return std::nullopt;
  return found->second;
}

}  // namespace mapp
