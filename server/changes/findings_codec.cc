// Layout: docs/formats/findings.md.

#include "mapp/base/bytes.h"
#include "server/changes/session_findings.h"

#include <algorithm>
#include <span>
#include <utility>

namespace mapp {
namespace {

constexpr uint8_t kVersion = 1;
/// Least bytes of one finding: id, seen, missed.
constexpr size_t kMinFindingBytes = 3;
constexpr size_t kFrameBytes = 1 + 7 * sizeof(double);

void PutFindings(std::span<const PointFinding> findings, ByteWriter& writer) {
  writer.PutVarint(findings.size());
  uint64_t previous = 0;
  for (const PointFinding& finding : findings) {
    writer.PutVarint(finding.point.value() - previous);
    writer.PutVarint(finding.num_seen);
    writer.PutVarint(finding.num_missed);
    previous = finding.point.value();
  }
}

uint16_t GetCount(ByteReader& reader) { return static_cast<uint16_t>(std::min<uint64_t>(reader.GetVarint(), 65535)); }

bool GetFindings(ByteReader& reader, std::vector<PointFinding>& findings) {
  const uint64_t count = reader.GetVarint();
  if (count > reader.remaining() / kMinFindingBytes) return false;
  findings.reserve(count);
  uint64_t id = 0;
  for (uint64_t i = 0; i < count; ++i) {
    id += reader.GetVarint();
    PointFinding finding{MapPointId(id), 0, 0};
    finding.num_seen = GetCount(reader);
    finding.num_missed = GetCount(reader);
    findings.push_back(finding);
  }
  return !reader.failed();
}

void PutPose(const Pose3& pose, ByteWriter& writer) {
  const Eigen::Quaterniond& q = pose.rotation();
  const Eigen::Vector3d& t = pose.translation();
  for (const double value : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()}) writer.Put(value);
}

Pose3 GetPose(ByteReader& reader) {
  Eigen::Vector3d t;
  for (double& value : t) value = reader.Get<double>();
  const auto w = reader.Get<double>(), x = reader.Get<double>(), y = reader.Get<double>(), z = reader.Get<double>();
  return Pose3::FromStored({w, x, y, z}, t);
}

}  // namespace

std::string EncodeFindings(const SessionFindings& findings) {
  ByteWriter writer;
  writer.Put(kVersion);
  writer.PutVarint(findings.session.value());
  writer.PutVarint(findings.frames.size());
  uint64_t previous = 0;
  for (const WitnessFrame& frame : findings.frames) {
    writer.PutVarint(frame.frame.value() - previous);
    PutPose(frame.T_map_camera, writer);
    previous = frame.frame.value();
  }
  PutFindings(findings.own, writer);
  writer.PutVarint(findings.earlier.size());
  for (const auto& [session, found] : findings.earlier) {
    writer.PutVarint(session.value());
    PutFindings(found, writer);
  }
  return writer.Take();
}

StatusOr<SessionFindings> DecodeFindings(std::string_view bytes) {
  const Status damaged = absl::DataLossError("findings: truncated or of another version");
  ByteReader reader(bytes);
  if (reader.Get<uint8_t>() != kVersion) return damaged;
  SessionFindings findings;
  findings.session = SessionId(reader.GetVarint());
  const uint64_t num_frames = reader.GetVarint();
  if (num_frames > reader.remaining() / kFrameBytes) return damaged;
  uint64_t frame = 0;
  for (uint64_t i = 0; i < num_frames; ++i) {
    frame += reader.GetVarint();
    findings.frames.push_back({FrameId(frame), GetPose(reader)});
  }
  if (!GetFindings(reader, findings.own)) return damaged;
  const uint64_t num_earlier = reader.GetVarint();
  for (uint64_t i = 0; i < num_earlier && !reader.failed(); ++i) {
    const SessionId session(reader.GetVarint());
    if (!GetFindings(reader, findings.earlier[session])) return damaged;
  }
  if (reader.failed() || reader.remaining() > 0) return damaged;
  return findings;
}

}  // namespace mapp
