// Bundles that are whole, and say what no server has written or what this one does not take.

#include "storage/memory/memory_map_store.h"
#include "tests/unit/server/bundle/bundle_fixture.h"

#include <functional>
#include <limits>

namespace mapp::testing {
namespace {

using absl::StatusCode;
using ::testing::HasSubstr;
using Records = std::vector<BundleRecord>;

template <typename T>
T& First(Records& records) {
  for (BundleRecord& record : records) {
    if (std::holds_alternative<T>(record)) return std::get<T>(record);
  }
  throw std::runtime_error("no such record");
}

template <typename T>
void Remove(Records& records) {
  std::erase_if(records, [](const BundleRecord& record) { return std::holds_alternative<T>(record); });
}

template <typename T>
void Double(Records& records) {
  const T copy = First<T>(records);
  const auto first =
      std::ranges::find_if(records, [](const auto& record) { return std::holds_alternative<T>(record); });
  records.insert(first, copy);
}

struct WrongCase {
  std::string name;
  std::function<void(Records&)> spoil;
  std::string says;
  StatusCode code = StatusCode::kDataLoss;
};
void PrintTo(const WrongCase& wrong, std::ostream* stream) { *stream << wrong.name; }

class BundleWrongTest : public ::testing::TestWithParam<WrongCase> {};

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

const WrongCase kWrong[] = {
    {"NoMap", [](Records& r) { r.erase(r.begin()); }, "does not begin with its map"},
    {"TwoMaps", [](Records& r) { Double<BundleMap>(r); }, "two maps"},
    {"Nothing", [](Records& r) { r.clear(); }, "it is empty"},
    {"OutOfOrder", [](Records& r) { std::swap(r[1], r[2]); }, "session 1 has a camera that is not there"},
    {"BackInOrder", [](Records& r) { r.push_back(r[1]); }, "a camera after a"},
    {"CameraTwice", [](Records& r) { Double<CameraRecord>(r); }, "camera 1 twice"},
    {"CameraOfNoSize", [](Records& r) { First<CameraRecord>(r).camera.width_px = 0; }, "camera 1"},
    {"SessionTwice", [](Records& r) { Double<SessionRecord>(r); }, "session 1 twice"},
    {"OpenSession", [](Records& r) { First<SessionRecord>(r).closed_ns.reset(); }, "session 1 is open"},
    {"NoDevice", [](Records& r) { First<SessionRecord>(r).device = ""; }, "session 1 has no device"},
    {"ControlCharacters", [](Records& r) { First<SessionRecord>(r).device = "a\nb"; }, "control characters",
     StatusCode::kInvalidArgument},
    {"NoScale", [](Records& r) { First<SessionRecord>(r).scale_map_session = 0; }, "scale_map_session"},
    {"NoFounder", [](Records& r) { First<BundleMap>(r).map.founder = SessionId(9); },
     "founder is none of its sessions"},
    {"TileEdge", [](Records& r) { First<BundleMap>(r).map.tile_edge_m = kNaN; }, "map.tile_edge_m"},
    {"Name", [](Records& r) { First<BundleMap>(r).map.name = ""; }, "name: must have 1 to 128",
     StatusCode::kInvalidArgument},
    {"Features", [](Records& r) { First<BundleMap>(r).map.features.num_levels = 77; }, "num_levels"},
    {"Scale", [](Records& r) { First<BundleMap>(r).map.features.scale_factor = 1.5F; },
     "feature_settings.scale_factor: this server makes maps of 1.2 only", StatusCode::kInvalidArgument},
    {"PointTwice", [](Records& r) { Double<PointRecord>(r); }, "it has a point twice"},
    {"PointOfNoSession", [](Records& r) { First<PointRecord>(r).session = SessionId(9); },
     "a session that is not there"},
    {"PointNowhere", [](Records& r) { First<PointRecord>(r).position.x() = kNaN; }, "point.position"},
    {"PointFarAway", [](Records& r) { First<PointRecord>(r).position.x() = 1e12; }, "outside of the map's tiling"},
    {"Direction", [](Records& r) { First<PointRecord>(r).view_direction *= 2; }, "not of unit length"},
    {"Confidence", [](Records& r) { First<PointRecord>(r).confidence = 2; }, "its confidence is 2"},
    {"FrameTwice",
     [](Records& r) {
       std::vector<BundleFrame*> frames;
       for (BundleRecord& record : r) {
         if (auto* frame = std::get_if<BundleFrame>(&record)) frames.push_back(frame);
       }
       frames[1]->id = frames[0]->id;
     },
     "it has a frame twice"},
    {"KeyframeTwice", [](Records& r) { Double<BundleFrame>(r); }, "keyframe 0 of session 1 twice"},
    {"FrameOfUnaligned", [](Records& r) { First<SessionRecord>(r).T_map_session.reset(); },
     "frame 1 is in the map, and its session has no place there"},
    {"Packet", [](Records& r) { First<BundleFrame>(r).packet = "MAPK and what else"; }, "frame 1: keyframe"},
    {"FrameOfNoSession",
     [](Records& r) {
       First<SessionRecord>(r).id = SessionId(9);
       First<BundleMap>(r).map.founder.reset();
       for (BundleRecord& record : r) {
         if (auto* point = std::get_if<PointRecord>(&record)) point->session = SessionId(9);
       }
     },
     "frame 1 is of a session that is not there"},
    {"Pose", [](Records& r) { First<BundleFrame>(r).T_frame_camera = PoseAt(kNaN, 0, 0); }, "frame: pose cannot be"},
    {"KeyframeOutOfItsImage",
     [](Records& r) {
       First<CameraRecord>(r).camera.width_px = 20;
       First<CameraRecord>(r).camera.projection = PinholeCamera{10, 10, 5, 5};
     },
     "is outside the 20 x"},
    {"ObservesNoPoint", [](Records& r) { First<BundleFrame>(r).observations[0].point = MapPointId(99); },
     "cannot have observed point 99"},
    {"ObservesTwice",
     [](Records& r) {
       auto& seen = First<BundleFrame>(r).observations;
       seen.push_back(seen[0]);
     },
     "cannot have observed point"},
    {"ObservesWithNoFeature", [](Records& r) { First<BundleFrame>(r).observations[0].feature_idx = 4; },
     "with feature 4"},
    {"ObservesBehindItself", [](Records& r) { First<BundleFrame>(r).observations[0].depth_m = -1; },
     "cannot have observed"},
    {"ObserverIsNoFrame", [](Records& r) { First<PointObservers>(r).frames[0] = FrameId(99); },
     "frame 99 observes point"},
    {"ObserversOfNoPoint", [](Records& r) { First<PointObservers>(r).point = MapPointId(99); },
     "observers of point 99"},
    {"ObserversTwice", [](Records& r) { Double<PointObservers>(r); }, "observers of a point twice"},
    {"FusedIntoNothing", [](Records& r) { First<FusedPoint>(r).point = MapPointId(99); },
     "fused into what is not there"},
    {"NoFrames", [](Records& r) { Remove<BundleFrame>(r); }, "observes point 1, and is not there"},
    {"TagIsANumber", [](Records& r) { r.push_back(BundleTag{"12"}); }, "tag: must be a name that is no number"},
};
INSTANTIATE_TEST_SUITE_P(Bundles, BundleWrongTest, ::testing::ValuesIn(kWrong),
                         [](const auto& tested) { return tested.param.name; });

TEST_P(BundleWrongTest, IsRefusedAndChangesNothing) {
  const SmallMap small;
  Records records = small.records();
  GetParam().spoil(records);
  const auto store = Value(OpenMemoryMapStore(CreateMemoryDatabase()));
  const auto imported = ImportFromString(*store, WriteRecords(records));
  EXPECT_THAT(imported, HasCode(GetParam().code));
  EXPECT_THAT(std::string(imported.status().message()), HasSubstr(GetParam().says));
  EXPECT_TRUE(Value(Value(store->Read())->ListMaps()).empty());
}

TEST(BundleTest, TakenNameSaysWhatToDo) {
  SmallMap small;
  const auto again = ImportFromString(small.store(), small.bundle());
  EXPECT_THAT(again, HasCode(StatusCode::kAlreadyExists));
  EXPECT_THAT(std::string(again.status().message()), HasSubstr("map \"cell\" is there already"));
  EXPECT_THAT(std::string(again.status().message()), HasSubstr("--as"));
  EXPECT_TRUE(ImportFromString(small.store(), small.bundle(), "other").ok());
}

TEST(BundleTest, OtherFeatureSettingsStandBesideEachOther) {
  SmallMap small;
  Records records = small.records();
  First<BundleMap>(records).map.features = {.descriptor_kind = "BRISK", .num_levels = 4, .patch_size_px = 41};
  const ImportedMap imported = Value(ImportFromString(small.store(), WriteRecords(records), "other"));
  EXPECT_EQ(imported.map.features.descriptor_kind, "BRISK");
  EXPECT_EQ(Value(Value(small.store().Read())->ListMaps()).size(), 2U);
}

}  // namespace
}  // namespace mapp::testing
