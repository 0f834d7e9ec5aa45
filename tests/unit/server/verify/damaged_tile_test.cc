// An encoded tile that is damaged is never sent: it is derived, and made again.

#include "mapp/codec/tile_codec.h"
#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/quarantine_fixture.h"

#include <sqlite3.h>

namespace mapp::testing {
namespace {

class DamagedTileTest : public QuarantineTest {
 protected:
  std::vector<std::string> Share() {
    std::vector<std::string> tiles;
    SharedMapInput input;
    input.session = founder_;
    input.view.T_frame_camera = SyntheticWorld::Stand(0, 0, 0);
    const auto sent = service_->RequestSharedMap(context_, input, [&](const std::string& tile) {
      tiles.push_back(tile);
      return absl::OkStatus();
    });
    EXPECT_TRUE(sent.ok()) << sent.status();
    return tiles;
  }
  /// Waits until what was sent has been stored.
  void Restart() {
    service_.reset();
    auto service = MapService::Create(*store_, {});
    ASSERT_TRUE(service.ok()) << service.status();
    service_ = *std::move(service);
  }
  int64_t RunSql(const std::string& sql) {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open_v2((folder_ / "map.db").c_str(), &db, SQLITE_OPEN_READWRITE, sqlite::ChecksumVfsName()),
              SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    const int64_t num_changed = sqlite3_total_changes(db);
    sqlite3_close(db);
    return num_changed;
  }
};

TEST_F(DamagedTileTest, IsMadeAgainOfItsPoints) {
  const std::vector<std::string> sound = Share();
  ASSERT_FALSE(sound.empty());
  // Stored behind the answer: until all are, they are asked for again.
  const auto num_stored = [&] {
    size_t num = 0;
    const auto reader = *store_->Read();
    const std::vector<TileRecord> tiles = *reader->ListTiles(Map().id, std::nullopt);
    for (const TileRecord& tile : tiles) {
      const auto blob = reader->GetTileBlob(Map().id, tile.key);
      num += blob.ok() && *blob ? 1 : 0;
    }
    return num;
  };
  while (num_stored() < sound.size()) Share();
  Restart();
  ASSERT_GE(RunSql("UPDATE tile_blobs SET crc32c = crc32c + 1"), static_cast<int64_t>(sound.size()));
  EXPECT_EQ(num_stored(), 0U);
  EXPECT_EQ(Share(), sound);
  while (num_stored() < sound.size()) Share();
}

}  // namespace
}  // namespace mapp::testing
