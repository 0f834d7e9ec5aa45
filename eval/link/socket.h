#pragma once

#include "mapp/base/status.h"

#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

namespace mapp {

/// A file descriptor that is closed with its owner.
class OwnedFd {
 public:
  OwnedFd() = default;
  explicit OwnedFd(int fd) : fd_(fd) {}
  OwnedFd(OwnedFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  OwnedFd& operator=(OwnedFd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~OwnedFd();
  int get() const { return fd_; }

 private:
  int fd_ = -1;
};

/// A listening TCP socket on any free port of all addresses of the calling thread's network namespace.
StatusOr<OwnedFd> ListenTcp(uint16_t* port);
/// Waits for one connection until the deadline.
StatusOr<OwnedFd> AcceptTcp(const OwnedFd& listener, std::chrono::steady_clock::time_point deadline);
/// Connects to an IPv4 address.
StatusOr<OwnedFd> ConnectTcp(const std::string& ipv4, uint16_t port);
/// Sends all of it, or as much as goes until the deadline: whether all went.
StatusOr<bool> SendAll(const OwnedFd& socket, std::span<const char> bytes,
                       std::chrono::steady_clock::time_point deadline);

}  // namespace mapp
