#include "test_folder.h"

#include "mapp/base/check.h"

#include <fmt/format.h>

#include <cstdlib>
#include <fstream>

namespace mapp {

namespace fs = std::filesystem;

TestFolder::TestFolder() {
  std::string pattern = (fs::temp_directory_path() / "mapp-tiles-XXXXXX").string();
  MAPP_CHECK(mkdtemp(pattern.data()) != nullptr);
  path_ = pattern;
}

TestFolder::~TestFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

fs::path TestFolder::Find(const std::string& suffix, uint64_t key) const {
  const std::string name = fmt::format("{:016x}.{}", key, suffix);
  for (const auto& entry : fs::recursive_directory_iterator(path_)) {
    if (entry.path().filename() == name) return entry.path();
  }
  MAPP_CHECK(false);
  return {};
}

void TestFolder::Spoil(const std::string& suffix, uint64_t key) const {
  const fs::path file = Find(suffix, key);
  const auto middle = static_cast<std::streamoff>(fs::file_size(file) / 2);
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekg(middle);
  const char spoiled = static_cast<char>(stream.get() ^ 4);
  stream.seekp(middle);
  stream.put(spoiled);
}

void TestFolder::Truncate(const std::string& suffix, uint64_t key) const {
  const fs::path file = Find(suffix, key);
  fs::resize_file(file, fs::file_size(file) / 2);
}

void TestFolder::ReplaceByFile() const {
  fs::remove_all(path_);
  std::ofstream(path_) << "in the way";
}

}  // namespace mapp
