#pragma once

#include "mapp/base/status.h"

#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace mapp {

/// One message of a device: when it is ready to go, and its size.
struct TimedMessage {
  double ready_s = 0;  ///< since the start
  uint64_t bytes = 0;
};
using MessageTrace = std::vector<TimedMessage>;  ///< by increasing time

/// How a message fared.
struct Transmission {
  double ready_s = 0;
  double latency_s = 0;  ///< from ready to the last byte's arrival, waiting behind the device's earlier ones included
};

/// What the link was made of.
enum class LinkKind {
  kNamespace,    ///< a network namespace behind a virtual Ethernet pair with the kernel's token bucket (tc tbf)
  kTokenBucket,  ///< loopback, the receiver reading through a token bucket of this program
};
const char* LinkKindName(LinkKind kind);

struct LinkRun {
  LinkKind kind = LinkKind::kTokenBucket;
  std::vector<std::vector<Transmission>> devices;  ///< what arrived in time, in the order of the traces
};

/// Sends the traces in real time, each device over a TCP connection of its own, all of them through one link of
/// `rate_mbit_s`, and stops `duration_s` after the start: what has not arrived by then is missing from the result.
/// The link is a network namespace where this process may make one, else a token bucket. Nothing is left behind.
/// INVALID_ARGUMENT: a rate or duration that is not positive. CANCELLED on a stop request. INTERNAL naming the call:
/// the system refuses a socket.
StatusOr<LinkRun> SendThroughLink(const std::vector<MessageTrace>& traces, double rate_mbit_s, double duration_s,
                                  const std::stop_token& stop);
/// The same over a given kind of link. FAILED_PRECONDITION: this process may not make namespaces.
StatusOr<LinkRun> SendThroughLink(LinkKind kind, const std::vector<MessageTrace>& traces, double rate_mbit_s,
                                  double duration_s, const std::stop_token& stop);

}  // namespace mapp
