// What a map is after it has been a bundle.

#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/bundle/bundle_fixture.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <algorithm>

namespace mapp::testing {
namespace {

/// The map "room" of a real service's database: sessions aligned, quarantined and not, points fused, a tag.
class BundleRoundTripTest : public MapStoreTest {
 protected:
  void SetUp() override {
    MapStoreTest::SetUp();
    source_ = Value(OpenSqliteMapStore(HealthyDatabase(), {.read_only = true}));
    room_ = Value(Value(source_->Read())->FindMap("room"));
  }

  std::unique_ptr<MapStore> source_;
  MapRecord room_;
};
INSTANTIATE_TEST_SUITE_P(Engines, BundleRoundTripTest, ::testing::ValuesIn(AllEngines()), EngineName);

TEST_P(BundleRoundTripTest, ImportedMapIsTheExportedOne) {
  NewScene();  // numbers of the new store are others
  const ImportedMap imported = Value(ImportFromString(store(), ExportToString(*source_, "room")));
  EXPECT_EQ(imported.map.name, "room");
  EXPECT_EQ(imported.map.revision, Revision(1));
  EXPECT_EQ(imported.counts.frames, Value(Value(source_->Read())->ListFrames(room_.id, std::nullopt)).size());
  EXPECT_GT(imported.counts.sessions, 3U);
  const auto before = Value(source_->Read());
  const auto after = Read();
  ExpectSameMap(*before, room_, *after, imported.map);
  const std::vector<RevisionRecord> revisions =
      Value(after->ListRevisions(imported.map.id, Revision(0), imported.map.revision));
  ASSERT_EQ(revisions.size(), 1U);
  EXPECT_EQ(revisions[0].cause, RevisionCause::kImport);
}

TEST_P(BundleRoundTripTest, SecondBundleIsTheFirstButForItsNumbers) {
  Value(ImportFromString(store(), ExportToString(*source_, "room"), "once"));
  const std::string second = ExportToString(store(), "once");
  // Numbers are given in the bundle's order: from an empty store they come out as they went in.
  const TempFolder folder;
  const auto fresh = Value(GetParam().create(folder, {})());
  Value(ImportFromString(*fresh, second));
  EXPECT_TRUE(ExportToString(*fresh, "once") == second);
  Check(fresh->Close());
}

TEST_P(BundleRoundTripTest, CarriesAnEarlierState) {
  const auto earlier = Value(source_->ReadAsOf(room_.id, Revision(5)));
  const MapRecord then = Value(earlier->FindMap("room"));
  ASSERT_LT(then.num_frames, room_.num_frames);
  const ImportedMap imported = Value(ImportFromString(store(), ExportToString(*source_, "room", "5"), "then"));
  ExpectSameMap(*earlier, then, *Read(), imported.map);
}

TEST_P(BundleRoundTripTest, CarriesTagsOfTheExportedRevision) {
  const auto tags = Value(Value(source_->Read())->ListTags(room_.id));
  ASSERT_FALSE(tags.empty());
  const ImportedMap imported = Value(ImportFromString(store(), ExportToString(*source_, "room", tags.front().name)));
  const auto carried = Value(Read()->ListTags(imported.map.id));
  ASSERT_EQ(carried.size(), 1U);
  EXPECT_EQ(carried[0].name, tags.front().name);
  EXPECT_EQ(carried[0].revision, Revision(1));
  const ImportedMap first = Value(ImportFromString(store(), ExportToString(*source_, "room", "1"), "first"));
  EXPECT_TRUE(Value(Read()->ListTags(first.map.id)).empty());
}

TEST_P(BundleRoundTripTest, EmptyMapKeepsItsSettings) {
  MapRecord map;
  map.name = "empty";
  map.tile_edge_m = 5;
  map.features = {.descriptor_kind = "other", .num_levels = 5, .patch_size_px = 41};
  MustWrite([&](MapWriter& writer) { Value(writer.CreateMap(map)); });
  const ImportedMap imported = Value(ImportFromString(store(), ExportToString(store(), "empty"), "copy"));
  EXPECT_EQ(imported.map.tile_edge_m, 5);
  EXPECT_FALSE(FirstDifference(imported.map.features, map.features));
  EXPECT_EQ(imported.map.num_sessions, 0);
}

TEST_P(BundleRoundTripTest, FusedPointsStandForWhatTheyStoodFor) {
  SmallMap small;
  const ImportedMap imported = Value(ImportFromString(store(), small.bundle()));
  EXPECT_EQ(imported.counts.fused, 1U);
  const SessionId session = Value(Read()->ListSessions(imported.map.id)).front().id;
  const uint64_t numbers[] = {1, 3};
  const auto found = Value(Read()->FindSessionPoints(session, numbers));
  ASSERT_TRUE(found[0] && found[1]);
  EXPECT_EQ(*found[0], *found[1]);
  ExpectSameMap(*Value(small.store().Read()), Value(Value(small.store().Read())->FindMap("cell")), *Read(),
                imported.map);
}

TEST_P(BundleRoundTripTest, InterruptedImportLeavesNothing) {
  const std::string bundle = ExportToString(*source_, "room");
  bool writing = false;
  CallContext context;
  context.is_cancelled = [&writing] { return writing; };
  const auto stop_half_way = [&](const BundleImportProgress& progress) {
    writing = progress.writing && progress.bytes_done > progress.bytes_total / 2;
  };
  const auto imported = ImportFromString(store(), bundle, {}, context, stop_half_way);
  EXPECT_THAT(imported, HasCode(absl::StatusCode::kCancelled));
  EXPECT_TRUE(writing);
  EXPECT_TRUE(Value(Read()->ListMaps()).empty());
  EXPECT_TRUE(Value(Read()->ListSessions(std::nullopt)).empty());
  EXPECT_TRUE(ImportFromString(store(), bundle).ok());
}

TEST(BundleDatabaseTest, NothingIsWrongWithADatabaseAfterImports) {
  const DatabaseCopy copy;
  const auto source = Value(OpenSqliteMapStore(HealthyDatabase(), {.read_only = true}));
  const auto store = Value(OpenSqliteMapStore(copy.file()));
  const std::string bundle = ExportToString(*source, "room");
  EXPECT_THAT(ImportFromString(*store, bundle), HasCode(absl::StatusCode::kAlreadyExists));
  Value(ImportFromString(*store, bundle, "beside"));
  Value(ImportFromString(*store, ExportToString(*source, "room", "7"), "earlier"));
  Value(ImportFromString(*store, SmallMap().bundle()));
  Check(store->Close());
  const VerifyReport report = Value(Verify(copy.file()));
  EXPECT_EQ(report.num_violations(), 0) << Describe(report);
  EXPECT_EQ(report.num_maps, 4);
}

}  // namespace
}  // namespace mapp::testing
