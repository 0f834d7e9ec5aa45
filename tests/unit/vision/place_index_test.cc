#include "vision/place_index.h"

#include "tests/unit/vision/synthetic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

using Descriptors = std::vector<OrbDescriptor>;

/// The frame again: part of its descriptors with noise, the rest new.
Descriptors SeenAgain(const Descriptors& frame, double share, int num_flips, Rng& rng) {
  Descriptors again;
  for (const OrbDescriptor& descriptor : frame) {
    again.push_back(rng.Uniform() < share ? test::FlipBits(descriptor, num_flips, rng) : test::RandomDescriptor(rng));
  }
  return again;
}

struct Frames {
  Rng rng{61};
  std::vector<Descriptors> frames;
  PlaceIndex index{PlaceIndex::Options{}};

  explicit Frames(size_t count) {
    for (size_t i = 0; i < count; ++i) {
      frames.push_back(test::RandomDescriptors(300, rng));
      index.Add(1000 + i, frames.back());
    }
  }
};

TEST(PlaceIndexTest, FindsTheFrameSeenAgain) {
  Frames world(50);
  EXPECT_EQ(world.index.num_frames(), 50U);
  for (size_t i = 0; i < world.frames.size(); ++i) {
    const auto candidates = world.index.Query(SeenAgain(world.frames[i], 0.4, 25, world.rng), 3);
    ASSERT_FALSE(candidates.empty()) << "frame " << i;
    EXPECT_EQ(candidates[0].frame, 1000 + i);
    EXPECT_TRUE(std::is_sorted(candidates.begin(), candidates.end(),
                               [](const auto& a, const auto& b) { return a.score > b.score; }));
  }
}

TEST(PlaceIndexTest, AcceptsEmptyInputs) {
  PlaceIndex index(PlaceIndex::Options{});
  Rng rng(62);
  EXPECT_TRUE(index.Query(test::RandomDescriptors(10, rng), 5).empty());
  index.Add(1, {});
  EXPECT_EQ(index.num_frames(), 1U);
  EXPECT_TRUE(index.Query({}, 5).empty());
  EXPECT_TRUE(index.Query(test::RandomDescriptors(10, rng), 0).empty());
}

TEST(PlaceIndexTest, ForgetsRemovedFrames) {
  Frames world(10);
  world.index.Remove(1003);
  world.index.Remove(77);
  EXPECT_EQ(world.index.num_frames(), 9U);
  for (const auto& candidate : world.index.Query(world.frames[3], 10)) EXPECT_NE(candidate.frame, 1003U);
}

TEST(PlaceIndexTest, SurvivesTheSweepOfRemovedFrames) {
  Frames world(20);
  for (size_t i = 0; i < 15; ++i) world.index.Remove(1000 + i);
  EXPECT_EQ(world.index.num_frames(), 5U);
  for (size_t i = 15; i < 20; ++i) {
    const auto candidates = world.index.Query(world.frames[i], 1);
    ASSERT_EQ(candidates.size(), 1U);
    EXPECT_EQ(candidates[0].frame, 1000 + i);
  }
  for (size_t i = 0; i < 15; ++i) {
    for (const auto& candidate : world.index.Query(world.frames[i], 20)) EXPECT_GE(candidate.frame, 1015U);
  }
  world.index.Add(1002, world.frames[2]);
  EXPECT_EQ(world.index.Query(world.frames[2], 1).at(0).frame, 1002U);
}

TEST(PlaceIndexTest, AddingAFrameAgainReplacesIt) {
  Rng rng(63);
  const Descriptors first = test::RandomDescriptors(200, rng);
  const Descriptors second = test::RandomDescriptors(200, rng);
  PlaceIndex index(PlaceIndex::Options{});
  index.Add(5, first);
  index.Add(6, test::RandomDescriptors(200, rng));
  index.Add(5, second);
  EXPECT_EQ(index.num_frames(), 2U);
  EXPECT_EQ(index.Query(second, 1).at(0).frame, 5U);
  for (const auto& candidate : index.Query(first, 5)) EXPECT_NE(candidate.frame, 5U);
}

TEST(PlaceIndexTest, AsksTheFilter) {
  Frames world(10);
  const Descriptors again = SeenAgain(world.frames[4], 0.5, 20, world.rng);
  const auto accept = [](uint64_t frame) { return frame != 1004; };
  for (const auto& candidate : world.index.Query(again, 10, accept)) EXPECT_NE(candidate.frame, 1004U);
  EXPECT_EQ(world.index.Query(again, 10).at(0).frame, 1004U);
}

/// Descriptors common to all frames fill their buckets beyond the cap and no longer vote.
TEST(PlaceIndexTest, CommonDescriptorsStopCounting) {
  Rng rng(64);
  const Descriptors common = test::RandomDescriptors(100, rng);
  PlaceIndex index({.max_bucket_entries = 10});
  for (uint64_t frame = 0; frame < 10; ++frame) index.Add(frame, common);
  EXPECT_EQ(index.Query(common, 20).size(), 10U);
  index.Add(10, common);
  EXPECT_TRUE(index.Query(common, 20).empty());
}

