#pragma once

#include "mapp/base/process_usage.h"
#include "mapp/base/status.h"

#include <sys/types.h>

struct rusage;

namespace mapp {

/// What a running process has used so far, from /proc. NOT_FOUND: there is none of that id.
StatusOr<ProcessUsage> ReadProcessUsage(pid_t pid);

/// What a child that has ended has used in all, as wait4 gives it.
ProcessUsage UsageFrom(const rusage& usage);

}  // namespace mapp
