#include "tests/unit/storage/fault_disk.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <sys/stat.h>

namespace mapp {
namespace {

namespace fs = std::filesystem;

constexpr size_t kSectorBytes = 512;

std::string ReadWhole(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

}  // namespace

class FaultDisk::Inode {
 public:
  /// A write, or a truncation to `offset`.
  struct Change {
    int64_t offset = 0;
    std::string bytes;
    bool truncates = false;
  };

  Inode(std::string content, const std::string& file_name) : name(file_name), kept(std::move(content)) { Look(); }

  /// At the file that it stands for.
  void Look() {
    struct stat facts {};
    stat(name.c_str(), &facts);
    device = facts.st_dev;
    id = facts.st_ino;
    size = static_cast<int64_t>(kept.size());
  }

  void Keep(const Change& change) {
    const auto offset = static_cast<size_t>(change.offset);
    if (change.truncates) return kept.resize(offset);
    kept.resize(std::max(kept.size(), offset + change.bytes.size()));
    kept.replace(offset, change.bytes.size(), change.bytes);
  }
  void KeepAll() {
    for (const Change& change : pending) Keep(change);
    pending.clear();
  }

  std::string name;
  std::string kept;
  std::vector<Change> pending;
  int64_t size = 0;  ///< as the running system sees it
  dev_t device = 0;
  ino_t id = 0;
};

void FaultDisk::Start(const std::string& folder) {
  const MutexLock lock(mutex_);
  folder_ = folder;
  fault_ = {};
  num_operations_ = num_syncs_ = 0;
  operations_.clear();
  struck_.clear();
  is_off_ = keeps_all_ = false;
  names_.clear();
  pending_names_.clear();
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().string();
    names_[name] = std::make_shared<Inode>(ReadWhole(name), name);
  }
  kept_names_ = names_;
}

void FaultDisk::Insert(const DiskFault& fault) {
  const MutexLock lock(mutex_);
  fault_ = fault;
  rng_ = Rng(fault.seed);
  num_operations_ = num_syncs_ = 0;
  operations_.clear();
  struck_.clear();
}

void FaultDisk::Heal() {
  const MutexLock lock(mutex_);
  fault_.kind = DiskFault::Kind::kNone;
}

void FaultDisk::CutPower() {
  const MutexLock lock(mutex_);
  is_off_ = true;
}

int64_t FaultDisk::num_operations() {
  const MutexLock lock(mutex_);
  return num_operations_;
}

std::vector<std::string> FaultDisk::operations() {
  const MutexLock lock(mutex_);
  return operations_;
}

int64_t FaultDisk::num_syncs() {
  const MutexLock lock(mutex_);
  return num_syncs_;
}

bool FaultDisk::is_off() {
  const MutexLock lock(mutex_);
  return is_off_;
}

std::string FaultDisk::struck() {
  const MutexLock lock(mutex_);
  return struck_;
}

void FaultDisk::Reboot() {
  const MutexLock lock(mutex_);
  size_t num_kept = keeps_all_ ? pending_names_.size() : rng_.Below(pending_names_.size() + 1);
  for (const NameChange& change : pending_names_) {
    if (num_kept == 0) break;
    --num_kept;
    for (const auto& [name, file] : change) kept_names_[name] = file;
  }
  std::erase_if(kept_names_, [](const auto& entry) { return entry.second == nullptr; });
  for (const auto& [name, file] : names_) {
    if (!kept_names_.contains(name)) fs::remove(name);
  }
  for (const auto& [name, file] : kept_names_) {
    if (keeps_all_) {
      file->KeepAll();
    } else {
      KeepSome(*file);
    }
    std::ofstream(name, std::ios::binary | std::ios::trunc) << file->kept;
    file->name = name;
    file->Look();
  }
  names_ = kept_names_;
  pending_names_.clear();
  fault_ = {};
  is_off_ = keeps_all_ = false;
}

void FaultDisk::KeepSome(Inode& file) {
  // Now and then all or none of a file: what a system does that writes back in order, or late.
  const double share = std::clamp(rng_.Uniform(-0.3, 1.3), 0.0, 1.0);
  for (const Inode::Change& change : file.pending) {
    if (rng_.Uniform() < share) {
      file.Keep(change);
    } else if (!change.truncates && rng_.Below(2) == 0) {
      const auto begin = static_cast<size_t>(change.offset);
      for (size_t at = begin; at < begin + change.bytes.size();) {
        const size_t end = std::min((at / kSectorBytes + 1) * kSectorBytes, begin + change.bytes.size());
        if (rng_.Uniform() < share) {
          file.Keep({.offset = static_cast<int64_t>(at), .bytes = change.bytes.substr(at - begin, end - at)});
        }
        at = end;
      }
    }
  }
  file.pending.clear();
}

void FaultDisk::Strike(const char* what, const std::string& name) {
  if (!struck_.empty()) return;
  struck_ = fmt::format("operation {}, {}", num_operations_ - 1, Describe(what, name));
}

std::string FaultDisk::Describe(const char* what, const std::string& name) const {
  return fmt::format("{} {}", what, name == folder_ ? "the folder" : fs::path(name).filename().string());
}

/// Counts an operation. What a full disk and a short write mean is for Write to say.
FaultDisk::Error FaultDisk::Operate(const char* what, const std::string& name) {
  const int64_t number = num_operations_++;
  switch (fault_.kind) {
    case DiskFault::Kind::kNone:
      operations_.push_back(Describe(what, name));
      break;
    case DiskFault::Kind::kFail:
      if (number != fault_.at) break;
      Strike(what, name);
      return Error::kIo;
    case DiskFault::Kind::kFailFrom:
      if (number < fault_.at) break;
      Strike(what, name);
      return Error::kIo;
    case DiskFault::Kind::kPowerCut:
      if (number < fault_.at) break;
      Strike(what, name);
      is_off_ = true;
      break;
    default:
      break;
  }
  return is_off_ ? Error::kIo : Error::kNone;
}

FaultDisk::Error FaultDisk::Open(const std::string& name) {
  const MutexLock lock(mutex_);
  return Operate("open", name);
}

FaultDisk::File FaultDisk::Opened(const std::string& name) {
  const MutexLock lock(mutex_);
  if (fs::path(name).parent_path() != folder_) throw std::logic_error(name + " is not on the disk");
  struct stat facts {};
  stat(name.c_str(), &facts);
  const auto found = names_.find(name);
  File file = found != names_.end() ? found->second : nullptr;
  if (file == nullptr || file->id != facts.st_ino) {
    // Made just now, or another in the place of one that was removed past this disk.
    file = std::make_shared<Inode>("", name);
    ChangeNames({{name, file}});
  }
  if (file->size != facts.st_size) {
    // So was its content: who makes a copy claims an empty file first.
    file->pending.push_back({.offset = 0, .bytes = {}, .truncates = true});
    file->pending.push_back({.offset = 0, .bytes = ReadWhole(name)});
    file->size = facts.st_size;
  }
  return file;
}

void FaultDisk::ChangeNames(NameChange change) {
  for (const auto& [name, file] : change) {
    if (file != nullptr) {
      names_[name] = file;
    } else {
      names_.erase(name);
    }
  }
  pending_names_.push_back(std::move(change));
}

FaultDisk::Error FaultDisk::Remove(const std::string& name) {
  const MutexLock lock(mutex_);
  if (const Error error = Operate("delete", name); error != Error::kNone) return error;
  if (names_.contains(name)) ChangeNames({{name, nullptr}});
  return Error::kNone;
}

void FaultDisk::Removed(const std::string& name) {
  const MutexLock lock(mutex_);
  if (!is_off_ && names_.contains(name)) ChangeNames({{name, nullptr}});
}

FaultDisk::Error FaultDisk::Rename(const std::string& from, const std::string& to) {
  const MutexLock lock(mutex_);
  const auto found = names_.find(from);
  if (found == names_.end()) return Error::kNone;
  if (const Error error = Operate("rename", from); error != Error::kNone) return error;
  const File file = found->second;
  file->name = to;
  ChangeNames({{from, nullptr}, {to, file}});
  return Error::kNone;
}

FaultDisk::Error FaultDisk::SyncNames() {
  const MutexLock lock(mutex_);
  if (const Error error = Operate("sync", folder_); error != Error::kNone) return error;
  if (fault_.ignores_syncs) return Error::kNone;
  for (const NameChange& change : pending_names_) {
    for (const auto& [name, file] : change) kept_names_[name] = file;
  }
  std::erase_if(kept_names_, [](const auto& entry) { return entry.second == nullptr; });
  pending_names_.clear();
  return Error::kNone;
}

FaultDisk::File FaultDisk::Find(dev_t device, ino_t id) {
  const MutexLock lock(mutex_);
  for (const auto& [name, file] : names_) {
    if (file->device == device && file->id == id) return file;
  }
  return nullptr;
}

FaultDisk::Error FaultDisk::Read(const File& file) {
  const MutexLock lock(mutex_);
  return Operate("read", file != nullptr ? file->name : "a temporary file");
}

FaultDisk::Error FaultDisk::Write(const File& file, int64_t offset, std::string_view bytes, size_t* num_bytes) {
  const MutexLock lock(mutex_);
  const std::string name = file != nullptr ? file->name : "a temporary file";
  const bool was_off = is_off_;
  Error error = Operate("write", name);
  *num_bytes = bytes.size();
  if (error == Error::kNone && num_operations_ > fault_.at) {
    if (fault_.kind == DiskFault::Kind::kShortWrite) {
      is_off_ = keeps_all_ = true;
      error = Error::kIo;
    } else if (fault_.kind == DiskFault::Kind::kFull) {
      // Some file systems have no room for what replaces something either.
      const bool grows = file == nullptr || offset + static_cast<int64_t>(bytes.size()) > file->size;
      if (grows || fault_.seed % 2 == 0) error = Error::kFull;
    }
  }
  if (error != Error::kNone) {
    Strike("write", name);
    *num_bytes = was_off ? 0 : rng_.Below(bytes.size());
  }
  if (file == nullptr || *num_bytes == 0) return error;
  file->pending.push_back({.offset = offset, .bytes = std::string(bytes.substr(0, *num_bytes))});
  file->size = std::max(file->size, offset + static_cast<int64_t>(*num_bytes));
  return error;
}

FaultDisk::Error FaultDisk::Truncate(const File& file, int64_t size) {
  const MutexLock lock(mutex_);
  if (const Error error = Operate("truncate", file != nullptr ? file->name : "a temporary file");
      error != Error::kNone) {
    return error;
  }
  if (file == nullptr) return Error::kNone;
  file->pending.push_back({.offset = size, .bytes = {}, .truncates = true});
  file->size = size;
  return Error::kNone;
}

FaultDisk::Error FaultDisk::Sync(const File& file) {
  const MutexLock lock(mutex_);
  const bool was_off = is_off_;
  const Error error = Operate("sync", file != nullptr ? file->name : "a temporary file");
  num_syncs_ += error == Error::kNone;
  if (file == nullptr || fault_.ignores_syncs) return error;
  if (error == Error::kNone) {
    file->KeepAll();
  } else if (!was_off && !is_off_) {
    // The system takes the pages that it could not write for clean: a later sync does not write them.
    KeepSome(*file);
  }
  return error;
}

}  // namespace mapp
