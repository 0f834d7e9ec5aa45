#include "storage/sqlite/interrupter.h"

#include <sqlite3.h>

#include <chrono>

namespace mapp::sqlite {
namespace {

constexpr std::chrono::milliseconds kPeriod(50);

}  // namespace

Interrupter::Interrupter(const CallContext& context, Connection& db)
    : thread_([this, &context, &db] { Run(context, db); }) {}

Interrupter::~Interrupter() {
  {
    MutexLock lock(mutex_);
    done_ = true;
    changed_.NotifyOne();
  }
  thread_.join();
}

void Interrupter::Run(const CallContext& context, Connection& db) {
  while (!WaitUntilDone()) {
    if (!context.Check().ok()) sqlite3_interrupt(db.handle());
  }
}

bool Interrupter::WaitUntilDone() {
  MutexLock lock(mutex_);
  const auto until = std::chrono::steady_clock::now() + kPeriod;
  while (!done_ && changed_.WaitUntil(mutex_, until)) {
  }
  return done_;
}

}  // namespace mapp::sqlite
