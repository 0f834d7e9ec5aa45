#include "cli/staged_folder.h"

#include <fmt/format.h>

#include <system_error>
#include <unistd.h>
#include <utility>

namespace mapp {
namespace {

namespace fs = std::filesystem;

Status Failed(const fs::path& folder, const std::error_code& error) {
  return absl::FailedPreconditionError(fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
}

void RemoveEmpty(const std::vector<fs::path>& folders) {
  std::error_code ignored;  // one that is not empty belongs to somebody else by now
  for (size_t i = folders.size(); i-- > 0;) fs::remove(folders[i], ignored);
}

}  // namespace

StatusOr<StagedFolder> StagedFolder::Create(const std::string& folder) {
  std::error_code error;
  if (folder.empty()) return absl::InvalidArgumentError("the folder needs a name");
  fs::path target = fs::absolute(folder, error).lexically_normal();
  if (error) return Failed(folder, error);
  if (!target.has_filename()) target = target.parent_path();  // it ended in a slash
  const bool is_there = fs::exists(fs::symlink_status(target, error));
  const bool is_empty_folder = is_there && fs::is_directory(target, error) && fs::is_empty(target, error);
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory) {
    return Failed(target, error);
  }
  if (is_there && !is_empty_folder) {
    return absl::AlreadyExistsError(fmt::format("{}: exists and is not an empty folder", target.string()));
  }
  std::vector<fs::path> made_parents;
  for (fs::path parent = target.parent_path(); !fs::exists(parent, error) && parent.has_relative_path();
       parent = parent.parent_path()) {
    made_parents.insert(made_parents.begin(), parent);
  }
  const fs::path staging = target.parent_path() / fmt::format(".{}.partial-{}", target.filename().string(), getpid());
  fs::create_directories(target.parent_path(), error);
  if (!error) fs::create_directory(staging, error);
  if (error) {
    RemoveEmpty(made_parents);
    return Failed(target, error);
  }
  return StagedFolder(std::move(target), staging, std::move(made_parents));
}

StagedFolder::StagedFolder(fs::path target, fs::path staging, std::vector<fs::path> made_parents)
    : target_(std::move(target)), staging_(std::move(staging)), made_parents_(std::move(made_parents)) {}

StagedFolder::StagedFolder(StagedFolder&& other) noexcept
    : target_(std::move(other.target_)),
      staging_(std::exchange(other.staging_, fs::path())),
      made_parents_(std::move(other.made_parents_)) {}

StagedFolder::~StagedFolder() {
  if (staging_.empty()) return;
  std::error_code ignored;
  fs::remove_all(staging_, ignored);
  RemoveEmpty(made_parents_);
}

Status StagedFolder::Commit() {
  std::error_code error;
  fs::rename(staging_, target_, error);  // also onto an empty folder
  if (error) return Failed(target_, error);
  staging_.clear();
  return absl::OkStatus();
}

}  // namespace mapp
