#pragma once

#include "mapp/base/status.h"

#include <functional>
#include <memory>
#include <string>

namespace mapp {

/// A network namespace of this process's own behind a virtual Ethernet pair whose near end sends at most at a given
/// rate (the kernel's token bucket, tc tbf). It has no name and no way out: it goes, with both ends, when this object
/// does.
class NamespaceLink {
 public:
  /// FAILED_PRECONDITION: this process may not make namespaces, or `ip` or `tc` is missing or refuses.
  static StatusOr<std::unique_ptr<NamespaceLink>> Create(double rate_mbit_s);
  ~NamespaceLink();

  /// IPv4 of the far end.
  const std::string& far_address() const { return far_address_; }
  /// Runs a function in the namespace, for sockets that are to live there.
  Status RunInside(const std::function<Status()>& function);

 private:
  NamespaceLink();
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string far_address_;
};

}  // namespace mapp
