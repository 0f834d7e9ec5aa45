#include "storage/memory/memory_map_store.h"

#include "mapp/base/mutex.h"
#include "storage/checks.h"
#include "storage/memory/change.h"
#include "storage/memory/contents.h"
#include "storage/memory/turnstile.h"

#include <exception>

namespace mapp {

class MemoryDatabase {
 public:
  /// False when a store has it open.
  bool Open() {
    const MutexLock lock(mutex_);
    return !std::exchange(is_open_, true);
  }
  void Close() {
    const MutexLock lock(mutex_);
    is_open_ = false;
  }

  memory::Contents Read() const {
    const MutexLock lock(mutex_);
    return contents_;
  }
  void Publish(memory::Contents contents) {
    // What is replaced here may be the last of it: it goes when the lock is gone.
    const MutexLock lock(mutex_);
    std::swap(contents_, contents);
  }

 private:
  mutable Mutex mutex_;
  bool is_open_ ABSL_GUARDED_BY(mutex_) = false;
  memory::Contents contents_ ABSL_GUARDED_BY(mutex_);
};

namespace memory {
namespace {

class MemoryMapStore final : public MapStore {
 public:
  MemoryMapStore(std::shared_ptr<MemoryDatabase> database, MemoryOptions options)
      : database_(std::move(database)), options_(std::move(options)) {}

  ~MemoryMapStore() override { CloseDatabase(); }

  StatusOr<std::unique_ptr<MapReader>> Read() override {
    if (turnstile_.is_closed()) return internal::StoreIsClosed();
    return std::make_unique<Reader>(database_->Read());
  }

  StatusOr<std::unique_ptr<MapReader>> ReadAsOf(MapId map, Revision revision) override {
    if (turnstile_.is_closed()) return internal::StoreIsClosed();
    MAPP_ASSIGN_OR_RETURN(Contents contents, database_->Read().AsOf(map, revision));
    return std::make_unique<Reader>(std::move(contents));
  }

  Status Write(const CallContext& context, std::function<Status(MapWriter&)> change,
               std::function<void()> on_commit) override {
    MAPP_ASSIGN_OR_RETURN(const Turnstile::Turn turn, turnstile_.Enter(context.deadline));
    MAPP_RETURN_IF_ERROR(context.Check());
    Change writer(database_->Read(), options_.unix_now_ns());
    try {
      MAPP_RETURN_IF_ERROR(change(writer));
    } catch (const std::exception& error) {
      return internal::ChangeThrew(error);
    }
    database_->Publish(writer.Finish());
    if (on_commit) on_commit();
    return absl::OkStatus();
  }

  /// What was deleted is gone from memory.
  Status Rewrite(const CallContext& context) override {
    if (turnstile_.is_closed()) return internal::StoreIsClosed();
    return context.Check();
  }

  Status Close() override {
    CloseDatabase();
    return absl::OkStatus();
  }

 private:
  void CloseDatabase() {
    if (turnstile_.Close()) database_->Close();
  }

  const std::shared_ptr<MemoryDatabase> database_;
  const MemoryOptions options_;
  Turnstile turnstile_;
};

}  // namespace
}  // namespace memory

std::shared_ptr<MemoryDatabase> CreateMemoryDatabase() { return std::make_shared<MemoryDatabase>(); }

StatusOr<std::unique_ptr<MapStore>> OpenMemoryMapStore(std::shared_ptr<MemoryDatabase> database,
                                                       const MemoryOptions& options) {
  if (!database->Open()) {
    return absl::FailedPreconditionError("map database in memory: in use by another store of this process");
  }
  return std::make_unique<memory::MemoryMapStore>(std::move(database), options);
}

}  // namespace mapp
