#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace mapp {

/// A folder of its own for a tile cache, removed in the end.
class TestFolder {
 public:
  TestFolder();
  ~TestFolder();
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;

  std::string path() const { return path_.string(); }
  /// The one file of that name, "<16 hex digits of key>.<suffix>", in any folder below. Programmer's error: not there.
  std::filesystem::path Find(const std::string& suffix, uint64_t key) const;
  /// Flips a bit in its middle.
  void Spoil(const std::string& suffix, uint64_t key) const;
  /// Cuts it in half.
  void Truncate(const std::string& suffix, uint64_t key) const;
  /// From now on the folder cannot be used, whoever the user is.
  void ReplaceByFile() const;

 private:
  std::filesystem::path path_;
};

}  // namespace mapp
