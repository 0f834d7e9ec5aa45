#include "client_sdk/src/tile_folder.h"

#include "test_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Optional;
using testing::SizeIs;
using testing::UnorderedElementsAre;

constexpr MapIdentity kGarage{.id = MapId(1), .created_ns = 5};
constexpr TileKey kHere{.x = 1, .y = -2, .z = 3};
constexpr TileKey kThere{.x = 2};

class TileFolderTest : public ::testing::Test {
 protected:
  std::unique_ptr<TileFolder> Open(const MapIdentity& map = kGarage, uint64_t max_bytes = 1 << 20) {
    return TileFolder::Open({.folder = temp_.path(), .max_bytes = max_bytes}, map).value();
  }
  static void MustWrite(TileFolder& folder, const TileKey& key, const std::string& bytes) {
    const Status written = folder.Write(key, bytes);
    ASSERT_TRUE(written.ok()) << written;
  }
  /// As if nobody had used the tile for so long.
  void Age(const TileKey& key, std::chrono::hours by) {
    const fs::path file = temp_.Find("tile", key.Packed());
    fs::last_write_time(file, fs::last_write_time(file) - by);
  }
  size_t NumFiles() const {
    size_t num_files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(temp_.path())) num_files += entry.is_regular_file();
    return num_files;
  }

  TestFolder temp_;
};

TEST_F(TileFolderTest, GivesBackWhatItWasGivenAfterReopening) {
  MustWrite(*Open(), kHere, "old");
  MustWrite(*Open(), kHere, std::string("new\0er", 6));
  const auto folder = Open();
  EXPECT_THAT(folder->Keys(), ElementsAre(kHere));
  EXPECT_THAT(folder->Read(kHere), Optional(std::string("new\0er", 6)));
  EXPECT_EQ(folder->Read(kThere), std::nullopt);
  folder->Remove(kHere);
  folder->Remove(kHere);
  EXPECT_THAT(Open()->Keys(), IsEmpty());
}

TEST_F(TileFolderTest, MapsAreKeptApartByNumberAndBirth) {
  MustWrite(*Open(), kHere, "garage");
  EXPECT_THAT(Open({.id = MapId(2), .created_ns = 5})->Keys(), IsEmpty());
  EXPECT_THAT(Open({.id = MapId(1), .created_ns = 6})->Keys(), IsEmpty()) << "made anew, or at another server";
}

TEST_F(TileFolderTest, MakesTheFolderAndThoseAbove) {
  const TileCacheOptions options{.folder = temp_.path() + "/a/b"};
  EXPECT_TRUE(TileFolder::CheckUsable(options).ok());
  EXPECT_TRUE(fs::is_directory(options.folder));
  EXPECT_EQ(NumFiles(), 0U) << "the trial leaves nothing";
}

TEST_F(TileFolderTest, SaysWhichFolderCannotBeUsed) {
  temp_.ReplaceByFile();
  for (const std::string& path : {temp_.path(), temp_.path() + "/below"}) {
    const Status status = TileFolder::CheckUsable({.folder = path});
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(status.message()), HasSubstr("tile_cache.folder: " + path + ": "));
    EXPECT_EQ(TileFolder::Open({.folder = path}, kGarage).status(), status);
  }
}

TEST_F(TileFolderTest, AFolderThatVanishesIsMadeAgain) {
  const auto folder = Open();
  MustWrite(*folder, kHere, "tile");
  fs::remove_all(temp_.path());
  EXPECT_EQ(folder->Read(kHere), std::nullopt);
  MustWrite(*folder, kHere, "tile");
  EXPECT_THAT(folder->Read(kHere), Optional(std::string("tile")));
}

TEST_F(TileFolderTest, TroubleInWritingIsToldAndHarmsNothing) {
  const auto folder = Open();
  temp_.ReplaceByFile();
  EXPECT_FALSE(folder->Write(kHere, "tile").ok());
  EXPECT_THAT(folder->Keys(), IsEmpty());
  EXPECT_EQ(folder->Read(kHere), std::nullopt);
}

TEST_F(TileFolderTest, BeyondTheLimitWhatWasUsedLeastLatelyGoesOfAllMaps) {
  const auto garage = Open(kGarage, 1000);
  const MapIdentity hall{.id = MapId(2), .created_ns = 7};
  const auto of_hall = Open(hall, 1000);
  MustWrite(*of_hall, kHere, std::string(400, 'h'));
  MustWrite(*garage, kHere, std::string(300, 'g'));
  MustWrite(*garage, kThere, std::string(200, 'g'));
  Age(kThere, std::chrono::hours(2));
  ASSERT_TRUE(garage->Read(kThere).has_value()) << "used";
  of_hall->Remove(kHere);
  MustWrite(*of_hall, TileKey{.x = 9}, std::string(400, 'h'));
  Age(TileKey{.x = 9}, std::chrono::hours(1));
  const auto later = Open(kGarage, 1000);
  MustWrite(*later, TileKey{.x = 3}, std::string(200, 'n'));
  EXPECT_THAT(Open(hall, 1000)->Keys(), IsEmpty());
  EXPECT_THAT(later->Keys(), UnorderedElementsAre(kHere, kThere, TileKey{.x = 3}));
}

TEST_F(TileFolderTest, ASmallerLimitIsKeptFromOpeningOn) {
  for (int32_t x = 0; x < 10; ++x) MustWrite(*Open(), TileKey{.x = x}, std::string(100, 't'));
  EXPECT_THAT(Open(kGarage, 500)->Keys(), SizeIs(4)) << "some room is left";
}

TEST_F(TileFolderTest, OtherFilesAreLeftAloneAndNotTakenForTiles) {
  const auto folder = Open();
  MustWrite(*folder, kHere, "tile");
  const fs::path map_folder = temp_.Find("tile", kHere.Packed()).parent_path();
  for (const char* name : {"notes.txt", "zz.tile", "00000000000000zz.tile", "ffffffffffffffff.tile"}) {
    std::ofstream(map_folder / name) << "mine";
  }
  std::ofstream(fs::path(temp_.path()) / "readme") << "mine";
  EXPECT_THAT(Open(kGarage)->Keys(), ElementsAre(kHere));
  EXPECT_EQ(NumFiles(), 6U);
}

TEST_F(TileFolderTest, WhatKilledWritersLeftIsClearedAwayInTime) {
  const auto folder = Open();
  MustWrite(*folder, kHere, "tile");
  const fs::path map_folder = temp_.Find("tile", kHere.Packed()).parent_path();
  const fs::path stale = map_folder / "0000000000000000.tile.1-1.part";
  const fs::path fresh = map_folder / "0000000000000000.tile.1-2.part";
  std::ofstream(stale) << "half";
  std::ofstream(fresh) << "half";
  fs::last_write_time(stale, fs::last_write_time(stale) - std::chrono::hours(2));
  EXPECT_THAT(Open()->Keys(), ElementsAre(kHere));
  EXPECT_FALSE(fs::exists(stale));
  EXPECT_TRUE(fs::exists(fresh)) << "its writer may be at work";
}

}  // namespace
}  // namespace mapp
