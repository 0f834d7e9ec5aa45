#include "tests/unit/storage/database_fixture.h"

#include "storage/sqlite/connection.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace mapp {
namespace {

constexpr size_t kFixturePacketBytes = 20'000;

}  // namespace

std::unique_ptr<MapStore> DatabaseTest::OpenStore(const std::string& file) {
  // No test cuts the power: spare a busy disk.
  return Value(OpenSqliteMapStore(file, {.sync_commits = false}));
}

void DatabaseTest::MakeDatabase(const std::string& file, int num_keyframes) {
  const auto store = OpenStore(file);
  for (int i = 0; i < num_keyframes; ++i) AddKeyframe(*store);
  Check(store->Close());
}

void DatabaseTest::MakeKilledDatabase(const std::string& file, int num_keyframes) const {
  const std::string live = folder_.File("live.db");
  const auto store = OpenStore(live);
  for (int i = 0; i < num_keyframes; ++i) AddKeyframe(*store);
  std::filesystem::copy_file(live, file);
  std::filesystem::copy_file(live + "-wal", file + "-wal");
  std::filesystem::copy_file(live + "-shm", file + "-shm");
  Check(store->Close());
  std::filesystem::remove(live);
  std::filesystem::remove(live + ".lock");
}

void DatabaseTest::AddKeyframe(MapStore& store) {
  Check(store.Write({}, [](MapWriter& writer) {
    Scene scene;
    if (const auto map = writer.FindMap("kitchen"); map.ok()) {
      const SessionRecord session = Value(writer.ListSessions(map->id)).at(0);
      scene = {map->id, session.camera, session.id};
    } else {
      scene = AddScene(writer, "kitchen");
    }
    const auto number = static_cast<uint32_t>(Value(writer.GetSession(scene.session)).num_keyframes);
    Value(writer.InsertPoint(scene.map, TestPoint(scene.session, number, {1, 1, 1})));
    return writer
        .InsertFrame(TestFrame(scene.map, scene.session, scene.camera, number, PoseAt(0, 0, 0)),
                     TestBytes(number, kFixturePacketBytes), {})
        .status();
  }));
}

int DatabaseTest::CountKeyframes(const std::string& file) {
  const auto store = OpenStore(file);
  const auto reader = Value(store->Read());
  const MapRecord map = Value(reader->FindMap("kitchen"));
  const std::vector<FrameRecord> frames = Value(reader->ListFrames(map.id, std::nullopt));
  bool is_whole = map.revision.value() == frames.size() && map.num_points == static_cast<int64_t>(frames.size()) &&
                  Value(reader->PointsInTile(map.id, {0, 0, 0})).size() == frames.size();
  for (size_t i = 0; i < frames.size(); ++i) {
    is_whole &= frames[i].number == i && Value(reader->GetPacket(frames[i].id)) == TestBytes(i, kFixturePacketBytes);
  }
  EXPECT_TRUE(is_whole) << file << " is no commit's state";
  return is_whole ? static_cast<int>(frames.size()) : -1;
}

std::vector<std::string> DatabaseTest::Entries(const std::string& folder) const {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.ends_with(".lock")) names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  return names;
}

void DatabaseTest::WriteBytes(const std::string& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

std::string DatabaseTest::ReadBytes(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void DatabaseTest::RunSqlOn(const std::string& file, const std::string& sql) {
  Check(Value(sqlite::Connection::Open(file, sqlite::Connection::Mode::kCreate, {}))->Execute(sql));
}

void DatabaseTest::Damage(const std::string& file) {
  // The root page of a table: page 2 is the pointer map.
  constexpr size_t kThirdPage = 2 * 16384;
  std::string bytes = ReadBytes(file);
  ASSERT_GT(bytes.size(), kThirdPage + 64);
  bytes.replace(kThirdPage, 64, std::string(64, '\x5a'));
  WriteBytes(file, bytes);
}

}  // namespace mapp
