#include "datasets/sequence.h"

#include "datasets/recorded_sequence.h"

#include <fmt/format.h>

#include <filesystem>

namespace mapp {
namespace {

namespace fs = std::filesystem;

/// The last part of the path, also for "kitchen/a/" and ".".
std::string FolderName(const std::string& folder) {
  std::error_code error;
  fs::path path = fs::canonical(folder, error);
  if (error) path = folder;
  return path.filename().string();
}

StatusOr<SequenceIndex> ReadIndex(const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) return absl::NotFoundError(fmt::format("{}: no such folder", folder));
  if (fs::exists(fs::path(folder) / "rgb.txt", error)) return ReadTumIndex(folder);
  if (fs::is_directory(fs::path(folder) / "mav0" / "cam0", error)) return ReadEurocIndex(folder);
  return absl::NotFoundError(
      fmt::format("{}: no sequence here: neither rgb.txt (TUM) nor mav0/cam0 (EuRoC) is in it", folder));
}

}  // namespace

StatusOr<std::unique_ptr<Sequence>> OpenSequence(const std::string& folder) {
  MAPP_ASSIGN_OR_RETURN(SequenceIndex index, ReadIndex(folder));
  index.name = FolderName(folder);
  return std::make_unique<RecordedSequence>(std::move(index));
}

}  // namespace mapp
