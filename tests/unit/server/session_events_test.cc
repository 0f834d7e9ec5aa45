#include "server/service/session_events.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace mapp::testing {
namespace {

TEST(SessionEventsTest, ReachTheirListenersOnly) {
  SessionEvents events;
  int first = 0, second = 0, other_map = 0;
  const auto a = events.Subscribe(SessionId(1), MapId(1), [&](const SessionEvent&) { ++first; });
  const auto b = events.Subscribe(SessionId(2), MapId(1), [&](const SessionEvent&) { ++second; });
  const auto c = events.Subscribe(SessionId(3), MapId(2), [&](const SessionEvent&) { ++other_map; });
  events.Publish(SessionId(1), AlignmentTried{});
  events.PublishToMap(MapId(1), TilesChanged{});
  EXPECT_EQ(first, 2);
  EXPECT_EQ(second, 1);
  EXPECT_EQ(other_map, 0);
}

TEST(SessionEventsTest, NothingArrivesAfterUnsubscribing) {
  SessionEvents events;
  const std::jthread publisher([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) events.Publish(SessionId(1), AlignmentTried{});
  });
  for (int i = 0; i < 200; ++i) {
    auto target = std::make_unique<std::atomic<int>>(0);
    auto subscription = events.Subscribe(SessionId(1), MapId(1), [&target](const SessionEvent&) { ++*target; });
    subscription.reset();
    target.reset();  // a late callback would write through null
  }
}

}  // namespace
}  // namespace mapp::testing
