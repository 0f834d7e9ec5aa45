#include "server/service/stored_places.h"

#include "server/service/frame_view.h"
#include "tests/unit/server/registration/map_fixture.h"
#include "tests/unit/server/registration/synthetic_room.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

using testing::MapFixture;
using testing::SyntheticRoom;
using testing::ViewNoise;

class StoredPlacesTest : public ::testing::Test {
 protected:
  StoredPlacesTest() {
    const std::vector<Pose3> poses = SyntheticRoom::Circle(0.5, 0, std::numbers::pi / 3, 6);
    for (size_t i = 0; i < poses.size(); ++i) {
      const Keyframe keyframe =
          room_.View(poses[i], poses.front(), session_, static_cast<uint32_t>(i), ViewNoise(), rng_);
      frames_.push_back(fixture_.Store(session_, keyframe));
    }
  }

  StoredPlaces Places() {
    return {fixture_.store(), fixture_.map(), [this](const Status& trouble) { troubles_.push_back(trouble); }};
  }
  void AddAll(StoredPlaces& places) {
    const auto reader = fixture_.Read();
    for (const FrameId frame : frames_) EXPECT_TRUE(places.Add(*reader, frame).ok());
  }
  /// As after a start.
  StoredPlaces Loaded() {
    StoredPlaces places = Places();
    const Status status = places.Load(*fixture_.Read());
    EXPECT_TRUE(status.ok()) << status;
    return places;
  }
  std::vector<std::string> Blocks() {
    const auto blocks = fixture_.Read()->ListPlaceBlocks(fixture_.map());
    EXPECT_TRUE(blocks.ok()) << blocks.status();
    return *blocks;
  }

  MapFixture fixture_;
  SyntheticRoom room_{1};
  Rng rng_{5};
  SessionId session_ = fixture_.OpenSession(SyntheticRoom::DeviceCamera(), /*founder=*/true);
  std::vector<FrameId> frames_;
  std::vector<Status> troubles_;
};

TEST_F(StoredPlacesTest, AStartKnowsWhatWasStored) {
  StoredPlaces places = Places();
  AddAll(places);
  EXPECT_TRUE(Blocks().empty()) << "not for a few frames";
  places.Store();
  places.Store();  // nothing new
  ASSERT_EQ(Blocks().size(), 1U);

  const StoredPlaces loaded = Loaded();
  EXPECT_TRUE(troubles_.empty());
  EXPECT_EQ(loaded.index().num_frames(), frames_.size());
  EXPECT_EQ(loaded.index().num_new_frames(), 0U);
  const auto view = LoadFrame(*fixture_.Read(), frames_[2]);
  ASSERT_TRUE(view.ok()) << view.status();
  EXPECT_EQ(loaded.index().Query(view->Descriptors(), 1).at(0).frame, frames_[2].value());
}

TEST_F(StoredPlacesTest, FramesThatHaveLeftTheMapAreLeftOut) {
  StoredPlaces places = Places();
  AddAll(places);
  places.Store();
  ASSERT_EQ(Blocks().size(), 1U);
  const Status status = fixture_.store().Write(
      {}, [&](MapWriter& writer) { return writer.SetFramePose(frames_[3], /*in_map=*/false, Pose3()); });
  ASSERT_TRUE(status.ok()) << status;
  const StoredPlaces loaded = Loaded();
  EXPECT_EQ(loaded.index().num_frames(), frames_.size() - 1);
  EXPECT_FALSE(loaded.index().Contains(frames_[3].value()));
}

TEST_F(StoredPlacesTest, ADamagedBlockIsToldAndDoneWithout) {
  StoredPlaces places = Places();
  AddAll(places);
  places.Store();
  ASSERT_EQ(Blocks().size(), 1U);
  std::string damaged = Blocks().front();
  damaged[damaged.size() / 2] ^= 1;
  const Status status =
      fixture_.store().Write({}, [&](MapWriter& writer) { return writer.AppendPlaceBlock(fixture_.map(), damaged); });
  ASSERT_TRUE(status.ok()) << status;
  const StoredPlaces loaded = Loaded();
  EXPECT_EQ(loaded.index().num_frames(), frames_.size()) << "of the whole one";
  ASSERT_EQ(troubles_.size(), 1U);
  EXPECT_EQ(troubles_[0].code(), absl::StatusCode::kDataLoss);
}

TEST_F(StoredPlacesTest, WhatCannotBeStoredIsToldAndInTheIndexAllTheSame) {
  StoredPlaces places = Places();
  AddAll(places);
  const Status deleted =
      fixture_.store().Write({}, [this](MapWriter& writer) { return writer.DeleteMap(fixture_.map()); });
  ASSERT_TRUE(deleted.ok()) << deleted;
  places.Store();
  EXPECT_EQ(places.index().num_frames(), frames_.size());
  ASSERT_EQ(troubles_.size(), 1U);
  EXPECT_EQ(troubles_[0].code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp
