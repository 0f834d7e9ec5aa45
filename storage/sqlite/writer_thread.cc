#include "storage/sqlite/writer_thread.h"

#include "storage/checks.h"
#include "storage/sqlite/change.h"

#include <algorithm>
#include <exception>
#include <pthread.h>

namespace mapp::sqlite {
namespace {

/// So that the first of a batch does not wait for too many others. 64 uploads take about as long as one slow sync.
constexpr size_t kMaxBatch = 64;

}  // namespace

WriterThread::WriterThread(std::unique_ptr<FileLock> lock, std::unique_ptr<Connection> db,
                           std::function<int64_t()> unix_now_ns)
    : lock_(std::move(lock)), db_(std::move(db)), unix_now_ns_(std::move(unix_now_ns)), thread_([this] { Run(); }) {
  pthread_setname_np(thread_.native_handle(), "mapp-writer");
}

WriterThread::~WriterThread() {
  // Whoever wants to know how closing went has called Stop before.
  Stop().IgnoreError();
}

Status WriterThread::Write(const CallContext& context, std::function<Status(MapWriter&)> change,
                           std::function<void()> on_commit) {
  Request request{
      .context = context, .change = std::move(change), .on_commit = std::move(on_commit), .alone = {}, .status = {}};
  return Await(request);
}

Status WriterThread::RunAlone(const CallContext& context, std::function<Status(Connection&)> work) {
  Request request{.context = context, .change = {}, .on_commit = {}, .alone = std::move(work), .status = {}};
  return Await(request);
}

Status WriterThread::Await(Request& request) {
  const CallContext& context = request.context;
  MutexLock lock(mutex_);
  if (stopping_) return internal::StoreIsClosed();
  queue_.push_back(&request);
  queue_changed_.NotifyOne();
  while (request.state != State::kDone) {
    if (request.state == State::kBegun || context.deadline == std::chrono::steady_clock::time_point::max()) {
      batch_done_.Wait(mutex_);
    } else if (!batch_done_.WaitUntil(mutex_, context.deadline) && request.state == State::kQueued) {
      std::erase(queue_, &request);
      return internal::WaitedPastDeadline();
    }
  }
  return request.status;
}

Status WriterThread::Stop() {
  MutexLock stop_lock(stop_mutex_);
  if (!thread_.joinable()) return absl::OkStatus();
  {
    MutexLock lock(mutex_);
    stopping_ = true;
    queue_changed_.NotifyOne();
  }
  thread_.join();
  return CloseDatabase();
}

void WriterThread::Run() {
  while (Request* first = WaitForRequest()) {
    std::vector<Request*> batch;
    if (first->alone) {
      batch.push_back(first);
      first->status = first->alone(*db_);
      Conclude(batch, absl::OkStatus());
      continue;
    }
    const Status committed = RunBatch(first, &batch);
    Conclude(batch, committed);
  }
}

/// Null when the store is closing and all is done.
WriterThread::Request* WriterThread::WaitForRequest() {
  MutexLock lock(mutex_);
  while (queue_.empty() && !stopping_) queue_changed_.Wait(mutex_);
  return PopQueue();
}

/// Null when none waits, or the next one is not for a batch.
WriterThread::Request* WriterThread::TakeRequest() {
  MutexLock lock(mutex_);
  if (!queue_.empty() && queue_.front()->alone) return nullptr;
  return PopQueue();
}

WriterThread::Request* WriterThread::PopQueue() {
  if (queue_.empty()) return nullptr;
  Request* request = queue_.front();
  queue_.pop_front();
  request->state = State::kBegun;
  return request;
}

/// Runs `first` and what waits behind it. OK when every change whose own status is OK is durable; else none of them is.
Status WriterThread::RunBatch(Request* first, std::vector<Request*>* batch) {
  batch->push_back(first);
  MAPP_ASSIGN_OR_RETURN(const auto transaction, Transaction::Begin(*db_, Transaction::Kind::kWrite));
  // Under a savepoint SQLite copies each page aside before it changes. The first change is undone with the transaction.
  first->status = RunChange(*first);
  if (!first->status.ok()) return absl::OkStatus();
  Status lost = CheckInTransaction(*first);
  while (lost.ok() && batch->size() < kMaxBatch) {
    Request* const request = TakeRequest();
    if (request == nullptr) break;
    batch->push_back(request);
    request->status = RunUnderSavepoint(*request);
    lost = CheckInTransaction(*request);
  }
  MAPP_RETURN_IF_ERROR(lost);
  return transaction->Commit();
}

/// A full disk or an I/O error may roll back the whole transaction: the changes before `request` are lost with it.
Status WriterThread::CheckInTransaction(const Request& request) const {
  if (db_->in_transaction()) return absl::OkStatus();
  if (request.status.ok()) return absl::InternalError("map database: the transaction has ended early");
  if (!absl::IsDataLoss(request.status)) return request.status;
  // What that change met is no fault of the others, which may do without the page.
  return absl::UnavailableError("map database: undone with another change, which met a damaged page: try again");
}

void WriterThread::Conclude(const std::vector<Request*>& batch, const Status& committed) {
  for (Request* request : batch) {
    if (!request->status.ok()) continue;
    if (!committed.ok()) {
      request->status = committed;
    } else if (request->on_commit) {
      request->on_commit();
    }
  }
  MutexLock lock(mutex_);
  for (Request* request : batch) request->state = State::kDone;
  batch_done_.NotifyAll();
}

Status WriterThread::RunUnderSavepoint(const Request& request) {
  MAPP_ASSIGN_OR_RETURN(const auto savepoint, Savepoint::Begin(*db_));
  MAPP_RETURN_IF_ERROR(RunChange(request));
  return savepoint->Release();
}

Status WriterThread::RunChange(const Request& request) {
  MAPP_RETURN_IF_ERROR(request.context.Check());
  Change change(*db_, unix_now_ns_());
  try {
    MAPP_RETURN_IF_ERROR(request.change(change));
  } catch (const std::exception& error) {
    // The caller's code runs on this thread; whatever it throws must not end the service.
    return internal::ChangeThrew(error);
  }
  return change.Finish();
}

Status WriterThread::CloseDatabase() {
  // A reader that is still open only leaves the log in place: everything is durable in it.
  Status status = db_->QueryInt64("PRAGMA wal_checkpoint(TRUNCATE)").status();
  db_.reset();
  lock_.reset();
  return absl::IsUnavailable(status) ? absl::OkStatus() : status;
}

}  // namespace mapp::sqlite
