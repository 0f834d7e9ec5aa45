#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace mapp {

/// Numbers and what they stand for, 16 bytes each. First filled, then sealed, then asked. One thread only.
class IdTable {
 public:
  void Add(uint64_t from, uint64_t to = 0) { entries_.emplace_back(from, to); }
  /// False when a number was added twice.
  bool Seal() {
    std::sort(entries_.begin(), entries_.end());
    const auto same = [](const Entry& a, const Entry& b) { return a.first == b.first; };
    return std::adjacent_find(entries_.begin(), entries_.end(), same) == entries_.end();
  }
  std::optional<uint64_t> Find(uint64_t from) const {
    const auto found = std::lower_bound(entries_.begin(), entries_.end(), Entry(from, 0));
    if (found == entries_.end() || found->first != from) return std::nullopt;
    return found->second;
  }
  bool Contains(uint64_t from) const { return Find(from).has_value(); }

 private:
  using Entry = std::pair<uint64_t, uint64_t>;
  std::vector<Entry> entries_;
};

}  // namespace mapp
