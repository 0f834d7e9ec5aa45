#include "storage/sqlite/sqlite_map_store.h"

#include "storage/sqlite/database_file.h"
#include "storage/sqlite/erasure.h"
#include "storage/sqlite/read_pool.h"
#include "storage/sqlite/writer_thread.h"

namespace mapp {
namespace sqlite {
namespace {

class SqliteMapStore final : public MapStore {
 public:
  /// `writer` is absent in a store that only reads.
  SqliteMapStore(std::unique_ptr<WriterThread> writer, std::shared_ptr<ReadPool> readers)
      : writer_(std::move(writer)), readers_(std::move(readers)) {}

  ~SqliteMapStore() override {
    // Whoever wants to know how closing went has called Close before.
    Close().IgnoreError();
  }

  StatusOr<std::unique_ptr<MapReader>> Read() override { return readers_->OpenReader(); }
  StatusOr<std::unique_ptr<MapReader>> ReadAsOf(MapId map, Revision revision) override {
    return readers_->OpenReaderAsOf(map, revision);
  }

  Status Write(const CallContext& context, std::function<Status(MapWriter&)> change,
               std::function<void()> on_commit) override {
    if (writer_ == nullptr) return absl::FailedPreconditionError("map database is open for reading only");
    return writer_->Write(context, std::move(change), std::move(on_commit));
  }

  Status Rewrite(const CallContext& context) override {
    if (writer_ == nullptr) return absl::FailedPreconditionError("map database is open for reading only");
    return writer_->RunAlone(context, [](Connection& db) { return sqlite::Rewrite(db); });
  }

  Status Close() override {
    // Readers first: an idle one would keep the write-ahead log from being emptied into the file.
    readers_->Close();
    return writer_ != nullptr ? writer_->Stop() : absl::OkStatus();
  }

 private:
  const std::unique_ptr<WriterThread> writer_;
  const std::shared_ptr<ReadPool> readers_;
};

StatusOr<std::unique_ptr<MapStore>> OpenReadOnly(const std::string& file, const SqliteOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<Connection> probe, OpenForReading(file, options));
  MAPP_RETURN_IF_ERROR(CheckSchemaIsCurrent(*probe));
  return std::make_unique<SqliteMapStore>(nullptr, std::make_shared<ReadPool>(file, options));
}

StatusOr<std::unique_ptr<MapStore>> OpenForServing(const std::string& file, const SqliteOptions& options) {
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<FileLock> lock, FileLock::Acquire(file));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> connection, OpenForWriting(file, options));
  return std::make_unique<SqliteMapStore>(
      std::make_unique<WriterThread>(std::move(lock), std::move(connection), options.unix_now_ns),
      std::make_shared<ReadPool>(file, options));
}

StatusOr<std::unique_ptr<MapStore>> Open(const std::string& file, const SqliteOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const std::string resolved, ResolveFile(file, /*must_exist=*/options.read_only));
  return options.read_only ? OpenReadOnly(resolved, options) : OpenForServing(resolved, options);
}

}  // namespace
}  // namespace sqlite

StatusOr<std::unique_ptr<MapStore>> OpenSqliteMapStore(const std::string& file, const SqliteOptions& options) {
  StatusOr<std::unique_ptr<MapStore>> store = sqlite::Open(file, options);
  if (!store.ok()) return Annotate(store.status(), file);
  return store;
}

}  // namespace mapp
