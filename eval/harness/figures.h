#pragma once

#include "mapp/base/status.h"

#include <map>
#include <optional>
#include <string>

namespace mapp {

/// The numbers of a JSON report by path: {"cpu": {"process_s": 1}} has "cpu.process_s". Truths count as 0 and 1; an
/// element of an array goes by its "name", "method" or "step", else by its index. Texts and nulls are left out.
class Figures {
 public:
  /// DATA_LOSS naming `what` when the text is no JSON.
  static StatusOr<Figures> Parse(const std::string& json, const std::string& what);

  std::optional<double> Get(const std::string& path) const;
  void Set(const std::string& path, double value) { values_[path] = value; }
  const std::map<std::string, double>& values() const { return values_; }

 private:
  std::map<std::string, double> values_;
};

}  // namespace mapp
