#include "eval/link/upload_link.h"

#include "eval/link/namespace_link.h"
#include "eval/link/socket.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <mutex>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <thread>

namespace mapp {
namespace {

using SteadyClock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

constexpr std::chrono::milliseconds kLinkSlice{2};
constexpr std::chrono::seconds kConnectTimeout{10};
/// What a bucket may save up: 5 ms of traffic, at least a packet.
constexpr double kBurst_s = 0.005;
constexpr double kMinBurst_bytes = 1500;

SteadyClock::time_point After(SteadyClock::time_point start, double seconds) {
  return start + std::chrono::duration_cast<SteadyClock::duration>(Seconds(seconds));
}

/// The receiving end. Reads all connections in turn, at most at the bucket's rate if there is one, and notes when each
/// message is complete.
class Sink {
 public:
  Sink(const std::vector<MessageTrace>& traces, std::optional<double> rate_bytes_s)
      : traces_(traces), rate_bytes_s_(rate_bytes_s), received_(traces.size()), done_(traces.size()) {}

  Status Run(std::vector<OwnedFd> connections, SteadyClock::time_point start, SteadyClock::time_point end,
             const std::stop_token& stop) {
    std::vector<pollfd> entries;
    for (const OwnedFd& connection : connections) entries.push_back({connection.get(), POLLIN, 0});
    auto refilled = start;
    double tokens = 0;
    while (SteadyClock::now() < end && !AllDone()) {
      if (stop.stop_requested()) return absl::CancelledError("interrupted");
      if (poll(entries.data(), entries.size(), static_cast<int>(kLinkSlice.count())) < 0 && errno != EINTR) {
        return absl::InternalError(fmt::format("poll: {}", std::strerror(errno)));
      }
      if (rate_bytes_s_) {
        const auto now = SteadyClock::now();
        const double burst = std::max(kMinBurst_bytes, *rate_bytes_s_ * kBurst_s);
        tokens = std::min(burst, tokens + *rate_bytes_s_ * Seconds(now - refilled).count());
        refilled = now;
        if (tokens < 1) std::this_thread::sleep_for(kLinkSlice);  // the pace of the link itself, not a wait for somebody
      }
      for (size_t i = 0; i < entries.size(); ++i) {
        // Turns rotate, so that no device is always first at the bucket.
        const size_t device = (i + turn_) % entries.size();
        if ((entries[device].revents & (POLLIN | POLLHUP)) == 0) continue;
        const size_t allowed = rate_bytes_s_ ? static_cast<size_t>(tokens) : buffer_.size();
        if (allowed == 0) break;
        const ssize_t got = recv(entries[device].fd, buffer_.data(), std::min(allowed, buffer_.size()), MSG_DONTWAIT);
        if (got < 0 && (errno == EAGAIN || errno == EINTR)) continue;
        if (got < 0) return absl::InternalError(fmt::format("recv: {}", std::strerror(errno)));
        if (got == 0) {
          entries[device].fd = -1;  // the device is done; poll leaves it out from now on
          continue;
        }
        tokens -= static_cast<double>(got);
        Note(device, static_cast<uint64_t>(got), start);
      }
      ++turn_;
    }
    return absl::OkStatus();
  }

  std::vector<std::vector<Transmission>> Take() { return std::move(done_); }

 private:
  bool AllDone() const {
    for (size_t i = 0; i < traces_.size(); ++i) {
      if (done_[i].size() < traces_[i].size()) return false;
    }
    return true;
  }

  void Note(size_t device, uint64_t bytes, SteadyClock::time_point start) {
    received_[device] += bytes;
    const double now_s = Seconds(SteadyClock::now() - start).count();
    while (done_[device].size() < traces_[device].size()) {
      const TimedMessage& message = traces_[device][done_[device].size()];
      if (received_[device] < message.bytes) return;
      received_[device] -= message.bytes;
      done_[device].push_back({message.ready_s, now_s - message.ready_s});
    }
  }

