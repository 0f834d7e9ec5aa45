#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <string>
#include <utility>

namespace mapp {

using absl::Status;
using absl::StatusOr;

/// `status` with `context` put before its message ("context: message"); OK stays OK. Payloads are kept.
Status Annotate(const Status& status, const std::string& context);

}  // namespace mapp

/// Returns from the enclosing function when `expr` (a Status) is not OK.
#define MAPP_RETURN_IF_ERROR(expr)               \
  do {                                           \
    ::absl::Status mapp_status_ = (expr);        \
    if (!mapp_status_.ok()) return mapp_status_; \
  } while (false)

#define MAPP_CONCAT_INNER_(a, b) a##b
#define MAPP_CONCAT_(a, b) MAPP_CONCAT_INNER_(a, b)

/// `MAPP_ASSIGN_OR_RETURN(auto x, F());` with F returning a StatusOr.
#define MAPP_ASSIGN_OR_RETURN(lhs, expr) MAPP_ASSIGN_OR_RETURN_IMPL_(MAPP_CONCAT_(mapp_or_, __LINE__), lhs, expr)
#define MAPP_ASSIGN_OR_RETURN_IMPL_(tmp, lhs, expr) \
  auto tmp = (expr);                                \
  if (!tmp.ok()) return std::move(tmp).status();    \
  lhs = std::move(tmp).value()
