#include "client_sdk/src/tracker/shared_localizer.h"

#include <gtest/gtest.h>

namespace mapp::tracker {
namespace {

TEST(SharedLocalizerTest, AsksForFewerMatchesOnlyWhereTheImageHasFewFeatures) {
  const OrbTrackerOptions options;
  EXPECT_EQ(SharedLocalizer::RequiredMatches(1000, options), options.min_shared_matches);
  EXPECT_EQ(SharedLocalizer::RequiredMatches(188, options), options.min_shared_matches);
  EXPECT_EQ(SharedLocalizer::RequiredMatches(100, options), 40);
  EXPECT_EQ(SharedLocalizer::RequiredMatches(10, options), options.min_tracked_points);
}

}  // namespace
}  // namespace mapp::tracker
