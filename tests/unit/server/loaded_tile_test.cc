#include "server/service/loaded_tile.h"

#include "mapp/base/rng.h"
#include "tests/unit/server/tile_content.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mapp::testing {
namespace {

constexpr TileKey kKey{0, 0, 0};

PointRecord RandomPoint(uint64_t id, FrameId observer, Rng& rng) {
  PointRecord point;
  point.id = MapPointId(id);
  point.in_map = true;
  point.position = {rng.Uniform(0, 8), rng.Uniform(0, 8), rng.Uniform(0, 8)};
  point.num_observations = static_cast<uint32_t>(1 + rng.Below(5));
  point.observers = {observer};
  return point;
}

ObserverFrame FrameAt(uint64_t id) {
  const Pose3 T_map_camera(Eigen::Quaterniond::Identity(), Eigen::Vector3d(4, 4, -static_cast<double>(id)));
  return {{FrameId(id), T_map_camera, 1.0F}, SessionId(1)};
}

/// Applies random changes to a loaded tile and to a plain list of points.
class ChangingTile {
 public:
  explicit ChangingTile(uint64_t seed) : rng_(seed) {}

  void Step(uint64_t revision) {
    TileChange change;
    change.key = kKey;
    change.frames = {FrameAt(revision)};
    for (int i = 0; i < 40; ++i) {
      const bool replace = !points_.empty() && rng_.Uniform() < 0.3;
      const uint64_t id =
          replace ? std::next(points_.begin(), static_cast<long>(rng_.Below(points_.size())))->first : ++last_id_;
      if (touched_.insert({revision, id}).second == false) continue;
      points_[id] = RandomPoint(id, FrameId(revision), rng_);
      change.upserted.push_back(points_[id]);
    }
    for (int i = 0; i < 8; ++i) {
      const uint64_t id = std::next(points_.begin(), static_cast<long>(rng_.Below(points_.size())))->first;
      if (!touched_.insert({revision, id}).second) continue;
      points_.erase(id);
      change.removed.push_back(MapPointId(id));
    }
    frames_.push_back(FrameAt(revision));
    StatusOr<std::shared_ptr<const LoadedTile>> next =
        tile_ == nullptr ? LoadedTile::Create(kKey, Revision(revision), change.upserted, frames_)
                         : tile_->With(change, Revision(revision));
    ASSERT_TRUE(next.ok()) << next.status();
    tile_ = *std::move(next);
    if (revision == 1) {
      for (const MapPointId id : change.removed) points_[id.value()] = RemovedFromFirst(change, id);
    }
  }

  std::shared_ptr<const LoadedTile> Reloaded() const {
    std::vector<PointRecord> points;
    for (const auto& [id, point] : points_) points.push_back(point);
    StatusOr<std::shared_ptr<const LoadedTile>> tile = LoadedTile::Create(kKey, Revision(1), points, frames_);
    EXPECT_TRUE(tile.ok());
    return *tile;
  }
  const LoadedTile& tile() const { return *tile_; }
  Rng& rng() { return rng_; }

 private:
  /// The first step only creates: what it would have removed stays.
  static PointRecord RemovedFromFirst(const TileChange& change, MapPointId id) {
    return *std::find_if(change.upserted.begin(), change.upserted.end(),
                         [&](const PointRecord& point) { return point.id == id; });
  }

  Rng rng_;
  uint64_t last_id_ = 0;
  std::map<uint64_t, PointRecord> points_;
  std::set<std::pair<uint64_t, uint64_t>> touched_;
  std::vector<ObserverFrame> frames_;
  std::shared_ptr<const LoadedTile> tile_;
};

TEST(LoadedTileTest, ManySmallChangesGiveTheSameAsLoading) {
  ChangingTile changing(1);
  for (uint64_t revision = 1; revision <= 60; ++revision) {
    changing.Step(revision);
    const std::shared_ptr<const LoadedTile> reloaded = changing.Reloaded();
    ASSERT_EQ(ContentOf(&changing.tile()), ContentOf(reloaded.get())) << "revision " << revision;
    EXPECT_EQ(changing.tile().num_points(), reloaded->num_points());
    EXPECT_LE(changing.tile().num_segments(), 4U);
    EXPECT_EQ(changing.tile().revision(), Revision(revision));
  }
}

TEST(LoadedTileTest, SearchesAllSegmentsAndNoHiddenPoint) {
  ChangingTile changing(2);
  for (uint64_t revision = 1; revision <= 30; ++revision) changing.Step(revision);
  const std::shared_ptr<const LoadedTile> reloaded = changing.Reloaded();
  for (int i = 0; i < 200; ++i) {
    Rng& rng = changing.rng();
    const Eigen::Vector3f query =
        Eigen::Vector3d(rng.Uniform(-1, 9), rng.Uniform(-1, 9), rng.Uniform(-1, 9)).cast<float>();
    const auto collect = [&](const LoadedTile& tile) {
      std::set<uint64_t> ids;
      tile.AnyWithin(query, 1.2F, [&](const LoadedPoint& point) { return !ids.insert(point.id.value()).second; });
      return ids;
    };
    EXPECT_EQ(collect(changing.tile()), collect(*reloaded));
  }
}

TEST(LoadedTileTest, RemovingEveryPointLeavesNoTile) {
  Rng rng(3);
  const std::vector<PointRecord> points = {RandomPoint(1, FrameId(1), rng), RandomPoint(2, FrameId(1), rng)};
  const std::vector<ObserverFrame> frames = {FrameAt(1)};
  const auto tile = LoadedTile::Create(kKey, Revision(1), points, frames);
  ASSERT_TRUE(tile.ok());
  TileChange change;
  change.key = kKey;
  change.removed = {MapPointId(2), MapPointId(1), MapPointId(77)};
  const auto emptied = (*tile)->With(change, Revision(2));
  ASSERT_TRUE(emptied.ok());
  EXPECT_EQ(*emptied, nullptr);
  EXPECT_EQ((*tile)->num_points(), 2U) << "versions are immutable";
}

TEST(LoadedTileTest, ObserverDirectionsPointFromTheCameraToThePoint) {
  PointRecord point;
  point.id = MapPointId(1);
  point.position = {4, 4, 2};
  point.observers = {FrameId(1), FrameId(9)};
  const std::vector<ObserverFrame> frames = {FrameAt(1)};
  const auto tile = LoadedTile::Create(kKey, Revision(1), std::span(&point, 1), frames);
  ASSERT_TRUE(tile.ok());
  (*tile)->ForEachPoint([](const LoadedPoint& loaded) {
    ASSERT_EQ(loaded.num_observers, 1U) << "frame 9 is unknown";
    EXPECT_LT((loaded.observer_directions[0] - Eigen::Vector3f::UnitZ()).norm(), 1e-6F);
  });
}

}  // namespace
}  // namespace mapp::testing
