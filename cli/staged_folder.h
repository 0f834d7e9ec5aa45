#pragma once

#include "mapp/base/status.h"

#include <filesystem>
#include <string>
#include <vector>

namespace mapp {

/// A folder that appears whole or not at all: it is filled under another name beside its place and renamed at the end.
/// Without Commit() everything is removed again, the folders above it that had to be made included.
class StagedFolder {
 public:
  /// ALREADY_EXISTS: something other than an empty folder is there. FAILED_PRECONDITION: it cannot be made.
  static StatusOr<StagedFolder> Create(const std::string& folder);
  ~StagedFolder();
  StagedFolder(StagedFolder&& other) noexcept;
  StagedFolder& operator=(StagedFolder&&) = delete;

  /// Where to write.
  const std::filesystem::path& path() const { return staging_; }
  /// Puts the folder in its place. FAILED_PRECONDITION: something came there in the meantime.
  Status Commit();

 private:
  StagedFolder(std::filesystem::path target, std::filesystem::path staging,
               std::vector<std::filesystem::path> made_parents);

  std::filesystem::path target_;
  std::filesystem::path staging_;                    ///< empty: nothing to clear away
  std::vector<std::filesystem::path> made_parents_;  ///< outermost first
};

}  // namespace mapp
