// Every engine answers as the first one does: the same random changes, refused ones among them, and then all reads.
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/random_script.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <atomic>
#include <cstdlib>

namespace mapp {
namespace {

using Transcript = std::vector<std::string>;

/// How often the random test runs: MAPP_STORE_SEEDS, few unless told otherwise.
uint64_t NumSeeds() {
  const char* const given = std::getenv("MAPP_STORE_SEEDS");
  return given != nullptr ? std::stoull(given) : 2;
}

std::string Describe(const std::vector<SessionDiff>& diffs) {
  std::string text;
  for (const SessionDiff& diff : diffs) {
    text +=
        fmt::format("session {} frames {} {} {} points {} {} {}\n", diff.session.value(), diff.frames_added,
                    diff.frames_moved, diff.frames_removed, diff.points_added, diff.points_moved, diff.points_removed);
  }
  return text;
}

/// What is found in boxes of different sizes.
std::string DumpBoxes(MapReader& reader, MapId map) {
  std::string dump;
  for (const double half_m : {0.5, 4.0, 8.0, 13.3, 100.0}) {
    const Aabb box(Eigen::Vector3d::Constant(-half_m), Eigen::Vector3d::Constant(half_m));
    dump += fmt::format("within {} m:", half_m);
    for (const FrameRecord& frame : Value(reader.FramesInBox(map, box))) dump += fmt::format(" {}", frame.id.value());
    for (const TileRecord& tile : Value(reader.ListTiles(map, box))) dump += " " + tile.key.ToString();
    dump += '\n';
  }
  return dump;
}

/// All reads of the present, of every earlier revision, and of what lies between.
void AddReads(MapStore& store, Transcript* transcript) {
  const auto reader = Value(store.Read());
  transcript->push_back(DumpAll(*reader));
  for (const MapRecord& map : Value(reader->ListMaps())) {
    transcript->push_back(DumpBoxes(*reader, map.id));
    for (uint64_t revision = 0; revision <= map.revision.value(); ++revision) {
      const auto past = Value(store.ReadAsOf(map.id, Revision(revision)));
      transcript->push_back(DumpMap(*past, map.id) + DumpBoxes(*past, map.id));
      transcript->push_back(Describe(Value(reader->DiffRevisions(map.id, Revision(revision), map.revision))));
    }
  }
}

/// The script of the seed on a store of its own.
Transcript RunScript(const Engine& engine, uint64_t seed) {
  const TempFolder folder;
  std::atomic<int64_t> now_ns = 1'000;
  const StoreOpener open = engine.create(folder, [&now_ns] { return now_ns.load(); });
  auto store = Value(open());
  RandomScript script(seed);
  Transcript transcript;
  for (int i = 0; i < 120; ++i) {
    ++now_ns;
    for (std::string& line : script.Change(*store)) transcript.push_back(std::move(line));
    if (i % 60 == 30) {
      store.reset();
      store = Value(open());
    }
  }
  AddReads(*store, &transcript);
  return transcript;
}

class MapStoreDifferentialTest : public testing::TestWithParam<Engine> {};

std::vector<Engine> AllButTheFirst() {
  std::vector<Engine> engines = AllEngines();
  engines.erase(engines.begin());
  return engines;
}
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreDifferentialTest, testing::ValuesIn(AllButTheFirst()), EngineName);

TEST_P(MapStoreDifferentialTest, AnswersAsTheFirstEngineDoes) {
  for (uint64_t seed = 1; seed <= NumSeeds(); ++seed) {
    const Transcript expected = RunScript(AllEngines().front(), seed);
    const Transcript answered = RunScript(GetParam(), seed);
    for (size_t i = 0; i < std::min(expected.size(), answered.size()); ++i) {
      ASSERT_EQ(answered[i], expected[i]) << "seed " << seed << ", after " << (i > 0 ? expected[i - 1] : "the start");
    }
    ASSERT_EQ(answered.size(), expected.size()) << "seed " << seed;
  }
}

}  // namespace
}  // namespace mapp
