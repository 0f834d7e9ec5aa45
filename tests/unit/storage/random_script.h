#pragma once

#include "mapp/base/rng.h"
#include "tests/unit/storage/store_fixture.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace mapp {

/// A random sequence of changes to a store: all that a MapWriter can do, on a few maps, some of it refused, some of the
/// changes undone. It depends on the seed and on what the store answers, so that two stores that answer alike are asked
/// alike.
class RandomScript {
 public:
  explicit RandomScript(uint64_t seed) : rng_(seed) {}

  /// Runs one change of a few operations. The lines say what each operation and the change came to.
  std::vector<std::string> Change(MapStore& store);

 private:
  /// Ids that there are or have been.
  struct Known {
    std::vector<MapId> maps;
    std::vector<CameraId> cameras;
    std::vector<SessionId> sessions;
    std::vector<FrameId> frames;
    std::vector<MapPointId> points;
    std::vector<ChangeId> changes;
    std::vector<PointRecord> retired;  ///< or asked to be
  };

  void Operate(MapWriter& writer);
  void CreateMap(MapWriter& writer);
  void DeleteMap(MapWriter& writer);
  void ChangeMap(MapWriter& writer);
  void NameRevision(MapWriter& writer);
  void InsertSession(MapWriter& writer);
  void UpdateSession(MapWriter& writer);
  void InsertFrame(MapWriter& writer);
  void ChangeFrame(MapWriter& writer);
  void InsertPoint(MapWriter& writer);
  void ChangePoint(MapWriter& writer);
  void RetirePoint(MapWriter& writer);
  void ReturnPoint(MapWriter& writer);
  void ReportChange(MapWriter& writer);
  void ChangeChange(MapWriter& writer);
  void PutBlob(MapWriter& writer);

  bool OneIn(uint64_t n) { return rng_.Below(n) == 0; }
  double RandomX() { return rng_.Uniform(-20, 20); }
  /// Now and then one that cannot be stored.
  double RandomOrBad(double otherwise);
  Eigen::Vector3d RandomPosition() { return {RandomOrBad(RandomX()), 1, 1}; }
  Pose3 RandomPose() { return PoseAt(RandomOrBad(RandomX()), 0, 0); }
  SessionRecord RandomSession();
  std::vector<Observation> RandomObservations();
  /// One of the ids, now and then one that never was.
  template <typename IdType>
  IdType Pick(const std::vector<IdType>& ids) {
    return ids.empty() || OneIn(30) ? IdType(9999) : ids[rng_.Below(ids.size())];
  }
  /// The map of the session, now and then another.
  MapId MapFor(MapWriter& writer, SessionId session);

  void Note(const std::string& operation, const Status& status);
  template <typename IdType>
  void Note(const std::string& operation, const StatusOr<IdType>& id, std::vector<IdType>* known);

  Rng rng_;
  Known known_;
  std::vector<std::string> lines_;
};

}  // namespace mapp
