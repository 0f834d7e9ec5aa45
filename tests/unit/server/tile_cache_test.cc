#include "server/service/tile_cache.h"

#include "server/service/loaded_tile.h"
#include "tests/unit/server/service_fixture.h"
#include "tests/unit/server/tile_content.h"

#include <thread>

namespace mapp::testing {
namespace {

/// Writes points of a founder straight into the store, and tells caches of it as an upload does.
class TileCacheTest : public ServiceFixture {
 protected:
  TileCacheTest() : session_(Open()) {
    MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session_, 0);
    map_ = Map().id;
  }

  /// One commit: some new points in one tile, some old ones changed, one removed.
  void Commit(std::span<TileCache* const> caches) {
    TileChange change;
    change.key = kKey;
    Revision revision;
    const Status written = store_->Write(
        context_,
        [&](MapWriter& writer) -> Status {
          MAPP_ASSIGN_OR_RETURN(revision, writer.NextRevision(map_));
          return ChangeTile(writer, change);
        },
        [&] {
          for (TileCache* cache : caches) cache->Apply(map_, revision, std::span(&change, 1));
        });
    ASSERT_TRUE(written.ok()) << written;
  }

  std::map<uint64_t, PointContent> Loaded(TileCache& cache) {
    const auto tile = cache.GetTile(map_, kKey);
    EXPECT_TRUE(tile.ok()) << tile.status();
    return ContentOf(tile->get());
  }

  static constexpr TileKey kKey{20, 0, 0};
  SessionId session_;
  MapId map_;

 private:
  Status ChangeTile(MapWriter& writer, TileChange& change) {
    for (int i = 0; i < 20; ++i) {
      PointRecord point;
      point.session = session_;
      point.session_point = ++last_session_point_;
      point.in_map = true;
      point.position = {rng_.Uniform(160, 168), rng_.Uniform(0, 8), rng_.Uniform(0, 8)};
      point.num_observations = 1;
      MAPP_ASSIGN_OR_RETURN(point.id, writer.InsertPoint(map_, point));
      change.upserted.push_back(point);
    }
    if (!live_.empty()) {
      PointRecord touched = live_[rng_.Below(live_.size())];
      ++touched.num_observations;
      MAPP_RETURN_IF_ERROR(writer.TouchPoint(touched));
      change.upserted.push_back(touched);
      const PointRecord removed = live_[rng_.Below(live_.size())];
      if (removed.id != touched.id) {
        MAPP_RETURN_IF_ERROR(writer.RetirePoint(removed.id, std::nullopt));
        change.removed.push_back(removed.id);
      }
    }
    for (const MapPointId id : change.removed) {
      std::erase_if(live_, [&](const PointRecord& point) { return point.id == id; });
    }
    for (const PointRecord& point : change.upserted) {
      std::erase_if(live_, [&](const PointRecord& known) { return known.id == point.id; });
      live_.push_back(point);
    }
    return absl::OkStatus();
  }

  std::vector<PointRecord> live_;
  uint64_t last_session_point_ = 1'000'000;
};

TEST_F(TileCacheTest, AppliedChangesGiveTheSameAsLoading) {
  TileCache warm(*store_, size_t{64} << 20);
  TileCache* const caches[] = {&warm};
  EXPECT_TRUE(Loaded(warm).empty());
  for (int i = 0; i < 40; ++i) {
    Commit(caches);
    TileCache cold(*store_, size_t{64} << 20);
    ASSERT_EQ(Loaded(warm), Loaded(cold)) << "commit " << i;
  }
}

TEST_F(TileCacheTest, UploadsReachTilesInMemory) {
  TileCache cold(*store_, size_t{64} << 20);
  const Aabb everywhere(Eigen::Vector3d::Constant(-20), Eigen::Vector3d::Constant(20));
  EXPECT_GT(Overlap(world_, SyntheticWorld::Stand(0, -2, 0), session_), 0.9);  // loads the service's tiles
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 1.5), session_, 1);
  EXPECT_GT(Overlap(world_, SyntheticWorld::Stand(0, -2, 1.5), session_), 0.9);
  const auto tiles = cold.TilesInBox(map_, everywhere);
  ASSERT_TRUE(tiles.ok());
  size_t num_points = 0;
  for (const auto& tile : *tiles) num_points += tile->num_points();
  EXPECT_EQ(static_cast<int64_t>(num_points), Map().num_points);
}

TEST_F(TileCacheTest, LoadsThatRaceWithCommitsLoseNothing) {
  TileCache cache(*store_, size_t{64} << 20);
  TileCache* const caches[] = {&cache};
  std::vector<std::jthread> readers;
  for (int i = 0; i < 2; ++i) {
    readers.emplace_back([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        const auto tile = cache.GetTile(map_, kKey);
        EXPECT_TRUE(tile.ok()) << tile.status();
        // Makes the next use load again, while commits go on.
        cache.Invalidate(map_, std::span(&kKey, 1));
      }
    });
  }
  for (int i = 0; i < 60; ++i) {
    Commit(caches);
    TileCache cold(*store_, size_t{64} << 20);
    ASSERT_EQ(Loaded(cache), Loaded(cold)) << "commit " << i;
  }
}

TEST_F(TileCacheTest, NewTilesAreFoundAfterTheDirectoryWasRead) {
  TileCache cache(*store_, size_t{64} << 20);
  const Aabb around(Eigen::Vector3d(161, 1, 1), Eigen::Vector3d(167, 7, 7));
  ASSERT_TRUE(cache.TilesInBox(map_, around)->empty());
  TileCache* const caches[] = {&cache};
  Commit(caches);
  EXPECT_EQ(cache.TilesInBox(map_, around)->size(), 1U);
  Commit({});
  cache.Invalidate(map_, std::span(&kKey, 1));
  TileCache cold(*store_, size_t{64} << 20);
  EXPECT_EQ(Loaded(cache), Loaded(cold));
}

TEST_F(TileCacheTest, KeepsToItsLimit) {
  TileCache large(*store_, size_t{64} << 20);
  const Aabb everywhere(Eigen::Vector3d::Constant(-20), Eigen::Vector3d::Constant(20));
  ASSERT_GE(large.TilesInBox(map_, everywhere)->size(), 2U);
  TileCache small(*store_, large.bytes() / 2);
  ASSERT_EQ(small.TilesInBox(map_, everywhere)->size(), large.TilesInBox(map_, everywhere)->size());
  EXPECT_LE(small.bytes(), large.bytes() / 2);
}

TEST_F(TileCacheTest, DeletedMapIsForgotten) {
  TileCache cache(*store_, size_t{64} << 20);
  const Aabb everywhere(Eigen::Vector3d::Constant(-20), Eigen::Vector3d::Constant(20));
  ASSERT_FALSE(cache.TilesInBox(map_, everywhere)->empty());
  ASSERT_TRUE(service_->DeleteMap(context_, "room", true).ok());
  cache.OnMapDeleted(map_);
  EXPECT_EQ(cache.bytes(), 0U);
  EXPECT_EQ(cache.TilesInBox(map_, everywhere).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(cache.GetTile(map_, kKey).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(cache.bytes(), 0U);
}

}  // namespace
}  // namespace mapp::testing
