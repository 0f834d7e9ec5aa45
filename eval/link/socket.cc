#include "eval/link/socket.h"

#include <fmt/format.h>

#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace mapp {
namespace {

using SteadyClock = std::chrono::steady_clock;

Status SystemError(const char* call) { return absl::InternalError(fmt::format("{}: {}", call, std::strerror(errno))); }

/// Whether the socket became ready before the deadline.
StatusOr<bool> WaitReady(int fd, short events, SteadyClock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - SteadyClock::now()).count();
  pollfd entry{fd, events, 0};
  const int ready = poll(&entry, 1, static_cast<int>(std::max<int64_t>(left, 0)));
  if (ready < 0 && errno != EINTR) return SystemError("poll");
  return ready > 0;
}

}  // namespace

OwnedFd::~OwnedFd() {
  if (fd_ >= 0) close(fd_);
}

StatusOr<OwnedFd> ListenTcp(uint16_t* port) {
  OwnedFd listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (listener.get() < 0) return SystemError("socket");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_ANY);
  socklen_t size = sizeof(address);
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  if (bind(listener.get(), generic, size) != 0) return SystemError("bind");
  if (listen(listener.get(), SOMAXCONN) != 0) return SystemError("listen");
  if (getsockname(listener.get(), generic, &size) != 0) return SystemError("getsockname");
  *port = ntohs(address.sin_port);
  return listener;
}

StatusOr<OwnedFd> AcceptTcp(const OwnedFd& listener, SteadyClock::time_point deadline) {
  MAPP_ASSIGN_OR_RETURN(const bool ready, WaitReady(listener.get(), POLLIN, deadline));
  if (!ready) return absl::DeadlineExceededError("no connection came");
  OwnedFd connection(accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC));
  if (connection.get() < 0) return SystemError("accept");
  return connection;
}

StatusOr<OwnedFd> ConnectTcp(const std::string& ipv4, uint16_t port) {
  OwnedFd connection(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (connection.get() < 0) return SystemError("socket");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  if (inet_pton(AF_INET, ipv4.c_str(), &address.sin_addr) != 1) {
    return absl::InvalidArgumentError(fmt::format("{}: not an IPv4 address", ipv4));
  }
  if (connect(connection.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return SystemError("connect");
  }
  const int yes = 1;
  setsockopt(connection.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));
  return connection;
}

StatusOr<bool> SendAll(const OwnedFd& socket, std::span<const char> bytes, SteadyClock::time_point deadline) {
  while (!bytes.empty()) {
    MAPP_ASSIGN_OR_RETURN(const bool ready, WaitReady(socket.get(), POLLOUT, deadline));
    if (!ready && SteadyClock::now() >= deadline) return false;
    if (!ready) continue;
    const ssize_t sent = send(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    if (sent < 0) return SystemError("send");
    bytes = bytes.subspan(static_cast<size_t>(sent));
  }
  return true;
}

}  // namespace mapp
