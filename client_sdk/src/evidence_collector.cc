#include "evidence_collector.h"

#include "mapp/codec/evidence_codec.h"

#include <algorithm>
#include <span>
#include <utility>

namespace mapp {
namespace {

/// Of the way, by the frames' stamps.
constexpr int64_t kReportEveryNs = 60'000'000'000;
/// Waiting for a server that is away: half an hour's way, some KB.
constexpr size_t kMaxReports = 32;

SightedPoints ToSightedPoints(const Tile& tile) {
  std::vector<SightedPoint> points;
  points.reserve(tile.points.size());
  for (const TilePoint& shared : tile.points) {
    SightedPoint point;
    point.p_map = shared.p_map;
    point.reference_distance_m = shared.reference_distance_m;
    point.id = shared.id;
    for (const uint16_t observer : shared.observers) {
      if (point.num_directions == point.directions.size() || observer >= tile.frames.size()) break;
      const Eigen::Vector3f center_map = tile.frames[observer].T_map_camera.translation().cast<float>();
      point.directions[point.num_directions++] = (point.p_map - center_map).normalized();
    }
    points.push_back(point);
  }
  return std::make_shared<const SightedTile>(std::move(points));
}

}  // namespace

void EvidenceCollector::UseMap(uint32_t number, const std::vector<TileKey>& keys, const SharedTiles& tiles,
                               const Pose3& T_map_session) {
  map_number_ = number;
  T_map_session_ = T_map_session;
  std::map<TileKey, MapTile> in_use;
  for (const TileKey& key : keys) {
    const Tile* tile = tiles.Find(key);
    if (tile == nullptr) continue;
    const auto before = tiles_.find(key);
    if (before != tiles_.end() && before->second.revision == tile->revision) {
      in_use.insert(tiles_.extract(before));
    } else {
      in_use.emplace(key, MapTile{tile->revision, TileGrid{tile->edge_m}.BoxOf(key), ToSightedPoints(*tile)});
    }
  }
  tiles_ = std::move(in_use);
}

bool EvidenceCollector::Add(const Keyframe& view, uint32_t number) {
  if (number != map_number_) return false;
  const MeasuredView measured(view, T_map_session_ * view.T_frame_camera, camera_, range_m_, /*scale=*/1);
  std::vector<SightedPoints> in_view;
  for (const auto& [key, tile] : tiles_) {
    if (tile.box_map.intersects(measured.box_map)) in_view.push_back(tile.points);
  }
  const bool is_due = judge_ && view.stamp_ns - first_stamp_ns_ >= kReportEveryNs;
  if (is_due) Conclude();
  if (!judge_) {
    judge_.emplace(PointJudgeOptions{});
    first_stamp_ns_ = view.stamp_ns;
  }
  judge_->Add(measured, in_view);
  return is_due && has_reports();
}

void EvidenceCollector::Conclude() {
  if (!judge_) return;
  std::vector<PointFinding> findings = MergeFindings(judge_->Conclude());
  judge_.reset();
  std::erase_if(findings, [](const PointFinding& finding) { return !IsInEvidenceSample(finding.point); });
  for (std::span<const PointFinding> rest = findings; !rest.empty();) {
    const std::span<const PointFinding> part = rest.first(std::min(rest.size(), kMaxEvidencePoints));
    rest = rest.subspan(part.size());
    reports_.push_back({next_number_++, EncodeEvidence(part)});
    if (reports_.size() > kMaxReports) reports_.pop_front();
  }
}

}  // namespace mapp
