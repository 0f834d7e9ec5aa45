#include "tests/unit/storage/numbered_keyframes.h"

#include "mapp/codec/keyframe_codec.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <map>
#include <utility>

namespace mapp {

Keyframe NumberedKeyframe(SessionId session, uint32_t number, uint16_t num_features) {
  Keyframe keyframe;
  keyframe.session = session;
  keyframe.number = number;
  keyframe.stamp_ns = int64_t{number} * 1'000'000'000;
  keyframe.T_frame_camera = PoseAt(0.2 * number, 0, 0);
  keyframe.features.resize(num_features);
  const std::string bytes = TestBytes(session.value() * 1'000'000 + number, num_features * OrbDescriptor::kBytes);
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    const char* const descriptor = bytes.data() + i * OrbDescriptor::kBytes;
    keyframe.features[i].descriptor = OrbDescriptor::FromBytes(reinterpret_cast<const uint8_t*>(descriptor));
  }
  return keyframe;
}

Status AddNumberedKeyframe(MapWriter& writer, const SessionRecord& session, uint32_t number, uint16_t num_features) {
  std::vector<PointRecord> points;
  std::vector<Observation> observations;
  for (uint16_t i = 0; i < kPointsPerNumberedKeyframe; ++i) {
    PointRecord point =
        TestPoint(session.id, uint64_t{number} * 100 + i, {0.3 * number, 0.1 * i, 1}, /*in_map=*/number % 3 != 0);
    point.observers.clear();
    MAPP_ASSIGN_OR_RETURN(point.id, writer.InsertPoint(session.map, point));
    observations.push_back({.feature_idx = i, .point = point.id, .depth_m = 1});
    points.push_back(std::move(point));
  }
  const Keyframe keyframe = NumberedKeyframe(session.id, number, num_features);
  FrameRecord frame = TestFrame(session.map, session.id, session.camera, number, keyframe.T_frame_camera);
  frame.stamp_ns = keyframe.stamp_ns;
  frame.num_features = num_features;
  MAPP_ASSIGN_OR_RETURN(const FrameId id, writer.InsertFrame(frame, EncodeKeyframe(keyframe), observations));
  for (PointRecord& point : points) {
    point.observers = {id};
    MAPP_RETURN_IF_ERROR(writer.TouchPoint(point));
  }
  return absl::OkStatus();
}

std::vector<std::string> FindLostKeyframes(MapReader& reader, const std::vector<NumberedUpload>& acknowledged,
                                           uint16_t num_features) {
  std::vector<std::string> problems;
  std::map<std::pair<uint64_t, uint32_t>, int> stored;
  for (const MapRecord& map : Value(reader.ListMaps())) {
    const std::vector<FrameRecord> frames = Value(reader.ListFrames(map.id, std::nullopt));
    for (const FrameRecord& frame : frames) {
      ++stored[{frame.session.value(), frame.number}];
      const std::string packet = EncodeKeyframe(NumberedKeyframe(frame.session, frame.number, num_features));
      if (Value(reader.GetPacket(frame.id)) != packet ||
          Value(reader.GetObservations(frame.id)).size() != kPointsPerNumberedKeyframe) {
        problems.push_back(fmt::format("keyframe {} of session {} is not whole", frame.number, frame.session.value()));
      }
    }
    size_t num_points = 0;
    for (const SessionRecord& session : Value(reader.ListSessions(map.id))) {
      num_points += Value(reader.PointsOfSession(session.id)).size();
    }
    if (num_points != kPointsPerNumberedKeyframe * frames.size() || map.revision.value() != frames.size() ||
        map.num_frames != static_cast<int64_t>(frames.size())) {
      problems.push_back(fmt::format("{} keyframes are stored, {} points, revision {}, and {} counted", frames.size(),
                                     num_points, map.revision.value(), map.num_frames));
    }
  }
  for (const NumberedUpload& one : acknowledged) {
    const int count = stored[{one.session, one.number}];
    if (count == 1) continue;
    problems.push_back(fmt::format("keyframe {} of session {} is there {} times", one.number, one.session, count));
  }
  return problems;
}

}  // namespace mapp