TEST(PlaceIndexTest, RareDescriptorsWeighMore) {
  Rng rng(65);
  const Descriptors common = test::RandomDescriptors(50, rng);
  const Descriptors rare = test::RandomDescriptors(50, rng);
  PlaceIndex index(PlaceIndex::Options{});
  for (uint64_t frame = 0; frame < 20; ++frame) index.Add(frame, common);
  index.Add(20, rare);
  Descriptors both = common;
  both.insert(both.end(), rare.begin(), rare.end());
  EXPECT_EQ(index.Query(both, 1).at(0).frame, 20U);
}

TEST(PlaceIndexTest, IsDeterministic) {
  Frames a(30);
  Frames b(30);
  const Descriptors query = SeenAgain(a.frames[7], 0.3, 30, a.rng);
  const auto first = a.index.Query(query, 10);
  const auto second = b.index.Query(query, 10);
  ASSERT_EQ(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].frame, second[i].frame);
    EXPECT_EQ(first[i].score, second[i].score);
  }
}

TEST(PlaceIndexTest, ManyFramesFillSegmentAfterSegment) {
  Frames world(0);
  constexpr size_t kCount = PlaceBlock::kMaxFrames + 2 * PlaceIndex::kMaxNewFrames + 3;
  for (size_t i = 0; i < kCount; ++i) {
    world.frames.push_back(test::RandomDescriptors(20, world.rng));
    world.index.Add(i, world.frames.back());
  }
  EXPECT_EQ(world.index.num_frames(), kCount);
  for (size_t i = 0; i < kCount; i += 97) EXPECT_EQ(world.index.Query(world.frames[i], 1).at(0).frame, i);
  for (size_t i = 0; i < kCount; ++i) {
    if (i % 3 != 0) world.index.Remove(i);
  }
  for (size_t i = 0; i < kCount; i += 3) EXPECT_EQ(world.index.Query(world.frames[i], 1).at(0).frame, i);
}

/// What was sealed and stored, another index reads; frames that came after are added to it.
TEST(PlaceIndexTest, BlocksCarryItOver) {
  Frames world(300);
  PlaceIndex read(PlaceIndex::Options{});
  std::vector<std::string> stored;
  Frames first(0);
  for (size_t i = 0; i < world.frames.size(); ++i) {
    first.index.Add(1000 + i, world.frames[i]);
    if (first.index.num_new_frames() == 100) stored.push_back(EncodePlaceBlock(first.index.SealBlock()));
  }
  ASSERT_EQ(stored.size(), 3U);
  const auto accept = [](uint64_t frame) { return frame != 1007; };
  for (const std::string& bytes : stored) {
    const auto block = DecodePlaceBlock(bytes);
    ASSERT_TRUE(block.ok()) << block.status();
    ASSERT_TRUE(read.AddBlock(*block, accept).ok());
    ASSERT_TRUE(read.AddBlock(*block, accept).ok()) << "known already";
  }
  EXPECT_EQ(read.num_frames(), 299U);
  EXPECT_FALSE(read.Contains(1007));
  EXPECT_EQ(read.num_new_frames(), 0U);
  read.Add(1007, world.frames[7]);
  for (size_t i = 0; i < world.frames.size(); i += 7) {
    const Descriptors again = SeenAgain(world.frames[i], 0.5, 20, world.rng);
    const auto expected = world.index.Query(again, 4);
    const auto found = read.Query(again, 4);
    ASSERT_EQ(found.size(), expected.size());
    EXPECT_EQ(found[0].frame, expected[0].frame);
    EXPECT_NEAR(found[0].score, expected[0].score, 1e-4);
  }
}

TEST(PlaceIndexTest, RefusesBlocksOfOtherWords) {
  PlaceIndex other({.words = {.seed = 8}});
  Rng rng(66);
  other.Add(1, test::RandomDescriptors(10, rng));
  PlaceIndex index(PlaceIndex::Options{});
  EXPECT_EQ(index.AddBlock(other.SealBlock(), {}).code(), absl::StatusCode::kInvalidArgument);
}

TEST(PlaceBlockTest, EveryDamageIsFound) {
  Rng rng(67);
  PlaceIndex index(PlaceIndex::Options{});
  for (uint64_t i = 0; i < 3; ++i) index.Add(i, test::RandomDescriptors(5, rng));
  const std::string bytes = EncodePlaceBlock(index.SealBlock());
  ASSERT_TRUE(DecodePlaceBlock(bytes).ok());
  for (size_t i = 0; i < bytes.size(); ++i) {
    EXPECT_EQ(DecodePlaceBlock(bytes.substr(0, i)).status().code(), absl::StatusCode::kDataLoss) << i;
    std::string flipped = bytes;
    flipped[i] = static_cast<char>(flipped[i] ^ 4);
    EXPECT_EQ(DecodePlaceBlock(flipped).status().code(), absl::StatusCode::kDataLoss) << i;
  }
}

TEST(PlaceIndexTest, CanBeMoved) {
  Frames world(3);
  const PlaceIndex moved = std::move(world.index);
  EXPECT_EQ(moved.Query(world.frames[1], 1).at(0).frame, 1001U);
}

}  // namespace
}  // namespace mapp
