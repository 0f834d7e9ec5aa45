#pragma once

#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/store_fixture.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mapp {

/// SQLite map databases in a temporary folder, each with the map "kitchen" of one session, whose keyframes count from
/// 0. The n-th commit after the first brings keyframe n and one point: any other state is torn.
class DatabaseTest : public testing::Test {
 protected:
  static std::unique_ptr<MapStore> OpenStore(const std::string& file);
  /// A closed database with this many keyframes.
  static void MakeDatabase(const std::string& file, int num_keyframes);
  /// As it is on disk when its server is killed: file and write-ahead log, nothing folded in.
  void MakeKilledDatabase(const std::string& file, int num_keyframes) const;
  /// One commit with the session's next keyframe.
  static void AddKeyframe(MapStore& store);
  /// The number of keyframes of a database that is one commit's state; -1, and a failure, when it is none.
  static int CountKeyframes(const std::string& file);

  /// What is in the folder, sorted, locks left out.
  std::vector<std::string> Entries(const std::string& folder = "") const;
  static void WriteBytes(const std::string& file, const std::string& bytes);
  static std::string ReadBytes(const std::string& file);
  static void RunSqlOn(const std::string& file, const std::string& sql);
  /// Overwrites the beginning of a table.
  static void Damage(const std::string& file);

  TempFolder folder_;
  const std::string file_ = folder_.File("maps.db");
};

}  // namespace mapp
