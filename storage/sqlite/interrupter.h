#pragma once

#include "mapp/base/call_context.h"
#include "mapp/base/mutex.h"
#include "storage/sqlite/connection.h"

#include <thread>

namespace mapp::sqlite {

/// While it lives, interrupts what SQLite is at on `db` once the context says so, which it asks from a thread of its
/// own: inside a long statement SQLite calls nobody.
class Interrupter {
 public:
  Interrupter(const CallContext& context, Connection& db);
  ~Interrupter();
  Interrupter(const Interrupter&) = delete;
  Interrupter& operator=(const Interrupter&) = delete;

 private:
  void Run(const CallContext& context, Connection& db);
  /// False after a period without.
  bool WaitUntilDone();

  Mutex mutex_;
  CondVar changed_;
  bool done_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace mapp::sqlite