  const std::vector<MessageTrace>& traces_;
  const std::optional<double> rate_bytes_s_;
  std::vector<uint64_t> received_;  ///< of the message under way
  std::vector<std::vector<Transmission>> done_;
  std::array<char, 16384> buffer_{};
  size_t turn_ = 0;
};

/// Sends one device's messages, each when it is ready.
Status SendTrace(const OwnedFd& connection, const MessageTrace& trace, SteadyClock::time_point start,
                 SteadyClock::time_point end, const std::stop_token& stop) {
  std::vector<char> bytes;
  for (const TimedMessage& message : trace) {
    const auto ready = After(start, message.ready_s);
    while (SteadyClock::now() < ready) {
      if (stop.stop_requested() || ready > end) return absl::OkStatus();
      std::this_thread::sleep_until(std::min(ready, SteadyClock::now() + std::chrono::milliseconds(50)));
    }
    bytes.assign(message.bytes, '\0');
    MAPP_ASSIGN_OR_RETURN(const bool sent, SendAll(connection, bytes, end));
    if (!sent) return absl::OkStatus();
  }
  return absl::OkStatus();
}

}  // namespace

const char* LinkKindName(LinkKind kind) {
  return kind == LinkKind::kNamespace ? "network namespace with tc tbf" : "token bucket in the harness";
}

StatusOr<LinkRun> SendThroughLink(LinkKind kind, const std::vector<MessageTrace>& traces, double rate_mbit_s,
                                  double duration_s, const std::stop_token& stop) {
  if (!(rate_mbit_s > 0) || !std::isfinite(rate_mbit_s)) {
    return absl::InvalidArgumentError(fmt::format("rate_mbit_s: must be positive, got {}", rate_mbit_s));
  }
  if (!(duration_s > 0) || !std::isfinite(duration_s)) {
    return absl::InvalidArgumentError(fmt::format("duration_s: must be positive, got {}", duration_s));
  }
  std::optional<double> bucket_bytes_s;
  if (kind == LinkKind::kTokenBucket) bucket_bytes_s = rate_mbit_s * 1e6 / 8;

  std::unique_ptr<NamespaceLink> link;
  std::string address = "127.0.0.1";
  OwnedFd listener;
  uint16_t port = 0;
  const auto listen = [&]() -> Status {
    MAPP_ASSIGN_OR_RETURN(listener, ListenTcp(&port));
    return absl::OkStatus();
  };
  if (kind == LinkKind::kNamespace) {
    MAPP_ASSIGN_OR_RETURN(link, NamespaceLink::Create(rate_mbit_s));
    address = link->far_address();
    MAPP_RETURN_IF_ERROR(link->RunInside(listen));
  } else {
    MAPP_RETURN_IF_ERROR(listen());
  }
  std::vector<OwnedFd> near, far;
  for (size_t i = 0; i < traces.size(); ++i) {
    MAPP_ASSIGN_OR_RETURN(OwnedFd connection, ConnectTcp(address, port));
    near.push_back(std::move(connection));
    MAPP_ASSIGN_OR_RETURN(OwnedFd accepted, AcceptTcp(listener, SteadyClock::now() + kConnectTimeout));
    far.push_back(std::move(accepted));
  }

  const auto start = SteadyClock::now();
  const auto end = After(start, duration_s);
  Sink sink(traces, bucket_bytes_s);
  std::mutex mutex;
  Status first_error;
  Status received;
  {
    std::vector<std::jthread> senders;
    for (size_t i = 0; i < traces.size(); ++i) {
      senders.emplace_back([&, i] {
        const Status sent = SendTrace(near[i], traces[i], start, end, stop);
        const std::lock_guard lock(mutex);
        first_error.Update(sent);
      });
    }
    received = sink.Run(std::move(far), start, end, stop);
  }
  MAPP_RETURN_IF_ERROR(received);
  MAPP_RETURN_IF_ERROR(first_error);
  return LinkRun{kind, sink.Take()};
}

StatusOr<LinkRun> SendThroughLink(const std::vector<MessageTrace>& traces, double rate_mbit_s, double duration_s,
                                  const std::stop_token& stop) {
  StatusOr<LinkRun> run = SendThroughLink(LinkKind::kNamespace, traces, rate_mbit_s, duration_s, stop);
  if (!absl::IsFailedPrecondition(run.status())) return run;
  return SendThroughLink(LinkKind::kTokenBucket, traces, rate_mbit_s, duration_s, stop);
}

}  // namespace mapp
