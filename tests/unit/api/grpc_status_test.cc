#include "api/status/grpc_status.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

TEST(GrpcStatusTest, CodeAndMessageSurviveTheRoundTrip) {
  for (int code = 1; code <= 16; ++code) {
    const Status status(static_cast<absl::StatusCode>(code), "tile 3/1/-4: gone");
    const grpc::Status wire = ToGrpcStatus(status);
    EXPECT_EQ(static_cast<int>(wire.error_code()), code);
    EXPECT_EQ(FromGrpcStatus(wire), status);
  }
}

TEST(GrpcStatusTest, OkIsOk) {
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_TRUE(FromGrpcStatus(grpc::Status::OK).ok());
}

TEST(GrpcStatusTest, FieldPathIsWhatStandsBeforeTheFirstColon) {
  EXPECT_EQ(FieldPath(absl::InvalidArgumentError("camera.fx: must be positive, got 0: really")), "camera.fx");
  EXPECT_EQ(FieldPath(absl::InvalidArgumentError("held_tiles[12].key: 0x1 is not a tile key")), "held_tiles[12].key");
}

TEST(GrpcStatusTest, APreconditionMayNameItsField) {
  EXPECT_EQ(FieldPath(absl::FailedPreconditionError("feature_settings.num_levels: the map was made with 8")),
            "feature_settings.num_levels");
  EXPECT_EQ(FieldPath(absl::FailedPreconditionError("session 3 is quarantined since 2026: depths")), "");
}

TEST(GrpcStatusTest, NoFieldPathWithoutAPath) {
  EXPECT_EQ(FieldPath(absl::InvalidArgumentError("the whole request is odd")), "");
  EXPECT_EQ(FieldPath(absl::InvalidArgumentError("no such thing: a sentence is not a path")), "");
  EXPECT_EQ(FieldPath(absl::NotFoundError("map: none of that name")), "");
  EXPECT_EQ(FieldPath(absl::OkStatus()), "");
}

}  // namespace
}  // namespace mapp
