#include "storage/sqlite/read_pool.h"

#include "storage/checks.h"
#include "storage/sqlite/as_of.h"
#include "storage/sqlite/database_file.h"
#include "storage/sqlite/map_reads.h"

namespace mapp::sqlite {

class SnapshotReader final : public MapReads<MapReader> {
 public:
  SnapshotReader(std::shared_ptr<ReadPool> pool, std::unique_ptr<Connection> connection,
                 std::unique_ptr<Transaction> snapshot)
      : MapReads(*connection),
        pool_(std::move(pool)),
        connection_(std::move(connection)),
        snapshot_(std::move(snapshot)) {}

  ~SnapshotReader() override {
    snapshot_.reset();
    pool_->Return(std::move(connection_));
  }

 private:
  std::shared_ptr<ReadPool> pool_;
  std::unique_ptr<Connection> connection_;
  std::unique_ptr<Transaction> snapshot_;
};

/// A reader of an earlier revision: its connection shows nothing else and is closed with it.
class AsOfReader final : public MapReads<MapReader> {
 public:
  AsOfReader(std::unique_ptr<Connection> connection, std::unique_ptr<Transaction> snapshot)
      : MapReads(*connection), connection_(std::move(connection)), snapshot_(std::move(snapshot)) {}

 private:
  std::unique_ptr<Connection> connection_;
  std::unique_ptr<Transaction> snapshot_;
};

StatusOr<std::unique_ptr<MapReader>> ReadPool::OpenReader() {
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> connection, Borrow());
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Transaction> snapshot,
                        Transaction::Begin(*connection, Transaction::Kind::kSnapshot));
  return std::make_unique<SnapshotReader>(shared_from_this(), std::move(connection), std::move(snapshot));
}

StatusOr<std::unique_ptr<MapReader>> ReadPool::OpenReaderAsOf(MapId map, Revision revision) {
  {
    const MutexLock lock(mutex_);
    if (closed_) return internal::StoreIsClosed();
  }
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Connection> connection, OpenForReading(file_, options_));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<Transaction> snapshot,
                        Transaction::Begin(*connection, Transaction::Kind::kSnapshot));
  MAPP_RETURN_IF_ERROR(ShowAsOf(*connection, map, revision));
  return std::make_unique<AsOfReader>(std::move(connection), std::move(snapshot));
}

void ReadPool::Close() {
  std::vector<std::unique_ptr<Connection>> idle;
  MutexLock lock(mutex_);
  closed_ = true;
  idle.swap(idle_);
}

StatusOr<std::unique_ptr<Connection>> ReadPool::Borrow() {
  {
    MutexLock lock(mutex_);
    if (closed_) return internal::StoreIsClosed();
    if (!idle_.empty()) {
      std::unique_ptr<Connection> connection = std::move(idle_.back());
      idle_.pop_back();
      return connection;
    }
  }
  return OpenForReading(file_, options_);
}

void ReadPool::Return(std::unique_ptr<Connection> connection) {
  // A connection that is not kept is closed by its owner, this argument, after the lock is gone.
  MutexLock lock(mutex_);
  if (!closed_ && static_cast<int>(idle_.size()) < options_.max_idle_readers) idle_.push_back(std::move(connection));
}

}  // namespace mapp::sqlite
